"""Do two renderers agree? Welch's test on every pixel or tile, corrected for their number.

    z = (mean_a - mean_b) / sqrt(var_a / n_a + var_b / n_b),   p two-sided from Student's t
    with the Welch-Satterthwaite degrees of freedom

(Jung, Hanika and Dachsbacher, JCGT 2020). With n tests a family-wise significance s asks
each for p < 1 - (1 - s)^(1/n) (Sidak). Colour channels share their samples (correlation
0.93 to 0.98 in Mitsuba): tested together, Sidak's threshold is on the safe side, but the
p-values are not independent, so whether they are uniform is judged on green alone.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

# Both renderers compute in float32, so differences of this relative size carry no meaning.
ROUNDING = 1e-6


@dataclass
class Agreement:
    tests: int  # pixels or tiles x channels, those that are black in both left out
    threshold: float  # Sidak's, for each test
    rejected: int
    smallest_p: float
    family_p: float  # of the smallest, corrected: 1 - (1 - p)^tests
    worst: tuple  # (row, column, channel) of the smallest
    worst_z: float
    uniform_p: float  # Kolmogorov-Smirnov: are the p-values uniform?
    mean_ratio: float  # of the whole images, a / b
    z: np.ndarray  # for a picture of where they differ

    @property
    def accepted(self):
        """No test rejected at the family's significance."""
        return self.rejected == 0

    @property
    def accepted_fraction(self):
        return 1.0 - self.rejected / self.tests

    def __str__(self):
        return (
            f"{self.rejected} of {self.tests} rejected; family p {self.family_p:.3g} "
            f"(z {self.worst_z:+.2f} at {self.worst}); p-values uniform: {self.uniform_p:.3g}; "
            f"mean ratio {self.mean_ratio:.6f}"
        )


def sidak_threshold(significance, tests):
    return -np.expm1(np.log1p(-significance) / tests)


def z_and_p(a, b, tolerance=0.0):
    """z and two-sided p of Moments a against b; NaN where both are exactly equal.

    `tolerance` is the relative difference that counts as agreement, for known differences
    of the two models: then z measures the excess, and p is an upper bound.
    """
    difference = a.mean - b.mean
    allowed = tolerance * np.maximum(np.abs(a.mean), np.abs(b.mean))
    excess = np.sign(difference) * np.maximum(np.abs(difference) - allowed, 0.0)
    rounding = ROUNDING * np.maximum(np.abs(a.mean), np.abs(b.mean))
    va, vb = a.variance_of_mean + rounding**2, b.variance_of_mean + rounding**2
    with np.errstate(divide="ignore", invalid="ignore"):
        z = excess / np.sqrt(va + vb)
        freedom = (va + vb) ** 2 / (va**2 / (a.count - 1) + vb**2 / (b.count - 1))
    return z, 2.0 * stats.t.sf(np.abs(z), freedom)


def compare(a, b, significance=0.01, tolerance=0.0):
    """Agreement of Moments `a` and `b`, which must be of the same tile size."""
    if a.mean.shape != b.mean.shape:
        raise ValueError(f"shapes differ: {a.mean.shape} and {b.mean.shape}")
    z, p = z_and_p(a, b, tolerance)
    used = np.isfinite(p)
    tests = int(used.sum())
    if tests == 0:
        raise ValueError("both images are black everywhere")
    threshold = sidak_threshold(significance, tests)
    smallest = float(p[used].min())
    worst = np.unravel_index(np.nanargmin(p), p.shape)
    one_channel = p[..., p.shape[-1] // 2]  # the middle one, green
    return Agreement(
        tests=tests,
        threshold=float(threshold),
        rejected=int((p[used] < threshold).sum()),
        smallest_p=smallest,
        family_p=float(-np.expm1(tests * np.log1p(-min(smallest, 1 - 1e-16)))),
        worst=tuple(int(k) for k in worst),
        worst_z=float(z[worst]),
        uniform_p=float(stats.kstest(one_channel[np.isfinite(one_channel)], "uniform").pvalue),
        mean_ratio=float(a.mean.mean() / b.mean.mean()) if b.mean.any() else np.inf,
        z=z,
    )
