use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use anyhow::{Result, bail};
use infonerf_metrics::Networks;
use infonerf_scene::Scene;
use infonerf_train::{Event, Trainer};

use crate::run::is_finished;
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
    /// Whether the device is waited for after each phase of a step: see [`Trainer::synchronize_phases`].
    ///
    /// [`Trainer::synchronize_phases`]: infonerf_train::Trainer::synchronize_phases
    pub profiled: bool,
    /// What learned metrics need: those without a network have no value.
    pub networks: Networks,
    /// The scene of the last run: the next one often has the same.
    last_scene: Mutex<Option<(String, Arc<Scene>)>>,
}

/// How to treat a run whose folder exists already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// A finished run is an error; an unfinished one starts over.
    Refuse,
    /// It starts over, and its results are replaced.
    Overwrite,
    /// It resumes, and a finished one is kept; an error if anything that its numbers depend on has changed.
    Resume,
    /// It resumes, and a finished one is kept; it starts over if anything that its numbers depend on has changed.
    ResumeUnchanged,
}

impl Existing {
    /// Whether an unfinished run is continued.
    pub(crate) fn resumes(self) -> bool {
        matches!(self, Self::Resume | Self::ResumeUnchanged)
    }
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

    /// Refuses to replace results, before anything is run.
    ///
    /// # Errors
    /// If a run of `plans` is finished and [`Existing::Refuse`] says that it must not be.
    pub fn refuse_finished(&self, plans: &[RunPlan]) -> Result<()> {
        let folders = plans.iter().map(|plan| self.run_folder(plan));
        self.refuse(&folders.filter(|folder| is_finished(folder)).collect::<Vec<_>>())
    }

    /// Refuses to replace the results in the folders `finished`, if there are any.
    pub(crate) fn refuse(&self, finished: &[PathBuf]) -> Result<()> {
        let (Existing::Refuse, [first, others @ ..]) = (self.existing, finished) else { return Ok(()) };
        let others = if others.is_empty() { String::new() } else { format!(", as are {} more", others.len()) };
        bail!(
            "{}: this run is finished{others}: --resume keeps its results, --overwrite replaces them",
            first.display()
        )
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DeviceName, Experiment, Selection, open};

    #[test]
    fn finished_runs_are_replaced_only_on_request() {
        let out = tempfile::tempdir().unwrap();
        let selection = Selection { scenes: vec!["knot".into()], ..Selection::default() };
        let plans = Experiment::plan("fast-losses", &selection).unwrap().runs;
        let refusal = |existing: Existing| {
            let session = Session::new(open(DeviceName::Flex).unwrap(), out.path(), existing);
            session.refuse_finished(&plans).err().map(|error| error.to_string())
        };
        assert_eq!(refusal(Existing::Refuse), None);
        for plan in &plans[..2] {
            let folder = out.path().join(&plan.experiment).join(plan.directory());
            std::fs::create_dir_all(&folder).unwrap();
            // Also one of another preset, whose checkpoint would be replaced.
            std::fs::write(folder.join("record-paper.json"), "").unwrap();
        }
        let message = refusal(Existing::Refuse).unwrap();
        let parts = [plans[0].directory().to_str().unwrap(), "1 more", "--resume", "--overwrite"].map(str::to_owned);
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert!(
            [Existing::Overwrite, Existing::Resume, Existing::ResumeUnchanged].map(refusal).iter().all(Option::is_none)
        );
    }
}
