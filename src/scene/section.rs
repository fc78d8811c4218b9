//! One table of a scene file, its keys known and its values read with their key path.

use std::path::{Path, PathBuf};

use glam::DVec3;
use toml::{Table, Value};

use super::error::Problem;

/// Results inside the reader; the file's name is added at the top.
pub(super) type Checked<T> = Result<T, Problem>;

/// A TOML table at a key path, all of whose keys are known.
pub(super) struct Section<'a> {
    /// Key path of the table; empty at the top.
    path: String,
    table: &'a Table,
}

/// The bounds of a number, and how to say them.
#[derive(Clone, Copy)]
pub(super) struct Range {
    /// Whether a (finite) number is allowed.
    pub(super) holds: fn(f64) -> bool,
    /// Completes "must be …", with a remedy where there is a likely one.
    pub(super) requirement: &'static str,
}

/// Any finite number.
pub(super) const FINITE: Range = Range {
    holds: |_| true,
    requirement: "a finite number",
};
/// Above zero.
pub(super) const POSITIVE: Range = Range {
    holds: |x| x > 0.0,
    requirement: "> 0",
};
/// Zero or above.
pub(super) const NON_NEGATIVE: Range = Range {
    holds: |x| x >= 0.0,
    requirement: ">= 0",
};

impl<'a> Section<'a> {
    /// Refuses every key that is not among `known`.
    pub(super) fn new(path: String, table: &'a Table, known: &[&str]) -> Checked<Self> {
        let section = Self { path, table };
        match table.keys().find(|key| !known.contains(&key.as_str())) {
            None => Ok(section),
            Some(key) => Err(Problem::UnknownKey {
                key: section.key(key),
                remedy: nearest(key, known).map_or_else(
                    || format!("known here: {}", known.join(", ")),
                    |near| format!("did you mean {near}?"),
                ),
            }),
        }
    }

    /// The full path of `key`.
    pub(super) fn key(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// Whether `key` is there.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// The value as typed.
    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        self.table.get(key)
    }

    /// A `Value` problem of `key`.
    pub(super) fn wrong(
        &self,
        key: &str,
        value: &Value,
        requirement: impl Into<String>,
    ) -> Problem {
        Problem::Value {
            key: self.key(key),
            value: brief(value),
            requirement: requirement.into(),
        }
    }

    /// A `Missing` problem of `key`.
    pub(super) fn missing(&self, key: &str, remedy: impl Into<String>) -> Problem {
        Problem::Missing {
            key: self.key(key),
            remedy: remedy.into(),
        }
    }

    /// Refuses `key` beside `other`.
    pub(super) fn refuse(&self, key: &str, other: &str, remove: &str) -> Checked<()> {
        if !self.has(key) {
            return Ok(());
        }
        Err(Problem::Conflict {
            key: self.key(key),
            other: other.to_owned(),
            remove: remove.to_owned(),
        })
    }

