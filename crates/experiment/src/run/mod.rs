//! One run from start to record: load, train, evaluate, write pictures.

mod evaluate;
mod folder;
mod log;
mod memory;
#[cfg(test)]
mod tests;
mod train;
mod trained;
mod volume;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::slice;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use infonerf_metrics::Networks;
use infonerf_report::{EVENTS_FILE, Record, write_atomically};
use infonerf_scene::Scene;
use infonerf_train::{Event, Trainer, without_collapsed};

pub use evaluate::picture_notes;
pub use folder::is_finished;
pub(crate) use folder::{clear, lock};
use folder::{has_results, reopen};
use memory::PeakMemory;
pub(crate) use train::{Training, load_checkpoint, train};
pub use trained::Trained;
use trained::total_progress;

use crate::device::OpenDevice;
use crate::identity::{Identity, REMEDY};
use crate::records::read_records;
use crate::run_plan::RunPlan;

/// Session: the device, the folder and the policies with which runs are trained and evaluated.
#[derive(Debug)]
pub struct Session {
    /// Device to compute on.
    pub device: OpenDevice,
    /// Folder for results: each run is in `<experiment>/<scene>/<variant>/seed<N>` below it.
    pub out: PathBuf,
    /// Policy for runs that exist already.
    pub existing: Existing,
    /// Networks of learned metrics. A metric whose network is missing has no value.
    pub networks: Networks,
    /// Key (see `scene_key`) and scene of the last run, since the next run often has the same scene.
    last_scene: Mutex<Option<(String, Arc<Scene>)>>,
}

/// Policy for a run whose folder exists already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existing {
    /// An unfinished run is continued and a finished one kept; an error if anything that its numbers depend on has changed.
    #[default]
    Continue,
    /// The run starts anew; its results are replaced.
    Overwrite,
}

/// Events of a run.
pub enum RunEvent<'a> {
    /// The scene is read.
    Loading,
    /// Fields are trained side by side.
    Started {
        /// Indices of the fields, from 0.
        fields: Range<usize>,
        /// Number of fields of the run.
        of: usize,
    },
    /// An event of training.
    Training {
        /// The event.
        event: &'a Event,
        /// Trainer of the field, after the event.
        trainer: &'a Trainer,
    },
    /// The fields that were started are trained, or were stopped.
    Ended,
    /// A test view is rendered.
    Evaluating {
        /// Index of the view.
        view: usize,
        /// Number of test views.
        views: usize,
    },
    /// A step of fitting a test view's pose, or of measuring ray entropy, begins.
    Measuring,
    /// A warning for the user.
    Warning(String),
    /// Information for the user that is not a warning.
    Note(String),
}

/// The watcher's answer to an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Control {
    /// Continue.
    Continue,
    /// Save a checkpoint, if a field is being trained, and continue, so that readers of the run's folder see the current field.
    Save,
    /// Save and stop.
    Stop,
}

/// Callback that receives the events of a run.
pub type Watch<'a> = dyn FnMut(RunEvent<'_>) -> Control + 'a;

/// The result of a run.
pub enum Finished {
    /// The run is done: its record and its fields.
    Record(Box<Record>, Box<Trained>),
    /// The run was done before; its record.
    AlreadyDone(Box<Record>),
    /// The run was stopped by its watcher, and can be continued.
    Stopped,
}

/// A run whose folder is locked by this process.
pub(crate) struct OpenRun {
    pub(crate) folder: PathBuf,
    identity: Identity,
    config: String,
    /// Whether an earlier process has begun the run.
    pub(crate) continues: bool,
    /// Whether the run was begun with fewer steps or a smaller budget.
    pub(crate) has_grown: bool,
    _lock: fs::File,
}

impl OpenRun {
    /// Removes an earlier run's files unless it is continued; writes identity and config. `first` is the first field's folder.
    pub(crate) fn begin(&self, first: &Path) -> Result<()> {
        if !self.continues {
            clear(&self.folder)?;
        }
        if self.has_grown {
            reopen(&self.folder, first)?;
        }
        // The identity is written first, so that every run with a config has an identity.
        self.identity.write(&self.folder)?;
        Ok(write_atomically(&self.folder.join("config.toml"), self.config.as_bytes())?)
    }
}

