//! Adaptive quadrature in two variables, and coordinates in which a microfacet lobe of any width
//! is smooth.

use glam::{DVec2, DVec3};

/// Gauss–Legendre nodes on (0, 1) with their weights.
const GAUSS: [(f64, f64); 6] = [
    (0.033_765_242_898_423_99, 0.085_662_246_189_585_17),
    (0.169_395_306_766_867_74, 0.180_380_786_524_069_3),
    (0.380_690_406_958_401_54, 0.233_956_967_286_345_52),
    (0.619_309_593_041_598_5, 0.233_956_967_286_345_52),
    (0.830_604_693_233_132_3, 0.180_380_786_524_069_3),
    (0.966_234_757_101_576, 0.085_662_246_189_585_17),
];

/// `∫∫ f dx dy` over the box from `low` to `high`, to about `tolerance`.
pub(crate) fn integrate(
    f: &impl Fn(f64, f64) -> f64,
    low: DVec2,
    high: DVec2,
    tolerance: f64,
) -> f64 {
    let whole = gauss(f, low, high);
    refine(f, low, high, whole, tolerance, 9)
}

/// Splits a box in four until its parts add up to what the whole gave.
fn refine(
    f: &impl Fn(f64, f64) -> f64,
    low: DVec2,
    high: DVec2,
    whole: f64,
    tolerance: f64,
    depth: u32,
) -> f64 {
    let half = 0.5 * (high - low);
    let corners = [
        low,
        low + DVec2::new(half.x, 0.0),
        low + DVec2::new(0.0, half.y),
        low + half,
    ];
    let parts = corners.map(|corner| gauss(f, corner, corner + half));
    let sum: f64 = parts.iter().sum();
    if depth == 0 || (sum - whole).abs() <= tolerance {
        return sum;
    }
    corners
        .into_iter()
        .zip(parts)
        .map(|(corner, part)| refine(f, corner, corner + half, part, 0.5 * tolerance, depth - 1))
        .sum()
}

fn gauss(f: &impl Fn(f64, f64) -> f64, low: DVec2, high: DVec2) -> f64 {
    let size = high - low;
    let mut sum = 0.0;
    for (x, wx) in GAUSS {
        for (y, wy) in GAUSS {
            sum += wx * wy * f(low.x + size.x * x, low.y + size.y * y);
        }
    }
    sum * size.x * size.y
}

/// A microfacet normal at lobe coordinates `(s, phi)` and its Jacobian `dwm / (ds dphi)`.
///
/// `tan θ_m = alpha r` with `1 + r² = (1 − s²)^−2`, `s` in (0, 1). GGX's projected density is
/// polynomial in `s`, Beckmann's is smooth, and so is a diffuse lobe under a narrow specular one.
pub(crate) fn lobe_normal(alpha: f64, s: f64, phi: f64) -> (DVec3, f64) {
    let c = (1.0 - s) * (1.0 + s);
    let tan = alpha * (s * (2.0 - s * s).sqrt() / c);
    let cos = 1.0 / tan.hypot(1.0);
    let sin = tan * cos;
    let jacobian = alpha * alpha * cos * cos * cos * 2.0 * s / (c * c * c);
    (DVec3::new(sin * phi.cos(), sin * phi.sin(), cos), jacobian)
}
