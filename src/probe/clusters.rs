//! The light in a few hundred patches, each of which can be sampled.
//!
//! The map is cut into rectangles of texels; the rectangle with the largest flux × spread² is cut
//! next, through the middle of its light. Bright lamps get patches of their own and dim sky large
//! ones, so that a surface can weigh them one by one: by its normal, by its lobe, by what stands in
//! the way.

use std::f64::consts::PI;

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::Environment;
use crate::geometry::{direction_from_latlong, latlong_from_direction};

/// A rectangle of texels and the light in it.
#[derive(Clone, Debug)]
struct Cluster {
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    /// Sum over RGB of the flux.
    flux: f64,
    /// Flux-weighted mean direction, probe frame; not a unit vector.
    mean: DVec3,
    /// `∫ E ω dω` of each channel.
    moments: [DVec3; 3],
}

/// What a patch of light looks like from afar.
#[derive(Clone, Copy, Debug)]
pub struct LightPatch {
    /// Mean direction of the light, unit, probe frame.
    pub direction: Vec3,
    /// Flux summed over RGB.
    pub flux: f32,
    /// Squared spread of the light about the direction, radians².
    pub spread2: f32,
    /// How far from the direction any of its light may come, radians; a chord.
    pub radius: f32,
    /// `∫ E ω dω`, one column a channel, linear RGB × steradian: its product with a normal that
    /// sees the whole patch is the patch's irradiance there.
    pub moments: Mat3,
}

/// Patches of light, probe frame.
#[derive(Clone, Debug)]
pub struct LightClusters {
    width: usize,
    height: usize,
    clusters: Vec<Cluster>,
    /// `[height][width]` the cluster of each texel.
    of_texel: Vec<u16>,
    /// `[cluster]` where its rows start in `row_ends`.
    first_row: Vec<u32>,
    /// Per cluster and row of it: share of the cluster's flux in this row and those above.
    row_ends: Vec<f32>,
    /// `[height][width]` share, within its cluster's row, of the texel and those left of it.
    column_ends: Vec<f32>,
    /// `[height + 1]` cosine of the polar angle of the edges of rows.
    edge_cosines: Vec<f64>,
}

