use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use infonerf_report::Claim;
use infonerf_train::{Preset, config};
use serde::Deserialize;
use toml::{Spanned, Table, Value};

use crate::published::{Aspect, Paper};
use crate::sweep::figures::Plot;

/// Defines `BUILT_IN` from the names of the files.
macro_rules! built_in {
    ($($name:literal,)*) => {
        /// Names and texts of the built-in experiments, each from `experiments/<name>.toml`.
        const BUILT_IN: &[(&str, &str)] = &[$(($name, include_str!(concat!("../experiments/", $name, ".toml"))),)*];
    };
}

built_in! {
    "synthetic-4view", "paper-regime", "fast-losses", "recipe", "time-against-error", "llff-2view", "llff-3view",
    "dtu-3view", "dtu-released", "zju-4view", "capture", "cameras", "loss-ablation", "unseen-rays", "baseline", "views",
    "information", "integration", "integration-pixelnerf", "pixelnerf-pretrain", "baselines", "baselines-paper",
    "released-small",
}

/// Maximum number of experiments that a file is based on, one through the other.
const MAX_CHAIN: usize = 8;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    /// Title: one line on what the experiment shows.
    pub(crate) title: Option<String>,
    /// Built-in experiment that this one is based on, or the path of a file, relative to the folder of this one.
    base: Option<String>,
    /// Name of the experiment in results; by default the file name.
    pub(crate) name: Option<String>,
    /// Folder of scenes.
    pub(crate) data: Option<PathBuf>,
    pub(crate) scenes: Option<Vec<String>>,
    pub(crate) seeds: Option<Vec<u64>>,
    /// Preset to start from; by default `capture` for photographs, else `fast`. `dense` replaces `capture` for many photographs.
    pub(crate) preset: Option<Preset>,
    /// Training time of each run in seconds.
    pub(crate) budget_seconds: Option<f64>,
    /// Mean wall-clock seconds of a run on two CPU cores, from reading its scene to its metrics; printed before the runs start.
    seconds_per_run: Option<u32>,
    /// Config that is laid over the preset.
    #[serde(default)]
    pub(crate) config: Table,
    /// Variants that are compared; tables have them in the order of the file. Each variant is laid over `preset` and `config`, or
    /// over a `preset` of its own (`auto`: the preset that suits the scene).
    #[serde(default)]
    variants: BTreeMap<Spanned<String>, Value>,
    /// A paper's published figures, shown next to the results.
    paper: Option<Paper>,
    /// Aspects of the paper's protocol that experiments based on this one share; their own `[paper.protocol]` takes precedence.
    paper_protocol: Option<BTreeMap<Aspect, String>>,
    /// Claims about the order of the variants, to be tested.
    pub(crate) claims: Option<Vec<Claim>>,
    pub(crate) plot: Option<Plot>,
}

/// An experiment file with all files that it is based on.
pub(crate) struct Layers {
    /// The file's own name, without extension.
    pub(crate) name: String,
    pub(crate) text: String,
    /// Names (or paths) and contents of the files. Each file is the base of the next; the last is the experiment's own.
    files: Vec<(String, File)>,
}

impl Layers {
    /// Reads the experiment called `name`: a built-in one, or the path of a file.
    pub(crate) fn read(name: &str) -> Result<Self> {
        let (own_name, text, file) = read(name)?;
        let mut files = vec![(name.to_owned(), file)];
        let based = |(file, contents): &(String, File)| Some((file.clone(), contents.base.clone()?));
        while let Some((file, base)) = files.last().and_then(based) {
            if files.len() > MAX_CHAIN {
                bail!("{name}: base: expected at most {MAX_CHAIN} experiments in a row, each changing the next");
            }
            let base = base_path(&file, &base);
            let (_, _, contents) = read(&base).with_context(|| format!("{file}: base"))?;
            files.push((base, contents));
        }
        files.reverse();
        Ok(Self { name: own_name, text, files })
    }

    /// Reads the built-in experiment called `name`, if there is one.
    pub(crate) fn built_in(name: &str) -> Option<Self> {
        built_in_text(name).and_then(|_| Self::read(name).ok())
    }

    /// Returns the name of the experiment in results: the one that the last file sets, by default its file name.
    pub(crate) fn result_name(&self) -> String {
        self.files.last().and_then(|(_, file)| file.name.clone()).unwrap_or_else(|| self.name.clone())
    }

