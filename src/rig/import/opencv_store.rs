//! OpenCV's FileStorage as names and values: YAML, JSON and XML, and the YAML of ROS' camera_info.
//!
//! Nested names are joined by dots, so that a matrix `M` has `M.rows`, `M.cols` and `M.data`. Of YAML only
//! what these programs write is read: mappings by indentation and lists in square brackets, which may run
//! over several lines. Anything else is passed over; what is then absent is named when it is asked for.

use serde_json::Value;

use super::{ImportProblem, Parsed};

/// A value of the file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Entry {
    /// One or more numbers, in the file's order.
    Numbers(Vec<f64>),
    /// Anything else.
    Text(String),
}

/// Names and values, in the file's order.
pub(super) type Store = Vec<(String, Entry)>;

/// Mappings deeper than this are not cameras.
const DEEPEST: usize = 16;
/// Nor are longer names, bytes; every value below them would be kept with its whole path.
const LONGEST_NAME: usize = 200;

impl Entry {
    /// Numbers between commas, blanks and brackets, or text.
    fn of(text: &str) -> Self {
        let separators = |c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']');
        let numbers: Option<Vec<f64>> = text
            .split(separators)
            .filter(|word| !word.is_empty())
            .map(number)
            .collect();
        match numbers {
            Some(numbers) if !numbers.is_empty() => Self::Numbers(numbers),
            _ => Self::Text(text.trim().trim_matches(['"', '\'']).to_owned()),
        }
    }
}

/// A number as OpenCV writes it: `1.`, `.5`, `-.Nan`, `.Inf`.
fn number(word: &str) -> Option<f64> {
    match word.to_ascii_lowercase().as_str() {
        ".nan" | "-.nan" => Some(f64::NAN),
        ".inf" => Some(f64::INFINITY),
        "-.inf" => Some(f64::NEG_INFINITY),
        // Rust also takes the words "nan" and "infinity", which here are text.
        word if word.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.')) => {
            word.parse().ok()
        }
        _ => None,
    }
}

/// Reads YAML.
pub(super) fn from_yaml(text: &str) -> Parsed<Store> {
    let mut store = Store::new();
    // The mappings that the current line is in: their indentation and their names.
    let mut inside: Vec<(usize, &str)> = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((i, line)) = lines.next() {
        let indent = line.len() - line.trim_start().len();
        let content = line.trim();
        if content.is_empty() || content.starts_with(['%', '#', '-']) || content == "..." {
            continue;
        }
        let Some((key, value)) = content.split_once(':') else {
            let reason = format!("neither a comment nor `name: value`: {}", brief(content));
            return Err(ImportProblem::damaged(format!("line {}", i + 1), reason));
        };
        let key = key.trim().trim_matches(['"', '\'']);
        if key.len() > LONGEST_NAME {
            let reason = format!("a name of {} bytes", key.len());
            return Err(ImportProblem::damaged(format!("line {}", i + 1), reason));
        }
        while inside.last().is_some_and(|(outer, _)| *outer >= indent) {
            inside.pop();
        }
        let value = value.trim();
        // Tags such as !!opencv-matrix say what the names inside say again.
        let value = match value.strip_prefix("!!") {
            Some(tagged) => tagged.split_once(' ').map_or("", |(_, rest)| rest.trim()),
            None => value,
        };
        if value.is_empty() {
            if inside.len() < DEEPEST {
                inside.push((indent, key));
            }
            continue;
        }
        let mut list = value.to_owned();
        if value.starts_with('[') {
            let mut open = balance(value);
            while open > 0 {
                let Some((_, more)) = lines.next() else {
                    let reason = format!("the list {} is not closed", brief(key));
                    return Err(ImportProblem::damaged(format!("line {}", i + 1), reason));
                };
                open += balance(more);
                list.push(' ');
                list.push_str(more);
            }
        }
        let path: Vec<&str> = inside.iter().map(|(_, name)| *name).chain([key]).collect();
        store.push((path.join("."), Entry::of(&list)));
    }
    Ok(store)
}

/// Brackets opened less those closed.
fn balance(text: &str) -> i64 {
    text.chars()
        .map(|c| match c {
            '[' => 1,
            ']' => -1,
            _ => 0,
        })
        .sum()
}

