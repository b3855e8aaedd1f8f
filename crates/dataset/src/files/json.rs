//! JSON files in which every value knows its path, for error messages.

use std::ops::RangeBounds;
use std::path::Path;

use infonerf_scene::SceneError;
use regex::bytes::{Captures, Regex};
use serde_json::Value;

use super::read_file;

type Result<T> = std::result::Result<T, SceneError>;

const MAX_BYTES: u64 = 256 << 20;

/// Numbers that Python writes although JSON has none of them.
const NOT_FINITE: [&str; 3] = ["NaN", "Infinity", "-Infinity"];

/// Reads and parses a file, refusing one of more than [`MAX_BYTES`] bytes unread.
pub(crate) fn read(path: &Path) -> Result<Value> {
    parse(path, &read_file(path, "a JSON file with camera poses", MAX_BYTES)?)
}

/// Parses the contents of the file at `path`. A byte-order mark, as Windows editors write it, and comments are skipped;
/// Python's `NaN` and `Infinity` become strings, which are no numbers.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Value> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let value = serde_json::from_slice(bytes).or_else(|_| serde_json::from_slice(&to_strict_json(bytes)));
    if let [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] = bytes {
        return Err(SceneError::malformed(path, "JSON in UTF-8", "it is in UTF-16"));
    }
    value.map_err(|e| SceneError::malformed(path, "JSON", e))
}

/// A value in a JSON file, with its path.
pub(crate) struct Node<'a> {
    file: &'a Path,
    field: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    pub fn root(file: &'a Path, value: &'a Value) -> Self {
        Self { file, field: String::new(), value }
    }

    /// Returns the field `key` of an object, which must be there.
    pub fn get(&self, key: &str, expected: &str) -> Result<Self> {
        self.find(key).ok_or_else(|| SceneError::field(self.file, self.join(key), expected, "nothing"))
    }

    /// Returns the field `key`, if this is an object that has it and it is not null.
    pub fn find(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(Node { file: self.file, field: self.join(key), value })
    }

    /// Reads the field `key`, if it is there and not null.
    pub fn optional<T>(&self, key: &str, read: impl FnOnce(Self) -> Result<T>) -> Result<Option<T>> {
        self.find(key).map(read).transpose()
    }

    pub fn items(&self, expected: &str) -> Result<Vec<Self>> {
        let items = self.value.as_array().ok_or_else(|| self.error(expected))?;
        let node = |(i, value)| Node { file: self.file, field: format!("{}[{i}]", self.field), value };
        Ok(items.iter().enumerate().map(node).collect())
    }

    /// Returns whether the value, or an element of it, is null or one of Python's numbers that are not finite.
    pub fn is_incomplete(&self) -> bool {
        let absent = |value: &Value| value.is_null() || value.as_str().is_some_and(|text| NOT_FINITE.contains(&text));
        absent(self.value) || self.value.as_array().is_some_and(|items| items.iter().any(absent))
    }

    pub fn number(&self, expected: &str) -> Result<f64> {
        self.value.as_f64().filter(|v| v.is_finite()).ok_or_else(|| self.error(expected))
    }

    pub fn within(&self, range: impl RangeBounds<f64>, expected: &str) -> Result<f64> {
        let number = self.number(expected)?;
        if range.contains(&number) { Ok(number) } else { Err(self.error(expected)) }
    }

    pub fn numbers<const N: usize>(&self, expected: &str) -> Result<[f64; N]> {
        let numbers = self.items(expected)?.iter().map(|item| item.number(expected)).collect::<Result<Vec<_>>>()?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| self.fault(expected, format!("{count} values")))
    }

    pub fn flag(&self, expected: &str) -> Result<bool> {
        self.value.as_bool().ok_or_else(|| self.error(expected))
    }

    pub fn text(&self, expected: &str) -> Result<&'a str> {
        self.value.as_str().filter(|s| !s.is_empty()).ok_or_else(|| self.error(expected))
    }

    pub fn error(&self, expected: impl Into<String>) -> SceneError {
        self.fault(expected, short(self.value))
    }

    /// Returns an error with the path of the value, what was `expected` and what was `found`.
    pub fn fault(&self, expected: impl Into<String>, found: impl std::fmt::Display) -> SceneError {
        SceneError::field(self.file, self.field.clone(), expected, found)
    }

    fn join(&self, key: &str) -> String {
        if self.field.is_empty() { key.into() } else { format!("{}.{key}", self.field) }
    }
}

