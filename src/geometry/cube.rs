//! Smooth functions on the sphere, sampled on the faces of a cube.
//!
//! Each face is an equi-angular grid (`tan(π/4 u)` along either side), continued two samples beyond
//! its edges on the face's own plane. The four-point Lagrange interpolation therefore never crosses
//! an edge, where a spherical map has a crease and its error would be of first order.

use std::f32::consts::FRAC_PI_4;

use glam::{Vec3, Vec3A};

/// Samples beyond the edge on either side: what a stencil of four reaches over.
const BORDER: usize = 2;

/// A direction's place on the cube, whatever the grid.
#[derive(Clone, Copy, Debug)]
pub struct CubePlace {
    face: usize,
    /// Equi-angular coordinates on the face, in [−1, 1].
    along: f32,
    down: f32,
}

impl CubePlace {
    /// Of a direction, which need not be unit.
    #[inline]
    pub fn of(direction: Vec3) -> Self {
        let size = direction.abs();
        let (axis, a, b) = if size.x >= size.y && size.x >= size.z {
            (0, direction.y / direction.x, direction.z / direction.x)
        } else if size.y >= size.z {
            (1, direction.z / direction.y, direction.x / direction.y)
        } else {
            (2, direction.x / direction.z, direction.y / direction.z)
        };
        Self {
            face: 2 * axis + usize::from(direction[axis] < 0.0),
            along: arctangent(a) * (1.0 / FRAC_PI_4),
            down: arctangent(b) * (1.0 / FRAC_PI_4),
        }
    }
}

/// Which samples of a [`CubeGrid`] a place lies between, and how much each counts: 4 × 4 of them.
#[derive(Clone, Copy, Debug)]
pub struct CubeStencil {
    first: usize,
    stride: usize,
    along: [f32; 4],
    down: [f32; 4],
}

impl CubeStencil {
    /// The interpolated value of the samples of one map.
    #[inline]
    pub fn interpolate(&self, samples: &[Vec3A]) -> Vec3A {
        let mut sum = Vec3A::ZERO;
        for (start, down) in self.rows() {
            let [a, b, c, d] = self.along;
            let four = &samples[start..start + 4];
            sum += (four[0] * a + four[1] * b + four[2] * c + four[3] * d) * down;
        }
        sum
    }

    /// The first sample of each of four rows, and the row's weight.
    #[inline]
    pub fn rows(&self) -> [(usize, f32); 4] {
        std::array::from_fn(|row| (self.first + row * self.stride, self.down[row]))
    }

    /// Weights of the four samples of a row.
    #[inline]
    pub fn along(&self) -> [f32; 4] {
        self.along
    }
}

/// The places of the samples of a map over the sphere.
#[derive(Clone, Copy, Debug)]
pub struct CubeGrid {
    /// Samples along a face's side, without the border.
    resolution: usize,
}

impl CubeGrid {
    /// A grid whose samples lie at most `spacing` radians apart.
    pub fn with_spacing(spacing: f32) -> Self {
        Self {
            resolution: (2.0 * FRAC_PI_4 / spacing).ceil() as usize,
        }
    }

    /// Samples along a face's side, border included.
    pub fn stride(self) -> usize {
        self.resolution + 2 * BORDER
    }

    /// Samples of a map.
    pub fn samples(self) -> usize {
        6 * self.stride() * self.stride()
    }

    /// The direction of sample `index`.
    pub fn direction(self, index: usize) -> Vec3 {
        let stride = self.stride();
        let (face, within) = (index / (stride * stride), index % (stride * stride));
        let place = |i: usize| {
            let u = (2.0 * (i as f32 - BORDER as f32) + 1.0) / self.resolution as f32 - 1.0;
            (FRAC_PI_4 * u).tan()
        };
        on_face(face, place(within % stride), place(within / stride)).normalize()
    }

    /// The stencil about a place.
    #[inline]
    pub fn stencil(self, place: CubePlace) -> CubeStencil {
        let n = self.resolution as f32;
        let cell = |u: f32| {
            let x = (u + 1.0) * 0.5 * n - 0.5;
            let low = x.floor().clamp(-1.0, n - 1.0);
            // The stencil starts one sample before the cell.
            (low as isize + BORDER as isize - 1, lagrange(x - low))
        };
        let ((column, along), (row, down)) = (cell(place.along), cell(place.down));
        let stride = self.stride();
        CubeStencil {
            first: (place.face * stride + row.max(0) as usize) * stride + column.max(0) as usize,
            stride,
            along,
            down,
        }
    }
}

/// The point at tangents `(a, b)` of a cube's face, as [`CubePlace::of`] names them: on the
/// negative faces both tangents are of mirrored coordinates.
fn on_face(face: usize, a: f32, b: f32) -> Vec3 {
    let sign = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    sign * match face / 2 {
        0 => Vec3::new(1.0, a, b),
        1 => Vec3::new(b, 1.0, a),
        _ => Vec3::new(a, b, 1.0),
    }
}

/// Weights of the samples at −1, 0, 1, 2 for a place `t` in [0, 1]: exact for cubics.
#[inline]
pub fn lagrange(t: f32) -> [f32; 4] {
    let (m, p, q) = (t - 1.0, t + 1.0, t - 2.0);
    [
        -t * m * q / 6.0,
        p * m * q / 2.0,
        -p * t * q / 2.0,
        p * t * m / 6.0,
    ]
}

/// `atan t` for |t| ≤ 1, within 2e-6 (minimax polynomial in t²): the grid is defined by `tan`, and an
/// error of 2e-6 rad is a thousandth of a cell.
#[inline]
fn arctangent(t: f32) -> f32 {
    let t2 = t * t;
    let series = -0.013_480_47 * t2 + 0.057_477_314;
    let series = series * t2 - 0.121_239_07;
    let series = series * t2 + 0.195_635_93;
    let series = series * t2 - 0.332_994_6;
    (series * t2 + 0.999_995_63) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn arctangent_is_the_arctangent() {
        for i in -1000..=1000 {
            let t = i as f32 / 1000.0;
            assert!((arctangent(t) - t.atan()).abs() < 5e-6, "{t}");
        }
    }

    proptest! {
        #[test]
        fn interpolation_is_exact_for_smooth_functions_everywhere(
            x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0,
        ) {
            prop_assume!(Vec3::new(x, y, z).length() > 0.1);
            let d = Vec3::new(x, y, z).normalize();
            let grid = CubeGrid::with_spacing(0.05);
            let f = |d: Vec3| Vec3A::new((2.0 * d.x).sin(), d.y * d.z, (d.z - d.x).exp());
            let samples: Vec<Vec3A> = (0..grid.samples()).map(|i| f(grid.direction(i))).collect();
            let error = grid.stencil(CubePlace::of(d)).interpolate(&samples) - f(d);
            prop_assert!(error.length() < 3e-5, "{error}");
        }
    }
}