fn brief(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Reads JSON.
pub(super) fn from_json(value: &Value) -> Store {
    let mut store = Store::new();
    flatten(value, "", 0, &mut store);
    store
}

fn flatten(value: &Value, path: &str, depth: usize, store: &mut Store) {
    let keep = |entry| (path.to_owned(), entry);
    match value {
        Value::Object(fields) if depth < DEEPEST => {
            for (key, value) in fields.iter().filter(|(key, _)| key.len() <= LONGEST_NAME) {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                flatten(value, &path, depth + 1, store);
            }
        }
        Value::Array(_) => {
            let mut numbers = Vec::new();
            // Anything but numbers makes it no matrix.
            if collect(value, &mut numbers) {
                store.push(keep(Entry::Numbers(numbers)));
            }
        }
        Value::Number(number) => {
            if let Some(number) = number.as_f64() {
                store.push(keep(Entry::Numbers(vec![number])));
            }
        }
        // OpenCV writes NaN and infinity as text.
        Value::String(text) => store.push(keep(Entry::of(text))),
        _ => {}
    }
}

/// Adds the numbers of nested lists, row by row; false where there is anything else.
fn collect(value: &Value, numbers: &mut Vec<f64>) -> bool {
    match value {
        Value::Array(items) => items.iter().all(|item| collect(item, numbers)),
        Value::Number(number) => number.as_f64().map(|x| numbers.push(x)).is_some(),
        _ => false,
    }
}

/// Reads XML.
pub(super) fn from_xml(text: &str) -> Parsed<Store> {
    let document = roxmltree::Document::parse(text).map_err(|error| {
        let at = error.pos();
        let place = format!("line {}, column {}", at.row, at.col);
        ImportProblem::damaged(place, error.to_string())
    })?;
    let mut store = Store::new();
    for node in document.descendants().filter(roxmltree::Node::is_element) {
        // The root's own name is no part of a path.
        let mut names: Vec<&str> = node
            .ancestors()
            .take(DEEPEST)
            .filter(roxmltree::Node::is_element)
            .map(|n| n.tag_name().name())
            .collect();
        names.pop();
        names.reverse();
        let text = node.text().unwrap_or_default();
        if names.iter().any(|name| name.len() > LONGEST_NAME) {
            continue;
        }
        if !names.is_empty() && !text.trim().is_empty() {
            store.push((names.join("."), Entry::of(text)));
        }
    }
    Ok(store)
}

#[cfg(test)]
mod tests {
    use super::*;

    const YAML: &str = "%YAML:1.0\n---\nimage_width: 640\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
        dt: d\n   data: [ 5.3e+02, 0., 342.,\n       0., 536., 235., 0., 0., 1. ]\nmodel: plumb_bob\n\
        images: !!opencv-nd-matrix\n   sizes: [ 1, 2 ]\nerror: .Nan\n";

    fn numbers(store: &Store, name: &str) -> Vec<f64> {
        match store.iter().find(|(key, _)| key == name) {
            Some((_, Entry::Numbers(numbers))) => numbers.clone(),
            other => panic!("{name}: {other:?}"),
        }
    }

    #[test]
    fn the_three_notations_say_the_same() {
        let yaml = from_yaml(YAML).unwrap();
        let json = serde_json::json!({
            "image_width": 640,
            "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
                "data": [530.0, 0.0, 342.0, 0.0, 536.0, 235.0, 0.0, 0.0, 1.0]},
        });
        let xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_width>\n<camera_matrix \
            type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data>\n 530. 0. 342. 0. 536. 235. 0. 0. \
            1.</data></camera_matrix>\n</opencv_storage>";
        for store in [yaml, from_json(&json), from_xml(xml).unwrap()] {
            assert_eq!(numbers(&store, "image_width"), [640.0]);
            assert_eq!(numbers(&store, "camera_matrix.rows"), [3.0]);
            assert_eq!(
                numbers(&store, "camera_matrix.data"),
                [530.0, 0.0, 342.0, 0.0, 536.0, 235.0, 0.0, 0.0, 1.0]
            );
        }
    }

    #[test]
    fn yaml_keeps_text_and_odd_numbers_and_names_faults() {
        let store = from_yaml(YAML).unwrap();
        assert!(store.contains(&("model".to_owned(), Entry::Text("plumb_bob".to_owned()))));
        assert_eq!(numbers(&store, "images.sizes"), [1.0, 2.0]);
        assert!(numbers(&store, "error")[0].is_nan());
        let open = from_yaml(&YAML.replace("1. ]", "1."))
            .unwrap_err()
            .to_string();
        assert!(
            open.starts_with("line 8: the list data is not closed"),
            "{open}"
        );
        let odd = from_yaml("a: 1\nnonsense\n").unwrap_err().to_string();
        assert!(odd.starts_with("line 2: "), "{odd}");
    }
}
