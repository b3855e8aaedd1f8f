//! Experiment files: which runs there are, and how each differs from a preset.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use burn::tensor::Device;
use infonerf_report::{Claim, Record, ReportInput};
use infonerf_scene::{Scene, SceneSource, procedural};
use infonerf_train::{Config, Preset, Trainer, config, member_seed};
use serde::{Deserialize, Serialize};
use toml::{Spanned, Table, Value};

use crate::args::{PresetName, Selection, parse_seeds};
use crate::paper::Paper;
use crate::plot::Plot;

/// The experiments that are built in.
const BUILT_IN: &[(&str, &str)] = &[
    ("synthetic-4view", include_str!("../../../experiments/synthetic-4view.toml")),
    ("synthetic-4view-losses", include_str!("../../../experiments/synthetic-4view-losses.toml")),
    ("synthetic-4view-mlp", include_str!("../../../experiments/synthetic-4view-mlp.toml")),
    ("synthetic-4view-alpha", include_str!("../../../experiments/synthetic-4view-alpha.toml")),
    ("integration", include_str!("../../../experiments/integration.toml")),
    ("integration-paper", include_str!("../../../experiments/integration-paper.toml")),
    ("released-skipping", include_str!("../../../experiments/released-skipping.toml")),
    ("released-warm", include_str!("../../../experiments/released-warm.toml")),
    ("scales", include_str!("../../../experiments/scales.toml")),
    ("unseen-rays", include_str!("../../../experiments/unseen-rays.toml")),
    ("loss-ablation", include_str!("../../../experiments/loss-ablation.toml")),
    ("baseline", include_str!("../../../experiments/baseline.toml")),
    ("views", include_str!("../../../experiments/views.toml")),
    ("information", include_str!("../../../experiments/information.toml")),
    ("small-nerf", include_str!("../../../experiments/small-nerf.toml")),
    ("dietnerf", include_str!("../../../experiments/dietnerf.toml")),
    ("pixelnerf-pretrain", include_str!("../../../experiments/pixelnerf-pretrain.toml")),
    ("pixelnerf-pretrain-paper", include_str!("../../../experiments/pixelnerf-pretrain-paper.toml")),
    ("integration-pixelnerf", include_str!("../../../experiments/integration-pixelnerf.toml")),
    ("integration-pixelnerf-paper", include_str!("../../../experiments/integration-pixelnerf-paper.toml")),
];

/// An experiment file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// One line on what it shows.
    title: Option<String>,
    /// Another experiment that this one changes.
    base: Option<String>,
    /// The experiment's name in results; by default the file's.
    name: Option<String>,
    /// Folder of scenes.
    data: Option<PathBuf>,
    /// Scenes to run on.
    scenes: Option<Vec<String>>,
    /// Seeds to run.
    seeds: Option<Vec<u64>>,
    /// Preset to start from.
    preset: Option<Preset>,
    /// Training time of each run in seconds.
    budget_seconds: Option<f64>,
    /// Laid over the preset.
    #[serde(default)]
    config: Table,
    /// What is compared: each laid over `config`. Where a name stands in the file says its place in tables.
    #[serde(default)]
    variants: BTreeMap<Spanned<String>, Value>,
    /// What a paper found, to stand beside the results.
    paper: Option<Paper>,
    /// What it says about the order of the variants.
    claims: Option<Vec<Claim>>,
    /// A chart for its report.
    plot: Option<Plot>,
}

/// What an experiment is, beside its runs.
#[derive(Clone, Debug)]
pub(crate) struct About {
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) data: Option<PathBuf>,
    pub(crate) paper: Option<Paper>,
    pub(crate) claims: Vec<Claim>,
    pub(crate) plot: Option<Plot>,
}

impl About {
    /// What a report of `records`, which came of `runs`, is made of.
    pub(crate) fn report_input(&self, records: Vec<Record>, runs: &[&RunPlan]) -> Result<ReportInput> {
        let plot = self.plot.as_ref().map(|plot| plot.figure(&records)).transpose()?;
        let mut input = ReportInput::new(&self.name, &self.title, records);
        input.figures.extend(plot);
        if self.data.is_none() {
            input.warnings.push("Procedural scenes of this project, not a published data set.".into());
        }
        input.published = self.paper.as_ref().map(|paper| paper.beside(runs));
        input.claims = self.claims.clone();
        Ok(input)
    }
}

/// An experiment, ready to run.
#[derive(Debug)]
pub(crate) struct Experiment {
    pub(crate) about: About,
    pub(crate) runs: Vec<RunPlan>,
}

