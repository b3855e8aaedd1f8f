//! Finished runs.

use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use infonerf_experiment::{RunPlan, Trained, picture_notes};
use infonerf_metrics::{METRICS, Metric, Networks, PSNR, Values};
use infonerf_render::{Pivot, TrainedModel};
use infonerf_scene::{TestProtocol, View};
use infonerf_train::{Evaluated, Evaluation, TestView};

use super::EvalArgs;
use crate::print::{errln, outln};
use crate::progress::counting_bar;
use crate::terminal::open_device;

/// Parses a scale such as `1/8` into its denominator.
pub(super) fn parse_scale(text: &str) -> Result<u32, String> {
    let factor = text.trim().strip_prefix("1/").and_then(|factor| factor.parse().ok());
    factor
        .filter(|factor| (2..=64).contains(factor))
        .ok_or_else(|| format!("expected a scale from 1/2 to 1/64, found `{text}`"))
}

pub(super) fn run(args: &EvalArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let networks = args.networks.open(&device)?;
    let mut table = Vec::new();
    for folder in &args.runs {
        let mut plan = RunPlan::of_run(folder)?;
        if let Some(test) = &args.test {
            plan = tested_by(&plan, test)?;
        }
        let trained = Trained::read(plan, folder, &device)?;
        for warning in &trained.warnings {
            errln!("warning: {warning}");
        }
        let (label, test) = (trained.plan.label(), &trained.plan.config.eval.test);
        let views = if test.test() == TestProtocol::Training {
            "training views, each without its own residual"
        } else {
            "test views"
        };
        outln!("{label}: {} {views} ({test})", trained.scene().test.len());
        let models = trained.models_with_residuals();
        if args.scales.is_empty() {
            each_view(&trained, &models, &networks)?;
        } else {
            table.push((label, scales(&trained, &models, &args.scales)?));
        }
    }
    if !args.scales.is_empty() {
        print_scales(&args.scales, &table);
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns `plan` with the test views of another protocol.
///
/// Some formats hold out views of one list, and all of them are for training where these are what is tested: a run is then of
/// other views, in another space, than it would be by the other protocol, and is not tested by that.
fn tested_by(plan: &RunPlan, test: &str) -> Result<RunPlan> {
    let mut other = plan.clone();
    other.config.eval.test = test.parse().map_err(|fault| anyhow::anyhow!("--test: {fault}"))?;
    let [was, is] = [plan, &other].map(|plan| plan.config.eval.test.test() == TestProtocol::Training);
    if was != is {
        let [then, now] = [plan.load()?, other.load()?];
        let same = then.given_cameras() == now.given_cameras() && then.space == now.space;
        let expected = if was { "training" } else { "another protocol than training" };
        ensure!(
            same,
            "--test: expected {expected}, found {test}: {} photographs are held out only where they are tested, and so the \
             run learned from others, in another space",
            then.format
        );
    }
    Ok(other)
}

/// Evaluates `views`, and shows each once it is measured.
fn evaluate(
    trained: &Trained,
    models: &[TrainedModel],
    views: &[View],
    mut evaluation: Evaluation<'_>,
    mut show: impl FnMut(&View, &TestView),
) -> Result<Evaluated> {
    let fit = (Pivot::of(trained.scene()), trained.plan.config.eval.pose_steps);
    let bar = counting_bar("test views", views.len());
    for view in views {
        let tested = evaluation.add_fitted(trained.renderer(), models, view, fit)?;
        bar.suspend(|| show(view, &tested));
        bar.inc(1);
    }
    bar.finish_and_clear();
    evaluation.finish().context("no test views")
}

fn each_view(trained: &Trained, models: &[TrainedModel], networks: &Networks) -> Result<()> {
    let protocol = trained.plan.config.eval.metric_protocol();
    outln!("{protocol}");
    let evaluation = Evaluation::new(networks, &protocol);
    let evaluated = evaluate(trained, models, &trained.scene().test, evaluation, |view, result| {
        outln!("{:16} {}{:.2} s", view.name, line(&result.values), result.seconds);
    })?;
    outln!("{:16} {}{:.2} s", "mean", line(&evaluated.measured.set), evaluated.seconds_per_image);
    let notes = picture_notes(&trained.plan.config).into_iter();
    for note in notes.chain(evaluated.measured.notes.iter().map(ToString::to_string)) {
        outln!("{note}");
    }
    Ok(())
}

/// Returns the metrics that have a value, each with its name.
fn line(values: &Values) -> String {
    let shown = |metric: &&Metric| {
        let value = values.get(metric.key()).copied().flatten()?;
        let unit = Some(metric.descriptor.unit).filter(|unit| !unit.is_empty());
        Some(format!(
            "{} {}{}  ",
            metric.descriptor.name,
            metric.descriptor.format(value),
            unit.map_or_else(String::new, |unit| format!(" {unit}"))
        ))
    };
    METRICS.iter().filter_map(shown).collect()
}

/// Returns the mean PSNR at full size and at each smaller one.
fn scales(trained: &Trained, models: &[TrainedModel], factors: &[u32]) -> Result<Vec<f64>> {
    let (networks, protocol) = (Networks::none(), trained.plan.config.eval.metric_protocol());
    let at = |factor: u32| -> Result<f64> {
        let reduced = trained.scene().test.iter().map(|view| view.reduced(factor));
        let is_measured = |view: &View| {
            let shows = view.valid.as_ref().is_none_or(|valid| valid.contains(&true));
            if !shows {
                errln!("warning: {} is left out at 1/{factor}: no pixel of it is valid there", view.name);
            }
            shows
        };
        let views: Vec<View> = reduced.filter(is_measured).collect();
        let evaluation = Evaluation::of(&[&PSNR], &networks, &protocol);
        let evaluated = evaluate(trained, models, &views, evaluation, |_, _| ())?;
        Ok(evaluated.measured.set[PSNR.key()].unwrap_or(f64::NAN))
    };
    std::iter::once(&1).chain(factors).map(|&factor| at(factor)).collect()
}

/// Prints one row per run: PSNR at full size, then at each scale, with the difference from full size.
fn print_scales(factors: &[u32], table: &[(String, Vec<f64>)]) {
    let wide = table.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let headings: String = factors.iter().map(|factor| format!("{:>16}", format!("1/{factor}"))).collect();
    outln!("\nmean PSNR in dB, and its difference from full size\n{:wide$}  {:>6}{headings}", "", "1");
    for (label, psnr) in table {
        let (full, smaller) = psnr.split_first().map_or((f64::NAN, &[][..]), |(full, smaller)| (*full, smaller));
        let cells: String = smaller.iter().map(|psnr| format!("{psnr:8.2} ({:+.2})", psnr - full)).collect();
        outln!("{label:wide$}  {full:6.2}{cells}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_from_a_half_to_a_64th() {
        assert_eq!(parse_scale("1/8"), Ok(8));
        for text in ["", "8", "1/1", "1/0", "1/65", "2/4", "1/-2", "1/1.5"] {
            assert!(parse_scale(text).is_err(), "{text}");
        }
    }
}
