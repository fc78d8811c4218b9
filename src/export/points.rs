//! `points.npz`: what a fit found at every surface point.

use std::path::Path;

use super::ExportError;
use super::npz::{ArrayReader, ArrayWriter, expect_length};

/// The estimate at N surface points, one entry a point in every array.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointTable {
    /// `[N]` object frame, scene units.
    pub position: Vec<[f32; 3]>,
    /// `[N]` unit shading normal, object frame.
    pub normal: Vec<[f32; 3]>,
    /// `[N]` diffuse albedo, linear RGB.
    pub rho_d: Vec<[f32; 3]>,
    /// `[N]` specular albedo, linear RGB; F0 where `fresnel` is 1.
    pub rho_s: Vec<[f32; 3]>,
    /// `[N]` reflectance at grazing where `fresnel` is 1.
    pub f90: Vec<f32>,
    /// `[N]` 0 dielectric, 1 Schlick.
    pub fresnel: Vec<i32>,
    /// `[N]` index of refraction where `fresnel` is 0, else NaN; NaN, too, in a file without it.
    pub eta: Vec<f32>,
    /// `[N]` roughness.
    pub alpha: Vec<f32>,
    /// `[N]` 0 Beckmann, 1 GGX.
    pub ndf: Vec<i32>,
    /// `[N]` standard deviation of `rho_d`, linear RGB.
    pub sigma_rho_d: Vec<[f32; 3]>,
    /// `[N]` standard deviation of `rho_s`, its largest channel.
    pub sigma_rho_s: Vec<f32>,
    /// `[N]` standard deviation of `alpha`.
    pub sigma_alpha: Vec<f32>,
    /// `[N]` frames that saw the point.
    pub frames: Vec<i32>,
    /// `[N]` root mean square of the residuals relative to that of the observations.
    pub residual: Vec<f32>,
    /// `[N]` how the fit of the point ended, as a code.
    pub status: Vec<i32>,
    /// `[N]` `ln L_ggx − ln L_beckmann`; NaN where only one was tried.
    pub ndf_evidence: Vec<f32>,
    /// `[N]` roughness of the second-best local minimum; NaN if there is none.
    pub second_alpha: Vec<f32>,
    /// `[N]` its ln likelihood less the estimate's; NaN if there is none.
    pub second_evidence: Vec<f32>,
    /// `[N]` what stands in the way of a roughness, as a code; 0 if nothing.
    pub reason: Vec<i32>,
    /// `[N]` number of the point's material where points were pooled by material or object, else −1.
    pub material: Vec<i32>,
    /// `[N]` 1 where the lobe is not known and the point is rendered with its neighbours'; all 0 in a
    /// file without it.
    pub borrowed: Vec<i32>,
    /// `[N]` the point's texel in the maps, row by row from the top left, where the points are texels;
    /// else −1.
    pub texel: Vec<i32>,
}

impl PointTable {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Writes `points.npz`: uncompressed, C order, little endian; equal tables give equal bytes.
    ///
    /// # Errors
    /// The arrays differ in length, or the file cannot be written.
    pub fn write_npz(&self, path: &Path) -> Result<(), ExportError> {
        self.check_lengths(path)?;
        super::files::write_atomically(path, |file| {
            let mut arrays = ArrayWriter::new(file);
            arrays.rgb("position", &self.position)?;
            arrays.rgb("normal", &self.normal)?;
            arrays.rgb("rho_d", &self.rho_d)?;
            arrays.rgb("rho_s", &self.rho_s)?;
            arrays.floats("f90", &self.f90)?;
            arrays.integers("fresnel", &self.fresnel)?;
            arrays.floats("alpha", &self.alpha)?;
            arrays.integers("ndf", &self.ndf)?;
            arrays.rgb("sigma_rho_d", &self.sigma_rho_d)?;
            arrays.floats("sigma_rho_s", &self.sigma_rho_s)?;
            arrays.floats("sigma_alpha", &self.sigma_alpha)?;
            arrays.integers("frames", &self.frames)?;
            arrays.floats("residual", &self.residual)?;
            arrays.integers("status", &self.status)?;
            arrays.floats("ndf_evidence", &self.ndf_evidence)?;
            arrays.floats("second_alpha", &self.second_alpha)?;
            arrays.floats("second_evidence", &self.second_evidence)?;
            arrays.integers("reason", &self.reason)?;
            arrays.integers("material", &self.material)?;
            arrays.integers("borrowed", &self.borrowed)?;
            arrays.floats("eta", &self.eta)?;
            arrays.integers("texel", &self.texel)?;
            arrays.finish()
        })
    }

    /// Reads what [`PointTable::write_npz`] or `numpy.savez` wrote; further arrays are ignored. In files
    /// of older versions, which lack the last eight arrays, nothing is known of those.
    ///
    /// # Errors
    /// An array is absent or has another type or shape, or the file is not a zip of arrays.
    pub fn read_npz(path: &Path) -> Result<Self, ExportError> {
        let mut arrays = ArrayReader::open(path)?;
        let position = arrays.rgb("position")?;
        let n = position.len();
        let mut evidence = |name| {
            let found = arrays.column_if_any(name)?;
            Ok::<_, ExportError>(found.unwrap_or_else(|| vec![f32::NAN; n]))
        };
        let ndf_evidence = evidence("ndf_evidence")?;
        let second_alpha = evidence("second_alpha")?;
        let second_evidence = evidence("second_evidence")?;
        let eta = evidence("eta")?;
        let mut code = |name, absent: i32| {
            let found = arrays.column_if_any(name)?;
            Ok::<_, ExportError>(found.unwrap_or_else(|| vec![absent; n]))
        };
        let table = Self {
            ndf_evidence,
            second_alpha,
            second_evidence,
            eta,
            reason: code("reason", 0)?,
            material: code("material", -1)?,
            borrowed: code("borrowed", 0)?,
            texel: code("texel", -1)?,
            position,
            normal: arrays.rgb("normal")?,
            rho_d: arrays.rgb("rho_d")?,
            rho_s: arrays.rgb("rho_s")?,
            f90: arrays.column("f90")?,
            fresnel: arrays.column("fresnel")?,
            alpha: arrays.column("alpha")?,
            ndf: arrays.column("ndf")?,
            sigma_rho_d: arrays.rgb("sigma_rho_d")?,
            sigma_rho_s: arrays.column("sigma_rho_s")?,
            sigma_alpha: arrays.column("sigma_alpha")?,
            frames: arrays.column("frames")?,
            residual: arrays.column("residual")?,
            status: arrays.column("status")?,
        };
        table.check_lengths(path)?;
        Ok(table)
    }

