//! One run from start to record: load, train, evaluate, write pictures.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use burn::tensor::Device;
use infonerf_metrics::to_rgb8;
use infonerf_render::Learned;
use infonerf_report::{Record, TestViews, depth_image, error_image, run_directory};
use infonerf_scene::{Scene, SceneRequest, SceneSource, View};
use infonerf_train::{
    Checkpoint, Evaluation, Event, Information, InformationQuery, Outcome, Progress as TrainProgress, TestView,
    Trainer, evaluate_view, information, show_nothing,
};

use crate::experiment::RunPlan;
use crate::interrupt;
use crate::progress::Progress;

/// Where and how runs happen.
pub(crate) struct Session {
    pub(crate) device: Device,
    pub(crate) device_name: &'static str,
    pub(crate) out: PathBuf,
    pub(crate) resume: bool,
    /// Share of each run after which it is stopped, to go on later.
    pub(crate) until: Option<f64>,
}

/// What came of a run.
pub(crate) enum Finished {
    /// It is done.
    Record(Box<Record>, Vec<Trainer>),
    /// It was done already.
    Kept,
    /// It was stopped, by the user or at [`Session::until`], and can be resumed.
    Stopped,
}

impl Session {
    /// Folder of an experiment.
    pub(crate) fn experiment_folder(&self, plan: &RunPlan) -> PathBuf {
        self.out.join(&plan.experiment)
    }

    /// Trains and evaluates `plan`.
    pub(crate) fn run(&self, plan: &RunPlan) -> Result<Finished> {
        let folder = self.experiment_folder(plan).join(run_directory(&plan.scene, &plan.variant, plan.seed));
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let _lock = lock(&folder)?;
        let config = plan.to_toml()?;
        let path = folder.join("config.toml");
        if self.resume {
            check_same(&path, &config)?;
        } else {
            clear(&folder)?;
        }
        if self.resume && record_path(&folder, plan).exists() {
            return Ok(Finished::Kept);
        }
        infonerf_report::write_atomically(&path, config.as_bytes())?;
        let scene = load(plan)?;
        let mut trainers = Vec::new();
        let mut collapsed = false;
        for index in 0..plan.members() {
            let folder = plan.member_folder(&folder, index);
            fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
            let mut trainer = plan.trainer(scene.clone(), index, &self.device)?;
            if let Some(checkpoint) = self.load_checkpoint(&folder)? {
                trainer.resume(&checkpoint)?;
            }
            match self.train(plan, &folder, &mut trainer)? {
                Outcome::Running => return Ok(Finished::Stopped),
                outcome => collapsed |= outcome == Outcome::Collapsed,
            }
            trainers.push(trainer);
        }
        let record = self.evaluate(plan, &folder, &trainers, collapsed)?;
        Ok(Finished::Record(Box::new(record), trainers))
    }

    fn load_checkpoint(&self, folder: &Path) -> Result<Option<Checkpoint>> {
        let (checkpoint, refused) = Checkpoint::load(folder)?;
        for reason in refused {
            eprintln!("warning: {reason}; going on from the checkpoint before it");
        }
        Ok(checkpoint)
    }

    /// Trains until the end or until it is stopped ([`Outcome::Running`]), and saves in both cases.
    fn train(&self, plan: &RunPlan, folder: &Path, trainer: &mut Trainer) -> Result<Outcome> {
        let mut progress = Progress::new(folder, &plan.label(), trainer.progress().step)?;
        let every = plan.config.train.checkpoint_every;
        let reached = |trainer: &Trainer| self.until.is_some_and(|share| trainer.done() >= share);
        if reached(trainer) && trainer.done() < 1.0 {
            return Ok(Outcome::Running);
        }
        let outcome = loop {
            let mut events: Vec<Event> = Vec::new();
            let outcome = trainer.step(&mut |event| events.push(event));
            for event in &events {
                progress.report(event, trainer.done())?;
            }
            match outcome {
                Ok(Outcome::Running) if interrupt::asked() || reached(trainer) => break Outcome::Running,
                Ok(Outcome::Running) => {
                    if every > 0 && trainer.progress().step.is_multiple_of(every) {
                        progress.flush()?;
                        trainer.checkpoint()?.save(folder)?;
                    }
                }
                Ok(outcome) => break outcome,
                Err(error) => {
                    progress.finish()?;
                    return Err(error).with_context(|| folder.display().to_string());
                }
            }
        };
        progress.finish()?;
        trainer.checkpoint()?.save(folder)?;
        Ok(outcome)
    }

