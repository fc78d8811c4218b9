//! The forward model at one surface point: diffuse and specular traces for unit albedos.
//!
//! ```text
//! T_d = [ I_sky(n) + Σ visible lamps − ∫ over blocked directions (E_sky − L_ind) (n·ω)+ dω ] / π
//! T_s = Σ_j Φ_j f_s V_j + Σ_k Φ_k f_s,   j of the light, k of the object's own
//! ```
//!
//! Diffuse reflection has a table of what an open surface gets from the light without its peaks
//! ([`SplitLight`]), so that only lamps and the blocked solid angle are summed. Specular reflection has
//! light nodes of its own for every observation, as fine as the lobe needs them.

use glam::{Mat3, Vec3};

use super::columns::{Columns, RANGE, ROUGHNESSES};
use super::fresnel_model::FresnelModel;
use super::interreflection::Glow;
use super::light_cut::{Lobe, LobeCut, Seen, diffuse_cut, to_object, usual_threshold};
use super::lobe_cells::{InLobe, LobeCells};
use super::visibility::Visibility;
use super::widening::Widening;
use crate::probe::{LightNode, LightPyramid, SplitLight};
use crate::traces::{Observation, Trace};

/// The narrowest roughness that cuts resolve.
const SMALLEST_ALPHA: f32 = 0.5 * RANGE.0;
/// Nodes for the lamps in diffuse reflection.
const DIFFUSE_LAMPS: usize = 128;
/// Nodes for all light in diffuse reflection within the paper's window.
const WINDOW_NODES: usize = 512;

/// What a forward model takes into account.
pub(super) struct ForwardModel<'a> {
    /// The light, world frame.
    pub(super) light: &'a SplitLight,
    /// `[frames]` rotation of the object.
    pub(super) world_from_object: &'a [Mat3],
    /// Fresnel's terms.
    fresnel: FresnelModel,
    /// About how many light nodes an observation gets.
    pub(super) light_nodes: usize,
    /// Where an observation's cut through the light begins.
    threshold: f32,
    /// Whether the normals' variance over a pixel widens the lobe.
    footprints: bool,
    /// Lamps for diffuse reflection, world frame.
    lamps: Vec<Arrival>,
    /// The paper's limit, if there is one.
    window: Option<Window>,
}

/// Directions within an angle of the mirror direction, to which the paper limits all integrals.
struct Window {
    /// Cosine of the largest angle.
    cos: f32,
    /// All light in nodes, world frame.
    light: Vec<Arrival>,
}

/// Light at a point from about one direction.
#[derive(Clone, Copy)]
struct Arrival {
    /// Towards the light, unit.
    direction: Vec3,
    /// Radiance × solid angle, linear RGB.
    flux: Vec3,
    /// Standard deviation of its directions, radians.
    spread: f32,
}

/// About `budget` nodes for diffuse reflection.
fn arrivals(light: &LightPyramid, budget: usize) -> Vec<Arrival> {
    let node = |index: u32| {
        let node = &light.nodes()[index as usize];
        Arrival {
            direction: node.direction,
            flux: node.flux,
            spread: node.spread,
        }
    };
    diffuse_cut(light, budget).into_iter().map(node).collect()
}

/// Working memory, one a thread.
#[derive(Default)]
pub(super) struct Scratch {
    /// What one frame adds to the sky at a point, for diffuse reflection, object frame: lamps, and
    /// light of the object in the sky's place.
    arriving: Vec<Arrival>,
    /// Frames that show the point.
    frames: Vec<usize>,
    /// `[frames][blocked]` radiance of every patch that blocks; empty if the object is black.
    glow: Vec<Vec3>,
    lobe: LobeScratch,
}

/// Working memory for lobes.
#[derive(Default)]
pub(super) struct LobeScratch {
    cut: LobeCut,
    cells: LobeCells,
}

impl<'a> ForwardModel<'a> {
    /// The model of an object turned by `world_from_object[frame]`.
    pub(super) fn new(
        light: &'a SplitLight,
        world_from_object: &'a [Mat3],
        fresnel: FresnelModel,
        light_nodes: usize,
    ) -> Self {
        Self {
            light,
            world_from_object,
            fresnel,
            light_nodes,
            threshold: usual_threshold(&light.whole, light_nodes, SMALLEST_ALPHA),
            footprints: true,
            lamps: arrivals(&light.lamps, DIFFUSE_LAMPS),
            window: None,
        }
    }