impl Session {
    /// Creates a session on `device` that writes below `out`, without networks.
    pub fn new(device: OpenDevice, out: impl Into<PathBuf>, existing: Existing) -> Self {
        let (out, networks) = (out.into(), Networks::none());
        Self { device, out, existing, networks, last_scene: Mutex::default() }
    }

    /// Returns the session with networks for learned metrics: see [`crate::networks`].
    #[must_use]
    pub fn with_networks(self, networks: Networks) -> Self {
        Self { networks, ..self }
    }

    /// Returns the folder of a run.
    pub fn run_folder(&self, plan: &RunPlan) -> PathBuf {
        self.out.join(&plan.experiment).join(plan.directory())
    }

    /// Trains and evaluates `plan`, or continues the run if an earlier process has begun it, and writes the run's folder. The
    /// record is returned and not saved: see [`crate::save_record`].
    ///
    /// # Errors
    /// If the scene cannot be read, training meets a value that is not finite, a file cannot be written, another process is
    /// at work on the run, or [`Existing::Continue`] finds it begun with another config, data, program or device.
    pub fn run(&self, plan: &RunPlan, watch: &mut Watch<'_>) -> Result<Finished> {
        let identity = Identity::of(slice::from_ref(plan), self.device.name.name())?;
        let run = self.open_run(self.run_folder(plan), identity, plan.to_toml()?, watch)?;
        let record = plan.record_path(&run.folder);
        if run.continues && !run.has_grown && record.exists() {
            let expected = "the run's record (without the file the run is evaluated again, --overwrite starts it anew)";
            let damaged = || format!("{}: expected {expected}", record.display());
            let read = read_records(&record).with_context(damaged)?.pop().with_context(damaged)?;
            return Ok(Finished::AlreadyDone(Box::new(read)));
        }
        let memory = PeakMemory::start();
        let Some(trainers) = self.train_members(plan, &run, watch)? else { return Ok(Finished::Stopped) };
        let progress = total_progress(&trainers);
        let (trainers, collapsed) = without_collapsed(trainers);
        let trained = Trained::new(plan.clone(), trainers, Vec::new());
        let evaluated = evaluate::evaluate(self, &trained, &run.folder, &progress, collapsed, watch)?;
        let Some(mut record) = evaluated else { return Ok(Finished::Stopped) };
        record.peak_rss_bytes = memory.peak();
        record.notes.extend(run.identity.grown());
        Ok(Finished::Record(Box::new(record), Box::new(trained)))
    }

    /// Locks the run's folder, and finds whether an earlier run is continued.
    pub(crate) fn open_run(
        &self,
        folder: PathBuf,
        mut identity: Identity,
        config: String,
        watch: &mut Watch<'_>,
    ) -> Result<OpenRun> {
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let (lock, warning) = lock(&folder, "run")?;
        if let Some(warning) = warning {
            watch(RunEvent::Warning(warning));
        }
        let (keeps, has_config) = (self.existing == Existing::Continue, folder.join("config.toml").exists());
        let is_lost = keeps && !has_config && has_results(&folder);
        ensure!(!is_lost, "{}: config.toml is missing beside a record or a checkpoint; {REMEDY}", folder.display());
        let continues = keeps && has_config;
        let has_grown = continues && identity.check_continuation(&folder, &config)?;
        if let Some(text) = identity.grown().filter(|_| has_grown) {
            watch(RunEvent::Note(format!("{}: {text}", folder.display())));
        }
        Ok(OpenRun { folder, identity, config, continues, has_grown, _lock: lock })
    }

