//! Levenberg–Marquardt for problems whose unknowns are a few shared ones and a few of every block's own.
//!
//! The normal equations then have the shape of an arrow,
//!
//! ```text
//! | A   W1  W2 … | | s  |     | g  |
//! | W1' B1       | | o1 | = − | h1 |          (Triggs et al. 2000, Bundle Adjustment, §6)
//! | W2'     B2   | | o2 |     | h2 |
//! ```
//!
//! and eliminating the blocks leaves `(A − Σ Wi Bi⁻¹ Wi') s = −g + Σ Wi Bi⁻¹ hi`: time grows with the
//! number of blocks, not with its cube. The damping is Marquardt's, `A + λ diag A`, so that units do not
//! matter.

use nalgebra::{SMatrix, SVector};

/// A least-squares problem: `S` shared unknowns, and `B` of each block.
pub(super) trait Arrow<const S: usize, const B: usize> {
    /// Values of all unknowns.
    type State: Clone;
    /// How many blocks there are.
    fn blocks(&self) -> usize;
    /// The block's part of the normal equations at `state`, or `None` where its residuals do not exist.
    fn linearise(&self, state: &Self::State, block: usize) -> Option<Block<S, B>>;
    /// `state` after a step.
    fn moved(
        &self,
        state: &Self::State,
        shared: &SVector<f64, S>,
        own: &[SVector<f64, B>],
    ) -> Self::State;
}

/// A block's part of the normal equations.
#[derive(Clone)]
pub(super) struct Block<const S: usize, const B: usize> {
    shared: SMatrix<f64, S, S>,
    mixed: SMatrix<f64, S, B>,
    own: SMatrix<f64, B, B>,
    shared_gradient: SVector<f64, S>,
    own_gradient: SVector<f64, B>,
    /// Sum of squared residuals.
    cost: f64,
}

impl<const S: usize, const B: usize> Block<S, B> {
    /// Without residuals.
    pub(super) fn empty() -> Self {
        Self {
            shared: SMatrix::zeros(),
            mixed: SMatrix::zeros(),
            own: SMatrix::zeros(),
            shared_gradient: SVector::zeros(),
            own_gradient: SVector::zeros(),
            cost: 0.0,
        }
    }

    /// Adds a residual and its derivatives. An unknown whose derivatives are all zero stays where it is.
    pub(super) fn add(&mut self, residual: f64, shared: &SVector<f64, S>, own: &SVector<f64, B>) {
        self.shared += shared * shared.transpose();
        self.mixed += shared * own.transpose();
        self.own += own * own.transpose();
        self.shared_gradient += shared * residual;
        self.own_gradient += own * residual;
        self.cost += residual * residual;
    }
}

#[cfg(test)]
impl<const S: usize, const B: usize> Block<S, B> {
    pub(super) fn cost(&self) -> f64 {
        self.cost
    }

    /// Half the derivatives of the cost: of the shared unknowns, then of the block's own.
    pub(super) fn gradient(&self) -> Vec<f64> {
        let shared = self.shared_gradient.iter();
        shared.chain(&self.own_gradient).copied().collect()
    }
}

/// Why the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// No step promises to lower the sum of squares by more than rounding.
    Converged,
    /// No step, however short, lowers it: a minimum up to rounding.
    SmallStep,
    /// It was still falling.
    IterationLimit,
}

/// Where the iteration ended.
pub(super) struct Minimum<State, const S: usize> {
    pub(super) state: State,
    /// Sum of squared residuals.
    pub(super) cost: f64,
    pub(super) stop: Stop,
    /// Steps taken.
    pub(super) steps: usize,
    /// Covariance of the shared unknowns for residuals of unit variance; zero for those that were held.
    /// `None` where the residuals do not determine them.
    pub(super) shared_covariance: Option<SMatrix<f64, S, S>>,
}

