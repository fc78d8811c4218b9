//! Captures that say little: a fit ends with what is known.

use turnlight::export::PointTable;

use super::*;
use crate::command::{succeeds, text};

/// Renders `setup` and fits it; the points, of which every number is finite or says that nothing is known.
fn fitted(setup: &Setup) -> PointTable {
    let (capture, fit) = (
        setup.folder.path().join("capture"),
        setup.folder.path().join("fit"),
    );
    succeeds(&[
        "render",
        text(&setup.write()),
        "--out",
        text(&capture),
        "--spp",
        "16",
        "--quiet",
    ]);
    let said = succeeds(&["fit", text(&capture), "--out", text(&fit), "--quiet"]);
    assert!(!said.contains("panicked"), "{said}");
    let table = PointTable::read_npz(&fit.join("points.npz")).unwrap();
    for i in 0..table.len() {
        let known = [table.rho_d[i], table.rho_s[i]];
        assert!(
            known
                .as_flattened()
                .iter()
                .all(|v| v.is_finite() && *v >= 0.0)
                && table.alpha[i] > 0.0
                && table.alpha[i] <= 1.0
                && !table.sigma_alpha[i].is_nan()
                && !table.sigma_rho_s[i].is_nan()
                && table.sigma_rho_d[i].iter().all(|v| !v.is_nan())
                && table.residual[i].is_finite()
                && (0..=5).contains(&table.status[i]),
            "point {i} of status {}",
            table.status[i]
        );
    }
    // The estimate can be rendered.
    let again = setup.folder.path().join("again");
    succeeds(&[
        "reproduce",
        text(&fit),
        "--out",
        text(&again),
        "--spp",
        "1",
        "--quiet",
    ]);
    let image = RgbImage::read(&again.join("images/0000.exr")).unwrap();
    assert!(image.pixels.as_flattened().iter().all(|v| v.is_finite()));
    table
}

/// How many points ended with each status.
fn endings(table: &PointTable) -> [usize; 6] {
    let mut counts = [0; 6];
    table
        .status
        .iter()
        .for_each(|&code| counts[code as usize] += 1);
    counts
}

fn turning(probe: &RgbImage, frames: usize, sensor: &str) -> Setup {
    let mut setup = Setup::new(&sphere(6), probe, PLASTIC);
    setup.sections = format!("[turntable]\nframes = {frames}\n{sensor}");
    setup
}

#[test]
fn few_frames_are_fitted_with_a_status() {
    for frames in [1, 2] {
        let [.., unseen, _] = endings(&fitted(&turning(&lamp_and_sky(), frames, "")));
        assert!(
            unseen > 10,
            "{frames} frames: half of the sphere is never seen"
        );
    }
}

#[test]
fn saturated_samples_are_no_data() {
    let sensor = "[sensor]\nfull_well_electrons = 30000.0\nread_noise_electrons = 5.0\nbits = 12\nexposure = 1e6\n";
    let [converged, unidentifiable, at_bound, few, unseen, saturated] =
        // Light without a lamp: what a facet of so coarse a sphere hides of one can leave a pixel black.
        endings(&fitted(&turning(&grey(8, 4, 1.0), 6, sensor)));
    assert_eq!(
        (converged, unidentifiable, at_bound, few),
        (0, 0, 0, 0),
        "{unseen} unseen"
    );
    assert!(saturated > 50, "{saturated} saturated, {unseen} unseen");
}

#[test]
fn collinear_traces_are_mostly_unidentifiable() {
    // A plate seen from straight above in light from everywhere: neither answer ever changes, and they are
    // multiples of each other.
    let mut setup = Setup::new(&tiles(8), &grey(1, 1, 1.0), PLASTIC);
    setup.seen.position = DVec3::new(0.0, 40.0, 0.0);
    setup.seen.fov_x_deg = 3.0;
    setup.sections = "up = [0.0, 0.0, 1.0]\n[turntable]\nframes = 6\n".to_owned();
    let [converged, unidentifiable, at_bound, ..] = endings(&fitted(&setup));
    // Noise fits a lobe now and then: at this seed one point of 79.
    assert!(
        unidentifiable > 25 * (converged + at_bound),
        "{unidentifiable}, {converged} converged, {at_bound} at the bound of alpha"
    );
}

#[test]
fn darkness_tells_nothing() {
    let [converged, unidentifiable, at_bound, ..] =
        endings(&fitted(&turning(&grey(4, 2, 0.0), 3, "")));
    assert_eq!(
        (converged, at_bound),
        (0, 0),
        "{unidentifiable} unidentifiable"
    );
}
