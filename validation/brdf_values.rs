//! Values of the dichromatic model for `check_brdf.py`.
//!
//!     brdf_values NDF ALPHA ETA RHO_D RHO_S PAIRS.npy OUT.npy
//!
//! NDF is `beckmann` or `ggx`; PAIRS is float32 [N, 6], `wi` and `wo` in the shading frame; OUT is
//! float32 [N], `f(wi, wo)` without the cosine.

mod npy;

use anyhow::{Result, bail, ensure};
use glam::Vec3;
use turnlight::brdf::{Alpha, Dichromatic, Fresnel};
use turnlight::geometry::Local;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [ndf, alpha, eta, rho_d, rho_s, pairs, out] = arguments.as_slice() else {
        bail!("usage: brdf_values NDF ALPHA ETA RHO_D RHO_S PAIRS.npy OUT.npy");
    };
    let material = Dichromatic {
        rho_d: Vec3::splat(rho_d.parse()?),
        rho_s: Vec3::splat(rho_s.parse()?),
        alpha: Alpha::new(alpha.parse()?)?,
        ggx: match ndf.as_str() {
            "beckmann" => 0.0,
            "ggx" => 1.0,
            other => bail!("no NDF {other}: beckmann or ggx"),
        },
        fresnel: Fresnel::Dielectric { eta: eta.parse()? },
    };
    let (values, shape) = npy::read(pairs)?;
    ensure!(
        matches!(shape.as_slice(), [_, 6]),
        "{pairs}: shape {shape:?}, must be [N, 6]"
    );
    let results = values.chunks_exact(6).map(|pair| {
        let (wi, wo) = (Vec3::from_slice(pair), Vec3::from_slice(&pair[3..]));
        material.eval(Local(wi), Local(wo)).x
    });
    npy::write(out, &shape[..1], results)
}