/// Minimises the sum of squares from `start`; `None` where the residuals do not exist there.
pub(super) fn minimise<const S: usize, const B: usize, P: Arrow<S, B>>(
    problem: &P,
    start: P::State,
    most_steps: usize,
) -> Option<Minimum<P::State, S>> {
    let linearise = |state: &P::State| {
        (0..problem.blocks())
            .map(|block| problem.linearise(state, block))
            .collect::<Option<Vec<_>>>()
            .filter(|blocks| cost(blocks).is_finite())
    };
    let mut state = start;
    let mut blocks = linearise(&state)?;
    let (mut damping, mut steps) = (1e-3, 0);
    let stop = loop {
        if steps == most_steps {
            break Stop::IterationLimit;
        }
        // Beyond this the step is below rounding in every unknown.
        if damping > 1e18 {
            break Stop::SmallStep;
        }
        let Some((shared, own)) = step(&blocks, damping) else {
            damping *= 10.0;
            continue;
        };
        let before = cost(&blocks);
        let promised = promised(&blocks, &shared, &own);
        if promised <= 1e-15 * before || before == 0.0 {
            break Stop::Converged;
        }
        let trial = problem.moved(&state, &shared, &own);
        match linearise(&trial) {
            Some(found) if cost(&found) < before => {
                (state, blocks) = (trial, found);
                damping = f64::max(damping * 0.1, 1e-12);
                steps += 1;
            }
            _ => damping *= 10.0,
        }
    };
    let shared_covariance = reduced(&blocks, 0.0).and_then(|(matrix, _)| inverse(&matrix));
    Some(Minimum {
        state,
        cost: cost(&blocks),
        stop,
        steps,
        shared_covariance,
    })
}

fn cost<const S: usize, const B: usize>(blocks: &[Block<S, B>]) -> f64 {
    blocks.iter().map(|block| block.cost).sum()
}

/// How much the linear model says the sum of squares falls.
fn promised<const S: usize, const B: usize>(
    blocks: &[Block<S, B>],
    shared: &SVector<f64, S>,
    own: &[SVector<f64, B>],
) -> f64 {
    let fall = |(block, own): (&Block<S, B>, &SVector<f64, B>)| {
        let slope = block.shared_gradient.dot(shared) + block.own_gradient.dot(own);
        let bend = shared.dot(&(block.shared * shared))
            + 2.0 * shared.dot(&(block.mixed * own))
            + own.dot(&(block.own * own));
        -2.0 * slope - bend
    };
    blocks.iter().zip(own).map(fall).sum()
}

/// The damped step, or `None` where the equations have no solution.
fn step<const S: usize, const B: usize>(
    blocks: &[Block<S, B>],
    damping: f64,
) -> Option<(SVector<f64, S>, Vec<SVector<f64, B>>)> {
    let (matrix, right) = reduced(blocks, damping)?;
    let shared = solve(&matrix, &right)?;
    let own = blocks
        .iter()
        .map(|block| {
            let right = -block.own_gradient - block.mixed.transpose() * shared;
            solve(&damped(&block.own, damping), &right)
        })
        .collect::<Option<Vec<_>>>()?;
    Some((shared, own))
}

/// The equations of the shared unknowns alone.
fn reduced<const S: usize, const B: usize>(
    blocks: &[Block<S, B>],
    damping: f64,
) -> Option<(SMatrix<f64, S, S>, SVector<f64, S>)> {
    let all: SMatrix<f64, S, S> = blocks.iter().map(|block| block.shared).sum();
    let mut matrix = damped(&all, damping);
    let mut right: SVector<f64, S> = -blocks
        .iter()
        .map(|block| block.shared_gradient)
        .sum::<SVector<f64, S>>();
    for block in blocks {
        let own = inverse(&damped(&block.own, damping))?;
        let weighted = block.mixed * own;
        matrix -= weighted * block.mixed.transpose();
        right += weighted * block.own_gradient;
    }
    Some((matrix, right))
}

/// Marquardt's damping.
fn damped<const N: usize>(matrix: &SMatrix<f64, N, N>, damping: f64) -> SMatrix<f64, N, N> {
    let mut damped = *matrix;
    for i in 0..N {
        damped[(i, i)] *= 1.0 + damping;
    }
    damped
}

/// Unit lengths for unknowns of very different units; 0 for one that no residual depends on, NaN where
/// rounding has left less than nothing, so that no solution is found.
fn lengths<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SVector<f64, N> {
    matrix
        .diagonal()
        .map(|d| if d == 0.0 { 0.0 } else { 1.0 / d.sqrt() })
}

/// The matrix with unit diagonal, unknowns without any say decoupled.
fn scaled<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    lengths: &SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(|i, j| match (i == j, lengths[i] * lengths[j]) {
        (true, _) => 1.0,
        (false, length) => matrix[(i, j)] * length,
    })
}

