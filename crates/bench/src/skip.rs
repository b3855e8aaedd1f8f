//! What each way of skipping saves, and what it costs in quality: everything off, everything on, each off alone, and what is
//! off by default on top.

use anyhow::{Context, Result};
use infonerf_report::chart::{Bar, Frame, bar_chart};
use infonerf_train::Config;
use serde::Serialize;

use super::context::{Bench, distinct};
use super::options::Options;
use super::output::{TextTable, number};
use super::trial::{Trial, mean, with_settings};

/// A way of skipping, and the settings that switch it off.
struct Switch {
    name: &'static str,
    /// Of a run's config.
    off: fn(&Config) -> Vec<String>,
}

const SWITCHES: &[Switch] = &[
    Switch { name: "empty space", off: |_| settings(&["render.occupancy.enabled=false"]) },
    Switch {
        name: "hidden samples",
        off: |_| settings(&["render.hidden_depth=0", "render.early_stop_transmittance=0"]),
    },
    Switch { name: "out of bounds", off: |_| settings(&["render.clip_to_bounds=false"]) },
    Switch { name: "image pyramid", off: |_| settings(&["train.downscale=1"]) },
    Switch { name: "sample ramp", off: |config| vec![format!("render.samples={}", config.render.samples.largest())] },
];

/// Ways that are off in the presets, and the settings that switch them on.
const EXTRAS: &[(&str, &[&str])] = &[
    ("all, and error sampling", &["train.error_sampling={threshold=0.03,keep=0.25}"]),
    ("all, and early stopping", &["train.early_stopping={patience=100,min_delta=0.02}"]),
];

/// Not a way of skipping: what the terms on unseen rays cost.
const NO_TERMS: &[&str] = &["loss.entropy.weight=0", "loss.kl.weight=0"];

/// The same rays in every run, however few samples they need.
const FIXED: &str = "train.target_samples=0";

const PROTOCOL: &str = "every run takes the same number of steps of the same number of rays (train.target_samples=0); factors \
                        compare with the run that skips nothing; means over scenes, variants and seeds";

#[derive(Serialize)]
struct Run {
    case: String,
    settings: Vec<String>,
    trials: Vec<Trial>,
}

/// A line of the table.
#[derive(Serialize)]
struct Row {
    case: String,
    settings: Vec<String>,
    train_seconds: f64,
    render_seconds_per_image: f64,
    samples_total: f64,
    samples_evaluated: f64,
    /// Evaluated over all, in this run.
    evaluated_share: f64,
    /// Samples evaluated without skipping over those here.
    fewer_samples: Option<f64>,
    /// Training time without skipping over that here.
    less_time: Option<f64>,
    psnr: f64,
    ssim: Option<f64>,
}

#[derive(Serialize)]
struct Results<'a> {
    rows: &'a [Row],
    runs: &'a [Run],
}

/// The cases in the order of the table with the settings of each, the one that skips nothing first.
fn cases(config: &Config) -> Vec<(String, Vec<String>)> {
    let nothing = SWITCHES.iter().flat_map(|switch| (switch.off)(config)).collect();
    let all_but = |switch: &Switch| (format!("all but {}", switch.name), (switch.off)(config));
    let mut cases = vec![("skip nothing".to_owned(), nothing), ("skip all".to_owned(), Vec::new())];
    cases.extend(SWITCHES.iter().map(all_but));
    cases.extend(EXTRAS.iter().map(|&(name, on)| (name.to_owned(), settings(on))));
    cases.push(("all, no unseen rays".to_owned(), settings(NO_TERMS)));
    cases
}

fn settings(settings: &[&str]) -> Vec<String> {
    settings.iter().map(|&setting| setting.to_owned()).collect()
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    say("");
    let mut runs: Vec<Run> = Vec::new();
    let first = bench.plans.first().context("expected at least one run to measure")?;
    for (case, settings) in cases(&first.config) {
        let mut trials = Vec::new();
        for plan in &bench.plans {
            let iterations = options.steps.map_or(plan.config.train.iterations, |steps| steps as usize);
            let mut all = vec![FIXED.to_owned(), format!("train.iterations={iterations}")];
            all.extend(settings.iter().cloned());
            let plan = with_settings(plan, &all).with_context(|| case.clone())?;
            let trial = bench.trial(&plan)?;
            let (label, seconds, psnr) = (plan.label(), trial.train_seconds, trial.psnr());
            say(&format!("{case}, {label}: {seconds:.1} s, {psnr:.2} dB"));
            trials.push(trial);
        }
        runs.push(Run { case, settings, trials });
        save(bench, &runs)?;
    }
    say(&text(&rows(&runs), &runs));
    Ok(())
}

