//! Pixels of a frame that show a point in so nearly the same way that their mean tells as much.
//!
//! ```text
//! T̄ = Σ T_i / k,   var T̄ = Σ var T_i / k²,   n̄ = Σ n_i / |Σ n_i|,   σ² = mean σ_i² + ½ mean |n_i − n̄|²
//! ```
//!
//! What a pixel's patch does to a lobe, the patch of several does: their normals' variance widens it. A
//! fit's work falls with the number of pixels, and nothing is lost where the spread of the normals is far
//! below the lobe's width and the noise is independent.

use glam::{BVec3, Vec3};

use super::{Observation, Trace};

impl Trace {
    /// The same trace with the pixels of each frame joined whose normals spread (standard deviation per
    /// axis, radians) by less than `largest_spread`; in order of frames, but not within them. Saturated pixels,
    /// and those of which a channel tells nothing, stay apart.
    pub fn joined(&self, largest_spread: f32) -> Self {
        let mut observations = Vec::new();
        let mut whole = Vec::new();
        for frame in self.observations.chunk_by(|a, b| a.frame == b.frame) {
            whole.clear();
            for observation in frame {
                if observation.saturated == BVec3::FALSE && observation.variance.is_finite() {
                    whole.push(*observation);
                } else {
                    observations.push(*observation);
                }
            }
            join(
                &mut whole,
                largest_spread * largest_spread,
                &mut observations,
            );
        }
        Self {
            point: self.point,
            observations,
        }
    }

    /// The same trace in at most `most` of its frames, evenly chosen, and in each only the nearest
    /// observation.
    pub fn sample(&self, most: usize) -> Self {
        let mut nearest = self.nearest();
        let count = nearest.observations.len();
        if count > most {
            nearest.observations = (0..most)
                .map(|i| nearest.observations[i * count / most])
                .collect();
        }
        nearest
    }
}

