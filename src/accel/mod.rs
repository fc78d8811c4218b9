//! Ray queries against a mesh: closest hit and occlusion.
//!
//! obvhs builds a binary tree; it is collapsed into an eight-wide one whose nodes and leaves are
//! tested eight lanes at a time, with AVX2 where the processor has it and in plain Rust otherwise,
//! bit for bit alike. Intersection is watertight: a ray aimed at an edge or a vertex of a closed
//! mesh never slips through (Woop, Benthin and Wald 2013). Both sides of a triangle are hit.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod build;
mod collapse;
#[cfg(feature = "embree")]
pub mod embree;
#[cfg(test)]
mod laws;
mod portable;
mod traverse;
mod wide_tree;
mod woop;

use glam::Vec3;

use crate::geometry::Ray;
use wide_tree::WideTree;
use woop::PreparedRay;

/// Where a ray meets the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, in units of its direction's length; > 0.
    pub t: f32,
    /// Index in the list of triangles given to [`Accel::build`].
    pub triangle: u32,
    /// Barycentric coordinate of the triangle's vertex 1, in [0, 1] but for rounding.
    pub u: f32,
    /// Barycentric coordinate of the triangle's vertex 2; vertex 0 has `1 − u − v`.
    pub v: f32,
}

/// A triangle mesh, arranged for ray queries. Rays are given in the frame of its positions.
#[derive(Clone, Debug)]
pub struct Accel {
    tree: WideTree,
    instructions: Instructions,
}

/// Which instantiation of the traversal runs; both return the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    Portable,
    /// Only ever constructed where the processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Instructions {
    fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Portable
    }
}

impl Accel {
    /// Arranges `triangles`, which index `positions`.
    ///
    /// Triangles that no ray can meet (a vertex that isn't finite or doesn't exist, or two equal
    /// vertices) are left out. The result depends on the mesh alone, not on the number of threads.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let soup = build::Soup {
            positions,
            triangles,
        };
        let tree = collapse::collapse(soup, &build::binary_tree(soup));
        Self {
            tree,
            instructions: Instructions::best(),
        }
    }

    /// The nearest hit at `0 < t <= t_max`. Of hits at the same `t`, to the bit, the triangle of
    /// lowest index. `None` for a ray with a component that isn't finite.
    #[inline]
    pub fn closest_hit(&self, ray: &Ray, t_max: f32) -> Option<Hit> {
        let ray = PreparedRay::new(ray)?;
        match self.instructions {
            Instructions::Portable => closest_portable(&self.tree, &ray, t_max),
            #[cfg(target_arch = "x86_64")]
            #[expect(
                unsafe_code,
                reason = "`Avx2` is only constructed where AVX2 was detected"
            )]
            // SAFETY: see the reason above.
            Instructions::Avx2 => unsafe { closest_avx2(&self.tree, &ray, t_max) },
        }
    }

    /// Whether anything is hit at `0 < t <= t_max`.
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        let Some(ray) = PreparedRay::new(ray) else {
            return false;
        };
        match self.instructions {
            Instructions::Portable => any_portable(&self.tree, &ray, t_max),
            #[cfg(target_arch = "x86_64")]
            #[expect(
                unsafe_code,
                reason = "`Avx2` is only constructed where AVX2 was detected"
            )]
            // SAFETY: see the reason above.
            Instructions::Avx2 => unsafe { any_avx2(&self.tree, &ray, t_max) },
        }
    }
}

#[inline(never)]
fn closest_portable(tree: &WideTree, ray: &PreparedRay, t_max: f32) -> Option<Hit> {
    traverse::closest(
        tree,
        ray,
        t_max,
        portable::enter_children,
        portable::hit_pack,
    )
}

#[inline(never)]
fn any_portable(tree: &WideTree, ray: &PreparedRay, t_max: f32) -> bool {
    traverse::any(
        tree,
        ray,
        t_max,
        portable::enter_children,
        portable::hit_pack,
    )
}

// Closures written inside a function with target features have them too.

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn closest_avx2(tree: &WideTree, ray: &PreparedRay, t_max: f32) -> Option<Hit> {
    traverse::closest(
        tree,
        ray,
        t_max,
        |node, ray, t_max| avx2::enter_children(node, ray, t_max),
        |pack, ray, t_max| avx2::hit_pack(pack, ray, t_max),
    )
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn any_avx2(tree: &WideTree, ray: &PreparedRay, t_max: f32) -> bool {
    traverse::any(
        tree,
        ray,
        t_max,
        |node, ray, t_max| avx2::enter_children(node, ray, t_max),
        |pack, ray, t_max| avx2::hit_pack(pack, ray, t_max),
    )
}
