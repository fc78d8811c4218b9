//! Light that falls on an unoccluded surface of any normal.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::LightPyramid;
use crate::geometry::{CubeGrid, CubePlace};

/// Samples of the map lie this far apart, radians. The cosine kernel is smooth but for the horizon: a
/// lamp there would be off by 1 % of its flux, which is why lamps are kept out of the map.
const SPACING: f32 = 0.05;
/// Largest spread of a light node, radians: its error is of second order, 1e-4 at 0.02.
const FINEST: f32 = 0.02;
/// Share of the whole flux from which on a node counts as a lamp.
const LAMP: f32 = 0.01;

/// Samples of the map that are made side by side.
const ABREAST: usize = 64;

/// `I(n) = ∫ E(ω) (n·ω)+ dω` of a distant light, world frame, linear RGB.
#[derive(Clone, Debug)]
pub struct Irradiance {
    grid: CubeGrid,
    samples: Vec<Vec3A>,
    lamps: Vec<Node>,
}

impl Irradiance {
    /// Tabulates a light.
    pub fn new(pyramid: &LightPyramid) -> Self {
        // The nodes that stand for the light: as coarse as the cosine allows.
        let mut nodes: Vec<Node> = Vec::new();
        let mut waiting: Vec<u32> = pyramid.roots().map(|root| root as u32).collect();
        while let Some(index) = waiting.pop() {
            let node = &pyramid.nodes()[index as usize];
            if node.children == 0 || node.spread <= FINEST {
                let spread2 = node.spread * node.spread;
                nodes.push(Node {
                    mean: (node.direction * (1.0 - spread2).max(0.0).sqrt()).into(),
                    flux: node.flux.into(),
                    half_width: (1.5 * spread2).sqrt().max(1e-6),
                });
            } else {
                waiting.extend(node.first_child..node.first_child + node.children);
            }
        }
        let all: f32 = nodes.iter().map(|node| node.flux.element_sum()).sum();
        let (lamps, nodes): (Vec<Node>, Vec<Node>) = nodes
            .into_iter()
            .partition(|node| node.flux.element_sum() > LAMP * all);
        let grid = CubeGrid::with_spacing(SPACING);
        let samples = (0..grid.samples().div_ceil(ABREAST))
            .into_par_iter()
            .flat_map_iter(|group| {
                let first = group * ABREAST;
                let count = ABREAST.min(grid.samples() - first);
                let mut normals = [[0.0; ABREAST]; 3];
                for (axis, normals) in normals.iter_mut().enumerate() {
                    for (k, coordinate) in normals[..count].iter_mut().enumerate() {
                        *coordinate = grid.direction(first + k)[axis];
                    }
                }
                let [r, g, b] = irradiances(&nodes, &normals);
                (0..count).map(move |k| Vec3A::new(r[k], g[k], b[k]))
            })
            .collect();
        Self {
            grid,
            samples,
            lamps,
        }
    }

    /// Irradiance of a surface facing `normal` (unit, world frame), linear RGB.
    #[inline]
    pub fn at(&self, normal: Vec3) -> Vec3 {
        let sky = self
            .grid
            .stencil(CubePlace::of(normal))
            .interpolate(&self.samples);
        let normal = Vec3A::from(normal);
        let lamps: Vec3A = self.lamps.iter().map(|lamp| lamp.irradiance(normal)).sum();
        (sky.max(Vec3A::ZERO) + lamps).into()
    }
}

/// Light from a small patch, spread evenly along any line through it.
#[derive(Clone, Debug)]
struct Node {
    /// Mean of the light's directions: shorter than one.
    mean: Vec3A,
    flux: Vec3A,
    /// Half the width of the strip of the same variance.
    half_width: f32,
}

impl Node {
    /// `Φ` times the mean of `(n·ω)+` over the patch: where the horizon cuts it, a part counts.
    #[inline]
    fn irradiance(&self, normal: Vec3A) -> Vec3A {
        let (cos, w) = (self.mean.dot(normal), self.half_width);
        let cut = (cos + w).clamp(0.0, 2.0 * w);
        self.flux * (cut * cut / (4.0 * w) + (cos - w).max(0.0))
    }
}

