//! Points that stand for those beside them, where an estimate of a few per cent will do.
//!
//! A maximal independent set of the points that are seen, the ones of most frames first: none is a
//! neighbour of another, and every other point that is seen has one of them beside it.

use crate::traces::Trace;

/// For each point the one that stands for it: itself, or a neighbour. `[points]`, `[points][neighbours]`.
pub(super) fn representatives(traces: &[Trace], neighbours: &[Vec<u32>]) -> Vec<u32> {
    let frames: Vec<u32> = traces.iter().map(Trace::frames).collect();
    let mut order: Vec<usize> = (0..traces.len()).collect();
    order.sort_by_key(|&index| std::cmp::Reverse(frames[index]));
    let mut stands: Vec<u32> = (0..traces.len() as u32).collect();
    let mut is_chosen = vec![false; traces.len()];
    for index in order {
        let position = traces[index].point.position;
        let distance = |other: u32| {
            let other = &traces[other as usize].point;
            other.position.distance_squared(position)
        };
        let chosen = neighbours[index].iter().copied();
        let chosen = chosen.filter(|&other| is_chosen[other as usize]);
        let nearest = chosen.min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        match nearest {
            Some(other) if frames[index] > 0 => stands[index] = other,
            _ => is_chosen[index] = frames[index] > 0,
        }
    }
    stands
}

#[cfg(test)]
mod tests {
    use glam::{BVec3, Vec2, Vec3};
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::SurfacePoint;
    use crate::traces::Observation;

    fn trace(x: f32, frames: u32) -> Trace {
        let observation = |frame| Observation {
            frame,
            radiance: Vec3::ONE,
            variance: Vec3::ONE,
            saturated: BVec3::FALSE,
            position: Vec3::ZERO,
            wo: Vec3::Z,
            normal: Vec3::Z,
            geometric_normal: Vec3::Z,
            normal_variance: 0.0,
        };
        let point = SurfacePoint {
            position: Vec3::new(x, 0.0, 0.0),
            normal: Vec3::Z,
            triangle: 0,
            barycentric: Vec2::ZERO,
            uv: None,
        };
        Trace {
            point,
            observations: (0..frames).map(observation).collect(),
        }
    }

    proptest! {
        /// On a line of points.
        #[test]
        fn every_seen_point_is_stood_for_by_itself_or_a_neighbour(
            frames in prop::collection::vec(0u32..4, 1..40),
        ) {
            let count = frames.len() as u32;
            let traces: Vec<Trace> = (0u8..).zip(&frames).map(|(x, f)| trace(f32::from(x), *f)).collect();
            let neighbours: Vec<Vec<u32>> = (0..count)
                .map(|i| [i.wrapping_sub(1), i + 1].into_iter().filter(|j| *j < count).collect())
                .collect();
            let stands = representatives(&traces, &neighbours);
            for index in 0..frames.len() {
                let other = stands[index] as usize;
                prop_assert_eq!(stands[other] as usize, other);
                let near = neighbours[index].contains(&stands[index]);
                prop_assert!(other == index || near);
                // No two of them side by side, and none that is seen less than whom it stands for.
                if frames[index] > 0 {
                    prop_assert!(frames[other] >= frames[index]);
                    let is_chosen = |i: u32| stands[i as usize] == i && frames[i as usize] > 0;
                    let beside = neighbours[index].iter().any(|&i| is_chosen(i));
                    prop_assert_eq!(other == index, !beside);
                }
            }
        }
    }
}