    /// Trains the fields of a run, as many at a time as suit the device; `None` if `watch` stops the training.
    fn train_members(&self, plan: &RunPlan, run: &OpenRun, watch: &mut Watch<'_>) -> Result<Option<Vec<Trainer>>> {
        let (members, at_once) = (plan.members(), self.device.name.fields_side_by_side());
        let key = scene_key(plan, &run.identity);
        let loaded = self.last_scene(&key);
        // A run that does not fit into memory is refused before anything is loaded.
        let needed = plan.memory(at_once)?;
        let needed = if loaded.is_some() { needed.with_images_loaded() } else { needed };
        needed.check_available()?;
        watch(RunEvent::Loading);
        let start = Instant::now();
        let scene = loaded.map_or_else(|| plan.load().map(Arc::new), Ok)?;
        *self.last_scene.lock().unwrap_or_else(PoisonError::into_inner) = Some((key, scene.clone()));
        let of_scene = |text: &String| format!("{}: {text}", plan.scene);
        let warnings = scene.warnings.iter().map(|warning| RunEvent::Warning(of_scene(warning)));
        let notes = scene.notes.iter().map(|note| RunEvent::Note(of_scene(note)));
        for event in warnings.chain(notes) {
            watch(event);
        }
        let reading = start.elapsed().as_secs_f64();
        let mut first_steps = 0.0;
        // Files of an earlier run stay until the first trainer of this one could be made.
        let mut first_trainer = Some(plan.trainer(&scene, 0, None, &self.device.device)?);
        run.begin(&plan.member_folder(&run.folder, 0))?;
        let mut trainers = Vec::new();
        for first in (0..members).step_by(at_once) {
            let fields = first..members.min(first + at_once);
            let mut training: Vec<Training> = Vec::new();
            for member in fields.clone() {
                let folder = plan.member_folder(&run.folder, member);
                fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
                let other = trainers.first().or_else(|| training.first().map(|field| &field.trainer));
                let new = || plan.trainer(&scene, member, other, &self.device.device);
                let mut trainer = first_trainer.take().map_or_else(new, Ok)?;
                let damaged = "the run cannot go on, and --overwrite starts it anew";
                let mut warn = |warning| _ = watch(RunEvent::Warning(warning));
                if let Some(checkpoint) = load_checkpoint(&folder, &mut warn).context(damaged)? {
                    trainer.resume(&checkpoint).with_context(|| folder.display().to_string())?;
                } else if folder.join(EVENTS_FILE).exists() {
                    warn(format!("{}: no checkpoint of the earlier steps: training begins again", folder.display()));
                }
                training.push(Training::new(trainer, folder)?);
            }
            watch(RunEvent::Started { fields, of: members });
            train(&mut training, plan.config.train.checkpoint_every, watch)?;
            watch(RunEvent::Ended);
            if !training.iter().all(|field| field.is_over) {
                return Ok(None);
            }
            first_steps += training.iter().map(|field| field.first_step_seconds).sum::<f64>();
            trainers.extend(training.into_iter().map(|field| field.trainer));
        }
        let steps = [total_progress(&trainers).step, members * plan.config.train.iterations];
        let stages = [reading, first_steps];
        if let Some(warning) = plan.budget.and_then(|budget| preparation_warning(budget, stages, steps)) {
            watch(RunEvent::Warning(format!("{}: {warning}", plan.scene)));
        }
        Ok(Some(trainers))
    }

    /// Returns the scene of the last run if its key is `key`, and forgets it otherwise.
    fn last_scene(&self, key: &str) -> Option<Arc<Scene>> {
        let mut last = self.last_scene.lock().unwrap_or_else(PoisonError::into_inner);
        *last = last.take().filter(|(known, _)| known == key);
        last.as_ref().map(|(_, scene)| scene.clone())
    }
}

/// Returns a warning if the preparation of training takes too long for its `budget`; all times are in seconds. Too long is
/// `reading` the scene (with refining its cameras by matches) or the `first_steps` of the fields (with stereo) beyond the
/// budget, or first steps beyond half of it if fewer than a tenth of the steps `asked` for are `taken`.
fn preparation_warning(budget: f64, [reading, first_steps]: [f64; 2], [taken, asked]: [usize; 2]) -> Option<String> {
    let is_short = 10 * taken < asked && first_steps > 0.5 * budget;
    (reading.max(first_steps) > budget || is_short).then(|| {
        format!(
            "preparation is long for a budget of {budget} s, and a longer one helps: reading the scene took {reading:.1} s, \
             the first step, which the budget includes, {first_steps:.1} s; {taken} of {asked} steps are done"
        )
    })
}

/// Returns a key of all that a loaded scene depends on, including the contents of its files.
fn scene_key(plan: &RunPlan, identity: &Identity) -> String {
    let RunPlan { source, seed, config, .. } = plan;
    let (scene, cameras, test) = (&config.scene, &config.train.cameras, &config.eval.test);
    format!("{source:?} {} {scene:?} {cameras:?} {test:?} {seed}", identity.data)
}
