//! Time, samples and quality of each way of skipping: all off, all on, each off alone, and what is off by default on top.

use anyhow::{Context, Result};
use infonerf_report::{Quantity, Record, TextTable};
use infonerf_train::Config;
use serde::Serialize;
use serde_json::json;

use crate::context::Bench;
use crate::output::number;
use crate::trial::{mean, with_settings};

/// Way of skipping, and the settings that switch it off.
struct Switch {
    name: &'static str,
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

/// Name and settings of cases on top of all ways of skipping: two that are off in the presets, and the cost of the terms
/// on unseen rays.
const EXTRAS: &[(&str, &[&str])] = &[
    ("all, and error sampling", &["train.error_sampling={threshold=0.03,keep=0.25}"]),
    ("all, and early stopping", &["train.early_stopping={patience=100,min_delta=0.02}"]),
    ("all, no unseen rays", &["loss.entropy.weight=0", "loss.kl.weight=0"]),
];

/// Setting that gives every run the same number of rays, however few samples they need.
const FIXED_RAYS: &str = "train.target_samples=0";

const PROTOCOL: &str = "every run takes the same number of steps of the same number of rays (train.target_samples=0); factors \
                        compare with the run that skips nothing; means over scenes, variants and seeds";

/// Case with its runs and their means.
#[derive(Serialize)]
struct SkipCase {
    case: String,
    settings: Vec<String>,
    iterations: f64,
    train_seconds: f64,
    render_seconds_per_image: f64,
    samples_total: f64,
    samples_evaluated: f64,
    /// Evaluated over all samples.
    evaluated_share: f64,
    /// Samples evaluated without skipping over those of this case.
    fewer_samples: Option<f64>,
    /// Training time without skipping over that of this case.
    less_time: Option<f64>,
    psnr: Option<f64>,
    ssim: Option<f64>,
    collapsed: bool,
    trials: Vec<Record>,
}

/// Lists name and settings of each case, in the order of the table; the first one skips nothing.
fn cases(config: &Config) -> Vec<(String, Vec<String>)> {
    let nothing = SWITCHES.iter().flat_map(|switch| (switch.off)(config)).collect();
    let all_but = |switch: &Switch| (format!("all but {}", switch.name), (switch.off)(config));
    let mut cases = vec![("skip nothing".into(), nothing), ("skip all".into(), Vec::new())];
    cases.extend(SWITCHES.iter().map(all_but));
    cases.extend(EXTRAS.iter().map(|&(name, on)| (name.to_owned(), settings(on))));
    cases
}

fn settings(settings: &[&str]) -> Vec<String> {
    settings.iter().map(|&setting| setting.to_owned()).collect()
}

pub(crate) fn run(bench: &Bench, steps: Option<u32>, print: &mut dyn FnMut(&str)) -> Result<()> {
    print("");
    let mut rows: Vec<SkipCase> = Vec::new();
    for (case, settings) in cases(&bench.first_plan().config) {
        let mut trials = Vec::new();
        for plan in &bench.plans {
            let iterations = steps.map_or(plan.config.train.iterations, |steps| steps as usize);
            let mut all = vec![FIXED_RAYS.to_owned(), format!("train.iterations={iterations}")];
            all.extend(settings.iter().cloned());
            let plan = with_settings(plan, &all).with_context(|| case.clone())?;
            let trial = bench.trial(&plan)?;
            let (label, seconds, psnr) = (plan.label(), trial.train_seconds, number(Quantity::PSNR.value(&trial), 2));
            print(&format!("{case}, {label}: {seconds:.1} s, {psnr} dB"));
            trials.push(trial);
        }
        rows.push(SkipCase::new(case, settings, trials, rows.first()));
        // Results so far stay if the rest is interrupted.
        bench.save_results(PROTOCOL, &rows, json!({}))?;
    }
    print(&text(&rows));
    Ok(())
}

impl SkipCase {
    /// Averages `trials` and compares them with the case that skips nothing, if this is another one.
    fn new(case: String, settings: Vec<String>, trials: Vec<Record>, nothing: Option<&Self>) -> Self {
        let all: Vec<&Record> = trials.iter().collect();
        let of = |value: fn(&Record) -> f64| mean(&all, |trial| Some(value(trial))).unwrap_or(f64::NAN);
        let (samples_total, samples_evaluated) =
            (of(|trial| trial.samples_total as f64), of(|trial| trial.samples_evaluated as f64));
        let train_seconds = of(|trial| trial.train_seconds);
        let ratio =
            |without: Option<f64>, with: f64| Some(without.unwrap_or(with) / with).filter(|ratio| ratio.is_finite());
        Self {
            case,
            settings,
            iterations: of(|trial| trial.iterations as f64),
            train_seconds,
            render_seconds_per_image: of(|trial| trial.render_seconds_per_image),
            samples_total,
            samples_evaluated,
            evaluated_share: samples_evaluated / samples_total,
            fewer_samples: ratio(nothing.map(|row| row.samples_evaluated), samples_evaluated),
            less_time: ratio(nothing.map(|row| row.train_seconds), train_seconds),
            psnr: mean(&all, |trial| Quantity::PSNR.value(trial)),
            ssim: mean(&all, |trial| Quantity::SSIM.value(trial)),
            collapsed: all.iter().any(|trial| trial.collapsed),
            trials,
        }
    }
}

fn text(rows: &[SkipCase]) -> String {
    let table = TextTable::new(
        rows,
        &[
            ("", |row| row.case.clone()),
            ("training", |row| format!("{:.1} s", row.train_seconds)),
            ("ms/step", |row| format!("{:.1}", 1e3 * row.train_seconds / row.iterations.max(1.0))),
            ("render", |row| format!("{:.2} s", row.render_seconds_per_image)),
            ("samples", |row| format!("{:.1} M", row.samples_total / 1e6)),
            ("evaluated", |row| format!("{:.1} M", row.samples_evaluated / 1e6)),
            ("share", |row| format!("{:.1} %", 100.0 * row.evaluated_share)),
            ("fewer", |row| number(row.fewer_samples, 1) + "x"),
            ("faster", |row| number(row.less_time, 1) + "x"),
            ("PSNR", |row| number(row.psnr, 2)),
            ("SSIM", |row| number(row.ssim, 4)),
        ],
    );
    let collapsed = rows.iter().filter(|row| row.collapsed);
    let note = |row: &SkipCase| format!("{}: a run collapsed, its field went empty\n", row.case);
    format!("\n{}", table.to_text()) + &collapsed.map(note).collect::<String>()
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
                let settings = settings.iter().map(String::as_str).chain([FIXED_RAYS]);
                Config::of(preset, settings).unwrap_or_else(|error| panic!("{case}: {error}"));
            }
        }
    }
}
