//! Which directions of the light deserve a node.
//!
//! A node of the light's quadtree stands for its patch with an error of second order in its
//! spread `r`: about `Φ r² |f''|`. The lobe at half-vector angle `δ` from the normal, whatever its
//! roughness, obeys `D ≲ 1/δ²`, hence `|f''| ≲ 1/δ⁴`. The node with the largest `Φ r²/(δ² + α²)²`
//! is split until the budget is spent: small bright lights and the neighbourhood of the mirror
//! direction are resolved, everything else is summed up. The nodes serve every roughness and both
//! NDFs, so the sums are smooth in alpha.

use glam::{Mat3, Vec3};

use crate::probe::LightPyramid;

/// Working memory of the refinement, kept between calls.
#[derive(Default)]
pub(super) struct LightCut {
    /// Nodes that wait to be split, by the binary exponent of their priority.
    buckets: Vec<Vec<u32>>,
    /// The cut: indices of nodes that stand for their patches.
    pub(super) chosen: Vec<u32>,
}

/// What a priority is made for.
pub(super) struct Lobe {
    /// To the camera, unit, world frame.
    pub(super) wo: Vec3,
    /// Normal, unit, world frame.
    pub(super) normal: Vec3,
    /// The narrowest roughness that the sums must resolve.
    pub(super) smallest_alpha: f32,
}

impl Lobe {
    /// Priority of a patch; `None` where it lies below the horizon.
    #[inline]
    fn priority(&self, direction: Vec3, flux: f32, spread: f32) -> Option<f32> {
        let cos_i = direction.dot(self.normal);
        if cos_i < -2.0 * spread {
            return None;
        }
        let half = direction + self.wo;
        let length2 = half.length_squared();
        let along = half.dot(self.normal);
        // sin² of the half vector's angle, and the patch's spread seen in half vectors: halved
        // face on, and more where the half vector turns faster than the light.
        let sin2 = (1.0 - along * along / length2).max(0.0);
        let half_spread2 = spread * spread / length2;
        let scale2 = sin2 + half_spread2 + self.smallest_alpha * self.smallest_alpha;
        Some(flux * half_spread2 / (scale2 * scale2))
    }
}

impl LightCut {
    /// A cut of about `budget` nodes: the patch of the highest priority, asked for by direction (world
    /// frame), flux and spread, is split first; one without a priority is dropped.
    fn refine(
        &mut self,
        pyramid: &LightPyramid,
        budget: usize,
        priority: impl Fn(Vec3, f32, f32) -> Option<f32>,
    ) {
        self.chosen.clear();
        self.buckets.resize_with(256, Vec::new);
        self.buckets.iter_mut().for_each(Vec::clear);
        let nodes = pyramid.nodes();
        let mut waiting = 0;
        let mut highest = 0;
        // A patch either waits to be split, or is a texel and stands as it is, or is dropped.
        let enter = |index: usize,
                     buckets: &mut Vec<Vec<u32>>,
                     chosen: &mut Vec<u32>,
                     highest: &mut usize|
         -> usize {
            let node = &nodes[index];
            match priority(node.direction, node.flux.element_sum(), node.spread) {
                None => 0,
                Some(_) if node.children == 0 => {
                    chosen.push(index as u32);
                    0
                }
                Some(p) => {
                    let bucket = (p.to_bits() >> 23) as usize & 0xff;
                    buckets[bucket].push(index as u32);
                    *highest = (*highest).max(bucket);
                    1
                }
            }
        };
        for root in pyramid.roots() {
            waiting += enter(root, &mut self.buckets, &mut self.chosen, &mut highest);
        }
        while waiting > 0 && self.chosen.len() + waiting < budget {
            while self.buckets[highest].is_empty() {
                highest -= 1;
            }
            let Some(index) = self.buckets[highest].pop() else {
                break;
            };
            waiting -= 1;
            let node = &nodes[index as usize];
            for child in node.first_child..node.first_child + node.children {
                waiting += enter(
                    child as usize,
                    &mut self.buckets,
                    &mut self.chosen,
                    &mut highest,
                );
            }
        }
        for bucket in &mut self.buckets {
            self.chosen.append(bucket);
        }
    }

    /// The cut for a specular lobe.
    pub(super) fn for_lobe(&mut self, pyramid: &LightPyramid, budget: usize, lobe: &Lobe) {
        self.refine(pyramid, budget, |direction, flux, spread| {
            lobe.priority(direction, flux, spread)
        });
    }

    /// The cut for diffuse reflection from any normal.
    pub(super) fn for_diffuse(&mut self, pyramid: &LightPyramid, budget: usize) {
        self.refine(pyramid, budget, |_, flux, spread| {
            Some(flux * spread * spread)
        });
    }
}

/// Directions of the world in the object frame.
#[inline]
pub(super) fn to_object(world_from_object: &Mat3, direction: Vec3) -> Vec3 {
    Vec3::new(
        world_from_object.x_axis.dot(direction),
        world_from_object.y_axis.dot(direction),
        world_from_object.z_axis.dot(direction),
    )
}