    /// Renders and measures the test views, writes the pictures, and returns the record.
    fn evaluate(&self, plan: &RunPlan, folder: &Path, trainers: &[Trainer], collapsed: bool) -> Result<Record> {
        let (scene, renderer, members) = (trainers[0].scene(), trainers[0].renderer(), learned(trainers));
        let mut views = Vec::new();
        for view in &scene.test {
            let result = evaluate_view(renderer, &members, view)?;
            write_pictures(folder, scene, view, &result)?;
            views.push(result);
        }
        let photographs = scene.train.iter().flat_map(|view| &view.image.rgb);
        let faint = show_nothing(&views) && photographs.into_iter().any(|color| *color != scene.background);
        let mean = Evaluation::mean(&views).context("no test views")?;
        let loss = &plan.config.loss;
        let query = InformationQuery {
            gain: &loss.gain,
            epsilon: loss.entropy.epsilon,
            rays: plan.config.eval.information_rays,
            seed: plan.seed,
        };
        let of_member = |trainer: &Trainer| information(renderer, &trainer.model(), trainer.occupancy(), scene, query);
        let information = Information::mean(&trainers.iter().filter_map(of_member).collect::<Vec<_>>());
        let progress = total(trainers);
        let mut notes = notes(plan, progress.restarts);
        if mean.depth_rmse.is_none() {
            notes.push("depth_rmse: the scene has no exact depth at this size".into());
        }
        Ok(Record {
            experiment: plan.experiment.clone(),
            scene: plan.scene.clone(),
            variant: plan.variant.clone(),
            seed: plan.seed,
            preset: plan.preset.name().to_owned(),
            device: self.device_name.to_owned(),
            train_views: scene.train.iter().map(|view| view.id).collect(),
            test_views: TestViews {
                protocol: plan.config.eval.test.to_string(),
                count: scene.test.len(),
                ids: scene.test.iter().map(|view| view.id).collect(),
            },
            image_size: [scene.test[0].image.width as usize, scene.test[0].image.height as usize],
            iterations: progress.step as u64,
            train_seconds: progress.seconds,
            render_seconds_per_image: mean.seconds,
            samples_total: progress.samples_total,
            samples_evaluated: progress.samples_evaluated,
            psnr: Some(mean.comparison.psnr),
            ssim: mean.comparison.ssim,
            lpips: None,
            gmsd: Some(mean.comparison.gmsd),
            sharpness: mean.comparison.sharpness,
            depth_rmse: mean.depth_rmse,
            ray_entropy_bits: information.map(|information| information.entropy_bits),
            information_gain: information.map(|information| information.gain),
            peak_rss_bytes: peak_rss(),
            collapsed: collapsed || faint,
            notes,
        })
    }
}

fn notes(plan: &RunPlan, restarts: usize) -> Vec<String> {
    let mut notes = vec!["lpips: needs the weights of a backbone, which are not part of this program".to_owned()];
    if plan.data.is_none() {
        notes.push("procedural scene, not a published data set".into());
    }
    if let Some(budget) = plan.budget {
        notes.push(format!("trained for {budget} s by the clock: another machine takes another number of steps"));
    }
    if plan.config.train.unseen == infonerf_train::config::Unseen::Dataset && plan.config.loss.entropy.weight > 0.0 {
        notes.push("unseen poses are those of all training images of the data set, chosen or not".into());
    }
    notes.extend(plan.config.first_weights());
    if restarts > 0 {
        notes.push(format!("the field went empty {restarts} times and training started over with other weights"));
    }
    notes
}

/// What pictures of a run are rendered from.
pub(crate) fn learned(trainers: &[Trainer]) -> Vec<Learned> {
    trainers.iter().map(Trainer::learned).collect()
}

