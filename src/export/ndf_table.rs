//! `ndf.npz`: tabulated densities of microfacet normals.

use std::path::Path;

use super::ExportError;
use super::npz::{ArrayReader, ArrayWriter, expect_length};

/// Densities over the half angle at K knots, of M groups of points that share a lobe.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NdfTable {
    /// `[K]` half angles of the knots, radians, growing. Between them densities fall as the
    /// parametric lobe does, shifted and scaled; within the first they are level, beyond the last zero.
    pub theta: Vec<f32>,
    /// `[M · K]` (in the file `[M, K]`) `D(θ_h)`, per steradian, beside the `rho_s` of `points.npz`.
    pub density: Vec<f32>,
    /// `[M · K]` (in the file `[M, K]`) its standard deviation; infinite where no light tells.
    pub sigma: Vec<f32>,
    /// `[M]` `∫ D cos θ dω`: 1 where the parametric lobe's normalisation is right.
    pub integral: Vec<f32>,
    /// `[M]` roughness of the parametric lobe, whose masking and Fresnel term the density goes with.
    pub alpha: Vec<f32>,
    /// `[M]` its NDF: 0 Beckmann, 1 GGX.
    pub ndf: Vec<i32>,
    /// `[M]` points in each group.
    pub points: Vec<i32>,
    /// `[N]` group of every point of `points.npz`; −1 where it has no lobe.
    pub group: Vec<i32>,
}

impl NdfTable {
    /// Number of groups.
    pub fn len(&self) -> usize {
        self.alpha.len()
    }

    /// Whether there is no group.
    pub fn is_empty(&self) -> bool {
        self.alpha.is_empty()
    }

    /// Densities of group `m`, and their deviations.
    pub fn group(&self, m: usize) -> (&[f32], &[f32]) {
        let knots = self.theta.len();
        let range = m * knots..(m + 1) * knots;
        (&self.density[range.clone()], &self.sigma[range])
    }

    /// Writes the table; equal tables give equal bytes.
    ///
    /// # Errors
    /// The arrays do not fit together, or the file cannot be written.
    pub fn write_npz(&self, path: &Path) -> Result<(), ExportError> {
        self.check_lengths(path)?;
        super::files::write_atomically(path, |file| {
            let mut arrays = ArrayWriter::new(file);
            arrays.floats("theta", &self.theta)?;
            arrays.rows("density", self.theta.len(), &self.density)?;
            arrays.rows("sigma", self.theta.len(), &self.sigma)?;
            arrays.floats("integral", &self.integral)?;
            arrays.floats("alpha", &self.alpha)?;
            arrays.integers("ndf", &self.ndf)?;
            arrays.integers("points", &self.points)?;
            arrays.integers("group", &self.group)?;
            arrays.finish()
        })
    }

    /// Reads what [`NdfTable::write_npz`] wrote.
    ///
    /// # Errors
    /// An array is absent or has another type or shape, or the file is not a zip of arrays.
    pub fn read_npz(path: &Path) -> Result<Self, ExportError> {
        let mut arrays = ArrayReader::open(path)?;
        let theta: Vec<f32> = arrays.column("theta")?;
        let table = Self {
            density: arrays.rows("density", theta.len())?,
            sigma: arrays.rows("sigma", theta.len())?,
            integral: arrays.column("integral")?,
            alpha: arrays.column("alpha")?,
            ndf: arrays.column("ndf")?,
            points: arrays.column("points")?,
            group: arrays.column("group")?,
            theta,
        };
        table.check_lengths(path)?;
        Ok(table)
    }

    fn check_lengths(&self, path: &Path) -> Result<(), ExportError> {
        let (m, k) = (self.len(), self.theta.len());
        let lengths = [
            ("density", self.density.len(), m * k),
            ("sigma", self.sigma.len(), m * k),
            ("integral", self.integral.len(), m),
            ("ndf", self.ndf.len(), m),
            ("points", self.points.len(), m),
        ];
        lengths
            .into_iter()
            .try_for_each(|(name, length, wanted)| expect_length(path, name, length, wanted))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> NdfTable {
        NdfTable {
            theta: vec![0.01, 0.1, 1.0],
            density: vec![9.0, 3.0, 0.0, 5.0, 1.0, 0.0],
            sigma: vec![0.1, 0.2, f32::INFINITY, 0.3, 0.4, 0.5],
            integral: vec![1.0, 0.9],
            alpha: vec![0.1, 0.2],
            ndf: vec![0, 1],
            points: vec![3, 1],
            group: vec![0, 1, -1, 0, 0],
        }
    }

    #[test]
    fn tables_read_back_and_uneven_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ndf.npz");
        table().write_npz(&path).unwrap();
        let read = NdfTable::read_npz(&path).unwrap();
        assert_eq!(read, table());
        assert_eq!(read.group(1).0, [5.0, 1.0, 0.0]);
        let mut uneven = table();
        uneven.sigma.pop();
        let error = uneven.write_npz(&path).unwrap_err().to_string();
        assert!(error.contains("sigma is [5]; must be [6]"), "{error}");
    }
}
