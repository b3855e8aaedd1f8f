use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use infonerf_scene::View;
use infonerf_train::{Evaluation, TestView, Trainer, evaluate_view};

use crate::args::{DeviceName, EvalArgs};
use crate::device;
use crate::experiment::RunPlan;
use crate::run::{self, learned};

pub(crate) fn run(args: &EvalArgs) -> Result<ExitCode> {
    let mut table = Vec::new();
    for folder in &args.runs {
        let mut plan = RunPlan::of_run(folder)?;
        if let Some(test) = &args.test {
            plan.config.eval.test = test.parse().map_err(|fault| anyhow::anyhow!("--test: {fault}"))?;
        }
        let trainers = trained(&plan, folder, args.device)?;
        let trainer = &trainers[0];
        println!("{}: {} test views ({})", plan.label(), trainer.scene().test.len(), plan.config.eval.test);
        if args.scales.is_empty() {
            each_view(&trainers)?;
        } else {
            table.push((plan.label(), scales(&trainers, &args.scales)?));
        }
    }
    if !args.scales.is_empty() {
        print_scales(&args.scales, &table);
    }
    Ok(ExitCode::SUCCESS)
}

/// The members of a finished or interrupted run, each as its newest checkpoint left it.
pub(crate) fn trained(plan: &RunPlan, folder: &Path, device: DeviceName) -> Result<Vec<Trainer>> {
    let (device, _) = device::open(device)?;
    let scene = run::load(plan)?;
    let plan = &RunPlan { config: plan.config.without_weight_files(), ..plan.clone() };
    let mut trainers = Vec::new();
    for index in 0..plan.members() {
        let (checkpoint, refused) = infonerf_train::Checkpoint::load(&plan.member_folder(folder, index))?;
        for reason in refused {
            eprintln!("warning: {reason}; using the checkpoint before it");
        }
        let Some(checkpoint) = checkpoint else { break };
        let mut trainer = plan.trainer(scene.clone(), index, &device)?;
        trainer.resume(&checkpoint)?;
        trainers.push(trainer);
    }
    if trainers.is_empty() {
        bail!("{}: expected a checkpoint: the run has none yet", folder.display());
    }
    Ok(trainers)
}

/// Evaluates `views`, and shows each as it is there.
fn evaluate(
    trainers: &[Trainer],
    views: &[View],
    mut show: impl FnMut(&View, &TestView) -> Result<()>,
) -> Result<Evaluation> {
    let members = learned(trainers);
    let mut results = Vec::new();
    for view in views {
        let result = evaluate_view(trainers[0].renderer(), &members, view)?;
        show(view, &result)?;
        results.push(result);
    }
    Evaluation::mean(&results).context("no test views")
}

fn each_view(trainers: &[Trainer]) -> Result<()> {
    let mean = evaluate(trainers, &trainers[0].scene().test, |view, result| {
        let alone = Evaluation::mean(std::slice::from_ref(result)).context("a view")?;
        println!("{:16} {}", view.name, line(&alone));
        Ok(())
    })?;
    println!("{:16} {}", "mean", line(&mean));
    Ok(())
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

/// Mean PSNR at full size and at each smaller one.
fn scales(trainers: &[Trainer], factors: &[u32]) -> Result<Vec<f64>> {
    let at = |factor: u32| -> Result<f64> {
        let views: Vec<View> = trainers[0].scene().test.iter().map(|view| view.reduced(factor)).collect();
        Ok(evaluate(trainers, &views, |_, _| Ok(()))?.comparison.psnr)
    };
    std::iter::once(&1).chain(factors).map(|&factor| at(factor)).collect()
}

/// One row a run: PSNR at full size, then at each scale, with the difference from full size.
fn print_scales(factors: &[u32], table: &[(String, Vec<f64>)]) {
    let wide = table.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let headings: String = factors.iter().map(|factor| format!("{:>16}", format!("1/{factor}"))).collect();
    println!("\nmean PSNR in dB, and its difference from full size\n{:wide$}  {:>6}{headings}", "", "1");
    for (label, psnr) in table {
        let (full, smaller) = psnr.split_first().map_or((f64::NAN, &[][..]), |(full, smaller)| (*full, smaller));
        let cells: String = smaller.iter().map(|psnr| format!("{psnr:8.2} ({:+.2})", psnr - full)).collect();
        println!("{label:wide$}  {full:6.2}{cells}");
    }
}
