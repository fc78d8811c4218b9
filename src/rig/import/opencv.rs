//! The lens in an OpenCV FileStorage.
//!
//! OpenCV counts pixels from the centre of the first one, so half a pixel is added to the principal point.

use super::opencv_store::{Entry, Store};
use super::{ImportChoices, ImportProblem, Imported, Parsed, side};
use crate::rig::{Distortion, Intrinsics, Lens};

/// What programs call the camera matrix, the common names first.
const MATRIX_NAMES: [&str; 9] = [
    "camera_matrix",
    "cameraMatrix",
    "Camera_Matrix",
    "CameraMatrix",
    "K",
    "M",
    "M1",
    "intrinsics",
    "intrinsic_matrix",
];
/// And the distortion.
const DISTORTION_NAMES: [&str; 11] = [
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distortionCoefficients",
    "dist_coeffs",
    "dist_coeff",
    "distCoeffs",
    "distCoeff",
    "distortion",
    "dist",
    "D",
    "D1",
];
const WIDTH_NAMES: [&str; 5] = [
    "image_width",
    "imageWidth",
    "image_Width",
    "width",
    "frameWidth",
];
const HEIGHT_NAMES: [&str; 5] = [
    "image_height",
    "imageHeight",
    "image_Height",
    "height",
    "frameHeight",
];
const SIZE_NAMES: [&str; 4] = ["image_size", "imageSize", "image_Size", "resolution"];

/// Reads the lens.
pub(super) fn read(store: &Store, choices: &ImportChoices) -> Parsed<Imported> {
    refuse_fisheye(store)?;
    let (matrix_name, numbers) = match &choices.keys {
        Some((name, _)) => named(store, name)?,
        None => MATRIX_NAMES
            .iter()
            .find_map(|name| matrix(store, name))
            .ok_or_else(|| {
                let remedy = format!(
                    "this file has {}; give the names of camera matrix and distortion with --keys MATRIX,DISTORTION",
                    names(store)
                );
                ImportProblem::missing("camera_matrix", remedy)
            })?,
    };
    let (distortion_name, coefficients) = match &choices.keys {
        Some((_, name)) => named(store, name)?,
        // A lens without distortion may be written without any.
        None => DISTORTION_NAMES
            .iter()
            .find_map(|name| matrix(store, name))
            .unwrap_or(("distortion_coefficients", &[][..])),
    };
    let (width, height) = size(store, choices)?;
    let lens = Lens {
        width,
        height,
        intrinsics: intrinsics(matrix_name, numbers)?,
        distortion: distortion(distortion_name, coefficients)?,
    };
    lens.check()
        .map_err(|error| ImportProblem::lens(&error, ""))?;
    Ok(Imported {
        format: "OpenCV",
        lens,
        shots: Vec::new(),
        up: None,
    })
}

fn find<'s>(store: &'s Store, name: &str) -> Option<(&'s str, &'s Entry)> {
    let (key, entry) = store.iter().find(|(key, _)| key == name)?;
    Some((key, entry))
}

/// The numbers of a matrix, with or without its own name for them.
fn matrix<'s>(store: &'s Store, name: &str) -> Option<(&'s str, &'s [f64])> {
    let entry = find(store, &format!("{name}.data")).or_else(|| find(store, name));
    match entry {
        Some((key, Entry::Numbers(numbers))) => Some((key, numbers)),
        _ => None,
    }
}

fn named<'s>(store: &'s Store, name: &str) -> Parsed<(&'s str, &'s [f64])> {
    matrix(store, name)
        .ok_or_else(|| ImportProblem::missing(name, format!("this file has {}", names(store))))
}

/// The file's lists of numbers.
fn names(store: &Store) -> String {
    let names: Vec<&str> = store
        .iter()
        .filter(|(_, entry)| matches!(entry, Entry::Numbers(n) if n.len() > 1))
        .map(|(key, _)| key.strip_suffix(".data").unwrap_or(key))
        .take(12)
        .collect();
    if names.is_empty() {
        "no matrices".to_owned()
    } else {
        format!("the matrices {}", names.join(", "))
    }
}