    /// The paper's: pixels are points, and directions lie within `window` radians of the mirror's.
    pub(super) fn of_the_paper(self, window: f32) -> Self {
        let window = Window {
            cos: window.cos(),
            light: arrivals(&self.light.whole, WINDOW_NODES),
        };
        Self {
            footprints: false,
            window: Some(window),
            ..self
        }
    }

    /// The same with another number of light nodes.
    pub(super) fn with_nodes(&self, light_nodes: usize) -> Self {
        Self::new(
            self.light,
            self.world_from_object,
            self.fresnel,
            light_nodes,
        )
    }

    /// What reaches a point in a frame beside the whole sky, or in the place of parts of it: `glow` is
    /// the radiance of every patch that blocks, or empty.
    fn arrive(
        &self,
        frame: usize,
        visibility: &Visibility,
        glow: &[Vec3],
        arriving: &mut Vec<Arrival>,
    ) {
        let rotation = &self.world_from_object[frame];
        arriving.clear();
        arriving.extend(self.lamps.iter().filter_map(|lamp| {
            let direction = to_object(rotation, lamp.direction);
            let open = visibility.open(direction, lamp.spread);
            (open > 0.0).then_some(Arrival {
                direction,
                flux: lamp.flux * open,
                spread: lamp.spread,
            })
        }));
        for (i, patch) in visibility.blocked().iter().enumerate() {
            let sky = self.light.sky.radiance(*rotation * patch.direction);
            let glow = glow.get(i).copied().unwrap_or_default();
            arriving.push(Arrival {
                direction: patch.direction,
                flux: (glow - sky) * patch.solid_angle,
                spread: 0.0,
            });
        }
    }

    /// Irradiance over π of the sky and of what arrives beside it, at a normal in the object frame.
    fn diffuse(&self, frame: usize, normal: Vec3, arriving: &[Arrival]) -> Vec3 {
        let sky = self
            .light
            .sky_irradiance
            .at(self.world_from_object[frame] * normal);
        let beside: Vec3 = arriving
            .iter()
            .map(|arrival| arrival.flux * arrival.direction.dot(normal).max(0.0))
            .sum();
        // Where all of the sky is blocked, two sums of it cancel but for their errors.
        (sky + beside).max(Vec3::ZERO) / std::f32::consts::PI
    }

    /// Irradiance of the light alone over π at a point of normal `normal` (object frame).
    pub(super) fn irradiance(
        &self,
        frame: usize,
        normal: Vec3,
        visibility: &Visibility,
        scratch: &mut Scratch,
    ) -> Vec3 {
        self.arrive(frame, visibility, &[], &mut scratch.arriving);
        self.diffuse(frame, normal, &scratch.arriving)
    }

    /// Fills the traces of a point.
    pub(super) fn columns(
        &self,
        trace: &Trace,
        visibility: &Visibility,
        glow: Option<&Glow<'_>>,
        scratch: &mut Scratch,
        columns: &mut Columns,
    ) {
        let Scratch {
            arriving,
            frames,
            glow: radiance,
            lobe,
        } = scratch;
        columns.clear(self.fresnel.bases(), trace.observations.len());
        lobe.cut.restart(self.threshold);
        let by_frame = || trace.observations.chunk_by(|a, b| a.frame == b.frame);
        frames.clear();
        frames.extend(by_frame().map(|observations| observations[0].frame as usize));
        radiance.clear();
        if let Some(glow) = glow {
            glow.radiance(frames, visibility, radiance);
        }
        // What arrives at the point serves all its observations in a frame.
        let patches = radiance.len() / frames.len().max(1);
        for (i, observations) in by_frame().enumerate() {
            let (frame, glow) = (frames[i], &radiance[i * patches..][..patches]);
            self.arrive(frame, visibility, glow, arriving);
            for observation in observations {
                let number = columns.diffuse.len();
                columns.diffuse.push(match &self.window {
                    None => self.diffuse(frame, observation.normal, arriving),
                    Some(window) => self.diffuse_within(window, observation),
                });
                self.specular((number, observation), visibility, glow, lobe, columns);
            }
        }
    }

    /// Irradiance over π within the paper's window, on an open surface.
    fn diffuse_within(&self, window: &Window, observation: &Observation) -> Vec3 {
        let rotation = self.world_from_object[observation.frame as usize];
        let (normal, mirror) = (
            rotation * observation.normal,
            rotation * mirror(observation),
        );
        let sum: Vec3 = window
            .light
            .iter()
            .filter(|arrival| arrival.direction.dot(mirror) > window.cos)
            .map(|arrival| arrival.flux * arrival.direction.dot(normal).max(0.0))
            .sum();
        sum / std::f32::consts::PI
    }

