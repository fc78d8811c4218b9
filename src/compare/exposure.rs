//! The exposure at which a reference is shown.

/// The exposure that maps the 99th percentile of what was added to 1.
///
/// Counts values by the leading bits of their float32 representation, so that a sequence of any
/// length takes 4 MB and the result does not depend on the order; it is exact to 2⁻¹¹.
pub(super) struct Percentile {
    counts: Vec<u64>,
    total: u64,
}

/// Keeps sign, exponent and 11 bits of mantissa.
const SHIFT: u32 = 12;

impl Percentile {
    pub(super) fn new() -> Self {
        Self {
            counts: vec![0; 1 << (31 - SHIFT)],
            total: 0,
        }
    }

    /// Adds a finite number; what is below 0 counts as 0.
    pub(super) fn add(&mut self, value: f32) {
        let bin = value.max(0.0).to_bits() >> SHIFT;
        // f32::max may return −0.
        self.counts[(bin & 0x7_ffff) as usize] += 1;
        self.total += 1;
    }

    /// 1 over the smallest value that 99 % do not exceed; 1 when that is 0 or nothing was added.
    pub(super) fn exposure(&self) -> f64 {
        let rank = self.total - self.total / 100;
        let mut below = 0;
        let bin = self.counts.iter().position(|&count| {
            below += count;
            below >= rank
        });
        match bin {
            Some(bin) if bin > 0 => 1.0 / f64::from(f32::from_bits((bin as u32) << SHIFT)),
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_maps_the_99th_percentile_to_one() {
        let mut percentile = Percentile::new();
        (1..=1000).for_each(|i| percentile.add(i as f32 / 64.0));
        let expected = 64.0 / 990.0;
        assert!((percentile.exposure() / expected - 1.0).abs() < 5e-4);
    }

    #[test]
    fn exposure_of_black_is_one() {
        let mut percentile = Percentile::new();
        assert_eq!(percentile.exposure(), 1.0);
        [0.0, -0.0, -3.0]
            .into_iter()
            .for_each(|x| percentile.add(x));
        assert_eq!(percentile.exposure(), 1.0);
    }
}