/// Steps, seconds, samples and fresh starts of all members together.
pub(crate) fn total(trainers: &[Trainer]) -> TrainProgress {
    let mut total = TrainProgress::default();
    for progress in trainers.iter().map(Trainer::progress) {
        total.step += progress.step;
        total.seconds += progress.seconds;
        total.samples_total += progress.samples_total;
        total.samples_evaluated += progress.samples_evaluated;
        total.restarts += progress.restarts;
        total.pixels_skipped += progress.pixels_skipped;
    }
    total
}

/// Loads the scene of a run.
pub(crate) fn load(plan: &RunPlan) -> Result<Scene> {
    let scene = &plan.config.scene;
    let request = SceneRequest {
        train: scene.views.select(plan.seed),
        test: plan.config.eval.test.test(),
        image_size: (scene.size > 0).then_some(scene.size),
        background: scene.background,
    };
    let name = match &plan.source {
        SceneSource::Procedural(name) => format!("built-in scene {name}"),
        SceneSource::Folder { path } => path.display().to_string(),
    };
    infonerf_scene::load(&plan.source, &request).with_context(|| format!("scene {}", name))
}

/// The file that says that a run is finished.
pub(crate) fn record_path(folder: &Path, plan: &RunPlan) -> PathBuf {
    folder.join(format!("record-{}.json", plan.preset.name()))
}

/// Fails if the run at whose `config.toml` `path` points began with another config.
pub(crate) fn check_same(path: &Path, config: &str) -> Result<()> {
    if let Some(found) = fs::read_to_string(path).ok().filter(|found| found != config) {
        let line = config.lines().zip(found.lines()).find(|(a, b)| a != b);
        let difference = line.map_or_else(String::new, |(now, then)| format!(": `{then}` then, `{now}` now"));
        bail!("{}: --resume needs the config that the run began with{difference}", path.display());
    }
    Ok(())
}

/// Takes away what an earlier run left.
pub(crate) fn clear(folder: &Path) -> Result<()> {
    for name in ["checkpoint", "checkpoint.previous", "checkpoint.writing", "test", "depth", "error", "truth", "render"]
    {
        let path = folder.join(name);
        if path.exists() {
            fs::remove_dir_all(&path).with_context(|| path.display().to_string())?;
        }
    }
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with("record-") || name == "metrics.jsonl" {
            fs::remove_file(entry.path()).with_context(|| entry.path().display().to_string())?;
        } else if name.starts_with("member") && entry.path().is_dir() {
            fs::remove_dir_all(entry.path()).with_context(|| entry.path().display().to_string())?;
        }
    }
    Ok(())
}

/// Keeps a second process out of a run's folder for as long as the file lives.
pub(crate) fn lock(folder: &Path) -> Result<fs::File> {
    let path = folder.join("lock");
    let file = fs::File::create(&path).with_context(|| path.display().to_string())?;
    // The lock of a process that was just killed may outlive it by a moment.
    let patience = Instant::now() + Duration::from_secs(1);
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(fs::TryLockError::WouldBlock) if Instant::now() < patience => sleep(Duration::from_millis(20)),
            Err(fs::TryLockError::WouldBlock) => bail!("{}: another process is at work on this run", folder.display()),
            Err(fs::TryLockError::Error(error)) => return Err(error).with_context(|| path.display().to_string()),
        }
    }
}

fn write_pictures(folder: &Path, scene: &Scene, view: &View, result: &TestView) -> Result<()> {
    let image = &result.image;
    let (width, height) = (image.width, image.height);
    let pictures = [
        ("test", to_rgb8(&image.rgb, width, height)?),
        ("truth", to_rgb8(&view.image.rgb, width, height)?),
        ("depth", depth_image(&image.depth, &image.acc, width, height, scene.near, scene.far)?),
        ("error", error_image(&image.rgb, &view.image.rgb, width, height)?),
    ];
    for (kind, picture) in pictures {
        let path = folder.join(kind).join(format!("{:03}.png", view.id));
        save_png(&picture, &path)?;
    }
    Ok(())
}

/// Writes a PNG, with its folder.
pub(crate) fn save_png(picture: &image::RgbImage, path: &Path) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    picture.save(path).with_context(|| path.display().to_string())
}

/// Largest resident memory of this process so far, where the system tells.
pub(crate) fn peak_rss() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}
