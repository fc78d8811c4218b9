//! Laws of the colour match.

use proptest::prelude::*;
use rand_distr::{Distribution, Normal};
use rand_pcg::{Pcg64Mcg as Pcg64, rand_core::SeedableRng};

use super::*;

/// Sharma, Wu and Dalal 2005, Table 1 (pairs that turn every corner of the formula).
#[test]
fn delta_e_gives_the_published_pairs() {
    let lab = |[l, a, b]: [f64; 3]| Lab { l, a, b };
    for (p, q, expected) in [
        ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
        ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0009], 7.1792),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0011], 7.2195),
        ([50.0, -0.001, 2.49], [50.0, 0.0009, -2.49], 4.8045),
        ([50.0, 2.5, 0.0], [50.0, 0.0, -2.5], 4.3065),
        ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
        (
            [60.2574, -34.0099, 36.2677],
            [60.4626, -34.1751, 39.4387],
            1.2644,
        ),
        (
            [22.7233, 20.0904, -46.694],
            [23.0331, 14.973, -42.5619],
            2.0373,
        ),
        (
            [90.8027, -2.0831, 1.441],
            [91.1528, -1.6435, 0.0447],
            1.4441,
        ),
        ([2.0776, 0.0795, -1.135], [0.9033, -0.0636, -0.5514], 0.9082),
    ] {
        let found = delta_e_2000(lab(p), lab(q));
        assert!(
            (found - expected).abs() < 1e-4,
            "{p:?} {q:?} {found} {expected}"
        );
        assert!((delta_e_2000(lab(q), lab(p)) - expected).abs() < 1e-4);
    }
}

/// What a camera of other primaries makes of the ColorChecker.
fn other_camera(noise: f64, tone: impl Fn(f64) -> f64) -> Chart {
    let matrix = [[0.62, 0.30, 0.05], [0.18, 0.75, 0.10], [0.02, 0.15, 0.58]];
    let mut random = Pcg64::seed_from_u64(7);
    let normal = Normal::new(0.0, noise).unwrap();
    let patches = Chart::colorchecker().patches;
    let patches = patches.into_iter().map(|p| Patch {
        rgb: matrix.map(|row| {
            let x: f64 = row.iter().zip(p.rgb).map(|(m, c)| m * c).sum();
            tone((x * (1.0 + normal.sample(&mut random))).max(0.0))
        }),
        ..p
    });
    Chart {
        patches: patches.collect(),
    }
}

#[test]
fn simulated_chart_is_matched() {
    let found = match_colours(
        &other_camera(0.01, |x| x),
        &Chart::colorchecker(),
        None,
        6.0,
    )
    .unwrap();
    println!(
        "mean {:.3}, left out {:.3}",
        found.mean(),
        found.mean_without()
    );
    assert!(found.mean() < 1.0 && found.mean_without() < 2.0);
}

#[test]
fn greys_linearise_a_tone_curve() {
    let tone = |x: f64| {
        let v = crate::image::srgb_encode(x.min(1.0));
        0.7 * v + 0.3 * v * v * (3.0 - 2.0 * v)
    };
    let greys: Vec<(f64, [f64; 3])> = [0.03, 0.09, 0.19, 0.36, 0.58, 0.9]
        .map(|y| (y, [tone(y * 0.97), tone(y * 1.03), tone(y * 0.75)]))
        .to_vec();
    let curve = GreyCurve::through(&greys).unwrap();
    let probe = other_camera(0.005, tone);
    let with = match_colours(&probe, &Chart::colorchecker(), Some(curve), 6.0).unwrap();
    let without = match_colours(&probe, &Chart::colorchecker(), None, 100.0).unwrap();
    println!("with {:.2}, without {:.2}", with.mean(), without.mean());
    assert!(with.mean() < 2.0 && without.mean() > 2.0 * with.mean());
}

