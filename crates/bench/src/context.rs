//! Context of a benchmark: runs to measure, device, machine and folder of results.

use std::hash::Hash;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use burn::tensor::Device;
use indexmap::IndexSet;
use infonerf_experiment::{DeviceName, Existing, Experiment, RunPlan, Selection, Session, networks, open};
use infonerf_scene::ViewSelection;
use serde::Serialize;

/// Benchmark with the runs that it measures.
pub struct Bench {
    pub(crate) name: &'static str,
    experiment: String,
    settings: Vec<String>,
    /// Runs to measure, at least one.
    pub(crate) plans: Vec<RunPlan>,
    /// Session that trains and evaluates runs in `runs` below the folder of results.
    pub(crate) session: Session,
    /// Folder of results.
    pub folder: PathBuf,
}

/// Program, machine and runs; part of `results.json`.
#[derive(Serialize)]
pub(crate) struct Conditions<'a> {
    benchmark: &'static str,
    program: &'static str,
    cpu: Option<String>,
    pub(crate) cores: usize,
    device: &'static str,
    experiment: &'a str,
    preset: &'static str,
    settings: &'a [String],
    data: String,
    scenes: Vec<String>,
    variants: Vec<String>,
    seeds: Vec<u64>,
    image_size: u32,
    train_views: &'a ViewSelection,
    test_views: String,
}

impl Bench {
    /// Prepares the benchmark called `name`, with results in a folder of that name in `out`. It measures the runs of `experiment`
    /// that `selection` names: by default those of the first scene, and of `variant` if one is given.
    ///
    /// # Errors
    /// If the experiment cannot be planned, or the device cannot be opened.
    pub fn new(
        name: &'static str,
        experiment: &str,
        selection: Selection,
        variant: Option<&str>,
        device: DeviceName,
        out: &Path,
    ) -> Result<Self> {
        let experiment = Experiment::plan(experiment, &selection)?;
        let mut plans = experiment.runs;
        if selection.scenes.is_empty() {
            keep(&mut plans, |plan| &plan.scene, None);
        }
        if selection.variants.is_empty() && variant.is_some() {
            keep(&mut plans, |plan| &plan.variant, variant);
        }
        ensure!(!plans.is_empty(), "expected at least one run to measure");
        let folder = out.join(name);
        let session = Session::new(open(device)?, folder.join("runs"), Existing::Overwrite);
        Ok(Self { name, experiment: experiment.about.name, settings: selection.set, plans, session, folder })
    }

    /// Returns the benchmark with the networks of learned metrics; `weights` are a place in addition to the usual ones.
    ///
    /// # Errors
    /// If weights cannot be read.
    pub fn with_networks(mut self, weights: Option<&Path>) -> Result<Self> {
        self.session.networks = networks(weights, &self.session.device)?;
        Ok(self)
    }

    pub(crate) fn device(&self) -> &Device {
        &self.session.device.device
    }

    pub(crate) fn conditions(&self) -> Conditions<'_> {
        let first = &self.plans[0];
        Conditions {
            benchmark: self.name,
            program: concat!("infonerf ", env!("CARGO_PKG_VERSION")),
            cpu: cpu(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            device: self.session.device.name.name(),
            experiment: &self.experiment,
            preset: first.preset.name(),
            settings: &self.settings,
            data: first.data.as_ref().map_or("built-in procedural scenes".into(), |data| data.display().to_string()),
            scenes: distinct(&self.plans, |plan| plan.scene.clone()),
            variants: distinct(&self.plans, |plan| plan.variant.clone()),
            seeds: distinct(&self.plans, |plan| plan.seed),
            image_size: first.config.scene.size,
            train_views: &first.config.scene.views,
            test_views: first.config.eval.test.to_string(),
        }
    }

    /// Describes the program and the machine.
    pub(crate) fn machine(&self) -> String {
        let Conditions { benchmark, program, cpu, cores, device, .. } = self.conditions();
        let cpu = cpu.as_deref().unwrap_or("unknown processor");
        format!("bench {benchmark}: {cpu}, {cores} cores, {program}, device {device}")
    }

    /// Describes the program, the machine and the runs.
    pub(crate) fn heading(&self) -> String {
        let Conditions { preset, settings, data, scenes, variants, seeds, image_size, test_views, .. } =
            self.conditions();
        let (machine, scenes, variants) = (self.machine(), scenes.join(", "), variants.join(", "));
        let size = match image_size {
            0 => "images of their own size".into(),
            size => format!("images of {size} pixels"),
        };
        let seeds = seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let settings: String = settings.iter().map(|setting| format!(", {setting}")).collect();
        format!(
            "{machine}\n{scenes} ({data}): {variants}\npreset {preset}, {size}, test views {test_views}, seed {seeds}{settings}"
        )
    }
}

/// Keeps the plans whose `key` is `wanted`, or the first plan's if none is.
fn keep(plans: &mut Vec<RunPlan>, key: fn(&RunPlan) -> &String, wanted: Option<&str>) {
    let Some(first) = plans.first() else { return };
    let wanted = plans.iter().find(|plan| wanted == Some(key(plan).as_str())).unwrap_or(first);
    let wanted = key(wanted).clone();
    plans.retain(|plan| *key(plan) == wanted);
}

/// Lists the values of `key`, each once, in order of appearance.
pub(crate) fn distinct<I, T: Hash + Eq>(items: &[I], key: impl Fn(&I) -> T) -> Vec<T> {
    items.iter().map(key).collect::<IndexSet<T>>().into_iter().collect()
}

fn cpu() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
