//! Keys of the config that a sweep sets, none of which may be set twice.

use std::fmt;

use anyhow::{Context, Result, bail};
use infonerf_train::config;

/// A key with the option that sets it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Key {
    pub(super) flag: &'static str,
    pub(super) path: Vec<String>,
}

impl fmt::Display for Key {
    /// The key, dotted.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.path.join("."))
    }
}

/// Refuses keys of which one is another, or a part of it, or of what a `--set` sets.
pub(super) fn refuse_overlaps<'a>(keys: impl Iterator<Item = &'a Key>, set: &[String]) -> Result<()> {
    let keys: Vec<&Key> = keys.collect();
    for (index, key) in keys.iter().enumerate() {
        if let Some(other) = keys[..index].iter().find(|other| overlap(&other.path, &key.path)) {
            match other == key {
                true => bail!("{} {key}: given twice", key.flag),
                false => bail!("{} {key}: contradicts {} {other}", key.flag, other.flag),
            }
        }
        for assignment in set {
            let (path, _) = config::parse_assignment(assignment).with_context(|| format!("--set {assignment}"))?;
            if overlap(&path, &key.path) {
                bail!("--set {assignment}: contradicts {} {key}", key.flag);
            }
        }
    }
    Ok(())
}

/// Whether one is the other or a part of it.
fn overlap(a: &[String], b: &[String]) -> bool {
    a.starts_with(b) || b.starts_with(a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(keys: &[(&'static str, &str)], set: &[&str]) -> String {
        let key =
            |(flag, path): &(&'static str, &str)| Key { flag, path: path.split('.').map(str::to_owned).collect() };
        let keys: Vec<Key> = keys.iter().map(key).collect();
        let set: Vec<String> = set.iter().map(|&text| text.to_owned()).collect();
        refuse_overlaps(keys.iter(), &set).map_or_else(|error| format!("{error:#}"), |()| String::new())
    }

    #[test]
    fn nothing_is_set_twice() {
        assert_eq!(fault(&[("--grid", "a.b"), ("--range", "a.c")], &["a.d=1"]), "");
        assert_eq!(fault(&[("--grid", "a.b"), ("--grid", "a.b")], &[]), "--grid a.b: given twice");
        assert_eq!(fault(&[("--grid", "a"), ("--grid", "a.b")], &[]), "--grid a.b: contradicts --grid a");
        assert_eq!(fault(&[("--grid", "a.b"), ("--range", "a.b")], &[]), "--range a.b: contradicts --grid a.b");
        assert_eq!(fault(&[("--range", "a.b")], &["a.b=2"]), "--set a.b=2: contradicts --range a.b");
    }
}
