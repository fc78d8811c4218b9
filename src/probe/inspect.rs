//! What is in a light, and what is wrong with it.
//!
//! A source is a patch of texels, connected over edges and corners, each brighter than 4 times the mean radiance of
//! the sphere: a lamp, a window, the sun; an overcast sky has none.

use glam::{DVec3, Vec2, Vec3};
use serde::Serialize;

use super::Environment;
use crate::geometry::direction_from_latlong;
use crate::image::luminance;

/// Times the mean radiance.
const BRIGHT: f64 = 4.0;
/// Sources that are told.
const MOST_SOURCES: usize = 12;
/// Texels within this of a source's maximum lie on its plateau: wider than half-float steps.
const PLATEAU: f64 = 0.998;
/// A plateau of so many texels, and of this share of its source, was probably cut off.
const PLATEAU_TEXELS: usize = 4;
const PLATEAU_SHARE: f64 = 0.05;
/// A source's core is brighter than this share of its peak; its own glare may count as source.
const CORE: f64 = 0.01;
/// A halo this bright beside the source's peak is reported. Lenses scatter 1e-4 to 1e-3 a few degrees away; what is
/// brighter are other windows.
const HALO: std::ops::Range<f64> = 1e-4..0.02;

/// A bright patch.
#[derive(Clone, Debug, Serialize)]
pub struct Source {
    /// Mean direction of its light, unit, world frame.
    pub direction: [f32; 3],
    /// Steradian.
    pub solid_angle: f64,
    /// Half-angle of a disc of that solid angle, degrees.
    pub radius_deg: f64,
    /// Highest luminance.
    pub peak: f64,
    /// Share of the flux of the whole light.
    pub flux_share: f64,
    /// Texels.
    pub texels: usize,
    /// Texels of the channel with the widest plateau that lie on it, where it looks cut off.
    pub plateau_texels: Option<usize>,
    /// Half-angle of a disc as large as what is brighter than a hundredth of its peak, degrees.
    pub core_radius_deg: f64,
    /// Luminance 1° to 3° beyond twice that radius that surroundings do not explain, over the peak, if suspicious.
    pub halo: Option<f64>,
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Luminance of the brightest texel.
    pub peak: f64,
    /// Mean luminance over the sphere.
    pub mean: f64,
    /// Luminance that a hundredth of the sphere falls below.
    pub dark: f64,
    /// Texels without light.
    pub black_texels: usize,
    /// Brightest sources, by flux.
    pub sources: Vec<Source>,
    /// Sources in all.
    pub source_count: usize,
}

impl Inspection {
    /// Peak over dark; infinite where a hundredth of the sphere is black.
    pub fn range(&self) -> f64 {
        self.peak / self.dark
    }

    /// Looks a light over.
    pub fn of(environment: &Environment) -> Self {
        let image = environment.image();
        let (width, height) = (image.width, image.height);
        let solid = environment.texel_solid_angle();
        let grey: Vec<f64> = (image.pixels.iter())
            .map(|p| luminance(p.map(f64::from)))
            .collect();
        let mut flux = 0.0;
        let mut by_level: Vec<(f64, f64)> = Vec::with_capacity(grey.len());
        for (i, &l) in grey.iter().enumerate() {
            flux += l * solid[i / width];
            by_level.push((l, solid[i / width]));
        }
        let mean = flux / (4.0 * std::f64::consts::PI);
        by_level.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = 0.0;
        let dark = by_level.iter().find(|(_, s)| {
            below += s;
            below >= 0.04 * std::f64::consts::PI
        });

        let mut sources: Vec<Source> = patches(&grey, width, height, BRIGHT * mean)
            .iter()
            .map(|texels| source(environment, &grey, texels, flux))
            .collect();
        sources.sort_by(|a, b| b.flux_share.total_cmp(&a.flux_share));
        let source_count = sources.len();
        sources.truncate(MOST_SOURCES);
        for source in &mut sources {
            source.halo = halo(environment, &grey, source);
        }
        Self {
            width,
            height,
            peak: by_level.last().map_or(0.0, |l| l.0),
            mean,
            dark: dark.map_or(0.0, |l| l.0),
            black_texels: grey.iter().filter(|l| **l <= 0.0).count(),
            sources,
            source_count,
        }
    }
}

/// Connected texels brighter than `threshold`, in the order of their first texel; periodic in longitude.
fn patches(grey: &[f64], width: usize, height: usize, threshold: f64) -> Vec<Vec<usize>> {
    let mut seen: Vec<bool> = grey.iter().map(|&l| l <= threshold).collect();
    let mut patches = Vec::new();
    for start in 0..grey.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while next < patch.len() {
            let (x, y) = (patch[next] % width, patch[next] / width);
            next += 1;
            for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for column in [x + width - 1, x, x + 1] {
                    let i = row * width + column % width;
                    if !seen[i] {
                        seen[i] = true;
                        patch.push(i);
                    }
                }
            }
        }
        patches.push(patch);
    }
    patches
}

/// World direction of a texel's centre.
fn direction(environment: &Environment, texel: usize) -> Vec3 {
    let (width, height) = (environment.image().width, environment.image().height);
    let uv = Vec2::new(
        ((texel % width) as f32 + 0.5) / width as f32,
        ((texel / width) as f32 + 0.5) / height as f32,
    );
    environment.world_from_probe() * direction_from_latlong(uv)
}

