use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use indexmap::IndexSet;
use infonerf_experiment::{Description, Experiment, RunPlan, Selection, config_origins, describe};
use infonerf_train::Preset;

use crate::completion;
use crate::print::outln;
use crate::units::expected_time;

/// List the built-in experiments, or describe one: variants, scenes, data, runs, and its file
#[derive(Debug, Args)]
pub(crate) struct ListArgs {
    /// Experiment to describe: a built-in one or a TOML file
    #[arg(add = completion::experiments())]
    name: Option<String>,
}

/// Print the config of a variant, with what set each key
#[derive(Debug, Args)]
pub(crate) struct ConfigArgs {
    /// Built-in experiment (see `infonerf list`) or TOML file
    #[arg(add = completion::experiments())]
    experiment: String,
    /// Variant [default: the experiment's first]
    #[arg(long, value_name = "V", add = completion::variants())]
    variant: Option<String>,
    /// Preset that the config starts from
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    /// Set a key of the config, such as loss.entropy.weight=0; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", add = completion::keys())]
    set: Vec<String>,
}

pub(crate) fn run(args: &ListArgs) -> Result<ExitCode> {
    match &args.name {
        Some(name) => print_description(name, &describe(name)?),
        None => {
            for (name, title) in infonerf_experiment::list()? {
                outln!("{name:24} {title}");
            }
            outln!("\n`infonerf list NAME` describes one, `infonerf config NAME` prints its settings.");
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn print_description(name: &str, described: &Description) {
    let Description { experiment: Experiment { about, runs }, bases, text } = described;
    let distinct = |key: fn(&RunPlan) -> String| {
        let values: IndexSet<String> = runs.iter().map(key).filter(|value| !value.is_empty()).collect();
        Vec::from_iter(values).join(", ")
    };
    let data = about.data.as_ref().map(|data| data.display().to_string());
    let data = data.unwrap_or_else(|| "built-in procedural scenes; --data DIR takes others".into());
    outln!("{name}: {}", about.title);
    for (what, values) in [
        ("base", bases.join(", ")),
        ("variants", distinct(|plan| plan.variant.clone())),
        ("scenes", distinct(|plan| plan.scene.clone())),
        ("data", data),
        ("seeds", distinct(|plan| plan.seed.to_string())),
        ("presets", distinct(|plan| plan.preset.name().to_owned())),
        ("training", distinct(RunPlan::training)),
        ("runs", runs.len().to_string()),
        ("time", about.seconds_per_run.map_or_else(String::new, |seconds| expected_time(seconds, runs.len()))),
    ] {
        if !values.is_empty() {
            outln!("{what:9} {values}");
        }
    }
    outln!("\n{}", text.trim_end());
}

pub(crate) fn config(args: &ConfigArgs) -> Result<ExitCode> {
    let variants = args.variant.iter().cloned().collect();
    let selection = Selection { variants, preset: args.preset, set: args.set.clone(), ..Selection::default() };
    let keys = config_origins(&args.experiment, &selection)?;
    outln!("# Optional keys that have their default are left out.\n[config]");
    for key in keys {
        let line = format!("{} = {}", key.key, key.value);
        match key.origin.as_str() {
            "" => outln!("{line}"),
            origin => outln!("{line:56} # {origin}"),
        }
    }
    Ok(ExitCode::SUCCESS)
}
