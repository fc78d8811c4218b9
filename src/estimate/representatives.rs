//! Points that stand for those beside them, where an estimate of a few per cent will do.
//!
//! A maximal independent set of the points that are seen, the ones of most frames first: none is a
//! neighbour of another, and every other point that is seen has one of them beside it.

use crate::traces::Trace;

/// For each point the one that stands for it: itself, or a neighbour. `[points]`, `[points][neighbours]`.
pub(super) fn representatives(traces: &[Trace], neighbours: &[Vec<u32>]) -> Vec<u32> {
    let frames: Vec<u32> = traces.iter().map(Trace::frames).collect();
    let mut order: Vec<usize> = (0..traces.len()).filter(|&i| frames[i] > 0).collect();
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
            Some(other) => stands[index] = other,
            None => is_chosen[index] = true,
        }
    }
    stands
}