/// One run.
#[derive(Clone, Debug)]
pub(crate) struct RunPlan {
    pub(crate) experiment: String,
    pub(crate) scene: String,
    pub(crate) source: SceneSource,
    pub(crate) data: Option<PathBuf>,
    pub(crate) variant: String,
    pub(crate) seed: u64,
    pub(crate) preset: Preset,
    pub(crate) budget: Option<f64>,
    pub(crate) config: Config,
}

/// The `config.toml` of a run: an experiment file of that one run, complete.
#[derive(Serialize, Deserialize)]
struct Complete {
    title: String,
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<PathBuf>,
    scenes: Vec<String>,
    seeds: Vec<u64>,
    preset: Preset,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget_seconds: Option<f64>,
    config: Config,
    variants: BTreeMap<String, Table>,
}

/// Names and titles of the built-in experiments.
pub(crate) fn list() -> Result<Vec<(&'static str, String)>> {
    let parsed = BUILT_IN.iter().map(|&(name, text)| Ok((name, parse(name, text)?)));
    let files = parsed.collect::<Result<Vec<(&str, File)>>>()?;
    // What has no variants and no base is there for others to build on.
    let runs = |(_, file): &(&str, File)| file.base.is_some() || !file.variants.is_empty();
    Ok(files.into_iter().filter(runs).map(|(name, file)| (name, file.title.unwrap_or_default())).collect())
}

fn parse(origin: &str, text: &str) -> Result<File> {
    let first = |error: toml::de::Error| {
        let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].lines().count().max(1));
        anyhow::anyhow!("{origin}: line {line}: {}", error.message().lines().next().unwrap_or_default())
    };
    toml::from_str(text).map_err(first)
}

fn read(name: &str) -> Result<(String, File)> {
    if let Some((_, text)) = BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
        return Ok((name.to_owned(), parse(name, text)?));
    }
    let path = Path::new(name);
    if !path.exists() {
        let known: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
        bail!("{name}: expected an experiment file or one of: {}", known.join(", "));
    }
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let stem = path.file_stem().map_or_else(|| "experiment".into(), |stem| stem.to_string_lossy().into_owned());
    Ok((stem, parse(name, &text)?))
}

/// Reads an experiment with those that it is based on, the furthest first.
fn layers(name: &str) -> Result<(String, Vec<File>)> {
    let (own_name, file) = read(name)?;
    let mut base = file.base.clone();
    let mut files = vec![file];
    while let Some(name) = base {
        if files.len() > 8 {
            bail!("{own_name}: base: expected at most 8 experiments in a row, each changing the next");
        }
        let (_, file) = read(&name).with_context(|| format!("{own_name}: base"))?;
        base = file.base.clone();
        files.push(file);
    }
    files.reverse();
    Ok((own_name, files))
}

impl Experiment {
    /// Reads the experiment called `experiment` and applies what `args` and `budget` change.
    pub(crate) fn plan(experiment: &str, args: &Selection, budget: Option<Duration>) -> Result<Self> {
        let (own_name, files) = layers(experiment)?;
        let last = |pick: fn(&File) -> Option<String>| files.iter().rev().find_map(pick);
        let name = files.last().and_then(|file| file.name.clone()).unwrap_or(own_name);
        let preset = match args.preset {
            Some(PresetName::Fast) => Preset::Fast,
            Some(PresetName::Paper) => Preset::Paper,
            Some(PresetName::Released) => Preset::Released,
            None => files.iter().rev().find_map(|file| file.preset).unwrap_or(Preset::Fast),
        };
        let data = args.data.clone().or_else(|| files.iter().rev().find_map(|file| file.data.clone()));
        let mut table = preset.table();
        for file in &files {
            config::merge(&mut table, file.config.clone());
        }
        let (order, variants) = variants(&files);
        if order.is_empty() {
            bail!("{name}: variants: expected at least one table");
        }
        let listed = if args.data.is_some() { None } else { files.iter().rev().find_map(|file| file.scenes.clone()) };
        let scenes = if args.scenes.is_empty() { listed } else { Some(args.scenes.clone()) };
        let scenes = find_scenes(data.as_deref(), scenes)?;
        let seeds = if args.seeds.is_empty() {
            files.iter().rev().find_map(|file| file.seeds.clone()).unwrap_or_else(|| vec![0])
        } else {
            args.seeds.iter().cloned().flatten().collect()
        };
        let names = choose_variants(order, &args.variants)?;
        check_distinct("--scene", scenes.iter().map(|(scene, _)| scene.clone()))?;
        check_distinct("--variant", names.iter().cloned())?;
        check_distinct("--seed", seeds.iter().map(u64::to_string))?;
        let budget = budget
            .map(|budget| budget.as_secs_f64())
            .or_else(|| files.iter().rev().find_map(|file| file.budget_seconds));
        let mut runs = Vec::new();
        for (scene, source) in &scenes {
            for variant in &names {
                let config =
                    variant_config(&table, &variants, variant, &args.set).with_context(|| experiment.to_owned())?;
                for &seed in &seeds {
                    runs.push(RunPlan {
                        experiment: name.clone(),
                        scene: scene.clone(),
                        source: source.clone(),
                        data: data.clone(),
                        variant: variant.clone(),
                        seed,
                        preset,
                        budget,
                        config: config.clone(),
                    });
                }
            }
        }
        let title = last(|file| file.title.clone()).unwrap_or_else(|| name.clone());
        let paper = files.iter().rev().find_map(|file| file.paper.clone());
        let claims = files.iter().rev().find_map(|file| file.claims.clone()).unwrap_or_default();
        let plot = files.iter().rev().find_map(|file| file.plot.clone());
        Ok(Self { about: About { name, title, data, paper, claims, plot }, runs })
    }
}

