//! What a surface reflects of light from anywhere, roughly and quickly: what guides weigh places by.

use glam::Vec3;

use super::weights::PLACES;
use crate::brdf::Dichromatic;
use crate::geometry::{Frame, Local};

/// What a patch of light that only reaches above the horizon counts, as a share of its reach. Without
/// it, the brightest texels were drawn once in millions where their patch's middle was just below.
const REACH: f32 = 0.1;

/// Cosine between the normal that an expectation is made for and one that it still serves, and that
/// angle, radians.
pub(super) const SAME_FACING: f32 = 0.995;
const SAME_FACING_ANGLE: f32 = 0.1;
/// The surface that an expectation is made for.
pub(super) struct Surface<'a> {
    pub(super) frame: Frame,
    pub(super) wo: Local,
    pub(super) brdf: &'a Dichromatic,
    /// Whether it is known to have no lobe.
    pub(super) matte: bool,
}

/// Places that light may come from, by quantity: patches of the sky, or cells of the direction map.
pub(super) struct Places {
    /// Middles, object frame: `[axis][place]`.
    pub(super) directions: [[f32; PLACES]; 3],
    /// Squared spread about the middle, radians².
    pub(super) spread2: [f32; PLACES],
    /// How far from the middle the place reaches, as a chord.
    pub(super) radius: [f32; PLACES],
}

impl Places {
    /// All in one point.
    pub(super) const NOWHERE: Self = Self {
        directions: [[0.0; PLACES], [0.0; PLACES], [1.0; PLACES]],
        spread2: [0.0; PLACES],
        radius: [0.0; PLACES],
    };

    pub(super) fn set(&mut self, k: usize, direction: Vec3, spread2: f32, radius: f32) {
        for (axis, coordinates) in self.directions.iter_mut().enumerate() {
            coordinates[k] = direction[axis];
        }
        self.spread2[k] = spread2;
        self.radius[k] = radius;
    }

    #[inline]
    pub(super) fn direction(&self, k: usize) -> Vec3 {
        Vec3::from([0, 1, 2].map(|axis| self.directions[axis][k]))
    }
}

/// `f cos` by place, mean of RGB.
pub(super) struct Expected {
    pub(super) diffuse: [f32; PLACES],
    pub(super) specular: [f32; PLACES],
}

/// A surface, as far as the expectation knows it.
pub(super) struct ExpectedLobe {
    normal: Vec3,
    wo: Vec3,
    cos_o: f32,
    diffuse: f32,
    pub(super) specular: f32,
    matte: bool,
    f0: f32,
    a2: f32,
}

impl ExpectedLobe {
    pub(super) fn new(surface: &Surface<'_>) -> Self {
        let brdf = surface.brdf;
        let f0 = brdf.fresnel.eval(1.0).element_sum() / 3.0;
        Self {
            normal: surface.frame.normal,
            wo: surface.frame.from_local(surface.wo),
            cos_o: surface.wo.0.z.max(1e-3),
            diffuse: brdf.rho_d.element_sum() / (3.0 * std::f32::consts::PI),
            specular: brdf.rho_s.element_sum() / 3.0,
            matte: surface.matte,
            f0,
            a2: brdf.alpha.get() * brdf.alpha.get(),
        }
    }

    /// About the share of light that is reflected, mean of RGB.
    pub(super) fn albedo(&self) -> f32 {
        (self.diffuse * std::f32::consts::PI + self.specular * self.f0).clamp(0.1, 3.0)
    }

    /// Diffuse and specular `f cos` towards places, the lobe (taken for GGX's) widened by each place's
    /// spread.
    #[inline]
    pub(super) fn expect(&self, places: &Places) -> Expected {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "the processor was just asked for AVX2")]
            // SAFETY: AVX2 is present.
            return unsafe { self.expect_avx2(places) };
        }
        self.expect_any(places)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn expect_avx2(&self, places: &Places) -> Expected {
        self.expect_any(places)
    }

    #[inline(always)]
    fn expect_any(&self, places: &Places) -> Expected {
        if self.matte {
            self.expect_both::<false>(places)
        } else {
            self.expect_both::<true>(places)
        }
    }

    #[inline(always)]
    fn expect_both<const LOBE: bool>(&self, places: &Places) -> Expected {
        let (n, o) = (self.normal, self.wo);
        let scale = self.specular / (4.0 * std::f32::consts::PI * self.cos_o);
        let [x, y, z] = &places.directions;
        let mut expected = Expected {
            diffuse: [0.0; PLACES],
            specular: [0.0; PLACES],
        };
        for k in 0..PLACES {
            let cos = x[k] * n.x + y[k] * n.y + z[k] * n.z;
            // A patch across the horizon still sends some light, and one whose middle is well below
            // may reach above it.
            let spread = places.spread2[k].sqrt();
            let lit = (0.5 * (cos + spread)).max(0.0).min(spread).max(cos);
            let lit = lit.max(REACH * (cos + places.radius[k] + SAME_FACING_ANGLE));
            expected.diffuse[k] = self.diffuse * lit;
            if !LOBE {
                continue;
            }
            let length2 = (2.0 + 2.0 * (x[k] * o.x + y[k] * o.y + z[k] * o.z)).max(1e-4);
            let along = cos + self.cos_o;
            let cos2 = (along * along / length2).min(1.0);
            let a2 = self.a2 + 0.5 * places.spread2[k] / length2;
            let q = 1.0 - cos2 + a2 * cos2;
            let m = 1.0 - 0.5 * length2.sqrt();
            let m2 = m * m;
            let fresnel = self.f0 + (1.0 - self.f0) * m2 * m2 * m;
            let masking = 2.0 * lit / (lit + (lit * lit + self.a2).sqrt() + 1e-6);
            expected.specular[k] = scale * fresnel * masking * a2 / (q * q);
        }
        expected
    }
}
