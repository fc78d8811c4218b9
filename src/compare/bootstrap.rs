//! 95 % intervals over frames.
//!
//! Percentile bootstrap: frames are drawn with replacement, their sums pooled, and the 2.5 % and
//! 97.5 % quantiles of each error taken. Neighbouring frames of a turntable resemble each other, so
//! the intervals are somewhat narrow.

use super::{ImageErrors, errors::Sums};

/// Between seeds the ends then scatter by about 1 % of the interval's width (for normal errors).
const DRAWS: usize = 4000;
const SEED: u64 = 0x7475_726e_6c69_6768;

/// Lower and upper end for each error, or `None` for fewer than two frames.
pub(super) fn interval(frames: &[Sums]) -> Option<[ImageErrors; 2]> {
    if frames.len() < 2 {
        return None;
    }
    let mut state = SEED;
    let mut draw = || {
        let mut pooled = Sums::default();
        for _ in 0..frames.len() {
            let high = (u128::from(splitmix(&mut state)) * frames.len() as u128) >> 64;
            pooled += frames[high as usize];
        }
        pooled.errors()
    };
    let draws: Vec<ImageErrors> = (0..DRAWS).map(|_| draw()).collect();
    Some([0.025, 0.975].map(|share| {
        let quantile = |error: &dyn Fn(&ImageErrors) -> f64| {
            let mut values: Vec<f64> = draws.iter().map(error).collect();
            values.sort_unstable_by(f64::total_cmp);
            values[(share * (DRAWS - 1) as f64).round() as usize]
        };
        ImageErrors {
            pixels: frames.iter().map(|frame| frame.pixels).sum(),
            rmse: quantile(&|e| e.rmse),
            rel_mse: quantile(&|e| e.rel_mse),
            mae: quantile(&|e| e.mae),
            mean_ratio: quantile(&|e| e.mean_ratio),
            psnr_db: quantile(&|e| e.psnr_db),
            ssim: draws
                .iter()
                .all(|e| e.ssim.is_some())
                .then(|| quantile(&|e| e.ssim.unwrap_or(0.0))),
            flip: quantile(&|e| e.flip),
        }
    }))
}

/// SplitMix64 (Steele et al. 2014).
fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
