use std::fs;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use infonerf_scene::Scene;
use infonerf_train::{Checkpoint, Event, Outcome, Pretrainer};

use crate::args::PretrainArgs;
use crate::experiment::{Experiment, RunPlan};
use crate::progress::Progress;
use crate::run::{check_same, clear, lock};
use crate::{device, interrupt, run};

/// Exit code after Ctrl-C.
const INTERRUPTED: u8 = 130;
/// Steps over which the last PSNR is averaged.
const LAST: usize = 100;

pub(crate) fn run(args: &PretrainArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection, None)?;
    let plan = experiment.runs.first().context("expected at least one scene")?;
    if experiment.runs.iter().any(|other| (&other.variant, other.seed) != (&plan.variant, plan.seed)) {
        bail!("{}: expected one variant and one seed: choose with --variant and --seed", args.experiment);
    }
    let (device, device_name) = device::open(args.selection.device)?;
    let folder = args.out.join(&experiment.about.name);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let _lock = lock(&folder)?;
    let config = plan.to_toml_with(experiment.runs.iter().map(|plan| plan.scene.clone()).collect())?;
    let path = folder.join("config.toml");
    let checkpoint = if args.resume {
        check_same(&path, &config)?;
        let (checkpoint, refused) = Checkpoint::load(&folder)?;
        for reason in refused {
            eprintln!("warning: {reason}; going on from the checkpoint before it");
        }
        checkpoint
    } else {
        clear(&folder)?;
        None
    };
    fs::write(&path, config).with_context(|| path.display().to_string())?;
    interrupt::install()?;
    let count = experiment.runs.len();
    println!("{}: {} ({count} scenes, on {device_name})", experiment.about.name, experiment.about.title);
    let scenes = experiment.runs.iter().map(training_views).collect::<Result<Vec<_>>>()?;
    let mut trainer = Pretrainer::new(&plan.config, &scenes, plan.seed, &device)?;
    if let Some(checkpoint) = &checkpoint {
        trainer.resume(checkpoint)?;
    }
    let (outcome, psnr) = train(&mut trainer, &folder, plan.config.train.checkpoint_every)?;
    trainer.checkpoint()?.save(&folder)?;
    if outcome == Outcome::Running {
        println!("{}: saved; the same command with --resume goes on", experiment.about.name);
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let progress = trainer.progress();
    let psnr = psnr.map_or_else(String::new, |psnr| format!(", PSNR {psnr:.2} dB over the last {LAST} steps' rays"));
    println!("{} steps in {:.1} s{psnr}", progress.step, progress.seconds);
    println!("begin with it: --set train.init={}", folder.display());
    Ok(ExitCode::SUCCESS)
}

/// A scene with as few test views as can be: none is looked at.
fn training_views(plan: &RunPlan) -> Result<Scene> {
    let mut plan = plan.clone();
    plan.config.eval.test = "first-1".parse().map_err(anyhow::Error::msg)?;
    run::load(&plan)
}

/// Trains until the end or until the user stops it ([`Outcome::Running`]); also the mean PSNR of the last
/// steps, if any were taken.
fn train(trainer: &mut Pretrainer, folder: &Path, every: usize) -> Result<(Outcome, Option<f32>)> {
    let mut progress = Progress::new(folder, "pre-training", trainer.progress().step)?;
    let mut last = std::collections::VecDeque::with_capacity(LAST + 1);
    let outcome = loop {
        let mut events: Vec<Event> = Vec::new();
        let outcome = trainer.step(&mut |event| events.push(event));
        for event in &events {
            progress.report(event, trainer.done())?;
            if let Event::Step { psnr, .. } = event {
                last.push_back(*psnr);
                if last.len() > LAST {
                    last.pop_front();
                }
            }
        }
        match outcome {
            Ok(Outcome::Running) if interrupt::asked() => break Outcome::Running,
            Ok(Outcome::Running) if every > 0 && trainer.progress().step.is_multiple_of(every) => {
                progress.flush()?;
                trainer.checkpoint()?.save(folder)?;
            }
            Ok(Outcome::Running) => {}
            Ok(outcome) => break outcome,
            Err(error) => {
                progress.finish()?;
                return Err(error).with_context(|| folder.display().to_string());
            }
        }
    };
    progress.finish()?;
    Ok((outcome, (!last.is_empty()).then(|| last.iter().sum::<f32>() / last.len() as f32)))
}
