//! Files to be written, checked before any work is done: nobody should wait for a result that has no place, and nothing
//! should be half written.

use std::path::Path;

use anyhow::anyhow;

use super::failure::Failure;

/// Refuses files that cannot be written: folders, and files in folders that do not exist.
pub(super) fn check_outputs<'a>(
    files: impl IntoIterator<Item = (&'static str, Option<&'a Path>)>,
) -> Result<(), Failure> {
    for (option, file) in files {
        let Some(file) = file else {
            continue;
        };
        if file.is_dir() {
            return Err(Failure::Input(anyhow!(
                "{option} {}: is a folder; name a file",
                file.display()
            )));
        }
        let folder = file.parent().unwrap_or(Path::new(""));
        if !folder.as_os_str().is_empty() && !folder.is_dir() {
            return Err(Failure::Input(anyhow!(
                "{option} {}: there is no folder {}; create it",
                file.display(),
                folder.display()
            )));
        }
    }
    Ok(())
}

/// Refuses folders that cannot be made, since a file stands there.
pub(super) fn check_folder(option: &str, folder: &Path) -> Result<(), Failure> {
    match folder.ancestors().find(|place| place.exists()) {
        Some(place) if !place.is_dir() => Err(Failure::Input(anyhow!(
            "{option} {}: {} is a file; name a folder",
            folder.display(),
            place.display()
        ))),
        _ => Ok(()),
    }
}

/// Refuses names for HDR images under which other programs would not open them.
pub(super) fn check_exr(option: &str, file: &Path) -> Result<(), Failure> {
    let is_exr = file
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    if is_exr {
        return Ok(());
    }
    Err(Failure::Input(anyhow!(
        "{option} {}: is written as EXR; give a name that ends in .exr",
        file.display()
    )))
}

/// Refuses to write over a file that is read.
pub(super) fn check_kept<'a>(
    option: &str,
    file: &Path,
    read: impl IntoIterator<Item = &'a Path>,
) -> Result<(), Failure> {
    let Ok(place) = file.canonicalize() else {
        return Ok(());
    };
    if read
        .into_iter()
        .any(|input| input.canonicalize().is_ok_and(|input| input == place))
    {
        return Err(Failure::Input(anyhow!(
            "{option} {}: would be written over, and it is read; choose another name",
            file.display()
        )));
    }
    Ok(())
}
