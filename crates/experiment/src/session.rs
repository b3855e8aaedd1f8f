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
    /// What becomes of runs that were begun before.
    pub resume: Resume,
    /// Share of each run after which it is stopped, to go on later.
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

/// What becomes of a run that was begun before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resume {
    /// It starts anew.
    Never,
    /// It goes on, and a finished one is kept; an error if anything that its numbers depend on has changed.
    Always,
    /// It goes on, and a finished one is kept; it starts anew if anything that its numbers depend on has changed.
    Unchanged,
}

/// What happens in a run, for whoever watches it.
pub enum RunEvent<'a> {
    /// The scene is read.
    Loading,
    /// Fields are trained, or go on, side by side.
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

/// What whoever watches a run wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Control {
    /// Go on.
    Continue,
    /// Save a checkpoint, if training, and go on: for others who look at the run's folder.
    Save,
    /// Save and stop.
    Stop,
}

/// Watches a run.
pub type Watch<'a> = dyn FnMut(RunEvent<'_>) -> Control + 'a;

impl Session {
    /// Runs on `device`, below `out`.
    pub fn new(device: OpenDevice, out: impl Into<PathBuf>, resume: Resume) -> Self {
        let (out, networks) = (out.into(), Networks::none());
        Self { device, out, resume, until: None, profiled: false, networks, last_scene: Mutex::default() }
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

    /// Folder of an experiment's results.
    pub fn experiment_folder(&self, experiment: &str) -> PathBuf {
        self.out.join(experiment)
    }

    /// The scene of a run, read again only if the last run had another.
    pub(crate) fn scene(&self, plan: &RunPlan) -> Result<Arc<Scene>> {
        let config = &plan.config;
        let key = format!("{:?} {:?} {:?} {}", plan.source, config.scene, config.eval.test, plan.seed);
        let mut last = self.last_scene.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, scene)) = last.as_ref().filter(|(known, _)| *known == key) {
            return Ok(scene.clone());
        }
        // What is not needed any more goes before the next is read.
        *last = None;
        let scene = Arc::new(plan.load()?);
        *last = Some((key, scene.clone()));
        Ok(scene)
    }
}
