use crate::Selection;

/// The grids of the paper's two weights: λ₁ about its 1e-3, λ₂ about the released code's 2e-5, and each without.
pub const PAPER_SPACE: [&str; 2] = ["loss.entropy.weight=0,1e-4,1e-3,1e-2", "loss.kl.weight=0,2e-6,2e-5,2e-4"];

/// The settings that a sweep varies.
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
    /// At each rung of successive halving, one of this many settings continues.
    pub halving: Option<u32>,
    /// Which runs of the experiment.
    pub selection: Selection,
}