impl LightClusters {
    /// Cuts a light into at most `count` patches; black parts belong to patches that are never
    /// chosen.
    pub fn new(environment: &Environment, count: usize) -> Self {
        let image = environment.image();
        let (width, height) = (image.width, image.height);
        let count = count.clamp(1, usize::from(u16::MAX));
        let rgb: Vec<Vec3> = (0..height)
            .flat_map(|row| (0..width).map(move |column| (column, row)))
            .map(|(column, row)| environment.cell_flux(column, row).as_vec3())
            .collect();
        let flux: Vec<f32> = rgb.iter().map(|rgb| rgb.element_sum()).collect();
        // Sines and cosines of rows and columns, once: texels are measured some ten times.
        let sin_cos = |turn: f32, count: usize| -> Vec<(f32, f32)> {
            (0..count)
                .map(|k| (turn * ((k as f32 + 0.5) / count as f32)).sin_cos())
                .collect()
        };
        let of_columns = sin_cos(2.0 * std::f32::consts::PI, width);
        let of_rows = sin_cos(std::f32::consts::PI, height);
        let measure = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            let mut cluster = Cluster {
                columns: columns.clone(),
                rows: rows.clone(),
                flux: 0.0,
                mean: DVec3::ZERO,
                moments: [DVec3::ZERO; 3],
            };
            for row in rows {
                let (sin_theta, cos_theta) = of_rows[row];
                for column in columns.clone() {
                    let weight = f64::from(flux[row * width + column]);
                    let (sin_phi, cos_phi) = of_columns[column];
                    let direction =
                        Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi).as_dvec3();
                    cluster.flux += weight;
                    cluster.mean += weight * direction;
                    let rgb = rgb[row * width + column].as_dvec3();
                    for (moment, flux) in cluster.moments.iter_mut().zip(rgb.to_array()) {
                        *moment += flux * direction;
                    }
                }
            }
            if cluster.flux > 0.0 {
                cluster.mean /= cluster.flux;
            }
            cluster
        };

        let mut clusters = vec![measure(0..width, 0..height)];
        while clusters.len() < count {
            let priority = |c: &Cluster| c.flux * c.spread2();
            let texels = |c: &Cluster| c.columns.len() * c.rows.len();
            let Some(next) = (0..clusters.len())
                .filter(|&i| texels(&clusters[i]) > 1)
                .max_by(|&a, &b| priority(&clusters[a]).total_cmp(&priority(&clusters[b])))
            else {
                break;
            };
            if priority(&clusters[next]) <= 0.0 {
                break;
            }
            let (left, right) = clusters[next].halves(&flux, width, height);
            clusters[next] = measure(left.0, left.1);
            clusters.push(measure(right.0, right.1));
        }

        let mut of_texel = vec![0; width * height];
        let mut column_ends = vec![0.0; width * height];
        let (mut first_row, mut row_ends) = (Vec::new(), Vec::new());
        for (number, cluster) in clusters.iter().enumerate() {
            first_row.push(row_ends.len() as u32);
            let mut above = 0.0;
            for row in cluster.rows.clone() {
                let texels = row * width + cluster.columns.start..row * width + cluster.columns.end;
                of_texel[texels.clone()].fill(number as u16);
                let total: f64 = flux[texels.clone()].iter().map(|&f| f64::from(f)).sum();
                let mut left = 0.0;
                for texel in texels {
                    left += f64::from(flux[texel]);
                    column_ends[texel] = if total > 0.0 {
                        (left / total) as f32
                    } else {
                        0.0
                    };
                }
                above += total;
                row_ends.push(if cluster.flux > 0.0 {
                    (above / cluster.flux) as f32
                } else {
                    0.0
                });
            }
        }
        Self {
            width,
            height,
            clusters,
            of_texel,
            first_row,
            row_ends,
            column_ends,
            edge_cosines: (0..=height)
                .map(|row| (PI * row as f64 / height as f64).cos())
                .collect(),
        }
    }

    /// Whether texels are so small, 1.4°, that their light may be placed at their centres, as
    /// [`LightPatch::moments`] does.
    pub fn has_small_texels(&self) -> bool {
        self.width >= 256 && self.height >= 128
    }

    /// Number of patches, at least one.
    pub fn count(&self) -> usize {
        self.clusters.len()
    }

    /// Patch `k` from afar.
    pub fn patch(&self, k: usize) -> LightPatch {
        let cluster = &self.clusters[k];
        let direction = cluster.mean.normalize_or(DVec3::Y).as_vec3();
        // The farthest of a grid of points over the rectangle, its corners among them.
        let (columns, rows) = (&cluster.columns, &cluster.rows);
        let mut radius = 0.0f32;
        for i in 0..=8 {
            for j in 0..=8 {
                let along = |range: &std::ops::Range<usize>, step: usize| {
                    range.start as f32 + range.len() as f32 * step as f32 / 8.0
                };
                let uv = Vec2::new(
                    along(columns, i) / self.width as f32,
                    along(rows, j) / self.height as f32,
                );
                radius = radius.max((direction_from_latlong(uv) - direction).length());
            }
        }
        LightPatch {
            direction,
            flux: cluster.flux as f32,
            spread2: cluster.spread2() as f32,
            radius,
            moments: Mat3::from_cols(
                cluster.moments[0].as_vec3(),
                cluster.moments[1].as_vec3(),
                cluster.moments[2].as_vec3(),
            ),
        }
    }

    /// A direction (unit, probe frame) in patch `k`, drawn in proportion to the light there from
    /// `u` in [0, 1)², the place in its texel from `inside` in [0, 1).
    #[inline]
    pub fn sample(&self, k: usize, u: Vec2, inside: f32) -> Vec3 {
        let cluster = &self.clusters[k];
        let first = self.first_row[k] as usize;
        let (row, y) = invert(&self.row_ends[first..first + cluster.rows.len()], u.y);
        let row = cluster.rows.start + row;
        let start = row * self.width;
        let ends = &self.column_ends[start + cluster.columns.start..start + cluster.columns.end];
        let (column, _) = invert(ends, u.x);
        let column = cluster.columns.start + column;
        // Uniform in solid angle within the texel: uniform in φ and in cos θ.
        let (top, bottom) = (self.edge_cosines[row], self.edge_cosines[row + 1]);
        let cos = top + (bottom - top) * f64::from(y);
        let sin = (1.0 - cos * cos).max(0.0).sqrt() as f32;
        let phi = 2.0 * std::f32::consts::PI * (column as f32 + inside) / self.width as f32;
        let (sin_phi, cos_phi) = phi.sin_cos();
        Vec3::new(sin * sin_phi, cos as f32, -sin * cos_phi)
    }

    #[inline]
    fn texel(&self, direction: Vec3) -> (usize, usize) {
        let uv = latlong_from_direction(direction);
        let column = ((uv.x * self.width as f32) as usize).min(self.width - 1);
        let row = ((uv.y * self.height as f32) as usize).min(self.height - 1);
        (column, row)
    }

    /// The patch that a direction (unit, probe frame) lies in, and the density per steradian with
    /// which [`LightClusters::sample`] draws it from that patch.
    #[inline]
    pub fn density(&self, direction: Vec3) -> (usize, f32) {
        let (column, row) = self.texel(direction);
        let k = usize::from(self.of_texel[row * self.width + column]);
        let cluster = &self.clusters[k];
        let first = self.first_row[k] as usize;
        let rows = &self.row_ends[first..first + cluster.rows.len()];
        let start = row * self.width;
        let columns = &self.column_ends[start + cluster.columns.start..start + cluster.columns.end];
        let share = |ends: &[f32], i: usize| ends[i] - if i == 0 { 0.0 } else { ends[i - 1] };
        let probability =
            share(rows, row - cluster.rows.start) * share(columns, column - cluster.columns.start);
        let solid_angle =
            2.0 * PI / self.width as f64 * (self.edge_cosines[row] - self.edge_cosines[row + 1]);
        (k, probability / solid_angle as f32)
    }
}

