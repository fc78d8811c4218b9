//! A quadtree over the probe: how much light comes from where, at every scale.
//!
//! Node of level 0 = one texel; a node of level k + 1 joins up to 2 × 2 nodes of level k. Each
//! keeps its flux `Φ = ∫ E dω`, its flux-weighted centroid and the radius that holds all of it,
//! so that `∫ f E dω ≈ f(centroid) Φ` with an error of second order in the radius.

use glam::{DVec3, Vec2, Vec3};

use super::Environment;
use crate::geometry::direction_from_latlong;

/// Light from a patch of the sphere.
#[derive(Clone, Copy, Debug)]
pub struct LightNode {
    /// Flux-weighted mean direction, unit, world frame.
    pub direction: Vec3,
    /// `∫ E dω` over the patch, linear RGB × steradian.
    pub flux: Vec3,
    /// Standard deviation of the patch's light about `direction`, radians.
    pub spread: f32,
    /// Children: index of the first and how many; none for a texel.
    pub first_child: u32,
    /// Number of children, stored together.
    pub children: u32,
}

/// The quadtree, its nodes in one list.
#[derive(Clone, Debug)]
pub struct LightPyramid {
    nodes: Vec<LightNode>,
    roots: std::ops::Range<usize>,
}

/// Moments of the light of a patch while the tree is built.
#[derive(Clone, Copy)]
struct Patch {
    flux: DVec3,
    /// `∫ E_sum ω dω`.
    first: DVec3,
    /// `∫ E_sum r² dω`, `r` the patch's own half diagonal: what the texels are wide themselves.
    own: f64,
    first_child: u32,
    children: u32,
}

impl LightPyramid {
    /// The finest level is at most this wide: a texel of 0.18° is far below any lobe that f32
    /// resolves, and the tree stays under 100 MB whatever the probe.
    const FINEST_WIDTH: usize = 2048;
    /// The finest level is at least this wide: texels wider than 1.4° are divided, since the light
    /// within them is bilinear and not a point.
    const COARSEST_WIDTH: usize = 256;

    /// Builds the tree; roots are the first level with at most 8 rows.
    pub fn new(environment: &Environment) -> Self {
        let image = environment.image();
        let reduce = image.width.div_ceil(Self::FINEST_WIDTH).max(1);
        // An even number, so that no part straddles a kink of the bilinear function.
        // A map a few texels wide but thousands high stays as it is.
        let divide = match Self::COARSEST_WIDTH.div_ceil(image.width) {
            1 => 1,
            _ if image.height > Self::COARSEST_WIDTH => 1,
            parts => parts.next_multiple_of(2),
        };
        let (width, height) = (
            (image.width * divide).div_ceil(reduce),
            (image.height * divide).div_ceil(reduce),
        );

        // Level 0: the flux of each block or part of texels, placed at its texels' centres.
        let mut level: Vec<Patch> = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let mut patch = Patch::EMPTY;
                if divide > 1 {
                    patch.add_part(environment, (column, row), divide);
                } else {
                    for y in row * reduce..((row + 1) * reduce).min(image.height) {
                        for x in column * reduce..((column + 1) * reduce).min(image.width) {
                            patch.add(
                                environment.cell_flux(x, y),
                                (x, y),
                                (image.width, image.height),
                            );
                        }
                    }
                }
                level.push(patch);
            }
        }

        // Upwards: join 2 × 2. Children of one node lie together because a level is emitted in
        // the order of its parents.
        let rotation = environment.world_from_probe();
        let mut nodes: Vec<LightNode> = Vec::new();
        let (mut width, mut height) = (width, height);
        while height > 8 {
            let (parents_wide, parents_high) = (width.div_ceil(2), height.div_ceil(2));
            let mut parents = Vec::with_capacity(parents_wide * parents_high);
            for row in 0..parents_high {
                for column in 0..parents_wide {
                    let first_child = nodes.len() as u32;
                    let mut parent = Patch {
                        first_child,
                        ..Patch::EMPTY
                    };
                    for y in 2 * row..(2 * row + 2).min(height) {
                        for x in 2 * column..(2 * column + 2).min(width) {
                            let child = level[y * width + x];
                            parent.flux += child.flux;
                            parent.first += child.first;
                            parent.own += child.own;
                            // Black patches need no node.
                            if child.flux != DVec3::ZERO {
                                nodes.push(child.node(rotation));
                                parent.children += 1;
                            }
                        }
                    }
                    parents.push(parent);
                }
            }
            (level, width, height) = (parents, parents_wide, parents_high);
        }
        let first_root = nodes.len();
        nodes.extend(
            level
                .iter()
                .filter(|p| p.flux != DVec3::ZERO)
                .map(|p| p.node(rotation)),
        );
        let roots = first_root..nodes.len();
        Self { nodes, roots }
    }

    /// All nodes.
    pub fn nodes(&self) -> &[LightNode] {
        &self.nodes
    }

    /// Indices of the coarsest nodes.
    pub fn roots(&self) -> std::ops::Range<usize> {
        self.roots.clone()
    }
}