    /// Every array is as long as `position`.
    fn check_lengths(&self, path: &Path) -> Result<(), ExportError> {
        let lengths = [
            ("normal", self.normal.len()),
            ("rho_d", self.rho_d.len()),
            ("rho_s", self.rho_s.len()),
            ("f90", self.f90.len()),
            ("fresnel", self.fresnel.len()),
            ("eta", self.eta.len()),
            ("alpha", self.alpha.len()),
            ("ndf", self.ndf.len()),
            ("sigma_rho_d", self.sigma_rho_d.len()),
            ("sigma_rho_s", self.sigma_rho_s.len()),
            ("sigma_alpha", self.sigma_alpha.len()),
            ("frames", self.frames.len()),
            ("residual", self.residual.len()),
            ("status", self.status.len()),
            ("ndf_evidence", self.ndf_evidence.len()),
            ("second_alpha", self.second_alpha.len()),
            ("second_evidence", self.second_evidence.len()),
            ("reason", self.reason.len()),
            ("material", self.material.len()),
            ("borrowed", self.borrowed.len()),
            ("texel", self.texel.len()),
        ];
        lengths
            .iter()
            .try_for_each(|&(name, length)| expect_length(path, name, length, self.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points whose numbers are all different, NaN and infinity among them.
    fn table(n: usize) -> PointTable {
        let single = |offset: f32| (0..n).map(|i| offset + i as f32 / 7.0).collect::<Vec<_>>();
        let rgb = |offset: f32| {
            single(offset)
                .iter()
                .map(|&x| [x, -x, 1.0 / (x + 1.0)])
                .collect::<Vec<_>>()
        };
        let codes = |modulus: usize| (0..n).map(|i| (i % modulus) as i32 - 1).collect::<Vec<_>>();
        let mut residual = single(9.0);
        if let Some(first) = residual.first_mut() {
            *first = f32::INFINITY;
        }
        PointTable {
            position: rgb(1.0),
            normal: rgb(2.0),
            rho_d: rgb(3.0),
            rho_s: rgb(4.0),
            f90: single(5.0),
            fresnel: codes(2),
            eta: single(5.5),
            alpha: single(6.0),
            ndf: codes(3),
            sigma_rho_d: rgb(7.0),
            sigma_rho_s: single(8.0),
            sigma_alpha: single(8.5),
            frames: codes(72),
            residual,
            status: codes(5),
            ndf_evidence: single(10.0),
            second_alpha: single(11.0),
            second_evidence: single(12.0),
            reason: codes(6),
            material: codes(4),
            borrowed: codes(1),
            texel: codes(64),
        }
    }

    #[test]
    fn points_read_back_and_equal_tables_give_equal_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a.npz"), folder.path().join("b.npz"));
        for n in [0, 1, 100] {
            table(n).write_npz(&a).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(if n == 1 {
                2100
            } else {
                0
            }));
            table(n).write_npz(&b).unwrap();
            assert_eq!(PointTable::read_npz(&a).unwrap(), table(n));
            assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
        }
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            2,
            "no temporary file stays"
        );
    }

    #[test]
    fn wrong_tables_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.npz");
        let mut uneven = table(3);
        uneven.ndf.pop();
        let error = uneven.write_npz(&path).unwrap_err().to_string();
        assert!(error.contains("ndf is [2]; must be [3"), "{error}");
        assert!(!path.exists());

        let error = PointTable::read_npz(&path).unwrap_err().to_string();
        assert!(error.contains("points.npz: No such file"), "{error}");
        std::fs::write(&path, "not a zip").unwrap();
        let error = PointTable::read_npz(&path).unwrap_err().to_string();
        assert!(error.contains("points.npz: "), "{error}");

        let write = |arrays: &dyn Fn(&mut ArrayWriter<&mut std::io::BufWriter<std::fs::File>>)| {
            super::super::files::write_atomically(&path, |file| {
                let mut writer = ArrayWriter::new(file);
                arrays(&mut writer);
                writer.finish()
            })
            .unwrap();
            PointTable::read_npz(&path).unwrap_err().to_string()
        };
        let error = write(&|arrays| arrays.floats("alpha", &[1.0]).unwrap());
        assert!(error.contains("no array position"), "{error}");
        let error = write(&|arrays| arrays.floats("position", &[1.0]).unwrap());
        assert!(
            error.contains("position is float32 [1]; must be float32 [N, 3]"),
            "{error}"
        );
        let error = write(&|arrays| arrays.integers("position", &[1]).unwrap());
        assert!(error.contains("position is int32 [1]"), "{error}");
    }

    #[test]
    fn every_truncation_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.npz");
        table(2).write_npz(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(PointTable::read_npz(&path).is_err(), "{length} bytes");
        }
    }
}
