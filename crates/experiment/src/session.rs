use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use anyhow::Result;
use infonerf_metrics::Networks;
use infonerf_scene::Scene;
use infonerf_train::{Event, Trainer};

use crate::{OpenDevice, RunPlan};

/// Where and how runs happen.
#[derive(Debug)]
pub struct Session {
    /// Where to compute.
    pub device: OpenDevice,
    /// Folder for results: each run is in `<experiment>/<scene>/<variant>/seed<N>` below it.
    pub out: PathBuf,
    /// How to treat runs that exist already.
    pub existing: Existing,
    /// Share of each run after which it is stopped, to be resumed later.
    pub until: Option<f64>,
    /// Whether the device is waited for after each phase of a step: see [`Trainer::synchronise_phases`].
    ///
    /// [`Trainer::synchronise_phases`]: infonerf_train::Trainer::synchronise_phases
    pub profiled: bool,
    /// What learned metrics need: those without a network have no value.
    pub networks: Networks,
    /// The scene of the last run: the next one often has the same.
    last_scene: Mutex<Option<(String, Arc<Scene>)>>,
}

/// How to treat a run whose folder exists already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existing {
    /// Continues an unfinished run and keeps a finished one; an error if anything that its numbers depend on has changed.
    #[default]
    Continue,
    /// Starts the run anew; its results are replaced.
    Overwrite,
}

/// Events of a run.
pub enum RunEvent<'a> {
    /// The scene is read.
    Loading,
    /// Fields are trained side by side.
    Started {
        /// Which fields, from 0.
        fields: Range<usize>,
        /// Of how many.
        of: usize,
    },
    /// Something happened in training.
    Training {
        /// What.
        event: &'a Event,
        /// The field as it is now.
        trainer: &'a Trainer,
    },
    /// The fields that were started are trained, or were stopped.
    Ended,
    /// A test view is rendered.
    Evaluating {
        /// Which, from 0.
        view: usize,
        /// Of how many.
        views: usize,
    },
    /// Something that the user should know.
    Warning(String),
}

/// The watcher's answer to an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Control {
    /// Continue.
    Continue,
    /// Save a checkpoint, if training, and continue: for others who look at the run's folder.
    Save,
    /// Save and stop.
    Stop,
}

/// Watches a run.
pub type Watch<'a> = dyn FnMut(RunEvent<'_>) -> Control + 'a;

impl Session {
    /// Runs on `device`, below `out`.
    pub fn new(device: OpenDevice, out: impl Into<PathBuf>, existing: Existing) -> Self {
        let (out, networks) = (out.into(), Networks::none());
        Self { device, out, existing, until: None, profiled: false, networks, last_scene: Mutex::default() }
    }

    /// The same, `profiled` or not.
    #[must_use]
    pub fn profiled(self, profiled: bool) -> Self {
        Self { profiled, ..self }
    }

    /// The same, with networks for learned metrics: see [`crate::networks`].
    #[must_use]
    pub fn with_networks(self, networks: Networks) -> Self {
        Self { networks, ..self }
    }

    /// The same, but each run is stopped after the share `until` of it.
    #[must_use]
    pub fn until(self, until: Option<f64>) -> Self {
        Self { until, ..self }
    }

    /// Folder of a run.
    pub fn run_folder(&self, plan: &RunPlan) -> PathBuf {
        self.experiment_folder(&plan.experiment).join(plan.directory())
    }

    /// Folder of an experiment's results.
    pub fn experiment_folder(&self, experiment: &str) -> PathBuf {
        self.out.join(experiment)
    }

    /// The scene of the last run if `plan` has the same; another is forgotten.
    pub(crate) fn loaded(&self, plan: &RunPlan) -> Option<Arc<Scene>> {
        let mut last = self.last_scene.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *last = last.take().filter(|(known, _)| *known == scene_key(plan));
        last.as_ref().map(|(_, scene)| scene.clone())
    }

    /// Loads the scene of `plan`, and keeps it for the next run.
    pub(crate) fn load(&self, plan: &RunPlan) -> Result<Arc<Scene>> {
        let scene = Arc::new(plan.load()?);
        let mut last = self.last_scene.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *last = Some((scene_key(plan), scene.clone()));
        Ok(scene)
    }
}

/// All that a scene depends on, its files apart.
fn scene_key(plan: &RunPlan) -> String {
    let config = &plan.config;
    format!("{:?} {:?} {:?} {:?} {}", plan.source, config.scene, config.train.cameras, config.eval.test, plan.seed)
}
