//! The light of one frame, object frame, in patches that guides weigh.

use glam::{Mat3, Vec3};

use super::direction_map::cell_of;
use super::expected_lobe::Places;
use super::weights::PLACES;
use crate::probe::{Environment, LightClusters, TurnedLight};

/// Light at one pose of the turntable.
pub(super) struct FrameLight<'a> {
    pub(super) clusters: &'a LightClusters,
    pub(super) light: TurnedLight<'a>,
    probe_from_object: Mat3,
    object_from_probe: Mat3,
    /// Patches of light; places beyond their number send none.
    pub(super) places: Places,
    /// `[patch of light]` flux summed over RGB.
    pub(super) flux: [f32; PLACES],
    /// `[patch of light]` `∫ E ω dω`, one column a channel.
    pub(super) moments: Vec<Mat3>,
    /// `[patch of light]` cell of the direction map that holds its middle.
    pub(super) cell: [u16; PLACES],
    /// Mean radiance, summed over RGB.
    pub(super) mean: f32,
    /// Middle and radius (radians) of the patches of light that are far brighter than the mean.
    lamps: Vec<(Vec3, f32)>,
}

/// Radiance over the mean from which on a patch of light is a lamp. Below, what a triangle hides of it in a
/// lune, asked for once in ten times, is no more than noise elsewhere.
const LAMP: f32 = 8.0;

impl<'a> FrameLight<'a> {
    pub(super) fn new(
        environment: &'a Environment,
        clusters: &'a LightClusters,
        world_from_object: Mat3,
    ) -> Self {
        let probe_from_object = environment.world_from_probe().transpose() * world_from_object;
        let mut frame_light = Self {
            clusters,
            light: environment.turned(world_from_object),
            probe_from_object,
            object_from_probe: probe_from_object.transpose(),
            places: Places::NOWHERE,
            flux: [0.0; PLACES],
            moments: vec![Mat3::ZERO; PLACES],
            cell: [0; PLACES],
            mean: 0.0,
            lamps: Vec::new(),
        };
        for k in 0..clusters.count().min(PLACES) {
            let patch = clusters.patch(k);
            let direction = frame_light.object_from_probe * patch.direction;
            frame_light
                .places
                .set(k, direction, patch.spread2, patch.radius);
            frame_light.flux[k] = patch.flux;
            frame_light.moments[k] = frame_light.object_from_probe * patch.moments;
            frame_light.cell[k] = cell_of(direction) as u16;
            frame_light.mean += patch.flux / (4.0 * std::f32::consts::PI);
        }
        for k in 0..clusters.count().min(PLACES) {
            let patch = clusters.patch(k);
            let radiance = patch.flux / (std::f32::consts::PI * patch.radius * patch.radius);
            if radiance > LAMP * frame_light.mean {
                let direction = frame_light.places.direction(k);
                frame_light.lamps.push((direction, patch.radius));
            }
        }
        frame_light
    }

    /// Whether some of a lamp may lie above the horizon of one normal and below that of another, both unit
    /// and in the object frame.
    #[inline]
    pub(super) fn has_lamp_between(&self, normal: Vec3, side: Vec3) -> bool {
        self.lamps
            .iter()
            .any(|(lamp, radius)| lamp.dot(normal) > -radius && lamp.dot(side) < *radius)
    }

    /// A direction of the object frame as the probe names it.
    #[inline]
    pub(super) fn to_probe(&self, direction: Vec3) -> Vec3 {
        self.probe_from_object * direction
    }

    /// A direction of the probe in the object frame.
    #[inline]
    pub(super) fn to_object(&self, direction: Vec3) -> Vec3 {
        (self.object_from_probe * direction).normalize()
    }
}
