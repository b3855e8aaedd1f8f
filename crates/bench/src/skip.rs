//! Time, samples and quality of each way of skipping work: all off, all on, each one off alone, and without unseen rays.

use anyhow::{Context, Result};
use infonerf_experiment::Watch;
use infonerf_report::{Quantity, Record, TextTable, overview_table};
use infonerf_train::Config;
use serde_json::json;

use crate::context::{Bench, distinct};
use crate::output::number;
use crate::trial::{measured_with, with_settings};

/// Setting that gives every run the same number of rays, however few samples they need.
const FIXED_RAYS: &str = "train.target_samples=0";

const PROTOCOL: &str = "every run takes the same number of steps of the same number of rays (train.target_samples=0); factors \
                        compare with the run that skips nothing; means over scenes, variants and seeds";

/// Lists the name of each case and its settings, separated by spaces, in the order of the table; the first case skips nothing.
fn cases(config: &Config) -> Vec<(String, String)> {
    let ramp = format!("render.samples={}", config.render.samples.largest());
    // Ways of skipping, and the settings that switch each off.
    let switches = [
        ("empty space", "render.occupancy.enabled=false"),
        ("hidden samples", "render.hidden_depth=0 render.early_stop_transmittance=0"),
        ("out of bounds", "render.clip_to_bounds=false"),
        ("image pyramid", "train.downscale=1"),
        ("sample ramp", ramp.as_str()),
    ];
    let all = switches.map(|(_, off)| off).join(" ");
    let mut cases = vec![("skip nothing".to_owned(), all), ("skip all".to_owned(), String::new())];
    cases.extend(switches.map(|(name, off)| (format!("all but {name}"), off.to_owned())));
    // The last case measures the cost of the terms on unseen rays, with all ways of skipping on.
    cases.push(("all, no unseen rays".to_owned(), "loss.entropy.weight=0 loss.kl.weight=0".to_owned()));
    cases
}

/// Measures time, samples and quality with each way of skipping switched off, in runs of `steps` if given.
pub fn run(bench: &Bench, steps: Option<u32>, print: &mut dyn FnMut(&str), watch: &mut Watch<'_>) -> Result<()> {
    print(&format!("{}\n", bench.heading()));
    let mut records: Vec<Record> = Vec::new();
    for (case, settings) in cases(&bench.plans[0].config) {
        for plan in &bench.plans {
            let iterations = steps.map_or(plan.config.train.iterations, |steps| steps as usize);
            let iterations = format!("train.iterations={iterations}");
            let all = [FIXED_RAYS, &iterations].into_iter().chain(settings.split_whitespace());
            let plan = with_settings(plan, all).with_context(|| case.clone())?;
            let record = bench.trial(&plan, watch)?;
            let (label, seconds, psnr) = (plan.label(), record.train_seconds, number(Quantity::PSNR.value(&record), 2));
            print(&format!("{case}, {label}: {seconds:.1} s, {psnr} dB"));
            records.push(measured_with(record, "case", case.clone()));
            // Results are saved after each run, so that they stay if the rest is interrupted.
            bench.save_results(PROTOCOL, &records, json!({}))?;
        }
    }
    let table = overview_table(&records, &[Quantity::cost(), vec![Quantity::PSNR, Quantity::SSIM]].concat());
    let factors = TextTable::new(
        &factors(&records),
        &[
            ("", |(run, _): &(String, [f64; 2])| run.clone()),
            ("fewer samples", |(_, [fewer_samples, _])| format!("{fewer_samples:.1}x")),
            ("faster", |(_, [_, less_time])| format!("{less_time:.1}x")),
        ],
    );
    print(&format!("\n{}\n{}", table.to_text(), factors.to_text()));
    Ok(())
}

/// Divides samples and training time of the first case's runs by those of each case's runs of the same variant.
fn factors(records: &[Record]) -> Vec<(String, [f64; 2])> {
    let variant = |record: &Record| record.setting.as_ref().map(|setting| setting.variant.clone());
    let factor = |run: String| {
        let own: Vec<&Record> = records.iter().filter(|record| record.variant == run).collect();
        let first = records.iter().find(|record| variant(record) == variant(own[0])).unwrap_or(own[0]);
        let ratio = |value: fn(&Record) -> f64| {
            let without = records.iter().filter(|record| record.variant == first.variant).map(value).sum::<f64>();
            without / own.iter().map(|record| value(record)).sum::<f64>()
        };
        (run, [ratio(|record| record.samples_evaluated as f64), ratio(|record| record.train_seconds)])
    };
    distinct(records, |record| record.variant.clone()).into_iter().map(factor).collect()
}

#[cfg(test)]
mod tests {
    use infonerf_train::Preset;

    use super::*;

    #[test]
    fn every_switch_is_a_setting_of_every_preset() {
        for preset in Preset::ALL {
            for (case, settings) in cases(&Config::from_table(preset.table()).unwrap()) {
                let settings = settings.split_whitespace().chain([FIXED_RAYS]);
                Config::of(preset, settings).unwrap_or_else(|error| panic!("{case}: {error}"));
            }
        }
    }
}
