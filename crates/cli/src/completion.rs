//! Completion in shells: names of experiments, variants and scenes, and keys of a config.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use clap_complete::engine::{ArgValueCompleter, CompletionCandidate, PathCompleter, ValueCompleter};
use infonerf_experiment::{config_keys, describe};
use infonerf_procedural as procedural;

/// The experiment whose keys are completed if the command line names none.
const DEFAULT: &str = "synthetic-4view";

/// Completes names of built-in experiments, with their titles, and paths of TOML files.
pub(crate) fn experiments() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let built_in = infonerf_experiment::list().unwrap_or_default().into_iter();
        let named = built_in.map(|(name, title)| CompletionCandidate::new(name).help(Some(title.into())));
        let is_file = |path: &Path| path.extension().is_some_and(|extension| extension == "toml");
        let files = PathCompleter::any().filter(is_file).complete(current);
        beginning_with(current, named).into_iter().chain(files).collect()
    })
}

/// Completes the variants of the experiment that the command line names.
pub(crate) fn variants() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let named = experiment().and_then(|name| describe(&name).ok());
        let runs = named.map_or_else(Vec::new, |described| described.experiment.runs);
        let names: BTreeSet<String> = runs.into_iter().map(|run| run.variant).collect();
        beginning_with(current, names.into_iter().map(CompletionCandidate::new))
    })
}

/// Completes the built-in scenes, or those in the folder of `--data`.
pub(crate) fn scenes() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| match data() {
        Some(folder) => {
            let entries = fs::read_dir(folder).into_iter().flatten().flatten().filter(|entry| entry.path().is_dir());
            beginning_with(current, entries.map(|entry| CompletionCandidate::new(entry.file_name())))
        }
        None => beginning_with(current, procedural::NAMES.into_iter().map(CompletionCandidate::new)),
    })
}

/// Completes the keys of the config of the experiment that the command line names, each with `=`.
pub(crate) fn keys() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let named = experiment().and_then(|name| config_keys(&name).ok());
        let keys = named.or_else(|| config_keys(DEFAULT).ok()).unwrap_or_default();
        beginning_with(current, keys.into_iter().map(|key| CompletionCandidate::new(format!("{key}="))))
    })
}

fn beginning_with(current: &OsStr, candidates: impl Iterator<Item = CompletionCandidate>) -> Vec<CompletionCandidate> {
    let current = current.as_encoded_bytes();
    candidates.filter(|candidate| candidate.get_value().as_encoded_bytes().starts_with(current)).collect()
}

/// Returns the words after the subcommand of the command line to complete, which shells pass after `COMPLETER -- infonerf`.
fn words() -> impl Iterator<Item = String> {
    std::env::args_os().skip(4).map(|word| word.to_string_lossy().into_owned())
}

/// Finds the experiment that the command line names: a built-in one or a TOML file.
fn experiment() -> Option<String> {
    let built_in = infonerf_experiment::list().unwrap_or_default();
    words().find(|word| word.ends_with(".toml") || built_in.iter().any(|(name, _)| name == word))
}

fn data() -> Option<String> {
    let mut words = words();
    let option = words.find(|word| word == "--data" || word.starts_with("--data="))?;
    option.strip_prefix("--data=").map(str::to_owned).or_else(|| words.next())
}
