//! Arguments that several subcommands take: which runs, on which device.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use infonerf_experiment::{DeviceName, Existing, OpenDevice, Selection, parse_seeds};
use infonerf_metrics::Networks;
use infonerf_train::Preset;

use crate::completion;

/// Runs of an experiment, and what they change.
#[derive(Clone, Debug, Args)]
pub(crate) struct SelectionArgs {
    /// Folder with one subfolder per scene [default: the built-in procedural scenes]
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// Scene to run on; may be repeated [default: the experiment's, or all of --data]
    #[arg(long = "scene", value_name = "S", add = completion::scenes())]
    pub(crate) scenes: Vec<String>,
    /// Variant to run; may be repeated [default: all of the experiment]
    #[arg(long = "variant", value_name = "V", add = completion::variants())]
    pub(crate) variants: Vec<String>,
    /// Seed of the training views and of all random numbers, or a range such as 0..4 (0 to 4); may be repeated
    #[arg(long = "seed", value_name = "N", value_parser = parse_seeds)]
    pub(crate) seeds: Vec<RangeInclusive<u64>>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) networks: NetworkArgs,
    /// Preset that the config starts from [default: the experiment's, or capture for photographs and fast otherwise]
    #[arg(long, value_enum)]
    pub(crate) preset: Option<Preset>,
    /// Set a key of the config, such as loss.entropy.weight=0 (λ1 of the paper; λ2 is loss.kl.weight); may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", add = completion::keys())]
    pub(crate) set: Vec<String>,
}

impl SelectionArgs {
    /// Returns the selection with a time budget for each run.
    pub(crate) fn selection(&self, budget: Option<Duration>) -> Selection {
        Selection {
            data: self.data.clone(),
            scenes: self.scenes.clone(),
            variants: self.variants.clone(),
            seeds: self.seeds.iter().cloned().flatten().collect(),
            preset: self.preset,
            set: self.set.clone(),
            budget: budget.map(|budget| budget.as_secs_f64()),
        }
    }
}

/// Policy for runs that exist already.
#[derive(Clone, Debug, Args)]
pub(crate) struct ExistingArgs {
    /// Start existing runs anew instead of continuing them
    #[arg(long)]
    overwrite: bool,
}

impl ExistingArgs {
    pub(crate) fn existing(&self) -> Existing {
        if self.overwrite { Existing::Overwrite } else { Existing::Continue }
    }

    /// Names the command that continues a run: without `--overwrite`, which would start it anew.
    pub(crate) fn same_command(&self) -> &'static str {
        if self.overwrite { "the same command without --overwrite" } else { "the same command" }
    }
}

/// Networks of learned metrics.
#[derive(Clone, Debug, Args)]
pub(crate) struct NetworkArgs {
    /// File or folder with weights of learned metrics, in addition to the folders that `infonerf weights` lists
    #[arg(long, value_name = "PATH")]
    pub(crate) weights: Option<PathBuf>,
}

impl NetworkArgs {
    pub(crate) fn open(&self, device: &OpenDevice) -> anyhow::Result<Networks> {
        infonerf_experiment::networks(self.weights.as_deref(), device)
    }
}

/// Where to compute.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct DeviceArgs {
    #[arg(long, value_enum, value_name = "DEVICE", default_value_t, hide_possible_values = true, help = device_help())]
    pub(crate) device: DeviceName,
}

fn device_help() -> String {
    let names: Vec<&str> = DeviceName::BUILT_IN.iter().map(|device| device.name()).collect();
    format!("Where to compute: {}; auto is the fastest of them", names.join(", "))
}
