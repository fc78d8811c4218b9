//! What `turnlight probe` reads: photographs with EXIF, raw files, responses, charts, greys.

use std::path::Path;

use turnlight::image::{Exposure, RgbImage};
use turnlight::probe::{Chart, GreyCurve, Response};

use super::mutate::Form;
use super::photographs::{dng, with_exif};
use super::room::{FLAT, TAGGED};
use super::{Outcome, Parser, fuzz, seeds};

#[test]
fn exif_is_read_or_refused() {
    let seeds = seeds::photographs();
    let jpegs = [(1, 250), (4, 1)].map(|seconds| with_exif(&seeds[0], seconds));
    let read = |path: &Path| {
        let exposure = Exposure::read(path).map_err(|e| e.to_string())?;
        for value in [exposure.seconds, exposure.f_number, exposure.iso] {
            assert!(value.is_none_or(|v| v.is_finite() && v > 0.0), "{value:?}");
        }
        Ok(())
    };
    fuzz(
        Parser {
            name: "exif",
            file: "bracket.jpg",
            form: Form::Binary,
            seeds: jpegs.into(),
            room: FLAT,
            inputs: 6_000,
        },
        |_| (),
        read,
    );
}

#[test]
#[cfg(feature = "raw")]
fn raw_is_read_or_refused() {
    let read = |path: &Path| -> Outcome {
        let image = RgbImage::read(path).map_err(|e| e.to_string())?;
        assert_eq!(image.pixels.len(), image.width * image.height);
        Ok(())
    };
    fuzz(
        Parser {
            name: "raw",
            file: "frame.dng",
            form: Form::Binary,
            seeds: vec![dng(16, 12, |x, y| 1000 + 100 * x + 7 * y)],
            room: TAGGED,
            inputs: 4_000,
        },
        |_| (),
        read,
    );
}

#[test]
fn response_csv_is_read_or_refused() {
    let read = |path: &Path| {
        let response = Response::read_csv(path).map_err(|e| e.to_string())?;
        for sample in [0.0, 0.3, 1.0] {
            let x = response.linearise(1, sample);
            assert!(x.is_finite() && x >= 0.0, "{x}");
        }
        Ok(())
    };
    fuzz(
        Parser {
            name: "response",
            file: "response.csv",
            form: Form::Text,
            seeds: vec![Response::srgb().to_csv().into()],
            room: FLAT,
            inputs: 2_000,
        },
        |_| (),
        read,
    );
}

#[test]
fn charts_and_greys_are_read_or_refused() {
    let greys = "N9.5,0.9,0.88,0.8\nN5,0.2,0.2,0.19\n0.05,0.03,0.03,0.03\n";
    let read = |path: &Path| {
        let chart = Chart::read_csv(path).map_err(|e| e.to_string())?;
        let sound = |c: &f64| c.is_finite() && *c >= 0.0;
        assert!(chart.patches.iter().all(|p| p.rgb.iter().all(sound)));
        let _ = turnlight::probe::match_colours(&chart, &chart, None, 10.0);
        let curve = GreyCurve::read_csv(path).map_err(|e| e.to_string())?;
        assert!(curve.linearise(0, 0.5) >= 0.0);
        Ok(())
    };
    fuzz(
        Parser {
            name: "chart",
            file: "chart.csv",
            form: Form::Text,
            seeds: vec![greys.into()],
            room: FLAT,
            inputs: 4_000,
        },
        |_| (),
        read,
    );
}
