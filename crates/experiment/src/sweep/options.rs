use crate::Selection;

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
