//! The training objective: L = Σ weight · term, over a list of terms.
//!
//! [`LossConfig`] is the list, with each term's formula. A term is one file in `terms/` and one line of that list: a name,
//! which is its table in config files, a scheduled weight, what it [needs](Need) rendered, and a value, usually a mean over
//! rays. The trainer renders the union of the needs of the terms that are on: nothing else lists losses, and no term depends
//! on another.
//!
//! InfoNeRF's objective is L_RGB + λ₁ L_entropy + λ₂ L_KL (Eq. 10): the terms `rgb`, `entropy` and `kl`.

mod objective;
mod renders;
mod term;
mod terms;
#[cfg(test)]
mod testing;

pub use objective::{LossConfig, LossValues, Objective};
pub use renders::{Need, RaySet, Renders, Target, UnseenImage};
pub use term::{Term, TermSpec, Weighted};
pub use terms::entropy::{EntropyConfig, HitMask, HitRule};
pub use terms::kl::{Direction, KlConfig};
pub use terms::opacity_prior::OpacityPriorConfig;
pub use terms::penalties::{LatentConfig, TvConfig};
pub use terms::photometric::{Norm, PhotometricConfig, photometric_loss};
pub use terms::semantic::{SemanticConfig, semantic_loss};
pub use terms::silhouette::SilhouetteConfig;
pub use terms::stereo::StereoConfig;