impl Cluster {
    /// `E|ω − m|² = 1 − |m|²`.
    fn spread2(&self) -> f64 {
        (1.0 - self.mean.length_squared()).max(0.0)
    }

    /// The two parts on either side of the middle of its light, across its longer side.
    #[expect(clippy::type_complexity, reason = "two rectangles")]
    fn halves(
        &self,
        flux: &[f32],
        width: usize,
        height: usize,
    ) -> (
        (std::ops::Range<usize>, std::ops::Range<usize>),
        (std::ops::Range<usize>, std::ops::Range<usize>),
    ) {
        let (columns, rows) = (self.columns.clone(), self.rows.clone());
        let middle = PI * (rows.start + rows.end) as f64 / (2.0 * height as f64);
        let wide = columns.len() as f64 * 2.0 * PI / width as f64 * middle.sin();
        let high = rows.len() as f64 * PI / height as f64;
        let cut_columns = columns.len() > 1 && (wide >= high || rows.len() == 1);
        let lines = if cut_columns {
            columns.clone()
        } else {
            rows.clone()
        };
        let mut below = 0.0;
        let mut cut = lines.start + 1;
        for line in lines.clone() {
            below += if cut_columns {
                rows.clone()
                    .map(|row| f64::from(flux[row * width + line]))
                    .sum::<f64>()
            } else {
                columns
                    .clone()
                    .map(|column| f64::from(flux[line * width + column]))
                    .sum()
            };
            if 2.0 * below >= self.flux {
                // On the nearer side of the line that holds the middle.
                cut = line + usize::from(line + 1 - lines.start <= lines.end - line);
                break;
            }
        }
        let cut = cut.clamp(lines.start + 1, lines.end - 1);
        if cut_columns {
            ((columns.start..cut, rows.clone()), (cut..columns.end, rows))
        } else {
            ((columns.clone(), rows.start..cut), (columns, cut..rows.end))
        }
    }
}

/// The first interval that ends beyond `u`, and the place of `u` in it, in [0, 1). `ends`
/// rise to 1; empty intervals are never chosen.
#[inline]
fn invert(ends: &[f32], u: f32) -> (usize, f32) {
    let last = ends.len() - 1;
    let i = ends.partition_point(|&end| end <= u).min(last);
    let low = if i == 0 { 0.0 } else { ends[i - 1] };
    let width = ends[i] - low;
    let place = if width > 0.0 { (u - low) / width } else { 0.5 };
    (i, place.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;
    use crate::sampling::SobolPath;

    /// A dim sky with a lamp.
    fn lamp() -> Environment {
        let (width, height) = (64, 32);
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                if (40..43).contains(&x) && (8..10).contains(&y) {
                    [900.0, 700.0, 500.0]
                } else if y > 28 {
                    [0.0; 3]
                } else {
                    [0.5 + 0.4 * (x as f32 * 0.3).sin(), 0.5, 0.6]
                }
            })
            .collect();
        let image = RgbImage {
            width,
            height,
            pixels,
        };
        Environment::new(image, 0.0).unwrap().0
    }

    #[test]
    fn patches_hold_all_the_light() {
        let environment = lamp();
        for count in [1, 2, 17, 256, 10_000] {
            let clusters = LightClusters::new(&environment, count);
            assert!(clusters.count() <= count);
            let total: f32 = (0..clusters.count()).map(|k| clusters.patch(k).flux).sum();
            let expected = environment.mean_radiance().element_sum() * 4.0 * std::f32::consts::PI;
            assert!(
                (total / expected - 1.0).abs() < 1e-4,
                "{count}: {total} {expected}"
            );
        }
    }

    #[test]
    fn samples_estimate_the_flux_of_their_patch() {
        let environment = lamp();
        let clusters = LightClusters::new(&environment, 64);
        let light = environment.turned(glam::Mat3::IDENTITY);
        for k in 0..clusters.count() {
            let flux = clusters.patch(k).flux;
            if flux == 0.0 {
                continue;
            }
            let n = 1024;
            let mut mean = 0.0;
            for index in 0..n {
                let [a, b, c, _] = SobolPath::new(1, 0, k as u32, index).next_4d();
                let direction = clusters.sample(k, Vec2::new(a, b), c);
                let (found, density) = clusters.density(direction);
                // A sample on an edge may round into the next patch.
                if found == k && density > 0.0 {
                    mean +=
                        light.radiance(Vec3::ZERO, direction).element_sum() / density / n as f32;
                }
            }
            assert!((mean / flux - 1.0).abs() < 0.02, "patch {k}: {mean} {flux}");
        }
    }

    #[test]
    fn lamps_get_patches_of_their_own() {
        let clusters = LightClusters::new(&lamp(), 64);
        let bright = (0..clusters.count())
            .map(|k| clusters.patch(k))
            .max_by(|a, b| a.flux.total_cmp(&b.flux))
            .unwrap();
        assert!(bright.spread2 < 0.02, "{bright:?}");
    }
}
