//! A fit folder: arrays for programs, maps for artists, and a scene that renders the estimate.

use std::path::Path;

use glam::{Vec3, Vec4};

use super::files::write_atomically;
use super::{ExportError, PointTable};
use crate::image::{Channel, write_exr_channels};
use crate::mesh::{Mesh, TexelGrid, neighbours, write_ply};
use crate::scene::{
    Capture, MapSource, MaterialSource, ObjectSource, ProbeSource, Scene, SpecularSource,
};

/// Texels by which charts grow over their seams, so that bilinear look-ups see no background.
const SEAM_PADDING: u32 = 8;

/// What goes into a fit folder.
pub struct FitFolder<'a> {
    /// What was fitted.
    pub capture: &'a Capture,
    /// Its mesh.
    pub mesh: &'a Mesh,
    /// The estimates.
    pub table: &'a PointTable,
    /// Where the points stand in texture space, if they are texels.
    pub grid: Option<&'a TexelGrid>,
    /// Index of refraction of the estimates' Fresnel term.
    pub eta: f32,
}

/// The parameters that a reproduction needs, one value a point.
struct Parameters {
    rho_d: Vec<Vec3>,
    rho_s: Vec<Vec3>,
    alpha: Vec<f32>,
    ggx: Vec<f32>,
}

