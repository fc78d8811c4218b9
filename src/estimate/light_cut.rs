//! Which directions of the light deserve a node.
//!
//! A node of the light's quadtree stands for its patch with an error of second order in its
//! spread `r`: about `Φ r² |f''|`. The lobe at half-vector angle `δ` from the normal, whatever its
//! roughness, obeys `D ≲ 1/δ²`, hence `|f''| ≲ 1/δ⁴`. Nodes whose `Φ r²/(δ² + α²)²` is above a threshold
//! are split: small bright lights and the neighbourhood of the mirror direction are resolved, everything
//! else is summed up. The nodes serve every roughness and both NDFs, so the sums are smooth in alpha.

use glam::{Mat3, Vec2, Vec3};

use crate::geometry::direction_from_octahedral;
use crate::probe::{LightNode, LightPyramid};

/// What a cut is made for.
#[derive(Clone, Copy)]
pub(super) struct Lobe {
    /// To the camera, unit, world frame.
    pub(super) wo: Vec3,
    /// Normal, unit, world frame.
    pub(super) normal: Vec3,
    /// The narrowest roughness that the sums must resolve.
    pub(super) smallest_alpha: f32,
}

/// A light node as a lobe sees it.
pub(super) struct Seen<'n> {
    pub(super) node: &'n LightNode,
    /// Cosine of its angle to the normal.
    pub(super) cos_i: f32,
    /// Squared sine of the half vector's angle to the normal.
    pub(super) sin2_h: f32,
    /// Cosine between half vector and light.
    pub(super) cos_d: f32,
    /// Variance of the half vectors of the node's light, radian² per axis.
    pub(super) variance_h: f32,
}

/// A cut through the light's quadtree for one lobe after the other.
#[derive(Default)]
pub(super) struct LobeCut {
    /// Error above which a node is split; zero where nothing is known of it.
    threshold: f32,
    /// Rounds in which it is found for the next lobe.
    rounds: usize,
    waiting: Vec<u32>,
}

/// Rounds in which a threshold is found from nothing.
const FIRST_ROUNDS: usize = 6;
/// Lobes along a side of the octahedral grid of which a light's usual threshold is the mean.
const USUAL_LOBES: usize = 6;

/// The threshold, in the geometric mean over lobes seen face on, of cuts of about `budget` nodes.
pub(super) fn usual_threshold(pyramid: &LightPyramid, budget: usize, smallest_alpha: f32) -> f32 {
    let mut cut = LobeCut::default();
    let ln_threshold = |index: usize| {
        let place = Vec2::new(
            (index % USUAL_LOBES) as f32 + 0.5,
            (index / USUAL_LOBES) as f32 + 0.5,
        );
        let normal = direction_from_octahedral(place / USUAL_LOBES as f32);
        let lobe = Lobe {
            wo: normal,
            normal,
            smallest_alpha,
        };
        cut.restart(0.0);
        cut.visit(pyramid, budget, &lobe, |_| ());
        cut.threshold.ln()
    };
    let count = USUAL_LOBES * USUAL_LOBES;
    let sum: f32 = (0..count).map(ln_threshold).sum();
    (sum / count as f32).exp()
}

impl LobeCut {
    /// The next cut begins at a threshold that is about right, or at zero, from nothing.
    pub(super) fn restart(&mut self, threshold: f32) {
        self.threshold = threshold;
        self.rounds = 1;
    }

    /// Visits the nodes above the horizon of a cut of about `budget` nodes.
    ///
    /// The threshold follows the counts: nodes go with its inverse square root, and the next lobe of a
    /// point is much like the last.
    pub(super) fn visit<'n>(
        &mut self,
        pyramid: &'n LightPyramid,
        budget: usize,
        lobe: &Lobe,
        mut each: impl FnMut(Seen<'n>),
    ) {
        if self.threshold == 0.0 {
            let flux = pyramid
                .roots()
                .map(|i| pyramid.nodes()[i].flux.element_sum());
            self.threshold = flux.sum::<f32>() / (budget * budget) as f32;
            self.rounds = FIRST_ROUNDS;
        }
        for _ in 0..std::mem::take(&mut self.rounds) {
            let mut count = 0;
            self.walk(pyramid, lobe, |_| count += 1);
            self.follow(count, budget);
        }
        let mut count = 0;
        self.walk(pyramid, lobe, |seen| {
            count += 1;
            each(seen);
        });
        self.follow(count, budget);
    }

    fn follow(&mut self, count: usize, budget: usize) {
        let ratio = count as f32 / budget as f32;
        self.threshold *= (ratio * ratio).clamp(0.05, 20.0);
    }

    #[inline]
    fn walk<'n>(&mut self, pyramid: &'n LightPyramid, lobe: &Lobe, mut each: impl FnMut(Seen<'n>)) {
        let nodes = pyramid.nodes();
        self.waiting.clear();
        self.waiting.extend(pyramid.roots().map(|root| root as u32));
        while let Some(index) = self.waiting.pop() {
            let node = &nodes[index as usize];
            let cos_i = node.direction.dot(lobe.normal);
            if cos_i < -2.0 * node.spread {
                continue;
            }
            let half = node.direction + lobe.wo;
            let length2 = half.length_squared().max(1e-12);
            // The cross product: 1 − cos² cancels in narrow lobes.
            let sin2_h = half.cross(lobe.normal).length_squared() / length2;
            // The patch's spread seen in half vectors: halved face on, and more where the half vector
            // turns faster than the light.
            let half_spread2 = node.spread * node.spread / length2;
            let scale2 = sin2_h + half_spread2 + lobe.smallest_alpha * lobe.smallest_alpha;
            let error = node.flux.element_sum() * half_spread2 / (scale2 * scale2);
            if node.children > 0 && error > self.threshold {
                self.waiting
                    .extend(node.first_child..node.first_child + node.children);
            } else if cos_i > 0.0 {
                each(Seen {
                    node,
                    cos_i,
                    sin2_h,
                    cos_d: (0.5 * length2.sqrt()).min(1.0),
                    // Half of the light's in the plane of incidence, 1/(2 cos) of it across: the mean.
                    variance_h: node.spread * node.spread * (0.0625 + 0.25 / length2),
                });
            }
        }
    }
}

/// About `budget` nodes that serve diffuse reflection from any normal, by index: those with the largest
/// `Φ r²` are split.
pub(super) fn diffuse_cut(pyramid: &LightPyramid, budget: usize) -> Vec<u32> {
    let nodes = pyramid.nodes();
    let error = |index: u32| {
        let node = &nodes[index as usize];
        node.flux.element_sum() * node.spread * node.spread
    };
    let mut cut: Vec<u32> = pyramid.roots().map(|root| root as u32).collect();
    while cut.len() < budget {
        let splittable = (0..cut.len()).filter(|&i| nodes[cut[i] as usize].children > 0);
        let Some(worst) = splittable.max_by(|&a, &b| error(cut[a]).total_cmp(&error(cut[b])))
        else {
            break;
        };
        let node = &nodes[cut.swap_remove(worst) as usize];
        cut.extend(node.first_child..node.first_child + node.children);
    }
    cut
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
