//! Arguments that several subcommands take: which runs, on which device.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use infonerf_experiment::{DeviceName, OpenDevice, Selection, parse_seeds};
use infonerf_metrics::Networks;
use infonerf_train::Preset;

/// Which runs of an experiment, and what they change.
#[derive(Clone, Debug, Args)]
pub(crate) struct SelectionArgs {
    /// Folder that holds the scenes' folders; without it the built-in procedural scenes are used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// A scene to run on, again for more; by default the experiment's, or all in DIR.
    #[arg(long = "scene", value_name = "S")]
    pub(crate) scenes: Vec<String>,
    /// A variant to run, again for more; by default all of the experiment.
    #[arg(long = "variant", value_name = "V")]
    pub(crate) variants: Vec<String>,
    /// A seed, or several such as 0..4 (0 to 4): decides the training views and all random numbers. Again for more.
    #[arg(long = "seed", value_name = "N", value_parser = parse_seeds)]
    pub(crate) seeds: Vec<RangeInclusive<u64>>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) networks: NetworkArgs,
    /// What the config starts from.
    #[arg(long, value_enum)]
    pub(crate) preset: Option<PresetName>,
    /// Change any key of the config, such as loss.entropy.weight=0.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
}

impl SelectionArgs {
    /// The same with a time budget for each run.
    pub(crate) fn selection(&self, budget: Option<Duration>) -> Selection {
        Selection {
            data: self.data.clone(),
            scenes: self.scenes.clone(),
            variants: self.variants.clone(),
            seeds: self.seeds.iter().cloned().flatten().collect(),
            preset: self.preset.map(PresetName::preset),
            set: self.set.clone(),
            budget: budget.map(|budget| budget.as_secs_f64()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PresetName {
    /// Small and quick.
    Fast,
    /// The same for photographs.
    Capture,
    /// The text of the paper.
    Paper,
    /// The authors' code.
    Released,
}

impl PresetName {
    fn preset(self) -> Preset {
        match self {
            Self::Fast => Preset::Fast,
            Self::Capture => Preset::Capture,
            Self::Paper => Preset::Paper,
            Self::Released => Preset::Released,
        }
    }
}

/// Networks of learned metrics.
#[derive(Clone, Debug, Args)]
pub(crate) struct NetworkArgs {
    /// A file or folder of weights of learned metrics, beside the places where `infonerf weights` looks for them.
    #[arg(long, value_name = "PATH")]
    pub(crate) weights: Option<PathBuf>,
}

impl NetworkArgs {
    /// The networks whose weights are at hand.
    pub(crate) fn open(&self, device: &OpenDevice) -> anyhow::Result<Networks> {
        infonerf_experiment::networks(self.weights.as_deref(), device)
    }
}

/// Where to compute.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct DeviceArgs {
    /// Where to compute: auto (the fastest one that is built in), flex, ndarray, wgpu, vulkan or cuda.
    #[arg(long, value_name = "DEVICE", default_value_t = DeviceName::Auto)]
    pub(crate) device: DeviceName,
}
