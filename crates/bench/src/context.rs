//! Context of a benchmark: runs to measure, device, machine and folder of results.

use std::hash::Hash;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use indexmap::IndexSet;
use infonerf_experiment::execute::cores;
use infonerf_experiment::{DeviceName, Existing, Experiment, RunPlan, Selection, Session, networks, open};
use serde_json::{Value, json};

const PROGRAM: &str = concat!("infonerf ", env!("CARGO_PKG_VERSION"));

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
    pub(crate) folder: PathBuf,
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
    pub fn with_networks(mut self, weights: Option<&Path>) -> Result<Self> {
        self.session.networks = networks(weights, &self.session.device)?;
        Ok(self)
    }

    /// Returns the program, the machine and the runs for `results.json`.
    pub(crate) fn conditions(&self) -> Value {
        let first = &self.plans[0];
        json!({
            "benchmark": self.name,
            "program": PROGRAM,
            "cpu": cpu(),
            "cores": cores(),
            "device": self.session.device.name.name(),
            "experiment": self.experiment,
            "preset": first.preset.name(),
            "settings": self.settings,
            "data": self.data(),
            "scenes": distinct(&self.plans, |plan| plan.scene.clone()),
            "variants": distinct(&self.plans, |plan| plan.variant.clone()),
            "seeds": distinct(&self.plans, |plan| plan.seed),
            "image_size": first.config.scene.size,
            "train_views": first.config.scene.views,
            "test_views": first.config.eval.test.to_string(),
        })
    }

    pub(crate) fn machine(&self) -> String {
        let (name, cores, device, folder) = (self.name, cores(), self.session.device.name, self.folder.display());
        let cpu = cpu().unwrap_or_else(|| "unknown processor".to_owned());
        format!("bench {name}: {cpu}, {cores} cores, {PROGRAM}, device {device}\nresults: {folder}")
    }

    pub(crate) fn heading(&self) -> String {
        let (machine, data, first) = (self.machine(), self.data(), &self.plans[0]);
        let scenes = distinct(&self.plans, |plan| plan.scene.clone()).join(", ");
        let variants = distinct(&self.plans, |plan| plan.variant.clone()).join(", ");
        let seeds = distinct(&self.plans, |plan| plan.seed.to_string()).join(", ");
        let size = match first.config.scene.size {
            0 => "images of their own size".into(),
            size => format!("images of {size} pixels"),
        };
        let settings: String = self.settings.iter().map(|setting| format!(", {setting}")).collect();
        let (preset, test) = (first.preset.name(), &first.config.eval.test);
        format!(
            "{machine}\n{scenes} ({data}): {variants}\npreset {preset}, {size}, test views {test}, seed {seeds}{settings}"
        )
    }

    fn data(&self) -> String {
        let data = self.plans[0].data.as_ref();
        data.map_or("built-in procedural scenes".into(), |data| data.display().to_string())
    }
}

/// Keeps the plans whose `key` is `wanted`, or the first plan's if none is.
fn keep(plans: &mut Vec<RunPlan>, key: fn(&RunPlan) -> &String, wanted: Option<&str>) {
    let Some(first) = plans.first() else { return };
    let wanted = plans.iter().find(|plan| wanted == Some(key(plan).as_str())).unwrap_or(first);
    let wanted = key(wanted).clone();
    plans.retain(|plan| *key(plan) == wanted);
}

pub(crate) fn distinct<I, T: Hash + Eq>(items: &[I], key: impl Fn(&I) -> T) -> Vec<T> {
    items.iter().map(key).collect::<IndexSet<T>>().into_iter().collect()
}

fn cpu() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
