use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use infonerf_experiment::{Experiment, Finished, Resume, RunPlan, Session, Trained, total_progress};
use infonerf_report::{
    Quantity, Record, ReportInput, VIEWER_PAGE, overview_table, protocol_lines, save_record, write_atomically,
    write_report,
};
use infonerf_train::{Phase, Trainer};

use super::INTERRUPTED;
use crate::args::ExpArgs;
use crate::interrupt;
use crate::progress::Progress;
use crate::terminal::{emphasis, open_device};

pub(crate) fn run(args: &ExpArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection.selection(args.budget))?;
    let resume = if args.resume { Resume::Always } else { Resume::Never };
    let device = open_device(args.selection.device.device)?;
    let networks = args.selection.weights.networks(&device)?;
    let session = Session::new(device, &args.out, resume).with_networks(networks);
    interrupt::install()?;
    announce(&experiment, &session);
    let folder = session.experiment_folder(&experiment.about.name);
    let mut records: Vec<Record> = Vec::new();
    for (index, plan) in experiment.runs.iter().enumerate() {
        let label = format!("[{}/{}] {}", index + 1, experiment.runs.len(), plan.label());
        let mut progress = Progress::new(&label)?;
        match session.run(plan, &mut |event| progress.watch(event))? {
            Finished::Record(record, trainers) => {
                println!("{label}: {}", summary(&record));
                if args.profile {
                    print_profile(&trainers);
                }
                if infonerf_view::holds(&plan.config.field) {
                    write_viewer(plan, trainers, &folder)?;
                }
                records = save_record(&folder, &record)?;
            }
            Finished::Kept(record) => {
                println!("{label}: finished before, kept");
                records = save_record(&folder, &record)?;
            }
            Finished::Stopped => {
                println!("{label}: saved; the same command with --resume goes on");
                return Ok(ExitCode::from(INTERRUPTED));
            }
        }
    }
    let records: Vec<Record> =
        records.into_iter().filter(|record| experiment.runs.iter().any(|plan| same(plan, record))).collect();
    print_table(&records);
    let input = experiment.about.report_input(records, &experiment.runs.iter().collect::<Vec<_>>())?;
    print_claims(&input);
    let files = write_report(&input, &folder)?;
    println!("\nreport: {}\nnumbers: {}", files.html.display(), folder.join("results.json").display());
    Ok(ExitCode::SUCCESS)
}

/// Leaves the page that shows a run's scene beside the run, for the report to open.
fn write_viewer(plan: &RunPlan, trainers: Vec<Trainer>, experiment: &Path) -> Result<()> {
    let run = Trained { plan: plan.clone(), trainers, warnings: Vec::new() };
    match infonerf_view::page(&run) {
        Ok(page) => write_atomically(&experiment.join(plan.directory()).join(VIEWER_PAGE), page.as_bytes())?,
        Err(error) => eprintln!("warning: {}: no page in 3D: {error:#}", plan.label()),
    }
    Ok(())
}

fn same(plan: &RunPlan, record: &Record) -> bool {
    (&plan.scene, &plan.variant, plan.seed, plan.preset.name())
        == (&record.scene, &record.variant, record.seed, record.preset.as_str())
}

fn announce(experiment: &Experiment, session: &Session) {
    let about = &experiment.about;
    println!("{}: {} ({} runs, on {})", about.name, about.title, experiment.runs.len(), session.device.name);
    match &about.data {
        Some(data) => println!("scenes from {}", data.display()),
        None => println!("no --data given: using the built-in procedural scenes"),
    }
}

/// The most telling numbers of a run on one line.
pub(super) fn summary(record: &Record) -> String {
    let shown = |quantity: Quantity| quantity.value(record).map_or_else(|| "-".into(), |value| quantity.format(value));
    format!(
        "PSNR {} dB, SSIM {}, {} steps in {:.1} s{}",
        shown(Quantity::PSNR),
        shown(Quantity::SSIM),
        record.iterations,
        record.train_seconds,
        if record.collapsed { ", COLLAPSED" } else { "" }
    )
}

fn print_table(records: &[Record]) {
    println!();
    for line in protocol_lines(records) {
        println!("{line}");
    }
    println!("\n{}", overview_table(records, &Quantity::all()).to_text(emphasis()));
}

/// What became of the statements on the order of variants, if the experiment has some.
pub(super) fn print_claims(input: &ReportInput) {
    for claim in input.tested_claims() {
        println!("{:13} {}", claim.verdict.to_string(), claim.statement);
        for finding in &claim.findings {
            let there = finding.in_paper();
            let there = if there.is_empty() { there } else { format!(" (paper {there})") };
            println!("{:13}   {}: {}{there}", "", finding.formula, finding.found());
        }
    }
}

fn print_profile(trainers: &[Trainer]) {
    let progress = total_progress(trainers);
    let steps = progress.step.max(1) as f64;
    let skipped = 1.0 - progress.samples_evaluated as f64 / progress.samples_total.max(1) as f64;
    println!(
        "    samples: {} of {} evaluated, {:.1} % skipped",
        progress.samples_evaluated,
        progress.samples_total,
        100.0 * skipped
    );
    if progress.pixels_skipped > 0 {
        println!("    pixels: {} draws rejected as well fitted", progress.pixels_skipped);
    }
    for phase in Phase::ALL {
        let spent = trainers.iter().map(|trainer| trainer.profile().spent(phase).as_secs_f64()).sum::<f64>();
        println!(
            "    {:12} {:8.2} ms per step {:5.1} %",
            phase.name(),
            spent / steps * 1e3,
            100.0 * spent / progress.seconds
        );
    }
}
