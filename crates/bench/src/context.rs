//! Context of a benchmark: runs to measure, device, machine and folder of results.

use std::cell::RefCell;
use std::fmt;
use std::hash::Hash;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use burn::tensor::Device;
use indexmap::IndexSet;
use infonerf_experiment::{DeviceName, Existing, Experiment, RunPlan, Selection, Session, Watch, networks, open};
use infonerf_metrics::Networks;
use infonerf_scene::ViewSelection;
use serde::Serialize;

/// Variant of benchmarks that measure one.
const DEFAULT_VARIANT: &str = "infonerf";

/// Benchmark with the runs that it measures; `Display` prints the program, the machine and, if it trains them, the runs.
pub struct Bench {
    /// Runs to measure, at least one.
    pub(crate) plans: Vec<RunPlan>,
    /// Session that trains and evaluates runs in `runs` below the folder of results.
    pub(crate) session: Session,
    /// Folder of results.
    pub folder: PathBuf,
    pub(crate) conditions: Conditions,
    pub(crate) watch: RefCell<Box<Watch<'static>>>,
}

/// Program, machine and runs; part of `results.json`.
#[derive(Serialize)]
pub(crate) struct Conditions {
    pub(crate) benchmark: &'static str,
    program: &'static str,
    cpu: Option<String>,
    pub(crate) cores: usize,
    device: &'static str,
    experiment: String,
    preset: &'static str,
    settings: Vec<String>,
    data: String,
    scenes: Vec<String>,
    variants: Vec<String>,
    seeds: Vec<u64>,
    image_size: u32,
    train_views: ViewSelection,
    test_views: String,
}

impl Bench {
    /// Prepares the benchmark called `name`, with results in a folder of that name in `out`. It measures the runs of `experiment`
    /// that `selection` names: by default those of the first scene and the variant `infonerf` (of all variants for `pareto`).
    /// `weights` are those of learned metrics, in addition to the usual places; `watch` receives the events of runs.
    ///
    /// # Errors
    /// If the experiment cannot be planned, or the device or the weights cannot be opened.
    pub fn new(
        name: &'static str,
        experiment: &str,
        selection: Selection,
        device: DeviceName,
        weights: Option<&Path>,
        out: &Path,
        watch: Box<Watch<'static>>,
    ) -> Result<Self> {
        let experiment = Experiment::plan(experiment, &selection)?;
        let mut plans = experiment.runs;
        if selection.scenes.is_empty() {
            keep(&mut plans, |plan| &plan.scene, None);
        }
        if selection.variants.is_empty() && name != "pareto" {
            keep(&mut plans, |plan| &plan.variant, Some(DEFAULT_VARIANT));
        }
        let device = open(device)?;
        let first = plans.first().context("expected at least one run to measure")?;
        let conditions = Conditions {
            program: concat!("infonerf ", env!("CARGO_PKG_VERSION")),
            cpu: cpu(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            device: device.name.name(),
            experiment: experiment.about.name,
            preset: first.preset.name(),
            settings: selection.set,
            data: first.data.as_ref().map_or("built-in procedural scenes".into(), |data| data.display().to_string()),
            scenes: distinct(&plans, |plan| plan.scene.clone()),
            variants: distinct(&plans, |plan| plan.variant.clone()),
            seeds: distinct(&plans, |plan| plan.seed),
            image_size: first.config.scene.size,
            train_views: first.config.scene.views.clone(),
            test_views: first.config.eval.test.to_string(),
            benchmark: name,
        };
        let measures_quality = matches!(name, "pareto" | "skip");
        let networks = if measures_quality { networks(weights, &device)? } else { Networks::none() };
        let folder = out.join(name);
        let session = Session::new(device, folder.join("runs"), Existing::Overwrite).with_networks(networks);
        Ok(Self { plans, session, folder, conditions, watch: RefCell::new(watch) })
    }

    pub(crate) fn device(&self) -> &Device {
        &self.session.device.device
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

impl fmt::Display for Bench {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Conditions { benchmark, program, cpu, cores, device, preset, settings, .. } = &self.conditions;
        let Conditions { data, scenes, variants, seeds, image_size, test_views, .. } = &self.conditions;
        let cpu = cpu.as_deref().unwrap_or("unknown processor");
        let size = match image_size {
            0 => "images of their own size".into(),
            size => format!("images of {size} pixels"),
        };
        let seeds = seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let settings: String = settings.iter().map(|setting| format!(", {setting}")).collect();
        write!(f, "bench {benchmark}: {cpu}, {cores} cores, {program}, device {device}")?;
        if matches!(*benchmark, "agreement" | "stress") {
            return Ok(());
        }
        writeln!(f, "\n{} ({data}): {}", scenes.join(", "), variants.join(", "))?;
        write!(f, "preset {preset}, {size}, test views {test_views}, seed {seeds}{settings}")
    }
}
