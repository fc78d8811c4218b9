//! Owen-scrambled Sobol points, one independent sequence per pixel.

use glam::Vec2;
use sobol_burley::sample_4d;

/// The stream of low-discrepancy numbers of one path: sample `index` of the sequence `seed`,
/// dimensions handed out in the order they are asked for.
///
/// Every four dimensions are the first four of the Sobol sequence under another scramble (padding;
/// Burley 2020, *Practical Hash-based Owen Scrambling*, §6). Later dimensions of the sequence are
/// worse where it counts, in the plane: 256 points of the first two hit each cell of 16 × 16 once,
/// those of dimensions 13 to 16 leave up to three cells of four empty. Samples beyond the
/// generator's 2^16 points continue with another scramble too.
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
        // An odd multiple of the golden ratio: no two of the first 2^32 sets share a scramble.
        let seed = self.seed.wrapping_add(self.set.wrapping_mul(0x9e37_79b9));
        self.set += 1;
        sample_4d(self.index, 0, seed)
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
        // The first point of every set is a (0, 2)-sequence: 256 of them put one into each box of
        // area 1/256, whatever its shape. The second reaches two a box of 16 × 16 at most.
        for set in [0, 1, 3, 17, 300] {
            for log_width in 0..=8 {
                let (wide, high) = ((1 << log_width) as f32, (256 >> log_width) as f32);
                let mut first = [0; 256];
                let mut second = [0; 256];
                for i in 0..256 {
                    let mut path = SobolPath::new(7, 3, 5, i);
                    let u = (0..=set).fold([0.0; 4], |_, _| path.next_4d());
                    let (a, b) = as_points(u);
                    first[(a.x * wide) as usize * high as usize + (a.y * high) as usize] += 1;
                    second[(b.x * 16.0) as usize * 16 + (b.y * 16.0) as usize] += 1;
                }
                assert_eq!(first, [1; 256], "set {set}, {wide} x {high}");
                assert!(second.iter().all(|&n| n <= 2), "set {set}");
            }
        }
    }

    #[test]
    fn sets_are_independent() {
        // Correlation of the first dimensions of neighbouring sets over 4096 points: σ = 1/64.
        let n = 4096;
        let mut sums = [0.0f64; 3];
        for i in 0..n {
            let mut path = SobolPath::new(3, 1, 4, i);
            let sets = [path.next_4d(), path.next_4d(), path.next_4d()];
            for (sum, (a, b)) in sums.iter_mut().zip([(0, 1), (1, 2), (0, 2)]) {
                *sum += 12.0 * f64::from(sets[a][0] - 0.5) * f64::from(sets[b][0] - 0.5);
            }
        }
        assert!(
            sums.iter().all(|s| (s / f64::from(n)).abs() < 4.0 / 64.0),
            "{sums:?}"
        );
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