fn rows(runs: &[Run]) -> Vec<Row> {
    let of = |run: &Run, value: fn(&Trial) -> f64| {
        mean(&run.trials.iter().collect::<Vec<_>>(), |trial| Some(value(trial))).unwrap_or(f64::NAN)
    };
    let row = |run: &Run| {
        let over_nothing = |value: fn(&Trial) -> f64| {
            let ratio = of(runs.first()?, value) / of(run, value);
            ratio.is_finite().then_some(ratio)
        };
        Row {
            case: run.case.clone(),
            settings: run.settings.clone(),
            train_seconds: of(run, |trial| trial.train_seconds),
            render_seconds_per_image: of(run, |trial| trial.render_seconds_per_image),
            samples_total: of(run, |trial| trial.samples_total as f64),
            samples_evaluated: of(run, |trial| trial.samples_evaluated as f64),
            evaluated_share: of(run, |trial| trial.samples_evaluated as f64)
                / of(run, |trial| trial.samples_total as f64),
            fewer_samples: over_nothing(|trial| trial.samples_evaluated as f64),
            less_time: over_nothing(|trial| trial.train_seconds),
            psnr: of(run, Trial::psnr),
            ssim: mean(&run.trials.iter().collect::<Vec<_>>(), |trial| trial.metric("ssim")),
        }
    };
    runs.iter().map(row).collect()
}

fn save(bench: &Bench, runs: &[Run]) -> Result<()> {
    let rows = rows(runs);
    bench.save_results(PROTOCOL, &Results { rows: &rows, runs })?;
    for (name, title, value) in [
        ("seconds", "Training time (s)", (|row| row.train_seconds) as fn(&Row) -> f64),
        ("samples", "Samples evaluated (millions)", |row| row.samples_evaluated / 1e6),
        ("psnr", "PSNR (dB)", |row| row.psnr),
    ] {
        let bars = rows.iter().enumerate().map(|(index, row)| Bar {
            label: label(index, row),
            value: value(row),
            spread: None,
        });
        let bars: Vec<Bar> = bars.collect();
        bench.save_chart(&format!("skip-{name}"), &bar_chart(&Frame::new(title, "skipped", ""), &bars)?)?;
    }
    Ok(())
}

/// Short enough to stand below a bar.
fn label(index: usize, row: &Row) -> String {
    let short =
        ["nothing", "all", "−empty", "−hidden", "−bounds", "−pyramid", "−ramp", "+errors", "+early stop", "−unseen"];
    short.get(index).map_or_else(|| row.case.clone(), |&label| label.to_owned())
}

fn text(rows: &[Row], runs: &[Run]) -> String {
    let mut table = TextTable::new(&[
        "",
        "training",
        "ms/step",
        "render",
        "samples",
        "evaluated",
        "share",
        "fewer",
        "faster",
        "PSNR",
        "SSIM",
    ]);
    for (row, run) in rows.iter().zip(runs) {
        let steps =
            run.trials.iter().map(|trial| trial.iterations).sum::<usize>().max(1) as f64 / run.trials.len() as f64;
        table.row(vec![
            row.case.clone(),
            format!("{:.1} s", row.train_seconds),
            format!("{:.1}", 1e3 * row.train_seconds / steps),
            format!("{:.2} s", row.render_seconds_per_image),
            format!("{:.1} M", row.samples_total / 1e6),
            format!("{:.1} M", row.samples_evaluated / 1e6),
            format!("{:.1} %", 100.0 * row.evaluated_share),
            number(row.fewer_samples, 1) + "x",
            number(row.less_time, 1) + "x",
            format!("{:.2}", row.psnr),
            number(row.ssim, 4),
        ]);
    }
    let collapsed = distinct(runs, |run| run.trials.iter().any(|trial| trial.collapsed).then(|| run.case.clone()));
    let note = |case: String| format!("{case}: a run collapsed, its field went empty\n");
    format!("\n{}", table.to_text()) + &collapsed.into_iter().flatten().map(note).collect::<String>()
}

#[cfg(test)]
mod tests {
    use infonerf_train::Preset;

    use super::*;

    #[test]
    fn every_switch_is_a_setting_of_every_preset() {
        for preset in Preset::ALL {
            let base = Config::from_table(preset.table()).unwrap();
            for (case, settings) in cases(&base) {
                let settings = settings.iter().map(String::as_str).chain([FIXED]);
                Config::of(preset, settings).unwrap_or_else(|error| panic!("{case}: {error}"));
            }
        }
    }
}
