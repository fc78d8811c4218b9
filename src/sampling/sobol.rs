//! Owen-scrambled Sobol points, one independent sequence per pixel.

use glam::Vec2;
use sobol_burley::sample_4d;

/// The stream of low-discrepancy numbers of one path: sample `index` of the sequence `seed`,
/// dimensions handed out in the order they are asked for.
///
/// Dimensions beyond the table of the generator (256 sets of four) and samples beyond its 2^16
/// points continue with another scramble, which keeps them unbiased and independent.
#[derive(Clone, Debug)]
pub struct SobolPath {
    index: u32,
    seed: u32,
    set: u32,
}

impl SobolPath {
    /// Sample number `index` of the pixel (or point) number `stream` of frame `frame`.
    pub fn new(seed: u64, frame: u32, stream: u32, index: u32) -> Self {
        let scramble = mix64(seed ^ mix64(u64::from(frame) << 32 | u64::from(stream)));
        let block = index >> 16;
        let scramble = if block == 0 {
            scramble
        } else {
            mix64(scramble ^ u64::from(block))
        };
        Self {
            index: index & 0xffff,
            seed: scramble as u32 ^ (scramble >> 32) as u32,
            set: 0,
        }
    }

    /// The next four dimensions, each in [0, 1).
    #[inline]
    pub fn next_4d(&mut self) -> [f32; 4] {
        let (set, wrap) = (
            self.set % sobol_burley::NUM_DIMENSION_SETS_4D,
            self.set / sobol_burley::NUM_DIMENSION_SETS_4D,
        );
        self.set += 1;
        sample_4d(
            self.index,
            set,
            self.seed.wrapping_add(wrap.wrapping_mul(0x9e37_79b9)),
        )
    }
}

/// Splits four dimensions into two points.
#[inline]
pub fn as_points(u: [f32; 4]) -> (Vec2, Vec2) {
    (Vec2::new(u[0], u[1]), Vec2::new(u[2], u[3]))
}

/// A bijective scramble of 64 bits (Stafford's variant 13 of the SplitMix finaliser).
#[inline]
fn mix64(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sobol_fills_elementary_intervals() {
        // 256 points of any two dimensions of a set put one point into each of 16 × 16 cells.
        let mut seen = [[false; 256]; 2];
        for i in 0..256 {
            let (a, b) = as_points(SobolPath::new(7, 3, 5, i).next_4d());
            for (cells, p) in seen.iter_mut().zip([a, b]) {
                let cell = (p.x * 16.0) as usize * 16 + (p.y * 16.0) as usize;
                assert!(
                    !std::mem::replace(&mut cells[cell], true),
                    "cell {cell} hit twice"
                );
            }
        }
    }

    #[test]
    fn streams_differ() {
        let first = SobolPath::new(1, 0, 0, 0).next_4d();
        assert_ne!(first, SobolPath::new(1, 0, 1, 0).next_4d());
        assert_ne!(first, SobolPath::new(1, 1, 0, 0).next_4d());
        assert_ne!(first, SobolPath::new(2, 0, 0, 0).next_4d());
        assert_ne!(first, SobolPath::new(1, 0, 0, 1 << 16).next_4d());
    }
}
