//! Any shape, size and place.

use super::*;

/// `surface` in other units, moved.
fn placed(surface: &Surface, scale: f64, offset: DVec3) -> Surface {
    let positions = surface
        .positions
        .iter()
        .map(|p| *p * scale + offset)
        .collect();
    Surface {
        positions,
        ..surface.clone()
    }
}

/// The cup seen by a camera that goes where the cup goes.
fn seen_at(scale: f64, offset: DVec3) -> RenderedFrame {
    let mut setup = Setup::new(&placed(&cup(), scale, offset), &lamp_and_sky(), PLASTIC);
    setup.seen.position = setup.seen.position * scale + offset;
    setup.seen.look_at = setup.seen.look_at * scale + offset;
    setup.render(8, 3)
}

#[test]
fn size_leaves_the_image() {
    let plain = seen_at(1.0, DVec3::ZERO);
    for scale in [1e-6, 0.001, 39.37, 1e6] {
        let off = difference(&plain, &seen_at(scale, DVec3::ZERO));
        assert!(off < 1e-3, "scale {scale}: {off}");
    }
}

#[test]
fn place_leaves_the_image() {
    let plain = seen_at(1.0, DVec3::ZERO);
    for (scale, direction) in [
        (1.0, DVec3::new(1.0, -0.7, 0.3)),
        (1.0, DVec3::NEG_Z),
        (1e-6, DVec3::Y),
        (1e6, DVec3::new(-0.3, 0.2, 1.0)),
    ] {
        // A million sizes of the cup, which is 2 across; the camera goes along.
        let offset = 2e6 * scale * direction;
        let off = difference(&plain, &seen_at(scale, offset));
        assert!(off < 1e-3, "camera along, scale {scale} {direction}: {off}");

        // The file's place is taken back by the scene.
        let mut setup = Setup::new(&placed(&cup(), scale, offset), &lamp_and_sky(), PLASTIC);
        let back = (-offset / scale).to_array();
        setup.object = format!("scale = {:?}\ntranslation = {back:?}", 1.0 / scale);
        let off = difference(&plain, &setup.render(8, 3));
        assert!(off < 1e-3, "taken back, scale {scale} {direction}: {off}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn any_size_and_place_leave_the_image(
        exponent in -6.0..6.0f64, far in 0.0..6.3f64, x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64,
    ) {
        let scale = 10f64.powf(exponent);
        let offset = scale * 10f64.powf(far) * DVec3::new(x, y, z);
        let off = difference(&seen_at(1.0, DVec3::ZERO), &seen_at(scale, offset));
        prop_assert!(off < 1e-3, "{off}");
    }
}

#[test]
fn defects_that_are_mended_leave_the_image() {
    let clean = sphere(12);
    let image = |surface: &Surface| Setup::new(surface, &lamp_and_sky(), PLASTIC).render(4, 2);
    let plain = image(&clean);
    let stray = clean.positions.len() as u32;
    let add = |triangles: &[[u32; 3]], positions: &[DVec3]| {
        let mut surface = clean.clone();
        surface.triangles.extend(triangles);
        surface.positions.extend(positions);
        surface
    };
    let inside_out = |triangles: &mut [[u32; 3]]| triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let mut one_inverted = clean.clone();
    inside_out(&mut one_inverted.triangles[100..101]);
    let mut inverted = clean.clone();
    inside_out(&mut inverted.triangles);
    let [a, b, _] = clean.triangles[50];
    for (defect, surface) in [
        ("zero-area", add(&[[a, b, b], [a, a, a]], &[])),
        ("duplicate", add(&clean.triangles[10..30], &[])),
        ("one inverted", one_inverted),
        ("all inverted", inverted),
        ("NaN vertex", add(&[[a, b, stray]], &[DVec3::NAN])),
        (
            "infinite vertex",
            add(&[[a, b, stray]], &[DVec3::new(0.0, f64::INFINITY, 0.0)]),
        ),
        ("stray vertex", add(&[], &[DVec3::splat(1e9)])),
    ] {
        let off = difference(&plain, &image(&surface));
        assert!(off < 1e-3, "{defect}: {off}");
    }
}

#[test]
fn surfaces_that_are_no_solid_render_finite() {
    let ball = sphere(12);
    let half = ball.triangles.len() / 2;
    let open = Surface {
        triangles: ball.triangles[..half].to_vec(),
        ..ball.clone()
    };
    let mut finned = ball.clone();
    finned.triangles.push([
        ball.triangles[60][0],
        ball.triangles[60][1],
        ball.positions.len() as u32,
    ]);
    finned
        .positions
        .push(1.5 * ball.positions[ball.triangles[60][0] as usize]);
    let triangle = Surface {
        positions: vec![
            DVec3::new(-1.0, -1.0, 0.0),
            DVec3::new(1.0, -1.0, 0.0),
            DVec3::Y,
        ],
        triangles: vec![[0, 1, 2]],
        ..Surface::default()
    };
    // Two sheets in one place, and a needle whose height is a millionth of its length.
    let mut double = plate(1.0);
    double.triangles.extend([[0, 2, 1], [0, 3, 2]]);
    let mut needle = triangle.clone();
    needle.positions.push(DVec3::new(0.0, -1.0 - 2e-6, 0.0));
    needle.triangles.push([1, 0, 3]);
    for (kind, surface) in [
        ("open", open),
        ("non-manifold", finned),
        ("one triangle", triangle),
        ("two-sided sheet", double),
        ("needle", needle),
    ] {
        let (mean, _) = inside(&Setup::new(&surface, &lamp_and_sky(), PLASTIC).render(4, 3));
        assert!(mean > 0.0 && mean < 100.0, "{kind}: {mean}");
    }
}

#[test]
fn a_million_triangles_render_as_a_sphere() {
    let surface = sphere(354);
    assert!(surface.triangles.len() > 1_000_000);
    let setup = Setup::new(&surface, &grey(8, 4, 1.0), WHITE);
    let started = Instant::now();
    let (mean, _) = inside(&setup.render(4, 1));
    let seconds = started.elapsed().as_secs_f64();
    assert!((mean - 1.0).abs() < 1e-3, "{mean}");
    // Ten times what one slow core needs in a release build; something is quadratic if it fails.
    assert!(
        seconds < if cfg!(debug_assertions) { 200.0 } else { 20.0 },
        "{seconds} s"
    );
}
