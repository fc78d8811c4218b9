//! `scene.toml` and `capture.toml`, checked: what to render, and what was photographed.
//!
//! Reading has two levels: TOML tables as typed ([`toml::Table`]) become the plain data of
//! [`Scene`] and [`Capture`], in which every number is finite and in range, every angle in radians
//! and every file there. Nothing downstream checks again.
//!
//! | section | keys (default) |
//! |---|---|
//! | `[object]` | `mesh`; `scale` (1); `rotation` (zeros): rotation vector, axis times angle, degrees; `translation` (zeros); `flat` (false): shade triangles flat |
//! | `[material]` | `ndf`, `alpha`, `rho_d`; `fresnel` (`"dielectric"`) with `rho_s`, `eta` (1.3), or `"schlick"` with `f0`, `f90` (1) |
//! | `[probe]` | `image`; `rotation_deg` (0) |
//! | `[camera]` | `width`, `height`, `fov_x_deg` or `fx fy cx cy`, `position`, `look_at`; `distortion` (zeros), `up` (+Y) |
//! | `[turntable]` | `axis` (+Y), `center` (zeros); in a scene `frames` or `angles_deg` |
//! | `[sensor]` | `full_well_electrons`, `read_noise_electrons`, `bits`; `exposure` (1) |
//! | `[[frames]]` | of a capture: `image`, `angle_deg`; `mask` (none), `exposure` (1) |
//!
//! A file of clicked pairs ([`ClickedPairs`]) has `frame` (0) and `[[pairs]]` with `point` and `pixel`.
//!
//! A material parameter is a number (neutral where it is a colour), `[r, g, b]`, the name of an
//! image looked up by UV, or `"vertex:NAME"`. `ndf` is `"beckmann"`, `"ggx"`, or such a parameter
//! holding the share of GGX.

mod assets;
mod error;
mod load;
mod material;
mod material_field;
mod pairs;
mod plan;
mod section;
mod sections;
#[cfg(test)]
mod tests;
mod write;

pub use assets::AssetError;
pub use error::{Problem, SceneError};
pub use material_field::MaterialField;
pub use pairs::ClickedPairs;
pub use plan::{
    Capture, CaptureFrame, MapSource, MaterialSource, ObjectSource, ProbeSource, Scene, Sensor,
    SpecularSource,
};
pub use write::RigSections;