fn source(environment: &Environment, grey: &[f64], texels: &[usize], whole: f64) -> Source {
    let image = environment.image();
    let solid = environment.texel_solid_angle();
    let (mut solid_angle, mut flux, mut first, mut peak) = (0.0, 0.0, DVec3::ZERO, 0.0f64);
    for &i in texels {
        let s = solid[i / image.width];
        solid_angle += s;
        flux += grey[i] * s;
        first += grey[i] * s * direction(environment, i).as_dvec3();
        peak = peak.max(grey[i]);
    }
    // The channel that is cut off over most texels.
    let plateau = (0..3)
        .map(|c| {
            let values = || texels.iter().map(|&i| f64::from(image.pixels[i][c]));
            let top = values().fold(0.0, f64::max);
            values().filter(|&v| v >= PLATEAU * top).count()
        })
        .max()
        .unwrap_or(0);
    let cut = plateau >= PLATEAU_TEXELS && plateau as f64 >= PLATEAU_SHARE * texels.len() as f64;
    let towards = first.normalize_or(DVec3::Y).as_vec3();
    let bright = texels.iter().filter(|&&i| grey[i] > CORE * peak);
    let core: f64 = bright.map(|&i| solid[i / image.width]).sum();
    Source {
        direction: towards.to_array(),
        solid_angle,
        radius_deg: disc(solid_angle),
        core_radius_deg: disc(core),
        peak,
        flux_share: flux / whole,
        texels: texels.len(),
        plateau_texels: cut.then_some(plateau),
        halo: None,
    }
}

/// Half-angle of a disc of a solid angle, degrees.
fn disc(solid_angle: f64) -> f64 {
    let cos = 1.0 - solid_angle / (2.0 * std::f64::consts::PI);
    cos.clamp(-1.0, 1.0).acos().to_degrees()
}

/// What surrounds a source evenly on all sides, and fades: glare. A window's frame or a lit wall stands on one side.
fn halo(environment: &Environment, grey: &[f64], source: &Source) -> Option<f64> {
    const SECTORS: usize = 8;
    if source.core_radius_deg > 15.0 {
        return None;
    }
    let centre = Vec3::from(source.direction);
    let frame = crate::geometry::Frame::about(centre);
    // Twice the disc's radius clears most shapes.
    let edge = 2.0 * source.core_radius_deg;
    let mut near: Vec<Vec<f64>> = vec![Vec::new(); SECTORS];
    let mut far = Vec::new();
    for (i, &l) in grey.iter().enumerate() {
        let towards = direction(environment, i);
        let angle = f64::from(towards.dot(centre).clamp(-1.0, 1.0).acos().to_degrees()) - edge;
        if (1.0..3.0).contains(&angle) {
            let local = frame.to_local(towards).0;
            let turn = local.y.atan2(local.x) / std::f32::consts::TAU + 0.5;
            near[((turn * SECTORS as f32) as usize).min(SECTORS - 1)].push(l);
        } else if (8.0..14.0).contains(&angle) {
            far.push(l);
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let mut sectors: Vec<f64> = near.iter_mut().filter_map(median).collect();
    if sectors.len() < SECTORS {
        return None;
    }
    sectors.sort_unstable_by(f64::total_cmp);
    let (least, around) = (sectors[1], median(&mut far)?);
    let halo = (least - around) / source.peak;
    (HALO.contains(&halo) && least > 2.0 * around).then_some(halo)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;

    /// A lamp of Gaussian profile at texel (x0, 64), cut off at `white`, and what it scatters.
    fn lamp(x0: f32, white: f32, glare: f32) -> Inspection {
        let image = RgbImage::from_fn(512, 256, |x, y| {
            let dx = (x as f32 - x0 + 256.0).rem_euclid(512.0) - 256.0;
            let dy = y as f32 - 100.0;
            let r2 = dx * dx + dy * dy;
            let l = 1.0 + 1e4 * (-r2 / 8.0).exp() + glare * 1e4 / (1.0 + r2 / 20.0);
            [l.min(white); 3]
        });
        Inspection::of(&Environment::new(image, 0.0).unwrap().0)
    }

    #[test]
    fn a_lamp_is_found_once_and_where_it_is() {
        for x0 in [200.0, 0.0, 511.0] {
            let found = lamp(x0, f32::MAX, 0.0);
            assert_eq!(found.source_count, 1, "{x0}");
            let uv = Vec2::new((x0 + 0.5) / 512.0, 100.5 / 256.0);
            let towards = Vec3::from(found.sources[0].direction);
            assert!(towards.dot(direction_from_latlong(uv)) > 0.99999, "{x0}");
            assert_eq!(found.sources[0].plateau_texels, None);
            assert_eq!(found.sources[0].halo, None);
            assert!((found.peak - 1e4).abs() < 2.0 && (found.dark - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn cut_off_lamps_and_glare_are_suspected() {
        assert!(lamp(200.0, 3e3, 0.0).sources[0].plateau_texels.is_some());
        let glare = lamp(200.0, f32::MAX, 0.01).sources[0].halo;
        assert!(glare.is_some_and(|h| h > 2e-4 && h < 5e-3), "{glare:?}");
    }

    #[test]
    fn even_light_and_darkness_have_no_source() {
        for value in [1.0, 0.0] {
            let image = RgbImage::constant(16, 8, [value; 3]);
            let found = Inspection::of(&Environment::new(image, 0.3).unwrap().0);
            assert_eq!(found.source_count, 0);
        }
        let one = RgbImage::constant(1, 1, [5.0; 3]);
        assert_eq!(
            Inspection::of(&Environment::new(one, 0.0).unwrap().0).source_count,
            0
        );
    }
}