fn solve<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    right: &SVector<f64, N>,
) -> Option<SVector<f64, N>> {
    let lengths = lengths(matrix);
    let factors = scaled(matrix, &lengths).cholesky()?;
    let solution = factors.solve(&right.component_mul(&lengths));
    let found = solution.component_mul(&lengths);
    found.iter().all(|x| x.is_finite()).then_some(found)
}

fn inverse<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let lengths = lengths(matrix);
    let inverse = scaled(matrix, &lengths).cholesky()?.inverse();
    let found: SMatrix<f64, N, N> =
        SMatrix::from_fn(|i, j| inverse[(i, j)] * lengths[i] * lengths[j]);
    found.iter().all(|x| x.is_finite()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Decays `y = a exp(−b x) + c_i` with shared a and b, an offset a block.
    struct Decays {
        samples: Vec<Vec<(f64, f64)>>,
        hold_rate: bool,
    }

    impl Arrow<2, 1> for Decays {
        type State = ([f64; 2], Vec<f64>);

        fn blocks(&self) -> usize {
            self.samples.len()
        }

        fn linearise(&self, ([a, b], offsets): &Self::State, block: usize) -> Option<Block<2, 1>> {
            let mut found = Block::empty();
            for &(x, y) in &self.samples[block] {
                let e = (-b * x).exp();
                let rate = if self.hold_rate { 0.0 } else { -a * x * e };
                found.add(
                    a * e + offsets[block] - y,
                    &SVector::from([e, rate]),
                    &SVector::from([1.0]),
                );
            }
            Some(found)
        }

        fn moved(
            &self,
            ([a, b], offsets): &Self::State,
            shared: &SVector<f64, 2>,
            own: &[SVector<f64, 1>],
        ) -> Self::State {
            let offsets = offsets.iter().zip(own).map(|(c, o)| c + o[0]).collect();
            ([a + shared[0], b + shared[1]], offsets)
        }
    }

    fn decays(noise: f64) -> Decays {
        let sample = |i: usize, block: usize| {
            let x = i as f64 * 0.2;
            let ripple = noise * ((7 * i + 3 * block) as f64).sin();
            (x, 2.0 * (-0.7 * x).exp() + block as f64 + ripple)
        };
        Decays {
            samples: (0..4)
                .map(|block| (0..20).map(|i| sample(i, block)).collect())
                .collect(),
            hold_rate: false,
        }
    }

    #[test]
    fn exact_samples_are_explained_exactly() {
        let found = minimise(&decays(0.0), ([1.0, 0.1], vec![0.0; 4]), 100).unwrap();
        let ([a, b], offsets) = found.state;
        assert!(
            (a - 2.0).abs() < 1e-10 && (b - 0.7).abs() < 1e-10,
            "{a} {b}"
        );
        assert!((offsets[3] - 3.0).abs() < 1e-10);
        assert_ne!(found.stop, Stop::IterationLimit);
    }

    #[test]
    fn held_unknowns_stay_and_have_no_variance() {
        let mut problem = decays(0.01);
        problem.hold_rate = true;
        let found = minimise(&problem, ([1.0, 0.5], vec![0.0; 4]), 100).unwrap();
        assert_eq!(found.state.0[1], 0.5);
        let covariance = found.shared_covariance.unwrap();
        assert_eq!(covariance[(1, 1)], 0.0);
        assert!(covariance[(0, 0)] > 0.0);
    }

    #[test]
    fn covariance_is_the_inverse_of_the_whole_matrix() {
        let problem = decays(0.02);
        let found = minimise(&problem, ([1.0, 0.1], vec![0.0; 4]), 100).unwrap();
        // The same equations without their shape: a, b and four offsets.
        let mut whole = nalgebra::Matrix6::<f64>::zeros();
        let ([a, b], _) = found.state;
        for (block, samples) in problem.samples.iter().enumerate() {
            for &(x, _) in samples {
                let e = (-b * x).exp();
                let mut row = nalgebra::Vector6::zeros();
                (row[0], row[1], row[2 + block]) = (e, -a * x * e, 1.0);
                whole += row * row.transpose();
            }
        }
        let inverse = whole.try_inverse().unwrap();
        let covariance = found.shared_covariance.unwrap();
        for i in 0..2 {
            for j in 0..2 {
                assert!((covariance[(i, j)] - inverse[(i, j)]).abs() < 1e-9);
            }
        }
    }
}