/// Adds the mean of some observations to `joined`, or halves of them where their normals spread by more
/// than a variance allows.
fn join(observations: &mut [Observation], largest_variance: f32, joined: &mut Vec<Observation>) {
    let [first, rest @ ..] = &*observations else {
        return;
    };
    if rest.is_empty() {
        joined.push(*first);
        return;
    }
    let count = observations.len() as f32;
    let mean_of = |of: fn(&Observation) -> Vec3| observations.iter().map(of).sum::<Vec3>() / count;
    let normal = mean_of(|o| o.normal).normalize_or(first.normal);
    let scatter = observations
        .iter()
        .map(|o| o.normal.distance_squared(normal))
        .sum::<f32>()
        / (2.0 * count);
    if scatter <= largest_variance {
        let own = observations.iter().map(|o| o.normal_variance).sum::<f32>() / count;
        joined.push(Observation {
            radiance: mean_of(|o| o.radiance),
            variance: mean_of(|o| o.variance) / count,
            position: mean_of(|o| o.position),
            wo: mean_of(|o| o.wo).normalize_or(first.wo),
            normal,
            geometric_normal: mean_of(|o| o.geometric_normal).normalize_or(first.geometric_normal),
            normal_variance: own + scatter,
            ..*first
        });
        return;
    }
    // Across the widest extent, through the median.
    let extent = |axis: usize| {
        let values = observations.iter().map(|o| o.normal[axis]);
        let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        high - low
    };
    let axis = (0..3).max_by(|&a, &b| extent(a).total_cmp(&extent(b)));
    let axis = axis.unwrap_or(0);
    observations.sort_by(|a, b| a.normal[axis].total_cmp(&b.normal[axis]));
    let (low, high) = observations.split_at_mut(observations.len() / 2);
    join(low, largest_variance, joined);
    join(high, largest_variance, joined);
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::SurfacePoint;

    fn observation(frame: u32, tilt: f32, radiance: f32, variance: f32) -> Observation {
        let normal = Vec3::new(tilt.sin(), tilt.cos(), 0.0);
        Observation {
            radiance: Vec3::splat(radiance),
            variance: Vec3::splat(variance),
            position: Vec3::new(tilt, 0.0, 0.0),
            wo: Vec3::Y,
            normal,
            geometric_normal: normal,
            normal_variance: 1e-6,
            ..Observation::face_on(frame)
        }
    }

    fn trace(observations: Vec<Observation>) -> Trace {
        let point = SurfacePoint {
            position: Vec3::ZERO,
            normal: Vec3::Y,
            triangle: 0,
            barycentric: Vec2::ZERO,
            uv: None,
        };
        Trace {
            point,
            observations,
        }
    }

    proptest! {
        /// Joining loses neither light nor information, and spreads stay below what is allowed.
        #[test]
        fn joined_pixels_keep_the_light_and_its_precision(
            tilts in prop::collection::vec(-0.2f32..0.2, 1..40), spread in 0.005f32..0.2,
        ) {
            let pixels = tilts.iter().enumerate().map(|(i, tilt)| {
                observation(i as u32 % 3, *tilt, 1.0 + tilt, 0.04)
            });
            let mut pixels: Vec<Observation> = pixels.collect();
            pixels.sort_by_key(|o| o.frame);
            let before = trace(pixels);
            let after = before.joined(spread);
            prop_assert_eq!(before.frames(), after.frames());
            for frame in 0..3 {
                let of = |trace: &Trace| -> Vec<Observation> {
                    trace.observations.iter().copied().filter(|o| o.frame == frame).collect()
                };
                let (pixels, joined) = (of(&before), of(&after));
                // Equal variances: the weight of a mean is its number of pixels.
                let weight = |o: &Observation| 0.04 / o.variance.x;
                let count: f32 = joined.iter().map(weight).sum();
                prop_assert!((count - pixels.len() as f32).abs() < 1e-3 * (1.0 + count));
                let light = |of: &[Observation]| of.iter().map(|o| weight(o) * o.radiance.x).sum::<f32>();
                prop_assert!((light(&pixels) - light(&joined)).abs() < 1e-3 * (1.0 + light(&pixels)));
                for observation in joined {
                    let single = (weight(&observation) - 1.0).abs() < 1e-3;
                    prop_assert!(single || observation.normal_variance <= 1.001 * spread * spread + 1e-6);
                }
            }
        }
    }

    #[test]
    fn joined_normals_that_spread_widen_as_their_variance() {
        let pixels = [-0.03f32, -0.01, 0.01, 0.03].map(|tilt| observation(0, tilt, 1.0, 1.0));
        let joined = trace(pixels.to_vec()).joined(0.1).observations;
        assert_eq!(joined.len(), 1);
        // Along one of two axes.
        let expected = 1e-6 + 0.5 * (0.03f32.powi(2) + 0.01f32.powi(2)) / 2.0;
        assert!((joined[0].normal_variance / expected - 1.0).abs() < 1e-2);
    }

    #[test]
    fn saturated_and_useless_pixels_stay_apart() {
        let mut pixels: Vec<Observation> = (0..6).map(|_| observation(0, 0.0, 1.0, 1.0)).collect();
        pixels[1].saturated = BVec3::new(true, false, false);
        pixels[4].variance.y = f32::INFINITY;
        let joined = trace(pixels).joined(0.1).observations;
        assert_eq!(joined.len(), 3);
        let apart = |o: &&Observation| o.saturated.any() || !o.variance.is_finite();
        assert_eq!(joined.iter().filter(apart).count(), 2);
    }

    #[test]
    fn a_sample_spreads_over_all_frames() {
        let all = trace((0..72).map(|t| observation(t, 0.0, 1.0, 1.0)).collect());
        let few: Vec<u32> = all
            .sample(12)
            .observations
            .iter()
            .map(|o| o.frame)
            .collect();
        assert_eq!(few, (0..12).map(|i| 6 * i).collect::<Vec<_>>());
        assert_eq!(all.sample(100).observations.len(), 72);
    }
}
