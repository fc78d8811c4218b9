//! Which frames of two sequences belong together.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use super::CompareError;
use crate::scene::Capture;

const EXTENSIONS: [&str; 7] = ["exr", "hdr", "png", "jpg", "jpeg", "tif", "tiff"];

/// Files that belong together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FramePair {
    /// File name of the reference.
    pub name: String,
    /// Reference image.
    pub reference: PathBuf,
    /// Image compared with it.
    pub test: PathBuf,
    /// Mask of both.
    pub mask: Option<PathBuf>,
}

/// Pairs two image files, two folders of images, or two captures.
///
/// A folder that contains `images/` is a capture: its images are paired by their names, and its `masks/` used
/// unless `masks` is given (`a`'s before `b`'s). A capture whose photographs lie elsewhere, such as one that
/// `register` wrote, or have other names than those of the other, is paired by the order of the frames in
/// `capture.toml`, which may also be named itself; its frames name their masks. `masks` is one mask for every
/// frame, or a folder of masks named as the frames, up to the extension.
pub fn pair_frames(
    a: &Path,
    b: &Path,
    masks: Option<&Path>,
) -> Result<Vec<FramePair>, CompareError> {
    if let Some(missing) = [a, b].into_iter().find(|path| !path.exists()) {
        return Err(CompareError::Folder {
            path: missing.to_owned(),
            source: std::io::ErrorKind::NotFound.into(),
        });
    }
    let is_sequence = |path: &Path| path.is_dir() || is_capture_file(path);
    if is_sequence(a) != is_sequence(b) {
        return Err(CompareError::Kinds {
            a: a.to_owned(),
            b: b.to_owned(),
        });
    }
    if !is_sequence(a) {
        let pairs = vec![FramePair {
            name: file_name(a),
            reference: a.to_owned(),
            test: b.to_owned(),
            mask: None,
        }];
        return with_masks(pairs, a, masks);
    }
    if !names_its_photographs(a) && !names_its_photographs(b) {
        let pairs = match by_name(a, b) {
            Ok(pairs) => pairs,
            // Photographs keep the names that the camera gave them.
            Err(missing @ CompareError::Missing { .. }) => {
                return by_order(a, b, masks).unwrap_or(Err(missing));
            }
            Err(error) => return Err(error),
        };
        let own = [a, b]
            .into_iter()
            .map(|path| path.join("masks"))
            .find(|masks| masks.is_dir());
        return with_masks(pairs, &images_of(a), masks.or(own.as_deref()));
    }
    let captures = (Capture::load(a)?, Capture::load(b)?);
    in_order(&captures.0, &captures.1, [a, b], masks)
}

/// Whether only its `capture.toml` tells where a sequence's photographs are.
fn names_its_photographs(path: &Path) -> bool {
    is_capture_file(path) || (path.join("capture.toml").is_file() && !path.join("images").is_dir())
}

fn is_capture_file(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|e| e == "toml")
}

/// Images of two folders by their names.
fn by_name(a: &Path, b: &Path) -> Result<Vec<FramePair>, CompareError> {
    let (images_a, images_b) = (images_of(a), images_of(b));
    let (names_a, names_b) = (list(&images_a)?, list(&images_b)?);
    check_all_in(&names_a, &images_a, &names_b, &images_b)?;
    check_all_in(&names_b, &images_b, &names_a, &images_a)?;
    let pair = |name: String| FramePair {
        reference: images_a.join(&name),
        test: images_b.join(&name),
        mask: None,
        name,
    };
    Ok(names_a.into_iter().map(pair).collect())
}

/// The frames of two complete captures in their order; `None` where one is none.
fn by_order(
    a: &Path,
    b: &Path,
    masks: Option<&Path>,
) -> Option<Result<Vec<FramePair>, CompareError>> {
    let captures = (Capture::load(a).ok()?, Capture::load(b).ok()?);
    let same = captures.0.frames.len() == captures.1.frames.len();
    same.then(|| in_order(&captures.0, &captures.1, [a, b], masks))
}

fn in_order(
    a: &Capture,
    b: &Capture,
    paths: [&Path; 2],
    masks: Option<&Path>,
) -> Result<Vec<FramePair>, CompareError> {
    if a.frames.len() != b.frames.len() {
        return Err(CompareError::Counts {
            a: paths[0].to_owned(),
            frames_a: a.frames.len(),
            b: paths[1].to_owned(),
            frames_b: b.frames.len(),
        });
    }
    let pairs = (a.frames.iter().zip(&b.frames))
        .map(|(of_a, of_b)| FramePair {
            name: file_name(&of_a.image),
            reference: of_a.image.clone(),
            test: of_b.image.clone(),
            mask: of_a.mask.clone().or_else(|| of_b.mask.clone()),
        })
        .collect();
    with_masks(pairs, paths[0], masks)
}

/// The pairs with the masks of a folder, or one for all; `frames` is where they are missing.
fn with_masks(
    mut pairs: Vec<FramePair>,
    frames: &Path,
    masks: Option<&Path>,
) -> Result<Vec<FramePair>, CompareError> {
    let Some(masks) = masks else {
        return Ok(pairs);
    };
    if !masks.is_dir() {
        for pair in &mut pairs {
            pair.mask = Some(masks.to_owned());
        }
        return Ok(pairs);
    }
    let by_stem: BTreeMap<String, String> = list(masks)?
        .into_iter()
        .map(|name| (stem(&name), name))
        .collect();
    let mut missing = Vec::new();
    for pair in &mut pairs {
        match by_stem.get(&stem(&pair.name)) {
            Some(name) => pair.mask = Some(masks.join(name)),
            None => missing.push(pair.name.clone()),
        }
    }
    if missing.is_empty() {
        Ok(pairs)
    } else {
        Err(CompareError::Missing {
            folder: masks.to_owned(),
            names: missing,
            other: frames.to_owned(),
        })
    }
}

/// A capture's images, or the folder itself.
fn images_of(folder: &Path) -> PathBuf {
    let images = folder.join("images");
    if images.is_dir() {
        images
    } else {
        folder.to_owned()
    }
}

/// Names of the images in a folder, sorted; hidden files are none.
fn list(folder: &Path) -> Result<Vec<String>, CompareError> {
    let fault = |source| CompareError::Folder {
        path: folder.to_owned(),
        source,
    };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(fault)? {
        let name = entry
            .map_err(fault)?
            .file_name()
            .to_string_lossy()
            .into_owned();
        let extension = Path::new(&name)
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase());
        let known = extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()));
        if known && !name.starts_with('.') {
            names.push(name);
        }
    }
    if names.is_empty() {
        return Err(CompareError::NoImages {
            folder: folder.to_owned(),
        });
    }
    names.sort_unstable();
    Ok(names)
}

fn check_all_in(
    names: &[String],
    folder: &Path,
    others: &[String],
    other_folder: &Path,
) -> Result<(), CompareError> {
    let missing: Vec<String> = names
        .iter()
        .filter(|name| others.binary_search(name).is_err())
        .cloned()
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let (folder, other) = (other_folder.to_owned(), folder.to_owned());
    Err(CompareError::Missing {
        folder,
        names: missing,
        other,
    })
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(OsStr::new(""))
        .to_string_lossy()
        .into_owned()
}

fn stem(name: &str) -> String {
    Path::new(name)
        .file_stem()
        .unwrap_or(OsStr::new(""))
        .to_string_lossy()
        .into_owned()
}