    /// Returns the `seconds_per_run` of the last file. Values of the files that it is based on hold for other settings.
    pub(crate) fn seconds_per_run(&self) -> Option<f64> {
        self.files.last().and_then(|(_, file)| file.seconds_per_run).map(f64::from)
    }

    pub(crate) fn last<T>(&self, pick: impl Fn(&File) -> Option<T>) -> Option<T> {
        self.files.iter().rev().find_map(|(_, file)| pick(file))
    }

    /// Names `key` and the last file that `has` it, by default the experiment's own.
    pub(crate) fn place(&self, key: &str, has: impl Fn(&File) -> bool) -> String {
        let file = self.files.iter().rev().find(|(_, file)| has(file)).or(self.files.last());
        format!("{}: {key}", file.map_or(&self.name, |(name, _)| name))
    }

    /// Returns the paper of the last file that has one, with the shared aspects of its protocol.
    pub(crate) fn paper(&self) -> Option<Paper> {
        let mut paper = self.last(|file| file.paper.clone())?;
        let mut protocol = self.last(|file| file.paper_protocol.clone()).unwrap_or_default();
        protocol.append(&mut paper.protocol);
        paper.protocol = protocol;
        Some(paper)
    }

    /// Returns the preset with the config of every file laid over it.
    pub(crate) fn config(&self, preset: Preset) -> Table {
        let mut table = preset.table();
        for (_, config) in self.configs() {
            config::merge(&mut table, config.clone());
        }
        table
    }

    /// Returns the name and the config of every file, each after the file that it is based on.
    pub(crate) fn configs(&self) -> impl Iterator<Item = (&str, &Table)> {
        self.files.iter().map(|(name, file)| (name.as_str(), &file.config))
    }

    /// Returns the names of the experiments that the last file is based on, the nearest first.
    pub(crate) fn bases(&self) -> impl Iterator<Item = &str> {
        self.files.iter().rev().skip(1).map(|(name, _)| name.as_str())
    }

    /// Returns the variants in the order of the files, the base's first.
    pub(crate) fn variants(&self) -> Result<Vec<Variant>> {
        let (mut order, mut tables) = (Vec::new(), Table::new());
        for (_, file) in &self.files {
            let mut own: Vec<(&Spanned<String>, &Value)> = file.variants.iter().collect();
            own.sort_by_key(|(name, _)| name.span().start);
            for (name, value) in own {
                let name = name.get_ref();
                if !order.contains(name) {
                    order.push(name.clone());
                }
                config::merge(&mut tables, Table::from_iter([(name.clone(), value.clone())]));
            }
        }
        order.iter().map(|name| Variant::read(name, &tables)).collect()
    }
}

/// One of the settings that an experiment compares.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Variant {
    pub(crate) name: String,
    pub(crate) start: Start,
    /// Config that is laid over `start`.
    pub(crate) changes: Table,
}

/// Config that a variant starts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Start {
    /// The experiment's preset and `config`.
    Experiment,
    /// A preset alone; `None` for the one that suits the scene.
    Preset(Option<Preset>),
}

impl Variant {
    fn read(name: &str, tables: &Table) -> Result<Self> {
        let Some(Value::Table(changes)) = tables.get(name) else { bail!("variants.{name}: expected a table") };
        let mut changes = changes.clone();
        let start = match changes.remove("preset") {
            None => Start::Experiment,
            Some(Value::String(auto)) if auto == "auto" => Start::Preset(None),
            Some(preset) => {
                let fault = |error: toml::de::Error| {
                    anyhow!("variants.{name}.preset: {}", config::plain_message(error.message()))
                };
                Start::Preset(Some(preset.try_into().map_err(fault)?))
            }
        };
        Ok(Self { name: name.to_owned(), start, changes })
    }
}

/// Returns the names and titles of the built-in experiments that can be run. An experiment with neither variants nor a base
/// only serves as the base of others.
pub fn list() -> Result<Vec<(&'static str, String)>> {
    let parsed = BUILT_IN.iter().map(|&(name, text)| Ok((name, parse(name, text)?)));
    let files = parsed.collect::<Result<Vec<(&str, File)>>>()?;
    let runs = |(_, file): &(&str, File)| file.base.is_some() || !file.variants.is_empty();
    Ok(files.into_iter().filter(runs).map(|(name, file)| (name, file.title.unwrap_or_default())).collect())
}