impl FitFolder<'_> {
    /// Writes `points.npz`, `mesh.ply`, `scene.toml`, and `maps/*.exr` where the points are texels.
    pub fn write(&self, out: &Path) -> Result<(), ExportError> {
        let maps = out.join("maps");
        let folder = if self.grid.is_some() { &maps } else { out };
        std::fs::create_dir_all(folder).map_err(|error| ExportError::file(folder, error))?;
        self.table.write_npz(&out.join("points.npz"))?;

        let mut mesh = self.mesh.clone();
        mesh.attributes.clear();
        let material = match self.grid {
            Some(grid) => self.write_maps(grid, &maps)?,
            None => self.add_properties(&mut mesh),
        };
        // With its own copy of the light, the folder renders wherever it is moved.
        let source = &self.capture.probe.image;
        let probe = out
            .join("probe")
            .with_extension(source.extension().unwrap_or_default());
        let light = std::fs::read(source).map_err(|error| ExportError::file(source, error))?;
        write_atomically(&probe, |file| std::io::Write::write_all(file, &light))?;
        let path = out.join("mesh.ply");
        write_ply(&path, &mesh)?;
        let scene = Scene {
            object: ObjectSource {
                mesh: path,
                object_from_file: Default::default(),
                flat: !self.mesh.smooth,
            },
            material,
            probe: ProbeSource {
                image: probe,
                ..self.capture.probe
            },
            camera: self.capture.camera,
            turn: self.capture.turn,
            angles: self.capture.frames.iter().map(|f| f.angle).collect(),
            sensor: None,
        };
        let path = out.join("scene.toml");
        let text = scene.to_toml(out);
        write_atomically(&path, |file| {
            std::io::Write::write_all(file, text.as_bytes())
        })
    }

    /// The estimates as vertex properties.
    fn add_properties(&self, mesh: &mut Mesh) -> MaterialSource {
        let adjacency = neighbours(mesh);
        let around = |i: usize| adjacency.of(i as u32).iter().map(|&j| j as usize).collect();
        let filled = self.filled(around);
        let mut vector = |name: &str, values: &[Vec3]| {
            for (c, suffix) in ["r", "g", "b"].into_iter().enumerate() {
                let channel = values.iter().map(|v| v[c]).collect();
                mesh.attributes.insert(format!("{name}_{suffix}"), channel);
            }
        };
        vector("rho_d", &filled.rho_d);
        vector("rho_s", &filled.rho_s);
        mesh.attributes.insert("alpha".to_owned(), filled.alpha);
        mesh.attributes.insert("ggx".to_owned(), filled.ggx);
        MaterialSource {
            ggx: MapSource::Vertex("ggx".to_owned()),
            alpha: MapSource::Vertex("alpha".to_owned()),
            rho_d: MapSource::Vertex("rho_d".to_owned()),
            specular: SpecularSource::Dielectric {
                eta: self.eta,
                rho_s: MapSource::Vertex("rho_s".to_owned()),
            },
        }
    }

    /// The estimates as images, seams padded.
    fn write_maps(&self, grid: &TexelGrid, maps: &Path) -> Result<MaterialSource, ExportError> {
        let filled = self.filled(texel_neighbours(grid));
        let write = |name: &str, names: &[&str], values: Vec<Vec3>| {
            let path = maps.join(name).with_extension("exr");
            let values: Vec<[f32; 3]> = values.iter().map(Vec3::to_array).collect();
            let map = grid.map(&values, [0.0; 3], SEAM_PADDING);
            let channels: Vec<Channel> = names
                .iter()
                .enumerate()
                .map(|(c, name)| Channel {
                    name: (*name).to_owned(),
                    samples: map.iter().map(|texel| texel[c]).collect(),
                })
                .collect();
            let side = grid.resolution as usize;
            write_exr_channels(&path, side, side, &channels)?;
            Ok::<_, ExportError>(path)
        };
        const RGB: [&str; 3] = ["R", "G", "B"];
        let rows = |values: &[[f32; 3]]| values.iter().map(|v| Vec3::from(*v)).collect();
        let gray = |values: &[f32]| values.iter().map(|v| Vec3::splat(*v)).collect();
        let rho_d = write("rho_d", &RGB, filled.rho_d)?;
        let rho_s = write("rho_s", &RGB, filled.rho_s)?;
        let alpha = write("alpha", &["Y"], gray(&filled.alpha))?;
        let ggx = write("ggx", &["Y"], gray(&filled.ggx))?;
        write("sigma_rho_d", &RGB, rows(&self.table.sigma_rho_d))?;
        write("sigma_rho_s", &["Y"], gray(&self.table.sigma_rho_s))?;
        write("sigma_alpha", &["Y"], gray(&self.table.sigma_alpha))?;
        Ok(MaterialSource {
            ggx: MapSource::Texture(ggx),
            alpha: MapSource::Texture(alpha),
            rho_d: MapSource::Texture(rho_d),
            specular: SpecularSource::Dielectric {
                eta: self.eta,
                rho_s: MapSource::Texture(rho_s),
            },
        })
    }

    /// Parameters without gaps. A point that the data say nothing of takes the mean of its known
    /// neighbours, ring by ring; where only the lobe is undetermined, only the lobe does.
    fn filled(&self, neighbours: impl Fn(usize) -> Vec<usize>) -> Parameters {
        let table = self.table;
        let count = table.alpha.len();
        let diffuse_known: Vec<bool> = (0..count).map(|i| table.diffuse_is_known(i)).collect();
        let lobe_known: Vec<bool> = (0..count).map(|i| table.lobe_is_known(i)).collect();
        let adjacency: Vec<Vec<usize>> = (0..count).map(neighbours).collect();

        let vectors = |rows: &[[f32; 3]]| rows.iter().map(|v| Vec3::from(*v)).collect::<Vec<_>>();
        let green = precision(table.sigma_rho_d.iter().map(|sigma| sigma[1]));
        let rho_d = fill(vectors(&table.rho_d), green, &diffuse_known, &adjacency);
        let weights = precision(table.sigma_rho_s.iter().copied());
        let rho_s = fill(vectors(&table.rho_s), weights, &lobe_known, &adjacency);
        // Alpha and NDF share the filling: (alpha, GGX share, ·).
        let lobe = (0..count)
            .map(|i| Vec3::new(table.alpha[i], table.ndf[i] as f32, 0.0))
            .collect();
        let weights = precision(table.sigma_alpha.iter().copied());
        let lobe = fill(lobe, weights, &lobe_known, &adjacency);
        Parameters {
            rho_d,
            rho_s,
            alpha: lobe.iter().map(|v| v.x).collect(),
            ggx: lobe.iter().map(|v| v.y).collect(),
        }
    }
}

