//! The eight-wide tree: inner nodes and triangle packs as structures of arrays.
//!
//! One SIMD instruction handles one quantity of all eight children of a node, or of all eight
//! triangles of a leaf. Nodes and packs lie in depth-first order.

use glam::Vec3;

/// Children a node, and triangles a pack.
pub(super) const WIDTH: usize = 8;

/// One float for each child or triangle.
pub(super) type Lanes = [f32; WIDTH];

/// What a child reference points at: a node, a pack, or nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Child(pub(super) u32);

impl Child {
    const PACK: u32 = 1 << 31;

    /// No child; the box of such a slot is inverted, so that no ray enters it.
    pub(super) const NONE: Self = Self(u32::MAX);

    /// The inner node at `index`.
    pub(super) fn node(index: usize) -> Self {
        Self(index as u32)
    }

    /// The leaf whose triangles are the pack at `index`.
    pub(super) fn pack(index: usize) -> Self {
        Self(index as u32 | Self::PACK)
    }

    /// The pack's index, if this is a leaf.
    #[inline(always)]
    pub(super) fn as_pack(self) -> Option<usize> {
        (self.0 & Self::PACK != 0).then_some((self.0 & !Self::PACK) as usize)
    }
}

/// An inner node: the boxes of its children, side by side. Four cache lines.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// `[axis][0 lower, 1 upper][child]`
    pub(super) bounds: [[Lanes; 2]; 3],
    /// `[child]`, the unused ones at the end.
    pub(super) children: [Child; WIDTH],
}

impl Node {
    /// A node without children.
    pub(super) fn empty() -> Self {
        Self {
            bounds: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
            children: [Child::NONE; WIDTH],
        }
    }

    /// Fills slot `slot` with `child`, whose triangles lie in the box from `lower` to `upper`.
    pub(super) fn set(&mut self, slot: usize, child: Child, lower: Vec3, upper: Vec3) {
        for axis in 0..3 {
            self.bounds[axis][0][slot] = lower[axis];
            self.bounds[axis][1][slot] = upper[axis];
        }
        self.children[slot] = child;
    }
}

/// A leaf: up to eight triangles, side by side.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Pack {
    /// `[axis][vertex][triangle]`; unused lanes are NaN, which every comparison of the
    /// intersection rejects.
    pub(super) vertices: [[Lanes; 3]; 3],
    /// `[triangle]` index in the input list, ascending.
    pub(super) triangles: [u32; WIDTH],
}

impl Pack {
    /// The pack of `triangles`, indices in ascending order, at most eight.
    pub(super) fn of(triangles: &[u32], corners: impl Fn(u32) -> [Vec3; 3]) -> Self {
        let mut pack = Self {
            vertices: [[[f32::NAN; WIDTH]; 3]; 3],
            triangles: [u32::MAX; WIDTH],
        };
        for (lane, &triangle) in triangles.iter().enumerate() {
            pack.triangles[lane] = triangle;
            for (vertex, corner) in corners(triangle).into_iter().enumerate() {
                for axis in 0..3 {
                    pack.vertices[axis][vertex][lane] = corner[axis];
                }
            }
        }
        pack
    }
}

/// The tree that the queries walk.
#[derive(Clone, Debug)]
pub(super) struct WideTree {
    /// [`Child::NONE`] if there is no triangle to hit.
    pub(super) root: Child,
    pub(super) nodes: Vec<Node>,
    pub(super) packs: Vec<Pack>,
}
