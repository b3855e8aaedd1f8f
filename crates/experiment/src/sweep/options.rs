use std::path::PathBuf;
use std::time::Duration;

use crate::{DeviceName, Selection};

/// What a sweep varies.
#[derive(Clone, Debug, Default)]
pub struct SweepOptions {
    /// `dotted.key=value,value,...`: a key of the config and the values that it takes, each combined with those of the
    /// others.
    pub grids: Vec<String>,
    /// Random settings of the keys of `ranges`.
    pub random: u32,
    /// `dotted.key=[log:|int:]low:high`: a key of the config and where random settings are drawn from.
    pub ranges: Vec<String>,
    /// Other random settings.
    pub random_seed: u64,
    /// Of how many settings one goes on at each rung of successive halving.
    pub halving: Option<u32>,
    /// Which runs of the experiment.
    pub selection: Selection,
}

/// How items are run.
#[derive(Clone, Debug)]
pub struct Workers {
    /// The program of which `PROGRAM sweep-item MANIFEST ITEM` runs an item.
    pub program: PathBuf,
    /// Where to compute.
    pub device: DeviceName,
    /// A file or folder of weights of learned metrics, beside the places where they are looked for.
    pub weights: Option<PathBuf>,
    /// Runs at a time, at most: no more than there are cores, nor than fit into the free memory.
    pub jobs: usize,
    /// Time after which a run is given up.
    pub timeout: Option<Duration>,
    /// Whether no more runs are to be started.
    pub stop: fn() -> bool,
}