fn refuse_fisheye(store: &Store) -> Parsed<()> {
    const REMEDY: &str =
        "OpenCV's model of five coefficients; calibrate with `turnlight camera calibrate`";
    if let Some((key, Entry::Numbers(numbers))) = find(store, "fisheye_model")
        && numbers.first().is_some_and(|flag| *flag != 0.0)
    {
        return Err(ImportProblem::value(
            key,
            numbers[0],
            format!("0: {REMEDY}"),
        ));
    }
    match find(store, "distortion_model") {
        Some((key, Entry::Text(model)))
            if model != "plumb_bob" && model != "rational_polynomial" =>
        {
            Err(ImportProblem::value(
                key,
                model,
                format!("plumb_bob: {REMEDY}"),
            ))
        }
        _ => Ok(()),
    }
}

fn size(store: &Store, choices: &ImportChoices) -> Parsed<(usize, usize)> {
    let single = |names: &[&str]| {
        names.iter().find_map(|name| match find(store, name) {
            Some((key, Entry::Numbers(numbers))) if numbers.len() == 1 => Some((key, numbers[0])),
            _ => None,
        })
    };
    let pair = SIZE_NAMES.iter().find_map(|name| match find(store, name) {
        Some((key, Entry::Numbers(numbers))) if numbers.len() == 2 => {
            Some(((key, numbers[0]), (key, numbers[1])))
        }
        _ => None,
    });
    if let Some(size) = choices.size {
        return Ok(size);
    }
    match (single(&WIDTH_NAMES), single(&HEIGHT_NAMES), pair) {
        (Some(width), Some(height), _) | (_, _, Some((width, height))) => {
            Ok((side(width.0, width.1)?, side(height.0, height.1)?))
        }
        _ => Err(ImportProblem::missing(
            "image_width and image_height",
            "give the size of the calibrated images with --size WIDTHxHEIGHT",
        )),
    }
}

fn intrinsics(name: &str, matrix: &[f64]) -> Parsed<Intrinsics> {
    let [fx, skew, cx, zero, fy, cy, rest @ ..] = matrix else {
        let requirement = "9 numbers, row by row: fx 0 cx, 0 fy cy, 0 0 1";
        return Err(ImportProblem::value(
            name,
            format!("{} numbers", matrix.len()),
            requirement,
        ));
    };
    if rest != [0.0, 0.0, 1.0] || *zero != 0.0 {
        let requirement = "fx 0 cx, 0 fy cy, 0 0 1, row by row";
        return Err(ImportProblem::value(
            name,
            format!("{matrix:?}"),
            requirement,
        ));
    }
    // A skew of a millionth of a pixel is rounding; more is another lens.
    if !(skew.is_finite() && skew.abs() <= 1e-6) {
        let requirement = "0, since turnlight's pixels are not skewed; calibrate without skew";
        return Err(ImportProblem::value(
            format!("{name}[0][1]"),
            skew,
            requirement,
        ));
    }
    Ok(Intrinsics {
        fx: *fx,
        fy: *fy,
        cx: cx + 0.5,
        cy: cy + 0.5,
    })
}

/// OpenCV's coefficients are k1, k2, p1, p2 and, where there are more, k3, k4…
fn distortion(name: &str, coefficients: &[f64]) -> Parsed<Distortion> {
    if ![0, 4, 5, 8, 12, 14].contains(&coefficients.len()) {
        let requirement = "4, 5, 8, 12 or 14 coefficients, as OpenCV has them";
        return Err(ImportProblem::value(
            name,
            format!("{} numbers", coefficients.len()),
            requirement,
        ));
    }
    if let Some((i, value)) = coefficients
        .iter()
        .enumerate()
        .skip(5)
        .find(|(_, k)| **k != 0.0)
    {
        let requirement = "0: turnlight's lens has k1, k2, p1, p2, k3; calibrate without \
                           CALIB_RATIONAL_MODEL, CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL";
        return Err(ImportProblem::value(
            format!("{name}[{i}]"),
            value,
            requirement,
        ));
    }
    let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
    Ok(Distortion {
        k1: at(0),
        k2: at(1),
        p1: at(2),
        p2: at(3),
        k3: at(4),
    })
}