/// `[channel]` irradiance at `[axis]` normals, by the widest instructions that the machine has.
fn irradiances(nodes: &[Node], normals: &[[f32; ABREAST]; 3]) -> [[f32; ABREAST]; 3] {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(unsafe_code, reason = "the processor was just asked for AVX2")]
        // SAFETY: AVX2 is present.
        return unsafe { irradiances_avx2(nodes, normals) };
    }
    irradiances_any(nodes, normals)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn irradiances_avx2(nodes: &[Node], normals: &[[f32; ABREAST]; 3]) -> [[f32; ABREAST]; 3] {
    irradiances_any(nodes, normals)
}

/// [`Node::irradiance`] for normals side by side.
#[inline(always)]
fn irradiances_any(nodes: &[Node], normals: &[[f32; ABREAST]; 3]) -> [[f32; ABREAST]; 3] {
    let [x, y, z] = normals;
    let mut sums = [[0.0; ABREAST]; 3];
    for node in nodes {
        let ([a, b, c], w) = (node.mean.to_array(), node.half_width);
        let per_width = 0.25 / w;
        let mut lit = [0.0; ABREAST];
        for (k, lit) in lit.iter_mut().enumerate() {
            let cos = a * x[k] + b * y[k] + c * z[k];
            let cut = (cos + w).max(0.0).min(2.0 * w);
            *lit = cut * cut * per_width + (cos - w).max(0.0);
        }
        for (sums, flux) in sums.iter_mut().zip(node.flux.to_array()) {
            for (sum, lit) in sums.iter_mut().zip(&lit) {
                *sum += flux * lit;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::{DVec3, Mat3, Vec2};

    use super::*;
    use crate::geometry::direction_from_latlong;
    use crate::image::RgbImage;
    use crate::probe::Environment;
    use crate::sampling::{SobolPath, as_points};

    /// `∫ E (n·ω)+ dω` by two by two points a texel.
    fn integral(environment: &Environment, normal: Vec3) -> Vec3 {
        let light = environment.turned(Mat3::IDENTITY);
        let image = environment.image();
        let (width, height) = (2 * image.width, 2 * image.height);
        let mut sum = DVec3::ZERO;
        for row in 0..height {
            let solid_angle = environment.texel_solid_angle()[row / 2] / 4.0;
            for column in 0..width {
                let uv = Vec2::new(
                    (column as f32 + 0.5) / width as f32,
                    (row as f32 + 0.5) / height as f32,
                );
                let direction = environment.world_from_probe() * direction_from_latlong(uv);
                let cos = direction.dot(normal);
                if cos > 0.0 {
                    let arriving = light.radiance(Vec3::ZERO, direction) * cos;
                    sum += arriving.as_dvec3() * solid_angle;
                }
            }
        }
        sum.as_vec3()
    }

    #[test]
    fn table_is_the_integral_over_every_texel() {
        let probes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
        for name in ["interior.exr", "courtyard.exr", "city.exr", "studio.exr"] {
            let image = RgbImage::read(&probes.join(name)).unwrap();
            let (environment, _) = Environment::new(image, 0.3).unwrap();
            let table = Irradiance::new(&LightPyramid::new(&environment));
            let mut errors: Vec<f32> = (0..24)
                .map(|index| {
                    let (u, _) = as_points(SobolPath::new(3, 0, 0, index).next_4d());
                    let normal = direction_from_latlong(Vec2::new(
                        u.x,
                        (1.0 - 2.0 * u.y).acos() / std::f32::consts::PI,
                    ));
                    let exact = integral(&environment, normal);
                    (table.at(normal) - exact).length() / exact.length()
                })
                .collect();
            errors.sort_by(f32::total_cmp);
            assert!(errors[12] < 3e-4 && errors[23] < 5e-3, "{name}: {errors:?}");
        }
    }

    #[test]
    fn uniform_light_gives_pi() {
        let image = RgbImage::constant(64, 32, [1.0, 2.0, 0.5]);
        let (environment, _) = Environment::new(image, 0.0).unwrap();
        let table = Irradiance::new(&LightPyramid::new(&environment));
        for normal in [Vec3::Y, Vec3::new(0.6, -0.8, 0.0), Vec3::NEG_Z] {
            let expected = Vec3::new(1.0, 2.0, 0.5) * std::f32::consts::PI;
            assert!((table.at(normal) - expected).length() < 1e-3 * expected.length());
        }
    }
}
