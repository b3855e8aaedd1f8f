use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;
use infonerf_experiment::{RunPlan, Trained, picture_notes};
use infonerf_metrics::{
    Descriptor, Folders, METRICS, Metric, Networks, PSNR, Protocol, Values, compare_folders, select,
};
use infonerf_render::Pivot;
use infonerf_report::{PictureComparison, counted};
use infonerf_scene::{TestProtocol, View};
use infonerf_train::{Evaluated, Evaluation, TestView, fit_test_poses};

use crate::print::{errln, outln};
use crate::progress::counting_bar;
use crate::selection::{DeviceArgs, NetworkArgs};
use crate::terminal::{open_device, read_run};
use crate::units::parse_folder;

const EVAL_EXAMPLES: &str = "\
Examples:
  infonerf eval runs/synthetic-4view/castle/infonerf+/seed0 --test all
      on all 200 test views
  infonerf eval runs/integration/castle/nerf/seed0 runs/integration/castle/mipnerf/seed0 --scale 1/2,1/4,1/8
      compares two runs at smaller image sizes than they were trained at
  infonerf eval --renders their/renders --truth their/test --out compared
      compares pictures of equal names (PNG, JPEG, WebP, TIFF, BMP): a table, compared/comparison.json and a page with sliders";

/// Evaluate finished runs again, also at smaller image sizes, or pictures rendered by other programs.
#[derive(Debug, Args)]
#[command(after_help = EVAL_EXAMPLES)]
pub(crate) struct EvalArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0; several are measured in turn, and compared with --scale
    #[arg(required_unless_present = "renders", conflicts_with = "renders", value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Test views: all, split, every-8, first-3, 0,8,16, training or a published protocol [default: the run's]
    #[arg(long, value_name = "PROTOCOL")]
    test: Option<TestProtocol>,
    /// Also render at smaller sizes, such as 1/2,1/4,1/8, against area-averaged test views
    #[arg(long = "scale", value_name = "1/N", value_delimiter = ',', value_parser = parse_scale)]
    scales: Vec<u32>,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    networks: NetworkArgs,
    #[command(flatten)]
    pictures: PicturesArgs,
}

/// Pictures rendered by other programs.
#[derive(Debug, Args)]
#[command(next_help_heading = "Pictures of other programs")]
struct PicturesArgs {
    /// Folder of rendered pictures: PNG, JPEG, WebP, TIFF or BMP
    #[arg(long, value_name = "DIR", requires = "truth", conflicts_with_all = ["test", "scales"])]
    renders: Option<PathBuf>,
    /// Folder of photographs, named like the renders except for the extension
    #[arg(long, value_name = "DIR", requires = "renders", conflicts_with = "runs")]
    truth: Option<PathBuf>,
    /// Folder of masks for the masked metrics, PNG, TIFF or BMP; black pixels are ignored
    #[arg(long, value_name = "DIR", requires = "renders", conflicts_with = "runs")]
    masks: Option<PathBuf>,
    /// How pictures are measured: infonerf, regnerf or neural-body (see docs/protocol.md)
    #[arg(long, value_name = "NAME", requires = "renders", conflicts_with = "runs", default_value = "infonerf")]
    protocol: String,
    /// Key of a metric to compute, such as lpips_vgg, and an error if it cannot be computed; may be repeated [default: all
    /// that can be computed]
    #[arg(long = "metric", value_name = "KEY", requires = "renders", conflicts_with = "runs")]
    metrics: Vec<String>,
    /// Leave out photographs without a render instead of refusing them
    #[arg(long, requires = "renders", conflicts_with = "runs")]
    partial: bool,
    /// Folder for comparison.json and comparison.html
    #[arg(long, value_name = "DIR", value_parser = parse_folder, requires = "renders", conflicts_with = "runs")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &EvalArgs) -> Result<ExitCode> {
    match (&args.pictures.renders, &args.pictures.truth) {
        (Some(renders), Some(truth)) => compare(args, renders, truth),
        _ => evaluate_runs(args),
    }
}

