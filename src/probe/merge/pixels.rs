//! The pixels from which response, exposures and noise are learnt.
//!
//! One pixel of every cell of a grid, the one whose surroundings vary least over all frames: an edge
//! would see another radiance in every frame that moved by a fraction of a pixel.

use super::Frame;

/// Cells of the grid in all. 2^14 pixels put some hundred samples on each of 256 levels, at a cost of a
/// tenth of a second.
const CELLS: usize = 1 << 14;

/// Samples below two of 255 levels say nothing about a ratio.
const DARK: f32 = 1.5 / 255.0;

/// Chosen pixels.
pub(super) struct Pixels {
    /// Number of frames.
    pub(super) frames: usize,
    /// `[channel][pixel · frames + frame]` samples; NaN where the frame's shift leaves none.
    pub(super) samples: [Vec<f32>; 3],
    /// Samples from here on are saturated.
    pub(super) saturation: f32,
}

impl Pixels {
    /// Chooses pixels of frames that are to be moved by `shifts`.
    pub(super) fn choose(frames: &[Frame], shifts: &[(i32, i32)], saturation: f32) -> Self {
        let (width, height) = (frames[0].samples.width, frames[0].samples.height);
        let step = ((width * height) as f64 / CELLS as f64).sqrt().max(1.0);
        let (columns, rows) = (
            (width as f64 / step).ceil() as usize,
            (height as f64 / step).ceil() as usize,
        );
        let edge = |n: usize, limit: usize| ((n as f64 * step) as usize).min(limit);
        let mut samples: [Vec<f32>; 3] = Default::default();
        for row in 0..rows {
            for column in 0..columns {
                let (x0, x1) = (edge(column, width), edge(column + 1, width));
                let (y0, y1) = (edge(row, height), edge(row + 1, height));
                // At most 3 × 3 candidates a cell.
                let skip = |a: usize, b: usize| (b - a).div_ceil(3).max(1);
                let flattest = (y0..y1)
                    .step_by(skip(y0, y1))
                    .flat_map(|y| (x0..x1).step_by(skip(x0, x1)).map(move |x| (x, y)))
                    .map(|(x, y)| (unrest(frames, shifts, x, y), x, y))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                let Some((_, x, y)) = flattest else {
                    continue;
                };
                for (frame, &shift) in frames.iter().zip(shifts) {
                    let pixel = at(frame, shift, x as i64, y as i64).unwrap_or([f32::NAN; 3]);
                    for (list, sample) in samples.iter_mut().zip(pixel) {
                        list.push(sample);
                    }
                }
            }
        }
        Self {
            frames: frames.len(),
            samples,
            saturation,
        }
    }

    /// The chosen pixels of a channel, each as its samples by frame.
    pub(super) fn of(&self, channel: usize) -> impl Iterator<Item = &[f32]> {
        self.samples[channel].chunks_exact(self.frames)
    }

    /// Whether a sample is neither lost in the dark nor saturated.
    pub(super) fn well_exposed(&self, sample: f32) -> bool {
        sample > DARK && sample < self.saturation
    }
}

/// Whether an image is taken for a full turn, whose columns go round: twice as wide as high.
pub(super) fn is_panorama(width: usize, height: usize) -> bool {
    width == 2 * height
}

/// The sample of a frame that is to be moved by `shift`, if there is one.
pub(super) fn at(frame: &Frame, shift: (i32, i32), x: i64, y: i64) -> Option<[f32; 3]> {
    let (width, height) = (frame.samples.width, frame.samples.height);
    let column = x - i64::from(shift.0);
    let column = if is_panorama(width, height) {
        column.rem_euclid(width as i64) as usize
    } else {
        usize::try_from(column).ok()?
    };
    let row = usize::try_from(y - i64::from(shift.1)).ok()?;
    (column < width && row < height).then(|| frame.samples.pixels[row * width + column])
}

/// How much green varies across a pixel's neighbours, over all frames.
fn unrest(frames: &[Frame], shifts: &[(i32, i32)], x: usize, y: usize) -> f32 {
    let (x, y) = (x as i64, y as i64);
    let mut sum = 0.0;
    for (frame, &shift) in frames.iter().zip(shifts) {
        let green = |dx: i64, dy: i64| at(frame, shift, x + dx, y + dy).map(|p| p[1]);
        for (a, b) in [(green(-1, 0), green(1, 0)), (green(0, -1), green(0, 1))] {
            sum += match (a, b) {
                (Some(a), Some(b)) => (a - b).abs(),
                // Rims are as good as any other place if there is nothing better.
                _ => 0.1,
            };
        }
    }
    sum
}