fn built_in_text(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(built_in, _)| *built_in == name).map(|(_, text)| *text)
}

/// Returns the name of a built-in experiment, or the path of a file, that `file` names as its `base`.
fn base_path(file: &str, base: &str) -> String {
    match built_in_text(base) {
        Some(_) => base.to_owned(),
        None => Path::new(file).with_file_name(base).display().to_string(),
    }
}

/// Reads an experiment, and returns its name, its text and the parsed file.
fn read(name: &str) -> Result<(String, String, File)> {
    if let Some(text) = built_in_text(name) {
        return Ok((name.to_owned(), text.to_owned(), parse(name, text)?));
    }
    let path = Path::new(name);
    if path.is_dir() || (!path.exists() && path.extension().is_none()) {
        let names: Vec<&str> = list()?.into_iter().map(|(name, _)| name).collect();
        bail!("{name}: expected an experiment file or one of: {}", names.join(", "));
    }
    let text = std::fs::read_to_string(path).with_context(|| format!("{name}: expected an experiment file"))?;
    let stem = path.file_stem().map_or_else(|| "experiment".into(), |stem| stem.to_string_lossy().into_owned());
    let file = parse(name, &text)?;
    Ok((stem, text, file))
}

fn parse(origin: &str, text: &str) -> Result<File> {
    let located = |error: toml::de::Error| {
        let start = error.span().map_or(0, |span| span.start);
        let before = text.get(..start).filter(|_| start < text.len()).unwrap_or_else(|| text.trim_end());
        let line = before.matches('\n').count();
        let key = text.lines().nth(line).filter(|_| error.span().is_some()).and_then(|line| line.split_once('='));
        let key = key.map_or_else(String::new, |(key, _)| format!("{}: ", key.trim()));
        anyhow!("{origin}: line {}: {key}{}", line + 1, config::plain_message(error.message()))
    };
    toml::from_str(text).map_err(located)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variants(texts: &[&str]) -> Result<Vec<Variant>> {
        let files = texts.iter().map(|text| ("file".to_owned(), parse("file", text).unwrap())).collect();
        Layers { name: "file".into(), text: String::new(), files }.variants()
    }

    #[test]
    fn variants_come_in_the_order_of_the_files() {
        let base = "[variants.z]\n[variants.m.loss.tv]\nweight = 1.0\n";
        let found = variants(&[base, "[variants.b]\n[variants.m.train]\nlr = 1.0\n[variants.a]\n"]).unwrap();
        assert_eq!(found.iter().map(|variant| variant.name.as_str()).collect::<Vec<_>>(), ["z", "m", "b", "a"]);
        assert_eq!(found[1].changes.len(), 2);
    }

    #[test]
    fn a_variant_can_have_a_preset_of_its_own() {
        let text = "[variants.a.train]\nlr = 2.0\n[variants.b]\npreset = 'released'\n[variants.c]\npreset = 'auto'\n";
        let found = variants(&[text]).unwrap();
        let starts: Vec<Start> = found.iter().map(|variant| variant.start).collect();
        assert_eq!(starts, [Start::Experiment, Start::Preset(Some(Preset::Released)), Start::Preset(None)]);
        assert!(found[1].changes.is_empty() && !found[0].changes.is_empty());
        let error = format!("{:#}", variants(&["[variants.a]\npreset = 'slow'\n"]).unwrap_err());
        assert!(error.starts_with("variants.a.preset: expected one of fast, "), "{error}");
    }

    #[test]
    fn a_base_is_relative_to_the_file_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("child.toml");
        std::fs::write(&file, "base = 'parent.toml'\n").unwrap();
        std::fs::write(folder.path().join("parent.toml"), "base = 'fast-losses'\ntitle = 'parent'\n").unwrap();
        let layers = Layers::read(&file.to_string_lossy()).unwrap();
        assert_eq!(layers.last(|file| file.title.clone()).as_deref(), Some("parent"));
        assert_eq!(layers.bases().nth(1), Some("fast-losses"));
    }

    #[test]
    fn every_built_in_experiment_has_a_title() {
        for (name, text) in BUILT_IN {
            parse(name, text).unwrap();
        }
        let listed = list().unwrap();
        assert!(listed.iter().all(|(name, title)| !title.is_empty() && *name != "released-small"));
        assert_eq!(listed.len(), BUILT_IN.len() - 1);
    }
}
