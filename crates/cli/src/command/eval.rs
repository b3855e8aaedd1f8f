use std::process::ExitCode;

use anyhow::{Context, Result};
use infonerf_train::{Evaluation, Trainer, evaluate_view};

use crate::args::{DeviceName, EvalArgs};
use crate::experiment::RunPlan;
use crate::{device, run};

pub(crate) fn run(args: &EvalArgs) -> Result<ExitCode> {
    let mut plan = RunPlan::of_run(&args.run)?;
    if let Some(test) = &args.test {
        plan.config.eval.test = test.parse().map_err(|fault| anyhow::anyhow!("--test: {fault}"))?;
    }
    let trainer = trained(&plan, &args.run, args.device)?;
    let (model, occupancy) = (trainer.model(), trainer.picture_occupancy());
    let mut views = Vec::new();
    println!("{}: {} test views ({})", plan.label(), trainer.scene().test.len(), plan.config.eval.test);
    for view in &trainer.scene().test {
        let result = evaluate_view(trainer.renderer(), &model, occupancy.as_ref(), view)?;
        println!("{:16} {}", view.name, line(&Evaluation::mean(std::slice::from_ref(&result)).context("a view")?));
        views.push(result);
    }
    println!("{:16} {}", "mean", line(&Evaluation::mean(&views).context("no test views")?));
    Ok(ExitCode::SUCCESS)
}

/// A finished or interrupted run, as its newest checkpoint left it.
pub(crate) fn trained(plan: &RunPlan, folder: &std::path::Path, device: DeviceName) -> Result<Trainer> {
    let (device, _) = device::open(device)?;
    let (checkpoint, refused) = infonerf_train::Checkpoint::load(folder)?;
    for reason in refused {
        eprintln!("warning: {reason}; using the checkpoint before it");
    }
    let checkpoint =
        checkpoint.with_context(|| format!("{}: expected a checkpoint: the run has none yet", folder.display()))?;
    let mut trainer = Trainer::new(&plan.config, run::load(plan)?, plan.seed, plan.budget, &device)?;
    trainer.resume(&checkpoint)?;
    Ok(trainer)
}

fn line(mean: &Evaluation) -> String {
    let number =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"));
    format!(
        "PSNR {:6.2} dB  SSIM {}  GMSD {:.4}  sharpness {}  depth RMSE {}  {:.2} s",
        mean.comparison.psnr,
        number(mean.comparison.ssim, 4),
        mean.comparison.gmsd,
        number(mean.comparison.sharpness, 3),
        number(mean.depth_rmse, 4),
        mean.seconds
    )
}
