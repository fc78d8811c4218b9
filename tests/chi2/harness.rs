//! Pearson's χ² test of samples against cell probabilities.

use glam::Vec2;

/// Outcomes counted in cells whose probabilities are known.
pub(crate) struct Histogram {
    counts: Vec<f64>,
    expected: Vec<f64>,
}

/// A rejected or broken sampler, in words.
pub(crate) type Failure = String;

impl Histogram {
    /// Cells of these probabilities; the last one should hold whatever falls nowhere else.
    pub(crate) fn new(probabilities: Vec<f64>, samples: usize) -> Self {
        Self {
            counts: vec![0.0; probabilities.len()],
            expected: probabilities
                .into_iter()
                .map(|p| p * samples as f64)
                .collect(),
        }
    }

    pub(crate) fn count(&mut self, cell: usize) {
        self.counts[cell] += 1.0;
    }

    /// p-value, cells that expect fewer than 5 pooled.
    ///
    /// Samples in cells of no probability fail at once, beyond the few (1e-5 of all, as in
    /// pbrt-v4) that f32 rounding carries across an edge.
    pub(crate) fn p_value(&self) -> Result<f64, Failure> {
        let samples: f64 = self.counts.iter().sum();
        let (mut statistic, mut cells) = (0.0, 0);
        let (mut pooled_count, mut pooled_expected, mut impossible) = (0.0, 0.0, 0.0);
        for (&count, &expected) in self.counts.iter().zip(&self.expected) {
            if expected < 1e-6 {
                impossible += count;
            }
            if expected < 5.0 {
                pooled_count += count;
                pooled_expected += expected;
            } else {
                statistic += (count - expected).powi(2) / expected;
                cells += 1;
            }
        }
        if impossible > 1e-5 * samples {
            return Err(format!("{impossible} samples in cells of no probability"));
        }
        // What is still below 5 after pooling says nothing by itself.
        if pooled_expected >= 5.0 {
            statistic += (pooled_count - pooled_expected).powi(2) / pooled_expected;
            cells += 1;
        }
        if cells < 3 {
            return Err(format!("only {cells} cells expect 5 samples or more"));
        }
        Ok(upper_gamma(0.5 * (cells - 1) as f64, 0.5 * statistic))
    }
}

/// Fails unless every p-value of a family passes at a joint significance of 0.01 (Šidák).
pub(crate) fn assert_family(results: Vec<(String, Result<f64, Failure>)>) {
    let threshold = 1.0 - 0.99f64.powf(1.0 / results.len() as f64);
    let failures: Vec<String> = results
        .iter()
        .filter_map(|(name, result)| match result {
            Ok(p) if *p >= threshold => None,
            Ok(p) => Some(format!("{name}: p = {p:.3e}")),
            Err(failure) => Some(format!("{name}: {failure}")),
        })
        .collect();
    assert!(
        failures.is_empty(),
        "{} of {} rejected (threshold p = {threshold:.2e}):\n{}",
        failures.len(),
        results.len(),
        failures.join("\n")
    );
}

/// Regularised upper incomplete gamma function `Q(a, x)`: its series below `a + 1`, Lentz's
/// continued fraction above (Press et al., *Numerical Recipes*, §6.2).
fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - libm::lgamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        let mut n = a;
        while term > sum * 1e-15 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        1.0 - front * sum
    } else {
        let mut b = x + 1.0 - a;
        let (mut c, mut d) = (1e300, 1.0 / b);
        let mut h = d;
        for i in 1..10_000 {
            let an = -f64::from(i) * (f64::from(i) - a);
            b += 2.0;
            d = 1.0 / (an * d + b);
            c = b + an / c;
            h *= d * c;
            if (d * c - 1.0).abs() < 1e-15 {
                break;
            }
        }
        front * h
    }
}

/// SplitMix64; f32 variates with 24 bits, as the renderer's own.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next_f32(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / 16_777_216.0
    }

    pub(crate) fn next_point(&mut self) -> Vec2 {
        Vec2::new(self.next_f32(), self.next_f32())
    }
}

#[test]
fn upper_gamma_matches_known_quantiles() {
    // χ² quantiles: 5 % at 1 and 10 degrees of freedom, 1 % at 100, 0.01 % at 400 (SciPy).
    for (freedom, x, p) in [
        (1.0, 3.841_458_820_694_124, 0.05),
        (10.0, 18.307_038_053_275_15, 0.05),
        (100.0, 135.806_723_171_026_76, 0.01),
        (10.0, 3.940_299_136_119_06, 0.95),
    ] {
        let found = upper_gamma(0.5 * freedom, 0.5 * x);
        assert!((found / p - 1.0).abs() < 1e-9, "{freedom} {x}: {found}");
    }
}

#[test]
fn a_biased_sampler_is_rejected() {
    // One cell in 100 is 5 % too likely: 200 counts where σ = 63 … p far below any threshold.
    let (cells, samples) = (100, 400_000);
    let mut histogram = Histogram::new(vec![1.0 / cells as f64; cells], samples);
    let mut random = Random(1);
    for _ in 0..samples {
        let cell = (random.next_f32() * cells as f32) as usize;
        let moved = cell == 7 && random.next_f32() < 0.1;
        histogram.count(if moved { 8 } else { cell });
    }
    assert!(histogram.p_value().is_ok_and(|p| p < 1e-6));
}