    /// Writes the specular traces of one observation, by its number.
    fn specular(
        &self,
        (number, observation): (usize, &Observation),
        visibility: &Visibility,
        glow: &[Vec3],
        scratch: &mut LobeScratch,
        columns: &mut Columns,
    ) {
        // In the world frame, where the light stands still.
        let rotation = &self.world_from_object[observation.frame as usize];
        let (normal, wo) = (*rotation * observation.normal, *rotation * observation.wo);
        let side = *rotation * observation.geometric_normal;
        let mirror = *rotation * mirror(observation);
        // Light from below the surface itself never arrives; the paper's window may exclude more.
        let allowed = |wi: Vec3| {
            let inside = |window: &Window| wi.dot(mirror) > window.cos;
            wi.dot(side) > 0.0 && self.window.as_ref().is_none_or(inside)
        };
        let open = |node: &LightNode| {
            if allowed(node.direction) {
                visibility.open(to_object(rotation, node.direction), node.spread)
            } else {
                0.0
            }
        };
        let lobe = Lobe {
            wo,
            normal,
            smallest_alpha: SMALLEST_ALPHA,
        };
        gather(
            self.light,
            self.fresnel,
            self.light_nodes,
            &lobe,
            scratch,
            open,
        );

        // The object's own light comes in nodes as they are.
        for (patch, radiance) in visibility.blocked().iter().zip(glow) {
            let wi = *rotation * patch.direction;
            let cos_i = wi.dot(normal);
            if *radiance == Vec3::ZERO || cos_i <= 0.0 || !allowed(wi) {
                continue;
            }
            let half = wi + wo;
            let length2 = half.length_squared().max(1e-12);
            let sin2_h = half.cross(normal).length_squared() / length2;
            scratch.cells.add(&InLobe {
                sin2_h,
                // Of a square patch, as of a light node.
                variance_h: patch.solid_angle / 6.0 * (0.0625 + 0.25 / length2),
                cos_i,
                cos_d: (0.5 * length2.sqrt()).min(1.0),
                flux: *radiance * patch.solid_angle,
            });
        }

        let cos_o = normal.dot(wo);
        let widening = self
            .footprints
            .then(|| Widening::of(observation.normal_variance));
        for basis in 0..self.fresnel.bases().len() {
            let mut lobes = scratch.cells.sums(basis, cos_o);
            if let Some(widening) = &widening {
                lobes = widening.of_lobes(&lobes);
            }
            for (ndf, lobe) in lobes.iter().enumerate() {
                columns.put(ndf, basis, number, lobe);
            }
        }
    }
}

/// Radiance that an open surface of unit albedo reflects face on, by the first of a model's terms:
/// `[ndf][roughness]`, linear RGB.
pub(super) fn open_lobe(
    light: &SplitLight,
    fresnel: FresnelModel,
    light_nodes: usize,
    normal: Vec3,
    scratch: &mut LobeScratch,
) -> [[Vec3; ROUGHNESSES]; 2] {
    let lobe = Lobe {
        wo: normal,
        normal,
        smallest_alpha: SMALLEST_ALPHA,
    };
    scratch.cut.restart(0.0);
    gather(light, fresnel, light_nodes, &lobe, scratch, |_| 1.0);
    scratch.cells.sums(0, 1.0)
}

/// Lays the light's nodes into the cells of a lobe, by the share of each that is `open`.
fn gather(
    light: &SplitLight,
    fresnel: FresnelModel,
    budget: usize,
    lobe: &Lobe,
    scratch: &mut LobeScratch,
    open: impl Fn(&LightNode) -> f32,
) {
    let LobeScratch { cut, cells } = scratch;
    cells.clear(fresnel);
    cut.visit(&light.whole, budget, lobe, |seen: Seen<'_>| {
        let open = open(seen.node);
        if open > 0.0 {
            cells.add(&InLobe {
                sin2_h: seen.sin2_h,
                variance_h: seen.variance_h,
                cos_i: seen.cos_i,
                cos_d: seen.cos_d,
                flux: seen.node.flux * open,
            });
        }
    });
}

/// The direction that a mirror would reflect to the camera.
fn mirror(observation: &Observation) -> Vec3 {
    let (n, wo) = (observation.normal, observation.wo);
    2.0 * n.dot(wo) * n - wo
}