    /// The table at `key`, whose own keys are `known`.
    pub(super) fn section(&self, key: &str, known: &[&str]) -> Checked<Option<Section<'a>>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::Table(table)) => Section::new(self.key(key), table, known).map(Some),
            Some(other) => Err(self.wrong(key, other, format!("a section, [{}]", self.key(key)))),
        }
    }

    /// The tables of `[[key]]`, each of whose keys are `known`.
    pub(super) fn sections(&self, key: &str, known: &[&str]) -> Checked<Vec<Section<'a>>> {
        let Some(value) = self.value(key) else {
            return Ok(Vec::new());
        };
        let requirement = || format!("sections, [[{}]]", self.key(key));
        let Value::Array(items) = value else {
            return Err(self.wrong(key, value, requirement()));
        };
        let one = |(i, item): (usize, &'a Value)| match item {
            Value::Table(table) => Section::new(format!("{}[{i}]", self.key(key)), table, known),
            other => Err(self.wrong(&format!("{key}[{i}]"), other, requirement())),
        };
        items.iter().enumerate().map(one).collect()
    }

    /// A finite number in `range`.
    pub(super) fn number(&self, key: &str, range: Range) -> Checked<Option<f64>> {
        self.value(key)
            .map(|value| self.checked(key, value, range))
            .transpose()
    }

    /// As [`Section::number`], required.
    pub(super) fn need_number(&self, key: &str, range: Range) -> Checked<f64> {
        self.number(key, range)?
            .ok_or_else(|| self.missing(key, format!("a number, {}", range.requirement)))
    }

    /// True or false.
    pub(super) fn boolean(&self, key: &str) -> Checked<Option<bool>> {
        let read = |value: &Value| {
            value
                .as_bool()
                .ok_or_else(|| self.wrong(key, value, "true or false"))
        };
        self.value(key).map(read).transpose()
    }

    /// A whole number from `low` to `high`.
    pub(super) fn count(&self, key: &str, low: i64, high: i64) -> Checked<Option<i64>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::Integer(n)) if (low..=high).contains(n) => Ok(Some(*n)),
            Some(other) => {
                Err(self.wrong(key, other, format!("a whole number from {low} to {high}")))
            }
        }
    }

    /// As [`Section::count`], required.
    pub(super) fn need_count(&self, key: &str, low: i64, high: i64) -> Checked<i64> {
        let found = self.count(key, low, high)?;
        found.ok_or_else(|| self.missing(key, format!("a whole number from {low} to {high}")))
    }

    /// Finite numbers, each in `range`.
    pub(super) fn numbers(&self, key: &str, range: Range) -> Checked<Option<Vec<f64>>> {
        let Some(value) = self.value(key) else {
            return Ok(None);
        };
        let Value::Array(items) = value else {
            return Err(self.wrong(key, value, "an array of numbers"));
        };
        let one = |(i, item): (usize, &Value)| self.checked(&format!("{key}[{i}]"), item, range);
        items
            .iter()
            .enumerate()
            .map(one)
            .collect::<Checked<Vec<_>>>()
            .map(Some)
    }

    /// Exactly `N` finite numbers, each in `range`.
    pub(super) fn array<const N: usize>(
        &self,
        key: &str,
        range: Range,
    ) -> Checked<Option<[f64; N]>> {
        let Some(numbers) = self.numbers(key, range)? else {
            return Ok(None);
        };
        match (<[f64; N]>::try_from(numbers), self.value(key)) {
            (Err(_), Some(value)) => {
                Err(self.wrong(key, value, format!("an array of {N} numbers")))
            }
            (array, _) => Ok(array.ok()),
        }
    }

    /// A vector.
    pub(super) fn vector(&self, key: &str) -> Checked<Option<DVec3>> {
        Ok(self.array::<3>(key, FINITE)?.map(DVec3::from_array))
    }

    /// A vector, required.
    pub(super) fn need_vector(&self, key: &str) -> Checked<DVec3> {
        self.vector(key)?
            .ok_or_else(|| self.missing(key, "[x, y, z]"))
    }

    /// A vector of length one, from one of any length but zero.
    pub(super) fn direction(&self, key: &str) -> Checked<Option<DVec3>> {
        let (Some(vector), Some(value)) = (self.vector(key)?, self.value(key)) else {
            return Ok(None);
        };
        // Divided by the largest component first, so that the length neither over- nor underflows.
        let scaled = vector / vector.abs().max_element();
        match scaled.try_normalize() {
            Some(unit) => Ok(Some(unit)),
            None => Err(self.wrong(key, value, "a vector other than zero")),
        }
    }

    /// A string.
    pub(super) fn string(&self, key: &str) -> Checked<Option<&'a str>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(other) => Err(self.wrong(key, other, "a string")),
        }
    }

    /// An existing file, resolved against `folder`.
    pub(super) fn file(&self, key: &str, folder: &Path) -> Checked<Option<PathBuf>> {
        let Some(text) = self.string(key)? else {
            return Ok(None);
        };
        let resolved = folder.join(text);
        if resolved.is_file() {
            return Ok(Some(resolved));
        }
        Err(Problem::MissingFile {
            key: self.key(key),
            value: text.to_owned(),
            resolved,
        })
    }

    /// As [`Section::file`], required; `example` says what to write.
    pub(super) fn need_file(&self, key: &str, folder: &Path, example: &str) -> Checked<PathBuf> {
        self.file(key, folder)?
            .ok_or_else(|| self.missing(key, example))
    }

    /// `value`, which stands at `key`, as a finite number in `range`.
    pub(super) fn checked(&self, key: &str, value: &Value, range: Range) -> Checked<f64> {
        let number = match value {
            Value::Float(x) => *x,
            Value::Integer(n) => *n as f64,
            _ => return Err(self.wrong(key, value, "a number")),
        };
        if !number.is_finite() {
            return Err(self.wrong(key, value, FINITE.requirement));
        }
        if (range.holds)(number) {
            Ok(number)
        } else {
            Err(self.wrong(key, value, range.requirement))
        }
    }
}

/// The known word nearest to `word`, unless all are far.
pub(super) fn nearest<'k>(word: &str, known: &[&'k str]) -> Option<&'k str> {
    let similarity = |candidate: &str| strsim::jaro_winkler(&word.to_lowercase(), candidate);
    let best = known
        .iter()
        .copied()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))?;
    // 0.7: below it, words that share only a letter or two ("x", "mesh") would be proposed.
    (similarity(best) > 0.7).then_some(best)
}

/// A value as TOML, cut where it is long.
fn brief(value: &Value) -> String {
    const LONGEST: usize = 60;
    let text = value.to_string();
    if text.chars().count() <= LONGEST {
        return text;
    }
    text.chars().take(LONGEST).chain(['…']).collect()
}
