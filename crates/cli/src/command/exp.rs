use std::process::ExitCode;

use anyhow::Result;
use infonerf_report::{
    Emphasis, Metric, Record, ReportInput, overview_table, protocol_lines, save_record, write_report,
};
use infonerf_train::{Phase, Trainer};

use crate::args::ExpArgs;
use crate::device;
use crate::experiment::{Experiment, RunPlan};
use crate::interrupt;
use crate::run::{Finished, Session, total};

/// Exit code after Ctrl-C.
const INTERRUPTED: u8 = 130;

pub(crate) fn run(args: &ExpArgs) -> Result<ExitCode> {
    let experiment = Experiment::plan(&args.experiment, &args.selection, args.budget)?;
    let (device, device_name) = device::open(args.selection.device)?;
    let session = Session { device, device_name, out: args.out.clone(), resume: args.resume, until: None };
    interrupt::install()?;
    announce(&experiment, device_name);
    let folder = args.out.join(&experiment.about.name);
    let mut records: Vec<Record> = Vec::new();
    for (index, plan) in experiment.runs.iter().enumerate() {
        let label = plan.label();
        match session.run(plan)? {
            Finished::Record(record, trainers) => {
                println!("[{}/{}] {label}: {}", index + 1, experiment.runs.len(), summary(&record));
                if args.profile {
                    print_profile(&trainers);
                }
                records = save_record(&folder, &record)?;
            }
            Finished::Kept => {
                println!("[{}/{}] {label}: finished before, kept", index + 1, experiment.runs.len());
                records = infonerf_report::read_records(&folder.join("results.json"))?;
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

fn same(plan: &RunPlan, record: &Record) -> bool {
    (&plan.scene, &plan.variant, plan.seed, plan.preset.name())
        == (&record.scene, &record.variant, record.seed, record.preset.as_str())
}

fn announce(experiment: &Experiment, device: &str) {
    let about = &experiment.about;
    println!("{}: {} ({} runs, on {device})", about.name, about.title, experiment.runs.len());
    match &about.data {
        Some(data) => println!("scenes from {}", data.display()),
        None => println!("no --data given: using the built-in procedural scenes"),
    }
}

/// The most telling numbers of a run on one line.
pub(super) fn summary(record: &Record) -> String {
    let number = |value: Option<f64>, digits| value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"));
    format!(
        "PSNR {} dB, SSIM {}, {} steps in {:.1} s{}",
        number(record.psnr, 2),
        number(record.ssim, 3),
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
    println!("\n{}", overview_table(records, &Metric::ALL).to_text(Emphasis::Terminal));
}

/// What became of the paper's statements, if the experiment has some.
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
    let progress = total(trainers);
    let steps = progress.step.max(1) as f64;
    let skipped = 1.0 - progress.samples_evaluated as f64 / progress.samples_total.max(1) as f64;
    println!(
        "    samples: {} of {} evaluated, {:.1} % skipped",
        progress.samples_evaluated,
        progress.samples_total,
        100.0 * skipped
    );
    if progress.pixels_skipped > 0 {
        println!("    pixels: {} draws passed over as explained", progress.pixels_skipped);
    }
    for phase in Phase::ALL {
        let spent = trainers.iter().map(|trainer| trainer.profile().spent(phase).as_secs_f64()).sum::<f64>();
        println!(
            "    {:12} {:8.2} ms a step {:5.1} %",
            phase.name(),
            spent / steps * 1e3,
            100.0 * spent / progress.seconds
        );
    }
}
