//! Losses of few-shot radiance fields: pure functions of what a render returns.
//!
//! L = L_RGB + λ₁ L_entropy + λ₂ L_KL (InfoNeRF, Eq. 10).

mod entropy;
mod gain;
mod photometric;
mod semantic;

pub use entropy::{EntropyConfig, HitMask, HitRule, entropy_loss};
pub use gain::{Direction, GainConfig, gain_loss};
pub use photometric::{Norm, photometric_loss};
pub use semantic::{SemanticConfig, semantic_loss};

use serde::{Deserialize, Serialize};

/// Which rays a regulariser is taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RaySet {
    /// Rays of training images.
    Seen,
    /// Rays of sampled poses.
    Unseen,
    /// Both.
    All,
}

impl RaySet {
    /// Whether rays of training images count.
    pub fn seen(self) -> bool {
        self != Self::Unseen
    }

    /// Whether rays of sampled poses count.
    pub fn unseen(self) -> bool {
        self != Self::Seen
    }
}