/// Which points lie beside a texel's, over texel edges.
fn texel_neighbours(grid: &TexelGrid) -> impl Fn(usize) -> Vec<usize> + '_ {
    let side = i64::from(grid.resolution);
    move |i| {
        let texel = i64::from(grid.texels[i]);
        let (x, y) = (texel % side, texel / side);
        [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]
            .into_iter()
            .filter(|(x, y)| (0..side).contains(x) && (0..side).contains(y))
            .filter_map(|(x, y)| grid.texels.binary_search(&((y * side + x) as u32)).ok())
            .collect()
    }
}

/// The mean by weight, or zero of nothing.
fn weighted_mean(values: impl Iterator<Item = (Vec3, f32)>) -> Vec3 {
    let sum = values.fold(Vec4::ZERO, |sum, (v, w)| sum + (v * w).extend(w));
    if sum.w > 0.0 {
        sum.truncate() / sum.w
    } else {
        Vec3::ZERO
    }
}

/// Fills unknown values with the mean of known neighbours, ring by ring; what no ring reaches takes
/// the mean of all known values.
///
/// Means are by `weights`, the inverse variances: an albedo whose error bar is small only beside its
/// own, far too large value would spread otherwise.
fn fill(
    mut values: Vec<Vec3>,
    mut weights: Vec<f32>,
    known: &[bool],
    adjacency: &[Vec<usize>],
) -> Vec<Vec3> {
    let mut known = known.to_vec();
    let all = (0..known.len()).filter(|&i| known[i]);
    let everywhere = weighted_mean(all.map(|i| (values[i], weights[i])));
    let mut waiting: Vec<usize> = (0..known.len()).filter(|&i| !known[i]).collect();
    while !waiting.is_empty() {
        let reached: Vec<(usize, Vec3, f32)> = waiting
            .iter()
            .filter_map(|&i| {
                let around = || adjacency[i].iter().copied().filter(|&j| known[j]);
                let count = around().count() as f32;
                let value = weighted_mean(around().map(|j| (values[j], weights[j])));
                let weight = around().map(|j| weights[j]).sum::<f32>() / count;
                (count > 0.0).then_some((i, value, weight))
            })
            .collect();
        if reached.is_empty() {
            waiting.iter().for_each(|&i| values[i] = everywhere);
            break;
        }
        for &(i, value, weight) in &reached {
            (values[i], weights[i]) = (value, weight);
            known[i] = true;
        }
        waiting.retain(|&i| !known[i]);
    }
    values
}

/// Inverse variances. Without error bars all weigh alike.
fn precision(sigmas: impl Iterator<Item = f32>) -> Vec<f32> {
    sigmas
        .map(|sigma| {
            if sigma.is_finite() {
                1.0 / (sigma * sigma).max(1e-12)
            } else {
                1e-12
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_their_neighbours_and_islands_the_mean() {
        // 0 – 1 – 2 – 3 in a chain, 4 alone; 0 and 3 are known.
        let values = vec![
            Vec3::ZERO,
            Vec3::NAN,
            Vec3::NAN,
            Vec3::splat(2.0),
            Vec3::NAN,
        ];
        let adjacency = vec![vec![1], vec![0, 2], vec![1, 3], vec![2], vec![]];
        let filled = fill(
            values,
            vec![1.0; 5],
            &[true, false, false, true, false],
            &adjacency,
        );
        assert_eq!(filled[1], Vec3::ZERO);
        assert_eq!(filled[2], Vec3::splat(2.0));
        assert_eq!(filled[4], Vec3::ONE);
    }
}