fn compare(args: &EvalArgs, renders: &Path, truth: &Path) -> Result<ExitCode> {
    let protocol = Protocol::named(&args.pictures.protocol).with_context(|| {
        let known = Protocol::NAMED.map(|(name, _)| name).join(", ");
        format!("--protocol {}: expected one of {known}", args.pictures.protocol)
    })?;
    // Metrics that are given by name must have a value. Without names, all metrics that can be computed are.
    let required = select(args.pictures.metrics.iter().map(String::as_str)).context("--metric")?;
    let metrics = if required.is_empty() { METRICS } else { required.as_slice() };
    let given = [("--renders", Some(renders)), ("--truth", Some(truth)), ("--masks", args.pictures.masks.as_deref())];
    for (option, folder) in given.into_iter().filter_map(|(option, folder)| Some((option, folder?))) {
        ensure!(folder.is_dir(), "{option} {}: expected a folder of pictures", folder.display());
    }
    let networks = args.networks.open(&open_device(args.device.device)?)?;
    let folders = Folders { renders, truth, masks: args.pictures.masks.as_deref(), partial: args.pictures.partial };
    let bar = counting_bar("pictures", 0);
    let compared = compare_folders(folders, metrics, &networks, &protocol, |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let compared = compared?;
    compared.measured.require(&required)?;
    let title = format!("{} against {}", renders.display(), truth.display());
    let comparison = PictureComparison { title: &title, protocol: &protocol, compared: &compared };
    outln!("{}", comparison.to_text().trim_end());
    if let Some(out) = &args.pictures.out {
        for file in comparison.write(out)? {
            outln!("{}", file.display());
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Parses a scale such as `1/8` into its denominator.
fn parse_scale(text: &str) -> Result<u32, String> {
    let factor = text.trim().strip_prefix("1/").and_then(|factor| factor.parse().ok());
    let factor = factor.filter(|factor| (2..=64).contains(factor));
    factor.ok_or_else(|| format!("expected a scale from 1/2 to 1/64, found `{text}`"))
}

fn evaluate_runs(args: &EvalArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let networks = args.networks.open(&device)?;
    let mut table = Vec::new();
    for folder in &args.runs {
        let mut plan = RunPlan::of_run(folder)?;
        if let Some(test) = &args.test {
            plan = tested_by(&plan, test)?;
        }
        let trained = read_run(plan, folder, &device)?;
        // Runs of several experiments may have the same label.
        let label = if args.runs.len() > 1 { folder.display().to_string() } else { trained.plan.label() };
        let test = &trained.plan.config.eval.test;
        let count = measured(&trained).len();
        let views = if *test == TestProtocol::Training {
            format!("{}, each without its own residual", counted(count, "training view"))
        } else {
            counted(count, "test view")
        };
        outln!("{label}: {views} ({test})");
        if args.scales.is_empty() {
            each_view(&trained, &networks)?;
        } else {
            table.push((label, scales(&trained, &args.scales)?));
        }
    }
    if !args.scales.is_empty() {
        print_scales(&args.scales, &table);
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns `plan` with the test views of another protocol; an error if the run would then have other training views, in another
/// space: formats that hold out views of one list train on all of them if training views are tested.
fn tested_by(plan: &RunPlan, test: &TestProtocol) -> Result<RunPlan> {
    let mut other = plan.clone();
    other.config.eval.max_views = 0;
    other.config.eval.test = test.clone();
    let [was, is] = [plan, &other].map(|plan| plan.config.eval.test == TestProtocol::Training);
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

fn measured(trained: &Trained) -> Vec<&View> {
    trained.plan.config.eval.measured(&trained.scene().test)
}

/// Evaluates `views`, and calls `show` for each of them once it is measured.
fn evaluate(
    trained: &Trained,
    views: &[&View],
    mut evaluation: Evaluation<'_>,
    mut show: impl FnMut(&View, &TestView),
) -> Result<Evaluated> {
    let (renderer, pivot, steps) =
        (trained.renderer(), Pivot::of(trained.scene()), trained.plan.config.eval.pose_steps);
    let bar = counting_bar("test views", views.len());
    for view in views {
        let members = fit_test_poses(renderer, &trained.models, view, pivot, steps, &mut || true);
        let tested = evaluation.add(renderer, &members, view)?;
        bar.suspend(|| show(view, &tested));
        bar.inc(1);
    }
    bar.finish_and_clear();
    evaluation.finish().context("no test views")
}

fn each_view(trained: &Trained, networks: &Networks) -> Result<()> {
    let protocol = trained.plan.config.eval.metric_protocol();
    outln!("{protocol}");
    let evaluation = Evaluation::new(networks, &protocol);
    let evaluated = evaluate(trained, &measured(trained), evaluation, |view, result| {
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
        let Descriptor { name, unit, .. } = metric.descriptor;
        let space = if unit.is_empty() { "" } else { " " };
        Some(format!("{name} {}{space}{unit}  ", metric.descriptor.format(value)))
    };
    METRICS.iter().filter_map(shown).collect()
}

/// Returns the mean PSNR at full size, then at `1/factor` of it for each factor.
fn scales(trained: &Trained, factors: &[u32]) -> Result<Vec<f64>> {
    let (networks, protocol) = (Networks::none(), trained.plan.config.eval.metric_protocol());
    let at = |factor: u32| -> Result<f64> {
        let reduced = measured(trained).into_iter().map(|view| view.reduced(factor));
        let is_measured = |view: &View| {
            let shows = view.valid.as_ref().is_none_or(|valid| valid.contains(&true));
            if !shows {
                errln!("warning: {} is left out at 1/{factor}: no pixel of it is valid there", view.name);
            }
            shows
        };
        let views: Vec<View> = reduced.filter(is_measured).collect();
        let evaluation = Evaluation::of(&[&PSNR], &networks, &protocol);
        let evaluated = evaluate(trained, &views.iter().collect::<Vec<_>>(), evaluation, |_, _| ())?;
        Ok(evaluated.measured.set[PSNR.key()].unwrap_or(f64::NAN))
    };
    std::iter::once(&1).chain(factors).map(|&factor| at(factor)).collect()
}

/// Prints one row per run: PSNR at full size, then at each scale, with the difference from full size.
fn print_scales(factors: &[u32], table: &[(String, Vec<f64>)]) {
    let wide = table.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
    let headings: String = factors.iter().map(|factor| format!("{:>16}", format!("1/{factor}"))).collect();
    outln!("\nmean PSNR in dB, and its difference from full size\n{:wide$}  {:>6}{headings}", "", "1");
    for (label, psnr) in table {
        let (full, smaller) = psnr.split_first().map_or((f64::NAN, &[][..]), |(full, smaller)| (*full, smaller));
        let cells: String = smaller.iter().map(|psnr| format!("{psnr:8.2} ({:+.2})", psnr - full)).collect();
        outln!("{label:wide$}  {full:6.2}{cells}");
    }
}
