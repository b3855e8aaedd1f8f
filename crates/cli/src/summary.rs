//! Results as lines of text.

use infonerf_experiment::sweep::Outcome;
use infonerf_report::{Quantity, Record, ReportInput};

use crate::print::outln;
use crate::terminal::fitted;

/// The most telling numbers of a run on one line.
pub(crate) fn summary(record: &Record) -> String {
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

/// Prints the table of a sweep, and where its report and numbers are.
pub(crate) fn print_outcome(outcome: &Outcome) {
    let Outcome { table, report, results, .. } = outcome;
    outln!("\n{}", fitted(table));
    outln!("report: {}\nnumbers: {}", report.display(), results.display());
}

/// Prints what became of the statements on the order of variants, if the experiment has some.
pub(crate) fn print_claims(input: &ReportInput) {
    for claim in input.tested_claims() {
        outln!("{:13} {}", claim.verdict.to_string(), claim.statement);
        for finding in &claim.findings {
            let there = finding.in_paper();
            let there = if there.is_empty() { there } else { format!(" (paper {there})") };
            outln!("{:13}   {}: {}{there}", "", finding.formula, finding.found());
        }
    }
}
