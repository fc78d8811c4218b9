//! The walk through the wide tree, generic over the two inner tests.
//!
//! Both walks are `#[inline(always)]`, and the tests come in as closures, so that each
//! instantiation compiles with the instruction set of the function that calls it.

use super::Hit;
use super::wide_tree::{Child, Lanes, Node, Pack, WIDTH, WideTree};
use super::woop::{FAR_SLACK, PackHits, PreparedRay};

/// Nodes still to visit, the nearest on top: entry distance (as bits) above, child below, so that
/// comparing entries compares distances, which are never negative.
///
/// The array is cleared for every ray, so it is as short as ordinary trees allow; what does not fit
/// goes to the heap, so depth has no limit.
struct Pending {
    slots: [u64; Self::INLINE],
    filled: usize,
    spilled: Vec<u64>,
}

impl Pending {
    const INLINE: usize = 32;

    #[inline(always)]
    fn new() -> Self {
        Self {
            slots: [0; Self::INLINE],
            filled: 0,
            spilled: Vec::new(),
        }
    }

    #[inline(always)]
    fn entry(near: f32, child: Child) -> u64 {
        u64::from(near.to_bits()) << 32 | u64::from(child.0)
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        if let Some(slot) = self.slots.get_mut(self.filled) {
            *slot = entry;
            self.filled += 1;
        } else {
            self.spill(entry);
        }
    }

    #[cold]
    fn spill(&mut self, entry: u64) {
        self.spilled.push(entry);
    }

    /// The distance at which the ray enters the child on top, and the child.
    #[inline(always)]
    fn pop(&mut self) -> Option<(f32, Child)> {
        let entry = if self.filled == Self::INLINE && !self.spilled.is_empty() {
            self.spilled.pop()?
        } else {
            self.filled = self.filled.checked_sub(1)?;
            *self.slots.get(self.filled)?
        };
        Some((f32::from_bits((entry >> 32) as u32), Child(entry as u32)))
    }
}

/// The nearest hit at `0 < t <= t_max`; of several at the same `t` the lowest triangle index.
#[inline(always)]
pub(super) fn closest(
    tree: &WideTree,
    ray: &PreparedRay,
    t_max: f32,
    enter_children: impl Fn(&Node, &PreparedRay, f32) -> (u32, Lanes),
    hit_pack: impl Fn(&Pack, &PreparedRay, f32) -> Option<PackHits>,
) -> Option<Hit> {
    let mut best = Hit {
        t: t_max,
        triangle: u32::MAX,
        u: 0.0,
        v: 0.0,
    };
    let mut pending = Pending::new();
    let mut current = tree.root;
    if current == Child::NONE {
        return None;
    }
    loop {
        if let Some(index) = current.as_pack() {
            let pack = &tree.packs[index];
            if let Some(hits) = hit_pack(pack, ray, best.t) {
                best = nearest_of(pack, &hits, best);
            }
        } else {
            let node = &tree.nodes[current.0 as usize];
            let (mask, near) = enter_children(node, ray, best.t);
            if mask != 0 {
                current = nearest_first(tree, node, mask, &near, &mut pending);
                continue;
            }
        }
        current = loop {
            let Some((near, child)) = pending.pop() else {
                return (best.triangle != u32::MAX).then_some(best);
            };
            if near <= best.t * FAR_SLACK {
                break child;
            }
        };
    }
}

/// The nearer of `best` and the hits of a pack.
#[inline(always)]
fn nearest_of(pack: &Pack, hits: &PackHits, mut best: Hit) -> Hit {
    let mut mask = hits.mask;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        let (t, triangle) = (hits.t[lane], pack.triangles[lane]);
        if t < best.t || (t == best.t && triangle < best.triangle) {
            let determinant = hits.determinant[lane];
            best = Hit {
                t,
                triangle,
                u: hits.v[lane] / determinant,
                v: hits.w[lane] / determinant,
            };
        }
    }
    best
}

/// Returns the nearest of the children in `mask` and leaves the others pending, in order.
#[inline(always)]
fn nearest_first(
    tree: &WideTree,
    node: &Node,
    mut mask: u32,
    near: &Lanes,
    pending: &mut Pending,
) -> Child {
    let mut next = || {
        let slot = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        let child = node.children[slot];
        prefetch(tree, child);
        (Pending::entry(near[slot], child), mask == 0)
    };
    // One or two children: the common case.
    let (first, last) = next();
    if last {
        return Child(first as u32);
    }
    let (second, last) = next();
    let (mut nearest, farther) = (first.min(second), first.max(second));
    if last {
        pending.push(farther);
        return Child(nearest as u32);
    }
    // More: insertion sort, farthest first.
    let mut sorted = [0; WIDTH];
    sorted[0] = farther;
    let mut count = 1;
    loop {
        let (entry, last) = next();
        let (keep, mut insert) = (nearest.min(entry), nearest.max(entry));
        nearest = keep;
        for slot in &mut sorted[..count] {
            let (larger, smaller) = ((*slot).max(insert), (*slot).min(insert));
            *slot = larger;
            insert = smaller;
        }
        sorted[count % WIDTH] = insert;
        count += 1;
        if last {
            break;
        }
    }
    for &entry in &sorted[..count] {
        pending.push(entry);
    }
    Child(nearest as u32)
}

/// Whether anything is hit at `0 < t <= t_max`; stops at the first hit found.
#[inline(always)]
pub(super) fn any(
    tree: &WideTree,
    ray: &PreparedRay,
    t_max: f32,
    enter_children: impl Fn(&Node, &PreparedRay, f32) -> (u32, Lanes),
    hit_pack: impl Fn(&Pack, &PreparedRay, f32) -> Option<PackHits>,
) -> bool {
    let mut pending = Pending::new();
    let mut current = tree.root;
    if current == Child::NONE {
        return false;
    }
    'walk: loop {
        if let Some(index) = current.as_pack() {
            if hit_pack(&tree.packs[index], ray, t_max).is_some() {
                return true;
            }
        } else {
            let node = &tree.nodes[current.0 as usize];
            let (mut mask, _) = enter_children(node, ray, t_max);
            while mask != 0 {
                let slot = mask.trailing_zeros() as usize % WIDTH;
                mask &= mask - 1;
                let child = node.children[slot];
                if mask == 0 {
                    current = child;
                    continue 'walk;
                }
                prefetch(tree, child);
                pending.push(Pending::entry(0.0, child));
            }
        }
        let Some((_, child)) = pending.pop() else {
            return false;
        };
        current = child;
    }
}

/// Asks for the memory of `child` ahead of its visit.
///
/// Random rays, which find little in the cache, gain a tenth; the others neither gain nor lose
/// (`benches/rays.rs`, 82 000 triangles, medians of five runs).
#[inline(always)]
fn prefetch(tree: &WideTree, child: Child) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address: *const i8 = match child.as_pack() {
            Some(index) => tree.packs.as_ptr().wrapping_add(index).cast(),
            None => tree.nodes.as_ptr().wrapping_add(child.0 as usize).cast(),
        };
        for line in 0..size_of::<Pack>() / 64 {
            #[expect(unsafe_code, reason = "a prefetch reads nothing and never faults")]
            // SAFETY: see the reason above; SSE is part of x86-64.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (tree, child);
}
