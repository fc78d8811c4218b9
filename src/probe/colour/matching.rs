//! The 3 × 3 matrix between two cameras.

use super::lab::xyz;
use super::{Chart, ColourError, GreyCurve, Lab, delta_e_2000};
use crate::probe::cholesky::solve;

/// Patches that a match needs: twice the three that a matrix needs.
const LEAST_PATCHES: usize = 6;
/// What a chart's brightest patch reflects.
const WHITE: f64 = 0.9;

/// How a patch came out.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchResidual {
    /// Its name in the probe's chart.
    pub name: String,
    /// Converted probe, linear RGB of the camera.
    pub matched: [f64; 3],
    /// Camera, linear RGB.
    pub camera: [f64; 3],
    /// ΔE2000 between them.
    pub delta_e: f64,
    /// ΔE2000 of the matrix that was fitted without this patch.
    pub delta_e_without: f64,
}

/// A probe's colours turned into a camera's.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourMatch {
    /// The probe's curve, if it has one.
    pub curve: Option<GreyCurve>,
    /// `camera = matrix · probe`, rows.
    pub matrix: [[f64; 3]; 3],
    /// Patch by patch.
    pub residuals: Vec<PatchResidual>,
}

impl ColourMatch {
    /// A probe's sample in the camera's linear RGB.
    pub fn apply(&self, sample: [f64; 3]) -> [f64; 3] {
        multiply(&self.matrix, linear(&self.curve, sample))
    }

    /// Mean ΔE2000.
    pub fn mean(&self) -> f64 {
        self.average(|r| r.delta_e)
    }

    /// Mean ΔE2000 of patches that had no say in their matrix: what other colours may expect.
    pub fn mean_without(&self) -> f64 {
        self.average(|r| r.delta_e_without)
    }

    /// Largest ΔE2000, and its patch.
    pub fn worst(&self) -> Option<&PatchResidual> {
        (self.residuals.iter()).max_by(|a, b| a.delta_e.total_cmp(&b.delta_e))
    }

    fn average(&self, value: impl Fn(&PatchResidual) -> f64) -> f64 {
        self.residuals.iter().map(value).sum::<f64>() / self.residuals.len() as f64
    }
}

/// Matches `probe` to `camera`, patch by patch in order; refuses a mean ΔE2000 above `limit`.
pub fn match_colours(
    probe: &Chart,
    camera: &Chart,
    curve: Option<GreyCurve>,
    limit: f64,
) -> Result<ColourMatch, ColourError> {
    let (n, m) = (probe.patches.len(), camera.patches.len());
    if n != m {
        return Err(ColourError::Data {
            reason: format!("the probe's chart has {n} patches, the camera's {m}"),
            remedy: "give the same patches in the same order".to_owned(),
        });
    }
    if n < LEAST_PATCHES {
        return Err(ColourError::Data {
            reason: format!("{n} patches: a matrix needs at least {LEAST_PATCHES}"),
            remedy: "photograph a colour chart".to_owned(),
        });
    }
    let from: Vec<[f64; 3]> = (probe.patches.iter())
        .map(|p| linear(&curve, p.rgb))
        .collect();
    let to: Vec<[f64; 3]> = camera.patches.iter().map(|p| p.rgb).collect();
    let matrix = fit(&from, &to)?;
    let white = white(&to);
    let delta = |matrix: &[[f64; 3]; 3], i: usize| {
        delta_e_2000(
            Lab::of(multiply(matrix, from[i]), white),
            Lab::of(to[i], white),
        )
    };
    let mut residuals = Vec::new();
    for i in 0..n {
        let others = |list: &[[f64; 3]]| -> Vec<[f64; 3]> {
            let kept = list.iter().enumerate().filter(|(j, _)| *j != i);
            kept.map(|(_, p)| *p).collect()
        };
        let without = fit(&others(&from), &others(&to)).map_or(f64::INFINITY, |m| delta(&m, i));
        residuals.push(PatchResidual {
            name: probe.patches[i].name.clone(),
            matched: multiply(&matrix, from[i]),
            camera: to[i],
            delta_e: delta(&matrix, i),
            delta_e_without: without,
        });
    }
    let found = ColourMatch {
        curve,
        matrix,
        residuals,
    };

    let mean = found.mean();
    if mean.is_nan() || mean > limit {
        // The usual mistake is a chart that stands on its head.
        let mut turned = from.clone();
        turned.reverse();
        let upside_down = fit(&turned, &to).is_ok_and(|matrix| {
            let sum: f64 = (0..n)
                .map(|i| {
                    let matched = Lab::of(multiply(&matrix, turned[i]), white);
                    delta_e_2000(matched, Lab::of(to[i], white))
                })
                .sum();
            sum / (n as f64) < 0.5 * mean
        });
        return Err(ColourError::Data {
            reason: format!("no matrix relates the charts: mean ΔE2000 = {mean:.1}, above {limit}"),
            remedy: if upside_down {
                "one chart is turned by half a turn: give its corners in the other order".to_owned()
            } else {
                "check that both list the same patches in the same order, that none is saturated or in \
                 shadow, and that the light was the same"
                    .to_owned()
            },
        });
    }
    let m = &found.matrix;
    if (0..3).any(|i| m[i][i] <= 0.0) || determinant(m) <= 0.0 {
        return Err(ColourError::Data {
            reason: format!("the matrix {m:.3?} turns colours over"),
            remedy: "check that red, green and blue stand in this order in both charts".to_owned(),
        });
    }
    Ok(found)
}

