//! turnlight measures what an object's surface is made of from a turntable video and a light probe.
//!
//! A rigid object of known geometry turns by `theta_t` about an axis; camera and surroundings
//! stand still; the light comes from far away and is an HDR lat-long map `E`. The radiance seen is
//!
//! ```text
//! L(ω_o, x, t) = ∫ f(ω_i, ω_o; x) [ V(x, ω_i) E(R_t ω_i) + (1 − V(x, ω_i)) L_ind(x, ω_i, t) ] (n·ω_i)+ dω_i
//! f(ω_i, ω_o; x) = rho_d/π + rho_s D(ω_h; alpha) G(ω_i, ω_o; alpha) F(ω_i·ω_h) / (4 (n·ω_i)(n·ω_o))
//! ```
//!
//! (Domon et al., *Improvement of Appearance from Motion by using Omni-Directional Camera*, Eq. 1–4,
//! plus self-shadowing `V` and interreflection `L_ind`). [`render`] evaluates it, [`estimate`] inverts it.
//!
//! # Conventions
//!
//! * Right-handed, +Y up, metres unless the scene says otherwise; degrees in files, radians in code.
//! * Linear RGB, Rec. 709 primaries; radiance in units common to camera and probe.
//! * `wo` points to the camera, `wi` to the light; both leave the surface.
//! * `eval` excludes the cosine; `pdf` is per steradian.
//! * Lat-long maps: `ω = (sin θ sin φ, cos θ, −sin θ cos φ)`, `φ = 2πu`, `θ = πv`, texels cell-centred;
//!   the top row is +Y, the centre column looks along +Z.
//! * World frame: the camera's and the light's. Object frame: the mesh's, in which geometry and
//!   visibility never move. Transforms read output-from-input: `world_from_object`.
//!
//! Modules are listed in the order the data flows; a module names only modules above it.

pub mod geometry;
pub mod sampling;
pub mod image;
pub mod mesh;
pub mod probe;
pub mod brdf;
pub mod accel;
pub mod rig;
pub mod scene;
pub mod render;
pub mod traces;
pub mod estimate;
pub mod compare;
pub mod export;
pub mod report;
pub mod cli;
