//! The camera as the turned object sees it.
//!
//! `camera_from_mesh = camera_from_world · world_from_object(angle) · object_from_mesh`: the mesh
//! stays where it is and the camera goes round, so that nothing about geometry is computed twice.

use glam::{DAffine3, DMat3, DVec2, DVec3, Mat3, Vec3};

use super::Camera;
use crate::geometry::{Ray, Turn};

/// A camera at one pose of the turntable, in the mesh frame.
#[derive(Clone, Copy, Debug)]
pub struct View {
    camera: Camera,
    /// Mesh frame to the camera's axes (right, down, forward), in mesh units.
    camera_from_mesh: DAffine3,
    /// Optical centre, mesh frame.
    position: Vec3,
    /// Rotation only: directions seen from the camera to directions in the mesh frame.
    mesh_from_camera: DMat3,
    world_from_object: Mat3,
}

impl View {
    /// The view at turntable angle `angle` (radians) of a mesh placed by `object_from_mesh`.
    pub fn new(camera: &Camera, turn: &Turn, angle: f64, object_from_mesh: DAffine3) -> Self {
        let world_from_object = turn.world_from_object(angle);
        let world_from_mesh = world_from_object * object_from_mesh;
        let mesh_from_world = world_from_mesh.inverse();
        let scale = object_from_mesh.matrix3.x_axis.length();
        // Mesh units along the camera's axes: divide the world's offset by the scale.
        let camera_from_world = camera.world_from_camera.transpose();
        let camera_from_mesh = DAffine3 {
            matrix3: camera_from_world * world_from_mesh.matrix3 * (1.0 / scale),
            translation: camera_from_world * (world_from_mesh.translation - camera.position)
                / scale,
        };
        Self {
            camera: *camera,
            camera_from_mesh,
            position: mesh_from_world.transform_point3(camera.position).as_vec3(),
            mesh_from_camera: camera_from_mesh.matrix3.transpose(),
            world_from_object: Mat3::from_cols(
                world_from_object.matrix3.x_axis.as_vec3(),
                world_from_object.matrix3.y_axis.as_vec3(),
                world_from_object.matrix3.z_axis.as_vec3(),
            ),
        }
    }

    /// Optical centre, mesh frame.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Rotation of the object in the world at this pose.
    pub fn world_from_object(&self) -> Mat3 {
        self.world_from_object
    }

    /// The ray through pixel coordinates `pixel` (centre of the first pixel at ½, ½), mesh frame.
    #[inline]
    pub fn ray(&self, pixel: DVec2) -> Ray {
        let p = self.camera.ideal_point(pixel);
        let direction = (self.mesh_from_camera * DVec3::new(p.x, p.y, 1.0)).normalize();
        Ray {
            origin: self.position,
            direction: direction.as_vec3().normalize(),
        }
    }

    /// Width, in mesh units, of what one pixel sees at `distance` face on.
    pub fn pixel_width_at(&self, distance: f32) -> f32 {
        let k = &self.camera.intrinsics;
        distance / k.fx.min(k.fy) as f32
    }

    /// Pixel coordinates of a point in the mesh frame, or `None` behind the camera; they may lie
    /// outside the image.
    pub fn project(&self, point: Vec3) -> Option<DVec2> {
        self.camera
            .project_from_camera(self.camera_from_mesh.transform_point3(point.as_dvec3()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Distortion, Intrinsics};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn project_inverts_ray_at_any_pose_and_scale(
            px in 0.0f64..64.0, py in 0.0f64..48.0, angle in -7.0f64..7.0, scale in -6i32..6,
        ) {
            let scale = 10f64.powi(scale);
            let origin = scale * DVec3::new(3.0, -2.0, 5.0);
            let camera = Camera::looking_at(
                (64, 48),
                Intrinsics::from_fov_x(64, 48, 0.5),
                Distortion::default(),
                origin + scale * DVec3::new(0.5, 1.0, 4.0),
                origin,
                DVec3::Y,
            ).unwrap();
            let turn = Turn { axis: DVec3::new(0.1, 1.0, -0.2).normalize(), center: origin };
            let object_from_mesh = DAffine3::from_scale_rotation_translation(
                DVec3::splat(scale), glam::DQuat::IDENTITY, origin);
            let view = View::new(&camera, &turn, angle, object_from_mesh);
            let ray = view.ray(DVec2::new(px, py));
            let back = view.project(ray.at(4.0)).unwrap();
            prop_assert!((back - DVec2::new(px, py)).length() < 1e-3);
            // The same point through the world.
            let world = turn.world_from_object(angle)
                .transform_point3(object_from_mesh.transform_point3(ray.at(4.0).as_dvec3()));
            let direct = camera.project(world).unwrap();
            prop_assert!((direct - DVec2::new(px, py)).length() < 1e-3);
        }
    }
}