#[test]
fn nonsense_is_refused_with_its_remedy() {
    let reference = Chart::colorchecker();
    let error = |probe: &Chart| {
        match_colours(probe, &reference, None, 6.0)
            .unwrap_err()
            .to_string()
    };
    let mut turned = other_camera(0.0, |x| x);
    turned.patches.reverse();
    assert!(error(&turned).contains("half a turn"));
    let mut shuffled = other_camera(0.0, |x| x);
    shuffled.patches.swap(2, 14);
    shuffled.patches.swap(5, 9);
    shuffled.patches.swap(0, 18);
    assert!(error(&shuffled).contains("same order"));
    let mut grey = other_camera(0.0, |x| x);
    grey.patches.iter_mut().for_each(|p| p.rgb = [p.rgb[1]; 3]);
    assert!(error(&grey).contains("of one colour"));
    let mut short = other_camera(0.0, |x| x);
    short.patches.truncate(20);
    assert!(error(&short).contains("20 patches"));
    let swap = |chart: Chart| Chart {
        patches: chart
            .patches
            .into_iter()
            .map(|p| Patch {
                rgb: [p.rgb[1], p.rgb[0], p.rgb[2]],
                ..p
            })
            .collect(),
    };
    assert!(error(&swap(reference.clone())).contains("in this order"));
    for wrong in [
        vec![],
        vec![(0.1, [0.1; 3]), (0.2, [0.1; 3]), (0.4, [0.4; 3])],
        vec![(0.1, [0.1; 3]), (0.2, [0.05; 3]), (0.4, [0.4; 3])],
        vec![(0.1, [0.0; 3]), (0.2, [0.2; 3]), (0.4, [0.4; 3])],
    ] {
        assert!(GreyCurve::through(&wrong).is_err());
    }
}

#[test]
fn patches_are_read_where_they_are() {
    // A chart seen at an angle: every patch a flat square of its own value.
    let corners = [[20.0, 15.0], [170.0, 25.0], [160.0, 110.0], [30.0, 95.0]];
    let image = crate::image::RgbImage::from_fn(200, 130, |x, y| {
        // The nearest patch, by brute force over the same projection.
        let mut best = (f64::INFINITY, 0);
        for i in 0..24 {
            let (u, v) = ((i % 6) as f64 / 5.0, (i / 6) as f64 / 3.0);
            let (px, py) = chart::projection(corners)(u, v);
            let d = (px - x as f64 - 0.5).powi(2) + (py - y as f64 - 0.5).powi(2);
            if d < best.0 {
                best = (d, i)
            }
        }
        [best.1 as f32 / 30.0, 0.5, 0.1]
    });
    let chart = Chart::sample("c.png".as_ref(), &image, corners, (6, 4), true).unwrap();
    for (i, patch) in chart.patches.iter().enumerate() {
        assert!(
            (patch.rgb[0] - i as f64 / 30.0).abs() < 1e-6,
            "{i} {patch:?}"
        );
    }
    let outside = [[20.0, 15.0], [260.0, 25.0], [160.0, 110.0], [30.0, 95.0]];
    let error = Chart::sample("c.png".as_ref(), &image, outside, (6, 4), true).unwrap_err();
    assert!(error.to_string().contains("c.png: patch"), "{error}");
}

proptest! {
    #[test]
    fn curve_grows_and_inverts_a_power(gamma in 0.4f64..3.0, a in 0.01f64..0.9, b in 0.01f64..0.9) {
        let greys: Vec<(f64, [f64; 3])> =
            [0.04, 0.1, 0.2, 0.5, 0.9].map(|y: f64| (y, [y.powf(1.0 / gamma); 3])).to_vec();
        let curve = GreyCurve::through(&greys).unwrap();
        let f = |v| curve.linearise(1, v);
        prop_assert!((f(a) / a.powf(gamma) - 1.0).abs() < 1e-9);
        prop_assert!((a < b) == (f(a) < f(b)) || a == b);
    }
}
