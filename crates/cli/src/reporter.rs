//! Prints the progress and the results of experiments.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use indexmap::IndexSet;
use indicatif::ProgressBar;
use infonerf_experiment::execute::{PlanEvent, RunEnd};
use infonerf_experiment::sweep::{Prepared, Sweep, SweepFiles};
use infonerf_experiment::{Control, DeviceName};
use infonerf_report::{Quantity, Record, ReportInput, counted};

use crate::print::{errln, outln};
use crate::progress::{ProgressDisplay, counting_bar};
use crate::terminal::fitted;
use crate::units::expected_time;
use crate::{command_line, interrupt};

const MAX_NAMED: usize = 8;

pub(crate) struct Reporter {
    same_command: &'static str,
    device: DeviceName,
    /// Whether runs are in this process, where each has a bar of its own.
    in_process: bool,
    out: PathBuf,
    has_begun: bool,
    /// Progress bar of the runs in processes of their own.
    bar: ProgressBar,
    /// Progress of the current run of this process.
    progress: Option<ProgressDisplay>,
}

impl Reporter {
    /// Makes a reporter for experiments below `out`, whose runs are `in_process` or elsewhere, and go on with `same_command`.
    pub(crate) fn new(same_command: &'static str, device: DeviceName, in_process: bool, out: &Path) -> Self {
        let out = out.to_owned();
        Self { same_command, device, in_process, out, has_begun: false, bar: ProgressBar::hidden(), progress: None }
    }

    /// Shows `event`, and returns the user's command: continue, save or stop.
    pub(crate) fn watch(&mut self, event: PlanEvent<'_>) -> Control {
        match event {
            PlanEvent::Started(sweep, prepared) => self.started(sweep, prepared),
            PlanEvent::Run(sweep, index, event) => {
                self.progress.get_or_insert_with(|| ProgressDisplay::new(&sweep.label(index))).show(event);
            }
            PlanEvent::RunEnded(sweep, index, ended) => {
                let label = sweep.label(index);
                self.progress = None;
                self.bar.suspend(|| match ended {
                    RunEnd::Trained(record, _) => outln!("{label}: {}", summary(&record)),
                    RunEnd::AlreadyDone(record) => outln!("{label}: {} (finished before)", summary(&record)),
                    RunEnd::Finished(line) => outln!("{label}: {line}"),
                    RunEnd::Stopped => outln!("{label}: saved; {} continues it", self.same_command),
                    RunEnd::Failed(reason) => errln!("{label}: failed: {reason}"),
                });
                self.bar.inc(1);
            }
            PlanEvent::Ended => self.bar.finish_and_clear(),
            PlanEvent::Written(sweep, outcome, missing) => self.written(sweep, outcome, &missing),
        }
        interrupt::control()
    }

    fn started(&mut self, sweep: &Sweep, prepared: &Prepared) {
        let (about, todo, all) = (&sweep.about, prepared.missing.len(), sweep.runs().len());
        if self.has_begun {
            outln!("");
        }
        self.has_begun = true;
        let kept = all - todo;
        let finished = if kept > 0 { format!(", {kept} finished before") } else { String::new() };
        let runs = counted(all, "run");
        outln!("{}: {} ({runs}{finished}) on {}", about.name, about.title, self.device);
        if let Some(seconds) = about.seconds_per_run.filter(|_| todo > 0) {
            outln!("time: {}", expected_time(seconds, todo));
        }
        match &about.data {
            Some(data) => outln!("scenes from {}", data.display()),
            None => outln!("no --data given: using the built-in procedural scenes"),
        }
        let mut presets: BTreeMap<&str, IndexSet<&str>> = BTreeMap::new();
        for plan in sweep.runs() {
            presets.entry(plan.preset.name()).or_default().insert(&plan.scene);
        }
        for (preset, scenes) in presets {
            outln!("preset {preset}: {}", Vec::from_iter(scenes).join(", "));
        }
        if let Some((plan, budget)) = sweep.runs().find_map(|plan| Some((plan, plan.budget?))) {
            let fields = plan.members();
            let fields = if fields > 1 { format!(", shared by {fields} fields") } else { String::new() };
            outln!(
                "each run trains for at most {budget} s{fields}; reading the scene before and testing afterwards take time of their own"
            );
        }
        if let Some(warning) = &prepared.warning {
            errln!("warning: {warning}");
        }
        self.bar = ProgressBar::hidden();
        if !self.in_process {
            self.bar = counting_bar(&about.name, todo);
            self.bar.enable_steady_tick(Duration::from_millis(500));
        }
    }

    fn written(&self, sweep: &Sweep, outcome: Option<&SweepFiles>, missing: &[String]) {
        if let Some(SweepFiles { table, input, report, results }) = outcome {
            outln!("\n{}", fitted(table));
            print_claims(input);
            outln!("report: {}\nrecords: {}", report.display(), results.display());
            command_line::save_or_warn(&sweep.folder(&self.out));
        }
        if !missing.is_empty() {
            let named = missing.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
            let more = if missing.len() > MAX_NAMED { ", ..." } else { "" };
            let (name, count, again) = (&sweep.about.name, missing.len(), self.same_command);
            let all = sweep.runs().len();
            errln!("{name}: not finished: {named}{more} ({count} of {all} runs); {again} tries them again");
        }
    }
}

pub(crate) fn summary(record: &Record) -> String {
    let shown = |quantity: Quantity| quantity.value(record).map_or_else(|| "-".into(), |value| quantity.format(value));
    let on = if record.test_views.protocol == "training" { " on training views" } else { "" };
    let collapsed = if record.collapsed { ", COLLAPSED" } else { "" };
    let [psnr, ssim] = [Quantity::PSNR, Quantity::SSIM].map(shown);
    let (steps, seconds) = (counted(record.iterations as usize, "step"), record.train_seconds);
    format!("PSNR {psnr} dB{on}, SSIM {ssim}, {steps} in {seconds:.1} s{collapsed}")
}

/// Prints the experiment's claims on the order of variants, each with its verdict and findings.
fn print_claims(input: &ReportInput) {
    for claim in input.tested_claims() {
        outln!("{:13} {}", claim.verdict.to_string(), claim.statement);
        for finding in &claim.findings {
            let there = &finding.in_paper;
            let there = if there.is_empty() { String::new() } else { format!(" (paper {there})") };
            outln!("{:13}   {}: {}{there}", "", finding.formula, finding.found);
        }
    }
}
