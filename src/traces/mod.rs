//! What each surface point was seen to do over the frames.
//!
//! A trace is `T(x, t)`: the radiance observed at surface point `x` in frame `t` (Domon et al.,
//! Eq. 5), with everything the fit must know about that observation: view, normal, noise.
//! Photographs and renders enter alike.

mod alike;
mod collect;
mod footprint;

pub use collect::{CollectSettings, TraceError, TraceStats, collect};

use glam::{BVec3, Mat3, Vec2, Vec3};

use crate::mesh::{Mesh, SurfacePoint};

/// One observation of a surface point.
///
/// A pixel averages over the patch of surface it covers, so view and normals are those of the
/// pixel's patch, not of the point itself.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the frame in the capture.
    pub frame: u32,
    /// Observed radiance, linear RGB.
    pub radiance: Vec3,
    /// Variance of its noise, radiance squared, by channel; infinite where the channel tells nothing.
    pub variance: Vec3,
    /// Channels at the sensor's saturation: `radiance` is then the level, which the surface was at
    /// least as bright as.
    pub saturated: BVec3,
    /// Centre of the pixel's patch, mesh frame.
    pub position: Vec3,
    /// To the camera, unit, object frame.
    pub wo: Vec3,
    /// Mean shading normal over the pixel's patch, unit, object frame.
    pub normal: Vec3,
    /// Mean geometric normal over the patch, unit, object frame.
    pub geometric_normal: Vec3,
    /// Variance of the shading normal over the patch, radian² per tangent axis.
    pub normal_variance: f32,
}

/// A surface point and all that was seen of it.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Where on the surface, mesh frame.
    pub point: SurfacePoint,
    /// In order of frames, and within a frame nearest to the point first; empty if it was never
    /// seen.
    pub observations: Vec<Observation>,
}

#[cfg(test)]
impl Observation {
    /// One for tests: of unit radiance, seen face on.
    pub(crate) fn face_on(frame: u32) -> Self {
        Self {
            frame,
            radiance: Vec3::ONE,
            variance: Vec3::ONE,
            saturated: BVec3::FALSE,
            position: Vec3::ZERO,
            wo: Vec3::Z,
            normal: Vec3::Z,
            geometric_normal: Vec3::Z,
            normal_variance: 0.0,
        }
    }
}

impl Trace {
    /// Number of frames in which the point is seen.
    pub fn frames(&self) -> u32 {
        self.observations
            .chunk_by(|a, b| a.frame == b.frame)
            .count() as u32
    }

    /// Where the point's surroundings are seen from: position and geometric normal of the observation in
    /// the middle of all, or the point's own if there is none. A vertex may lie inside another part of
    /// the object while the surface around it shows.
    pub fn middle(&self) -> (Vec3, Vec3) {
        let mean = self.observations.iter().map(|o| o.position).sum::<Vec3>()
            / self.observations.len().max(1) as f32;
        let distance = |o: &Observation| o.position.distance_squared(mean);
        self.observations
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .map_or((self.point.position, self.point.normal), |o| {
                (o.position, o.geometric_normal)
            })
    }

    /// Only the nearest observation of every frame.
    pub fn nearest(&self) -> Self {
        let frames = self.observations.chunk_by(|a, b| a.frame == b.frame);
        Self {
            point: self.point,
            observations: frames.map(|frame| frame[0]).collect(),
        }
    }
}

/// Normals of a mesh, by triangle: what the object looks like to its own points.
#[derive(Clone, Debug, Default)]
pub struct SurfaceNormals {
    /// `[triangles]` unit, on the side from which the triangle is counter-clockwise.
    pub geometric: Vec<Vec3>,
    /// `[triangles]` shading normals at the corners, unit.
    pub corners: Vec<[Vec3; 3]>,
}

impl SurfaceNormals {
    /// Those of a mesh.
    pub fn of_mesh(mesh: &Mesh) -> Self {
        let triangles = 0..mesh.triangles.len() as u32;
        const CORNERS: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];
        Self {
            geometric: triangles
                .clone()
                .map(|t| mesh.geometric_normal(t))
                .collect(),
            corners: triangles
                .map(|t| CORNERS.map(|barycentric| mesh.normal_at(t, barycentric)))
                .collect(),
        }
    }

    /// The unit shading normal at `(b1, b2)` of a triangle.
    pub fn shading(&self, triangle: u32, barycentric: Vec2) -> Vec3 {
        let [a, b, c] = self.corners[triangle as usize];
        let (u, v) = (barycentric.x, barycentric.y);
        (a * (1.0 - u - v) + b * u + c * v)
            .try_normalize()
            .unwrap_or(self.geometric[triangle as usize])
    }
}

/// All traces of a capture.
#[derive(Clone, Debug)]
pub struct TraceSet {
    /// `[N]`, in the order of the points asked for.
    pub traces: Vec<Trace>,
    /// `[frames]` rotation of the object in the world.
    pub world_from_object: Vec<Mat3>,
    /// `[triangles]` the points nearest to each triangle's corners: whose radiance to take where a
    /// ray meets the object.
    pub points_of_triangle: Vec<[u32; 3]>,
    /// How the surface is turned.
    pub surface: SurfaceNormals,
    /// Whether the noise variances come from a sensor's model; else they are only relative.
    pub noise_is_known: bool,
}