/// Reads two fields that are stated together or not at all; `place` finds the node that has a field.
pub(crate) fn pair<'n, 'a: 'n, T>(
    place: impl Fn(&str) -> &'n Node<'a>,
    keys: [&str; 2],
    expected: &str,
    read: impl Fn(Node<'a>) -> Result<T>,
) -> Result<Option<(T, T)>> {
    match keys.map(|key| place(key).find(key)) {
        [None, None] => Ok(None),
        [Some(first), Some(second)] => Ok(Some((read(first)?, read(second)?))),
        [first, _] => {
            let [stated, absent] = if first.is_some() { keys } else { [keys[1], keys[0]] };
            place(absent).get(absent, &format!("{expected} next to `{stated}`")).map(|_| None)
        }
    }
}

/// Removes comments (`//` to the end of the line, `/* … */`), and makes strings of numbers that are not finite.
fn to_strict_json(bytes: &[u8]) -> Vec<u8> {
    // Strings are matched too, so that nothing within them is taken for a comment.
    let parts = Regex::new(r#"(?s-u)"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/|-?Infinity|NaN"#);
    let replaced = |part: &Captures<'_>| match part[0][0] {
        b'"' => part[0].to_vec(),
        b'/' => Vec::new(),
        _ => [b"\"", &part[0], b"\""].concat(),
    };
    parts.map_or_else(|_| bytes.to_vec(), |parts| parts.replace_all(bytes, replaced).into_owned())
}

fn short(value: &Value) -> String {
    match value {
        Value::Array(items) => format!("an array of {}", items.len()),
        Value::Object(_) => "an object".into(),
        Value::String(s) => format!("\"{}\"", s.chars().take(60).collect::<String>()),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn broken_json_says_where() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        for text in ["", "{", "{\"a\": \"b}", "{\"a\": 1e999}", "/* {}"] {
            fs::write(&path, text).unwrap();
            let text = read(&path).err().unwrap().to_string();
            assert!(text.contains("a.json: expected JSON") && text.contains("line"), "{text}");
        }
        assert!(parse(&path, b"\xff\xfe{\0}\0").unwrap_err().to_string().ends_with("JSON in UTF-8: it is in UTF-16"));
    }

    #[test]
    fn comments_are_skipped_and_numbers_that_are_not_finite_become_strings() {
        let text = br#"{ // a rig's "poses"
            "a": [1, NaN, -Infinity], /* "b": 2, */ "c": "// \" NaN /* */" }"#;
        let marked = [b"\xef\xbb\xbf", &text[..]].concat();
        let value = parse(Path::new("a.json"), &marked).unwrap();
        let root = Node::root(Path::new("a.json"), &value);
        let (a, c) = (root.get("a", "").unwrap(), root.get("c", "").unwrap());
        assert!(a.is_incomplete() && a.items("").unwrap()[0].number("").unwrap() == 1.0 && root.find("b").is_none());
        assert!(a.items("").unwrap()[1].number("a number").err().unwrap().to_string().contains("NaN"));
        assert_eq!(c.text("").unwrap(), "// \" NaN /* */");
    }

    #[test]
    fn huge_files_are_refused_unread() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        // Sparse: takes no space on disk.
        fs::File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
        assert!(matches!(read(&path), Err(SceneError::TooLarge { .. })));
    }
}
