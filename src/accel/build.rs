//! From triangles to a binary tree: which triangles count, their boxes, and obvhs's builder.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use rayon::prelude::*;

/// A mesh, which need be neither finite nor sensible.
#[derive(Clone, Copy)]
pub(super) struct Soup<'a> {
    pub(super) positions: &'a [Vec3],
    pub(super) triangles: &'a [[u32; 3]],
}

impl Soup<'_> {
    /// The corners of `triangle`, if a ray could ever meet it: the vertices exist, are finite, and
    /// differ.
    ///
    /// Triangles without area but with three different vertices stay: they may close a seam.
    fn usable(&self, triangle: &[u32; 3]) -> Option<[Vec3; 3]> {
        let corner = |i: usize| self.positions.get(triangle[i] as usize).copied();
        let [a, b, c] = [corner(0)?, corner(1)?, corner(2)?];
        let finite = a.is_finite() && b.is_finite() && c.is_finite();
        (finite && a != b && b != c && c != a).then_some([a, b, c])
    }

    /// The corners of a triangle that [`Soup::usable`] has passed.
    pub(super) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}

/// Triangles that no tree can tell apart well, because their boxes have the same centre.
#[derive(Clone, Copy)]
pub(super) struct Group {
    /// First of the group in [`BinaryTree::members`].
    pub(super) first: u32,
    pub(super) count: u32,
}

/// obvhs's tree over groups of triangles.
pub(super) struct BinaryTree {
    /// One group a leaf; boxes are multiplied by `scale`.
    pub(super) tree: Bvh2,
    /// A power of two that brings the largest coordinate near one, so that no area overflows.
    pub(super) scale: f32,
    pub(super) groups: Vec<Group>,
    /// Triangle indices, grouped, ascending within a group.
    pub(super) members: Vec<u32>,
}

/// Builds the binary tree over the usable triangles; the same for any number of threads, since
/// obvhs runs serially without its feature `parallel`.
pub(super) fn binary_tree(soup: Soup) -> BinaryTree {
    // 1. One sort key a usable triangle: the centre of its box, then its index.
    let mut keys: Vec<u128> = (soup.triangles.par_iter().enumerate())
        .filter_map(|(index, triangle)| Some(centre_key(soup.usable(triangle)?, index as u32)))
        .collect();
    keys.par_sort_unstable();
    let members: Vec<u32> = keys.iter().map(|&key| key as u32).collect();

    // 2. Group equal centres. The builder pairs neighbours of least common area, and where all
    //    areas are equal it takes quadratic time: minutes for 100 000 copies of one triangle.
    let mut groups: Vec<Group> = Vec::with_capacity(keys.len());
    for (index, key) in keys.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if keys[group.first as usize] >> 32 == key >> 32 => group.count += 1,
            _ => groups.push(Group {
                first: index as u32,
                count: 1,
            }),
        }
    }

    // 3. Boxes.
    let boxes: Vec<(Vec3, Vec3)> = (groups.par_iter())
        .map(|group| {
            let range = group.first as usize..(group.first + group.count) as usize;
            enclose(
                members[range]
                    .iter()
                    .map(|&triangle| padded_box(soup.corners(triangle))),
            )
        })
        .collect();
    let (lower, upper) = enclose(boxes.iter().copied());
    let largest = lower.abs().max(upper.abs()).max_element();
    let scale = if boxes.is_empty() {
        1.0
    } else {
        (-largest.log2().floor()).clamp(-126.0, 126.0).exp2()
    };
    let boxes: Vec<Aabb> = (boxes.iter())
        .map(|&(lower, upper)| Aabb::new(Vec3A::from(lower * scale), Vec3A::from(upper * scale)))
        .collect();

    let settings = BvhBuildParams {
        max_prims_per_leaf: 1,
        ..BvhBuildParams::medium_build()
    };
    let tree = build_bvh2(&boxes, settings, &mut Duration::default());
    BinaryTree {
        tree,
        scale,
        groups,
        members,
    }
}

/// Sorts by twice the centre of the box, then by index.
fn centre_key([a, b, c]: [Vec3; 3], index: u32) -> u128 {
    let twice_centre = a.min(b).min(c) + a.max(b).max(c);
    // + 0.0 makes −0 and 0 the same.
    let [x, y, z] = (twice_centre + 0.0)
        .to_array()
        .map(|v| u128::from(v.to_bits()));
    x << 96 | y << 64 | z << 32 | u128::from(index)
}

/// The box of a triangle, padded for the rounding of the intersection.
///
/// Rounding moves a vertex by up to three units in 2⁻²⁴ of its distance from the ray's origin. The
/// part that grows with the distance to the hit is allowed for by [`super::woop::FAR_SLACK`]; the
/// rest is bounded by the triangle's own extent, and goes into the box.
fn padded_box([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3) {
    const PAD: f32 = 4.0 / (1 << 24) as f32;
    let (lower, upper) = (a.min(b).min(c), a.max(b).max(c));
    let pad = Vec3::splat(PAD * (upper - lower).max_element());
    let outwards = |v: Vec3, step: fn(f32) -> f32| Vec3::from_array(v.to_array().map(step));
    (
        outwards(lower - pad, f32::next_down),
        outwards(upper + pad, f32::next_up),
    )
}

/// The box of all `boxes`.
pub(super) fn enclose(boxes: impl Iterator<Item = (Vec3, Vec3)>) -> (Vec3, Vec3) {
    boxes.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |all, one| {
        (all.0.min(one.0), all.1.max(one.1))
    })
}

/// The box of some triangles of a group.
pub(super) fn box_of(soup: Soup, members: &[u32]) -> (Vec3, Vec3) {
    enclose(
        members
            .iter()
            .map(|&triangle| padded_box(soup.corners(triangle))),
    )
}