/// The names of the variants in the order of the files, the base's first, and what each changes.
fn variants(files: &[File]) -> (Vec<String>, Table) {
    let (mut order, mut tables) = (Vec::new(), Table::new());
    for file in files {
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
    (order, tables)
}

fn variant_config(table: &Table, variants: &Table, variant: &str, set: &[String]) -> Result<Config> {
    let mut table = table.clone();
    match variants.get(variant) {
        Some(Value::Table(over)) => config::merge(&mut table, over.clone()),
        _ => bail!("variants.{variant}: expected a table"),
    }
    for assignment in set {
        config::assign(&mut table, assignment).with_context(|| format!("--set {assignment}"))?;
    }
    Config::from_table(table).with_context(|| format!("variant {variant}"))
}

fn choose_variants(known: Vec<String>, wanted: &[String]) -> Result<Vec<String>> {
    if let Some(unknown) = wanted.iter().find(|name| !known.contains(name)) {
        bail!("--variant {unknown}: expected one of: {}", known.join(", "));
    }
    Ok(if wanted.is_empty() { known } else { wanted.to_vec() })
}

fn check_distinct(what: &str, items: impl Iterator<Item = String>) -> Result<()> {
    let mut seen = std::collections::BTreeSet::new();
    for item in items {
        if !seen.insert(item.clone()) {
            bail!("{what} {item}: given twice");
        }
    }
    Ok(())
}

/// The scenes to run on, with where they are.
fn find_scenes(data: Option<&Path>, names: Option<Vec<String>>) -> Result<Vec<(String, SceneSource)>> {
    let Some(data) = data else {
        let names = names.unwrap_or_else(|| procedural::NAMES.iter().map(|&name| name.to_owned()).collect());
        return names
            .iter()
            .flat_map(|name| expand(name))
            .map(|name| match procedural::check_name(&name) {
                Ok(()) => Ok((name.clone(), SceneSource::Procedural(name))),
                Err(_) => bail!(
                    "--scene {name}: expected one of the built-in scenes ({}, random-<seed>), or --data with the folder that holds it",
                    procedural::NAMES.join(", ")
                ),
            })
            .collect();
    };
    let names = match names {
        Some(names) => names,
        None => subfolders(data)?,
    };
    names
        .into_iter()
        .map(|name| {
            let path = data.join(&name);
            if name.is_empty() || Path::new(&name).components().count() != 1 || name.contains("..") {
                bail!("--scene {name}: expected the name of a folder in {}", data.display());
            }
            if !path.is_dir() {
                bail!("{}: expected the folder of scene {name}: not found", path.display());
            }
            Ok((name, SceneSource::Folder { path }))
        })
        .collect()
}

/// `random-0..3` is short for random-0, random-1, random-2 and random-3; any other name is itself.
fn expand(name: &str) -> Vec<String> {
    let range = name.strip_prefix("random-").and_then(|range| parse_seeds(range).ok());
    range.map_or_else(|| vec![name.to_owned()], |seeds| seeds.map(|seed| format!("random-{seed}")).collect())
}

fn subfolders(data: &Path) -> Result<Vec<String>> {
    let entries =
        std::fs::read_dir(data).with_context(|| format!("{}: expected a folder of scenes", data.display()))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    if names.is_empty() {
        bail!("{}: expected a folder of scenes: it has none", data.display());
    }
    Ok(names)
}

impl RunPlan {
    /// How many fields the run trains.
    pub(crate) fn members(&self) -> usize {
        self.config.train.members_in(self.budget)
    }

    /// Folder of the `index`th field's training: the run's own if there is one field.
    pub(crate) fn member_folder(&self, run: &Path, index: usize) -> PathBuf {
        if self.members() == 1 { run.to_owned() } else { run.join(format!("member{index}")) }
    }

    /// The `index`th field before its first step.
    pub(crate) fn trainer(&self, scene: Scene, index: usize, device: &Device) -> Result<Trainer> {
        let budget = self.budget.map(|budget| budget / self.members() as f64);
        let config = Config { train: self.config.train.of_member(self.members()), ..self.config.clone() };
        Ok(Trainer::new(&config, scene, member_seed(self.seed, index), budget, device)?)
    }

    /// How the run is named to people.
    pub(crate) fn label(&self) -> String {
        format!("{}/{}/seed{}", self.scene, self.variant, self.seed)
    }

    /// The text of `config.toml`: running it again gives the same numbers.
    pub(crate) fn to_toml(&self) -> Result<String> {
        self.to_toml_with(vec![self.scene.clone()])
    }

    /// The same of a run over several scenes.
    pub(crate) fn to_toml_with(&self, scenes: Vec<String>) -> Result<String> {
        let data = self.data.as_deref().map(|data| std::path::absolute(data).unwrap_or_else(|_| data.to_owned()));
        let complete = Complete {
            title: self.label(),
            name: self.experiment.clone(),
            data,
            scenes,
            seeds: vec![self.seed],
            preset: self.preset,
            budget_seconds: self.budget,
            config: self.config.clone(),
            variants: BTreeMap::from([(self.variant.clone(), Table::new())]),
        };
        Ok(toml::to_string(&complete)?)
    }

    /// Reads the `config.toml` of a run's folder.
    pub(crate) fn of_run(folder: &Path) -> Result<Self> {
        let path = folder.join("config.toml");
        if !path.is_file() {
            bail!("{}: expected the folder of a run: it has no config.toml", folder.display());
        }
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        Self::from_toml(&text).with_context(|| path.display().to_string())
    }

    /// Reads the text of a `config.toml`.
    pub(crate) fn from_toml(text: &str) -> Result<Self> {
        let complete: Complete = toml::from_str(text).map_err(|error| anyhow::anyhow!("{}", error.message()))?;
        complete.config.validate()?;
        let (Some(scene), Some(&seed), Some(variant)) =
            (complete.scenes.first(), complete.seeds.first(), complete.variants.keys().next())
        else {
            bail!("expected one scene, one seed and one variant");
        };
        let source = find_scenes(complete.data.as_deref(), Some(vec![scene.clone()]))?.remove(0).1;
        Ok(Self {
            experiment: complete.name,
            scene: scene.clone(),
            source,
            data: complete.data,
            variant: variant.clone(),
            seed,
            preset: complete.preset,
            budget: complete.budget_seconds,
            config: complete.config,
        })
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Args, Command};

    /// Over any preset, and as it comes back from a run's `config.toml`.
    #[test]
    fn every_built_in_experiment_is_valid() {
        for (name, _) in list().unwrap() {
            for preset in Preset::ALL.map(Preset::name) {
                let args = Args::parse_from(["infonerf", "exp", name, "--preset", preset]);
                let Command::Exp(args) = args.command else { panic!("exp") };
                for plan in Experiment::plan(name, &args.selection, None).unwrap().runs {
                    assert_eq!(RunPlan::from_toml(&plan.to_toml().unwrap()).unwrap().config, plan.config, "{name}");
                }
            }
        }
    }

    #[test]
    fn variants_come_in_the_order_of_the_files() {
        let base = parse("base", "[variants.z]\n[variants.m.loss]\nalpha = 1.0\n").unwrap();
        let over = parse("over", "[variants.b]\n[variants.m.train]\nlr = 1.0\n[variants.a]\n").unwrap();
        let (order, tables) = variants(&[base, over]);
        assert_eq!(order, ["z", "m", "b", "a"]);
        assert_eq!(tables["m"].as_table().unwrap().len(), 2);
    }

    #[test]
    fn every_built_in_experiment_is_sound() {
        for (name, text) in BUILT_IN {
            parse(name, text).unwrap();
        }
        let listed = list().unwrap();
        assert!(listed.iter().all(|(name, title)| !title.is_empty() && *name != "small-nerf"));
        assert_eq!(listed.len(), BUILT_IN.len() - 1);
    }
}
