//! The order of the modules in `lib.rs` is the order in which data flows: a module may name only
//! modules above it, and some not even those.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Arrows that are forbidden though they point upwards: `(from, to)`.
const FORBIDDEN: &[(&str, &[&str])] = &[
    ("mesh", &["probe", "brdf", "scene"]),
    ("probe", &["mesh", "brdf", "scene"]),
    ("brdf", &["mesh", "probe", "scene"]),
    ("traces", &["render"]),
    ("compare", &["estimate", "render"]),
    ("export", &["estimate", "render"]),
];

/// Modules that see only what is listed.
const ONLY: &[(&str, &[&str])] = &[
    ("accel", &["mesh", "geometry"]),
    (
        "estimate",
        &["traces", "brdf", "probe", "accel", "sampling", "geometry"],
    ),
];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn modules() -> Vec<String> {
    std::fs::read_to_string(source().join("lib.rs"))
        .unwrap()
        .lines()
        .filter_map(|line| {
            line.strip_prefix("pub mod ")?
                .strip_suffix(';')
                .map(str::to_owned)
        })
        .collect()
}

/// Whether a file holds tests alone: its module declares it under `#[cfg(test)]`. Tests may build
/// their input with any module.
fn is_test_only(file: &Path) -> bool {
    let (Some(folder), Some(name)) = (file.parent(), file.file_stem()) else {
        return false;
    };
    let declared = format!("#[cfg(test)]\nmod {};", name.to_string_lossy());
    std::fs::read_to_string(folder.join("mod.rs")).is_ok_and(|text| text.contains(&declared))
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

/// Modules that a text names as `crate::NAME`, also inside `use crate::{a::…, b::…}`; doc comments
/// may point anywhere.
fn named(text: &str) -> BTreeSet<String> {
    let code: String = text
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n");
    let word = |rest: &str| -> String {
        rest.chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    let mut names = BTreeSet::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 0;
            let mut start = true;
            for (i, c) in group.char_indices() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => start = true,
                    c if start && !c.is_whitespace() => {
                        names.insert(word(&group[i..]));
                        start = false;
                    }
                    _ => {}
                }
            }
        } else {
            names.insert(word(rest));
        }
    }
    names
}

#[test]
fn arrows_point_upwards_and_avoid_forbidden_pairs() {
    let modules = modules();
    assert!(modules.len() > 10, "lib.rs lists its modules one a line");
    let place = |name: &str| modules.iter().position(|m| m == name);
    let mut faults = Vec::new();
    for module in &modules {
        let folder = source().join(module);
        let files = if folder.is_dir() {
            rust_files(&folder)
        } else {
            vec![folder.with_extension("rs")]
        };
        for file in files.into_iter().filter(|file| !is_test_only(file)) {
            for name in named(&std::fs::read_to_string(&file).unwrap()) {
                let Some(to) = place(&name).filter(|_| name != *module) else {
                    continue;
                };
                let points_up = Some(to) < place(module);
                let forbidden = FORBIDDEN
                    .iter()
                    .any(|(from, to)| from == module && to.contains(&name.as_str()));
                let outside = ONLY
                    .iter()
                    .any(|(from, to)| from == module && !to.contains(&name.as_str()));
                if !points_up || forbidden || outside {
                    faults.push(format!("{}: {module} names {name}", file.display()));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_reader_of_names_sees_every_form() {
    let text = "use crate::{brdf::Ndf, geometry::{Frame, Ray}, probe};\nlet x = crate::mesh::Mesh;\n/// crate::cli\n";
    let names: Vec<String> = named(text).into_iter().collect();
    assert_eq!(names, ["brdf", "geometry", "mesh", "probe"]);
}
