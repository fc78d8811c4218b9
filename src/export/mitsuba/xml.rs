//! Indented XML.

use std::fmt::Write;

/// A document in the making.
#[derive(Default)]
pub(super) struct Xml {
    text: String,
    open: Vec<&'static str>,
}

impl Xml {
    /// Starts an element that has children.
    pub(super) fn open(&mut self, tag: &'static str, attributes: &[(&str, &str)]) {
        self.element(tag, attributes, ">");
        self.open.push(tag);
    }

    /// Ends the element opened last.
    pub(super) fn close(&mut self) {
        if let Some(tag) = self.open.pop() {
            let indent = 2 * self.open.len();
            // Writing to a String cannot fail.
            let _ = writeln!(self.text, "{:indent$}</{tag}>", "");
        }
    }

    /// An element without children.
    pub(super) fn leaf(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.element(tag, attributes, "/>");
    }

    /// `<kind name="name" value="value"/>`.
    pub(super) fn value(&mut self, kind: &str, name: &str, value: &str) {
        self.leaf(kind, &[("name", name), ("value", value)]);
    }

    /// The document.
    pub(super) fn finish(self) -> String {
        self.text
    }

    fn element(&mut self, tag: &str, attributes: &[(&str, &str)], end: &str) {
        let indent = 2 * self.open.len();
        let _ = write!(self.text, "{:indent$}<{tag}", "");
        for (name, value) in attributes {
            let escaped = value
                .replace('&', "&amp;")
                .replace('<', "&lt;")
                .replace('"', "&quot;");
            let _ = write!(self.text, " {name}=\"{escaped}\"");
        }
        let _ = writeln!(self.text, "{end}");
    }
}

/// Shortest text that reads back as the same number, without a negative zero.
pub(super) fn number(x: f64) -> String {
    format!("{:?}", x + 0.0)
}