impl Patch {
    const EMPTY: Self = Self {
        flux: DVec3::ZERO,
        first: DVec3::ZERO,
        own: 0.0,
        first_child: 0,
        children: 0,
    };

    /// Adds the flux of cell `(column, row)` of a lat-long grid of `size`.
    fn add(&mut self, flux: DVec3, (column, row): (usize, usize), size: (usize, usize)) {
        let uv = Vec2::new(
            (column as f32 + 0.5) / size.0 as f32,
            (row as f32 + 0.5) / size.1 as f32,
        );
        let weight = flux.element_sum();
        let sin = f64::from((std::f32::consts::PI * uv.y).sin());
        let (a, b) = (
            2.0 * std::f64::consts::PI / size.0 as f64 * sin,
            std::f64::consts::PI / size.1 as f64,
        );
        self.flux += flux;
        self.first += weight * direction_from_latlong(uv).as_dvec3();
        self.own += weight * (a * a + b * b) / 12.0;
    }

    /// Adds one of the `divide` × `divide` parts of a texel: its radiance in the middle times its
    /// solid angle.
    fn add_part(&mut self, environment: &Environment, place: (usize, usize), divide: usize) {
        let image = environment.image();
        let size = (image.width * divide, image.height * divide);
        let edge = |row: usize| (std::f64::consts::PI * row as f64 / size.1 as f64).cos();
        let solid_angle =
            2.0 * std::f64::consts::PI / size.0 as f64 * (edge(place.1) - edge(place.1 + 1));
        let middle = direction_from_latlong(Vec2::new(
            (place.0 as f32 + 0.5) / size.0 as f32,
            (place.1 as f32 + 0.5) / size.1 as f32,
        ));
        let flux = environment.lookup(middle).as_dvec3() * solid_angle;
        self.add(flux, place, size);
    }

    /// `E|ω − c|² = 1 − |E ω|²` about the mean, for unit vectors, plus the texels' own width.
    fn node(&self, world_from_probe: glam::Mat3) -> LightNode {
        let weight = self.flux.element_sum();
        let mean = self.first / weight;
        let length2 = mean.length_squared();
        let between = (1.0 - length2).max(0.0);
        LightNode {
            direction: (world_from_probe * mean.normalize_or(DVec3::Y).as_vec3()).normalize(),
            flux: self.flux.as_vec3(),
            spread: (between + self.own / weight).sqrt() as f32,
            first_child: self.first_child,
            children: self.children,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;

    fn gradient(width: usize, height: usize) -> Environment {
        let pixels = (0..width * height)
            .map(|i| {
                let bright = if i == width * height / 3 { 1e5 } else { 0.0 };
                [1.0 + (i % width) as f32 + bright, 0.5, (i / width) as f32]
            })
            .collect();
        Environment::new(
            RgbImage {
                width,
                height,
                pixels,
            },
            0.4,
        )
        .unwrap()
        .0
    }

    #[test]
    fn every_level_holds_the_whole_flux() {
        for (width, height) in [(64, 32), (37, 19), (8, 4), (1, 1)] {
            let environment = gradient(width, height);
            let pyramid = LightPyramid::new(&environment);
            let truth = environment.mean_radiance() * (4.0 * std::f32::consts::PI);
            let sum: Vec3 = pyramid.roots().map(|i| pyramid.nodes()[i].flux).sum();
            assert!(
                (sum - truth).length() < 1e-4 * truth.length(),
                "{sum} {truth}"
            );
            for node in pyramid.nodes() {
                let range = node.first_child as usize..(node.first_child + node.children) as usize;
                if !range.is_empty() {
                    let below: Vec3 = range.map(|i| pyramid.nodes()[i].flux).sum();
                    assert!((below - node.flux).length() <= 1e-4 * node.flux.length());
                }
            }
        }
    }

    #[test]
    fn centroids_carry_the_first_moment() {
        let environment = gradient(64, 32);
        let pyramid = LightPyramid::new(&environment);
        let moment = |nodes: &mut dyn Iterator<Item = LightNode>| -> Vec3 {
            nodes
                .map(|n| n.direction * n.flux.element_sum() * (1.0 - 0.5 * n.spread * n.spread))
                .sum()
        };
        let fine = moment(&mut pyramid.nodes().iter().copied().filter(|n| n.children == 0));
        let coarse = moment(&mut pyramid.roots().map(|i| pyramid.nodes()[i]));
        assert!((fine - coarse).length() < 0.02 * fine.length());
    }
}
