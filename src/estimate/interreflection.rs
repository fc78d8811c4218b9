//! Light that the object throws on itself.
//!
//! Where a point's view is blocked it sees another part of the object, whose radiance the current
//! estimate predicts: its diffuse reflection `rho_d T_d`, of every point in every frame. The
//! specular part is left out: under the paper's Fresnel it is a few per cent of the diffuse, seen
//! over the small solid angles that are blocked.

use glam::Vec3;

use super::Estimate;
use super::visibility::{BlockedPatch, Visibility};

/// Predicted radiance of the object, for one point's blocked directions.
pub(super) struct Glow<'a> {
    /// `[frame · points + point]` outgoing radiance, linear RGB.
    pub(super) radiance: &'a [Vec3],
    /// Number of points.
    pub(super) points: usize,
    /// `[triangles]` points at each triangle's corners.
    pub(super) points_of_triangle: &'a [[u32; 3]],
}

impl Glow<'_> {
    /// Every blocked patch with its flux in `frame`.
    pub(super) fn at<'b>(
        &'b self,
        frame: usize,
        visibility: &'b Visibility,
    ) -> impl Iterator<Item = (&'b BlockedPatch, Vec3)> + 'b {
        let radiance = &self.radiance[frame * self.points..][..self.points];
        visibility.blocked().iter().map(move |patch| {
            let corners = self.points_of_triangle[patch.triangle as usize];
            let (u, v) = (patch.barycentric.x, patch.barycentric.y);
            let at = |i: u32| radiance[i as usize];
            let seen = at(corners[0]) * (1.0 - u - v) + at(corners[1]) * u + at(corners[2]) * v;
            (patch, seen * patch.solid_angle)
        })
    }
}

/// Outgoing radiance `rho_d T_d` of every point in every frame, `[frame · points + point]`.
///
/// Points without an albedo of their own (never seen) take the mean of those that have one.
pub(super) fn outgoing(estimates: &[Estimate], irradiance_over_pi: &[Vec3]) -> Vec<Vec3> {
    let known = |e: &&Estimate| e.frames > 0 && e.sigma_rho_d.is_finite();
    let count = estimates.iter().filter(known).count().max(1) as f32;
    let mean = estimates
        .iter()
        .filter(known)
        .map(|e| e.rho_d / count)
        .sum::<Vec3>();
    let albedos: Vec<Vec3> = estimates
        .iter()
        .map(|e| if known(&e) { e.rho_d } else { mean })
        .collect();
    irradiance_over_pi
        .chunks(estimates.len().max(1))
        .flat_map(|frame| {
            frame
                .iter()
                .zip(&albedos)
                .map(|(light, albedo)| *light * *albedo)
        })
        .collect()
}
