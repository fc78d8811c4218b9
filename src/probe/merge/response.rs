//! The response of a camera: linear exposure by stored sample.
//!
//! ```text
//! x = f(v),   f tabulated at v = k/255, straight between, non-decreasing, f(128/255) = sRGB's
//! ```
//!
//! A bracket leaves the scale of each channel open. It is fixed where the middle level means what it
//! means in sRGB, so that a camera's white balance stays as its pictures have it.

use std::path::Path;

use super::MergeError;
use crate::image::srgb_decode;

/// Levels of the table: those of 8 bits, which are then exact.
pub(super) const LEVELS: usize = 256;
/// The level at which the scale is fixed.
pub(super) const MIDDLE: usize = 128;

/// Linear exposure by stored sample, by channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// `[channel][level]`.
    tables: [Vec<f32>; 3],
}

/// The exposure that the middle level stands for.
fn middle() -> f64 {
    srgb_decode(MIDDLE as f64 / (LEVELS - 1) as f64)
}

impl Response {
    /// `f(v) = v`.
    pub fn linear() -> Self {
        Self::from_levels(|_, level| level as f32 / (LEVELS - 1) as f32)
    }

    /// sRGB's.
    pub fn srgb() -> Self {
        Self::from_levels(|_, level| srgb_decode(level as f64 / (LEVELS - 1) as f64) as f32)
    }

    fn from_levels(value: impl Fn(usize, usize) -> f32) -> Self {
        Self {
            tables: [0, 1, 2].map(|c| (0..LEVELS).map(|level| value(c, level)).collect()),
        }
    }

    /// From the logarithm of `f` at every level, up to a constant; made non-decreasing where noise made it fall.
    pub(super) fn from_logarithms(logarithms: [Vec<f64>; 3]) -> Self {
        Self {
            tables: logarithms.map(|mut g| {
                non_decreasing(&mut g);
                let offset = middle().ln() - g[MIDDLE];
                g.iter().map(|g| (g + offset).exp() as f32).collect()
            }),
        }
    }

    /// The exposure of a sample; beyond [0, 1] along the last step.
    #[inline]
    pub fn linearise(&self, channel: usize, sample: f32) -> f32 {
        let table = &self.tables[channel];
        let place = sample * (LEVELS - 1) as f32;
        let level = (place.max(0.0) as usize).min(LEVELS - 2);
        let (low, high) = (table[level], table[level + 1]);
        low + (place - level as f32) * (high - low)
    }

    /// How much the exposure grows over one of 255 levels about a sample.
    #[inline]
    pub fn step(&self, channel: usize, sample: f32) -> f32 {
        let half = 0.5 / (LEVELS - 1) as f32;
        let (low, high) = ((sample - half).max(0.0), (sample + half).min(1.0));
        self.linearise(channel, high) - self.linearise(channel, low)
    }

    /// The sample that stands for an exposure, in [0, 1].
    pub fn encode(&self, channel: usize, exposure: f32) -> f32 {
        let table = &self.tables[channel];
        let above = table.partition_point(|&x| x <= exposure);
        if above == 0 {
            return 0.0;
        }
        if above == LEVELS {
            return 1.0;
        }
        let (low, high) = (table[above - 1], table[above]);
        ((above - 1) as f32 + (exposure - low) / (high - low)) / (LEVELS - 1) as f32
    }

    /// A table of text: a level and its three exposures a line.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("# level of 255, linear exposure of red, green, blue\n");
        for level in 0..LEVELS {
            let [r, g, b] = [0, 1, 2].map(|c| self.tables[c][level]);
            text.push_str(&format!("{level},{r},{g},{b}\n"));
        }
        text
    }

    /// Reads what [`Response::to_csv`] wrote.
    pub fn read_csv(path: &Path) -> Result<Self, MergeError> {
        let fault = |fault: String| MergeError::ResponseFile {
            path: path.to_owned(),
            fault,
        };
        let text = std::fs::read_to_string(path).map_err(|e| fault(e.to_string()))?;
        let mut tables: [Vec<f32>; 3] = Default::default();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let number = number + 1;
            let fields: Vec<&str> = line.split(',').map(str::trim).collect();
            let [level, exposures @ ..] = &fields[..] else {
                continue;
            };
            let expected = tables[0].len();
            if expected == LEVELS {
                return Err(fault(format!("line {number}: more than {LEVELS} levels")));
            }
            if level.parse() != Ok(expected) || exposures.len() != 3 {
                return Err(fault(format!(
                    "line {number} = {line:?}: must be {expected} and three exposures"
                )));
            }
            for (table, exposure) in tables.iter_mut().zip(exposures) {
                let last = table.last().copied().unwrap_or(0.0);
                match exposure.parse::<f32>() {
                    Ok(x) if x.is_finite() && x >= last => table.push(x),
                    _ => {
                        return Err(fault(format!(
                            "line {number}: exposure = {exposure}: must be a number of at least {last}, \
                             the exposure of the level below"
                        )));
                    }
                }
            }
        }
        let levels = tables[0].len();
        if levels != LEVELS {
            return Err(fault(format!("has {levels} levels: must be {LEVELS}")));
        }
        if tables.iter().any(|table| table[MIDDLE] <= 0.0) {
            return Err(fault("the middle level has no exposure".to_owned()));
        }
        Ok(Self { tables })
    }
}

/// The nearest non-decreasing sequence (pool adjacent violators, Ayer et al. 1955).
fn non_decreasing(values: &mut [f64]) {
    let mut blocks: Vec<(f64, usize)> = Vec::with_capacity(values.len());
    for &value in values.iter() {
        let mut block = (value, 1);
        while let Some(&(mean, count)) = blocks.last()
            && mean > block.0
        {
            blocks.pop();
            let total = count + block.1;
            block = (
                (mean * count as f64 + block.0 * block.1 as f64) / total as f64,
                total,
            );
        }
        blocks.push(block);
    }
    let pooled = blocks
        .into_iter()
        .flat_map(|(mean, count)| std::iter::repeat_n(mean, count));
    for (value, mean) in values.iter_mut().zip(pooled) {
        *value = mean;
    }
}
