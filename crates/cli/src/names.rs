//! Names that shells complete, of values that may be others as well.

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::error::Error;
use clap::{Arg, Command};
use infonerf_train::Preset;

/// Accepts any text, and lists known names for completion.
#[derive(Clone)]
pub(crate) struct KnownNames(pub(crate) fn() -> Vec<String>);

impl TypedValueParser for KnownNames {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &std::ffi::OsStr) -> Result<String, Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        // Clap takes names that live as long as the program, which is not long after it completes them.
        let lasting = |name: String| PossibleValue::new(&*name.leak());
        Some(Box::new((self.0)().into_iter().map(lasting)))
    }
}

/// Returns the built-in experiments.
pub(crate) fn experiments() -> Vec<String> {
    infonerf_experiment::list().unwrap_or_default().into_iter().map(|(name, _)| name.to_owned()).collect()
}

/// Returns the variants of the built-in experiments.
pub(crate) fn variants() -> Vec<String> {
    infonerf_experiment::variant_names().unwrap_or_default()
}

/// Returns the built-in scenes.
pub(crate) fn scenes() -> Vec<String> {
    infonerf_procedural::NAMES.iter().map(|&name| name.to_owned()).collect()
}

/// Returns the keys of the config, each with the `=` that a value follows.
pub(crate) fn keys() -> Vec<String> {
    infonerf_experiment::config_keys(Preset::Fast).into_iter().map(|key| format!("{key}=")).collect()
}
