//! Who stands for whom.

use glam::{Vec2, Vec3};
use proptest::prelude::*;

use super::representatives::representatives;
use crate::mesh::SurfacePoint;
use crate::traces::{Observation, Trace};

fn trace(x: f32, frames: u32) -> Trace {
    let point = SurfacePoint {
        position: Vec3::new(x, 0.0, 0.0),
        normal: Vec3::Z,
        triangle: 0,
        barycentric: Vec2::ZERO,
        uv: None,
    };
    Trace {
        point,
        observations: (0..frames).map(Observation::face_on).collect(),
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