fn linear(curve: &Option<GreyCurve>, sample: [f64; 3]) -> [f64; 3] {
    match curve {
        Some(curve) => [0, 1, 2].map(|c| curve.linearise(c, sample[c])),
        None => sample,
    }
}

fn multiply(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}

/// XYZ of what would reflect all light, from the brightest patch.
fn white(camera: &[[f64; 3]]) -> [f64; 3] {
    let brightest = (camera.iter().map(|&c| xyz(c)))
        .max_by(|a, b| a[1].total_cmp(&b[1]))
        .unwrap_or([1.0; 3]);
    brightest.map(|c| (c / WHITE).max(f64::MIN_POSITIVE))
}

/// The matrix with the least `Σ ΔE²/(1 + ΔE)`, ΔE2000: squares of small differences, and large ones as they
/// are, so that a patch in a shadow does not bend the rest. Linear least squares relative to luminance first, then
/// Levenberg and Marquardt.
fn fit(from: &[[f64; 3]], to: &[[f64; 3]]) -> Result<[[f64; 3]; 3], ColourError> {
    let flat = |reason: &str| ColourError::Data {
        reason: reason.to_owned(),
        remedy: "photograph a chart with red, green and blue patches".to_owned(),
    };
    let white = white(to);
    let mut normal = vec![0.0; 9];
    let mut right = [[0.0; 3]; 3];
    for (p, c) in from.iter().zip(to) {
        let weight = 1.0 / (xyz(*c)[1] + 0.02 * white[1]).powi(2);
        for i in 0..3 {
            for j in 0..3 {
                normal[3 * i + j] += weight * p[i] * p[j];
                right[i][j] += weight * c[i] * p[j];
            }
        }
    }
    // The share of its axes' product that the box of the patches fills.
    let box_ = [0, 1, 2].map(|i| [0, 1, 2].map(|j| normal[3 * i + j]));
    let axes = box_[0][0] * box_[1][1] * box_[2][2];
    let filled = determinant(&box_) / axes;
    if filled.is_nan() || filled <= 1e-7 {
        return Err(flat("the probe's patches are all of one colour"));
    }
    let mut rows = [[0.0; 3]; 3];
    for (row, right) in rows.iter_mut().zip(right) {
        let solution = solve(normal.clone(), right.to_vec());
        let solution = solution.ok_or_else(|| flat("the probe's patches are all of one colour"))?;
        row.copy_from_slice(&solution);
    }

    let residuals = |m: &[[f64; 3]; 3]| -> Vec<f64> {
        let both = from.iter().zip(to);
        both.flat_map(|(p, c)| {
            let (a, b) = (Lab::of(multiply(m, *p), white), Lab::of(*c, white));
            let difference = delta_e_2000(a, b);
            let (a, b) = (a.list(), b.list());
            let apart = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            let length = apart.iter().map(|d| d * d).sum::<f64>().sqrt();
            // Of length ΔE/√(1 + ΔE).
            let scale = if length > 1e-9 {
                difference / (1.0 + difference).sqrt() / length
            } else {
                1.0
            };
            apart.map(|d| scale * d)
        })
        .collect()
    };
    let square = |r: &[f64]| r.iter().map(|r| r * r).sum::<f64>();
    let scale = rows.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
    let step = 1e-6 * scale;
    let mut now = residuals(&rows);
    let mut damping = 1e-3;
    for _ in 0..50 {
        let slopes: Vec<Vec<f64>> = (0..9)
            .map(|k| {
                let mut moved = rows;
                moved[k / 3][k % 3] += step;
                let there = residuals(&moved);
                there
                    .iter()
                    .zip(&now)
                    .map(|(a, b)| (a - b) / step)
                    .collect()
            })
            .collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut matrix: Vec<f64> = (0..81)
            .map(|i| dot(&slopes[i / 9], &slopes[i % 9]))
            .collect();
        let right: Vec<f64> = slopes.iter().map(|s| -dot(s, &now)).collect();
        for k in 0..9 {
            matrix[10 * k] *= 1.0 + damping;
        }
        let Some(change) = solve(matrix, right) else {
            break;
        };
        let mut next = rows;
        for (k, change) in change.iter().enumerate() {
            next[k / 3][k % 3] += change;
        }
        let there = residuals(&next);
        let (before, after) = (square(&now), square(&there));
        if after < before {
            (rows, now) = (next, there);
            damping *= 0.2;
            if before - after < 1e-12 * before {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e9 {
                break;
            }
        }
    }
    Ok(rows)
}
