//! The list of terms.

use infonerf_schedule::Schedule;
use serde::{Deserialize, Serialize};

use crate::renders::{Need, union};
use crate::term::{TermSpec, Weighted};
use crate::terms::distortion::DistortionConfig;
use crate::terms::entropy::EntropyConfig;
use crate::terms::kl::KlConfig;
use crate::terms::latent::LatentConfig;
use crate::terms::mask::MaskConfig;
use crate::terms::occlusion::OcclusionConfig;
use crate::terms::opacity::OpacityConfig;
use crate::terms::opacity_prior::OpacityPriorConfig;
use crate::terms::photometric::PhotometricConfig;
use crate::terms::semantic::SemanticConfig;
use crate::terms::silhouette::SilhouetteConfig;
use crate::terms::stereo::StereoConfig;
use crate::terms::tv::TvConfig;

/// Defines [`LossConfig`] from a list of terms: the name of each, which is its table in config files, and its config.
macro_rules! terms {
    ($($(#[$doc:meta])* $name:ident: $config:ty,)*) => {
        /// `[loss]` of a config: one table for each term.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct LossConfig {
            $($(#[$doc])* pub $name: $config,)*
        }

        $(impl Weighted for $config {
            fn weight(&self) -> &Schedule {
                &self.weight
            }

            fn weight_mut(&mut self) -> &mut Schedule {
                &mut self.weight
            }
        })*

        impl LossConfig {
            /// Every term by name, in the order of reports.
            pub fn specs(&self) -> impl Iterator<Item = (&'static str, &dyn TermSpec)> {
                [$((stringify!($name), &self.$name as &dyn TermSpec),)*].into_iter()
            }

            /// The same, mutable.
            pub fn specs_mut(&mut self) -> impl Iterator<Item = (&'static str, &mut dyn TermSpec)> {
                [$((stringify!($name), &mut self.$name as &mut dyn TermSpec),)*].into_iter()
            }
        }
    };
}

terms! {
    /// L_RGB (InfoNeRF, Eq. 3).
    rgb: PhotometricConfig,
    /// λ₁ L_entropy (InfoNeRF, Eq. 8).
    entropy: EntropyConfig,
    /// λ₂ L_KL (InfoNeRF, Eq. 9).
    kl: KlConfig,
    /// DietNeRF's semantic consistency.
    semantic: SemanticConfig,
    /// Distortion of the weights along rays (mip-NeRF 360).
    distortion: DistortionConfig,
    /// Penalty on density just before the cameras.
    occlusion: OcclusionConfig,
    /// Depth of the training images from stereo.
    stereo: StereoConfig,
    /// Penalty on opacity.
    opacity: OpacityConfig,
    /// Neural Volumes' prior that opacities are 0 or 1.
    opacity_prior: OpacityPriorConfig,
    /// Supervision of opacity by a known background colour.
    silhouette: SilhouetteConfig,
    /// Supervision of opacity by the alpha channel.
    mask: MaskConfig,
    /// Total variation of a field's tables.
    tv: TvConfig,
    /// Divergence of a field's latent code (Neural Volumes).
    latent: LatentConfig,
}

impl LossConfig {
    /// The terms whose weight is above 0 at some time of the run.
    pub fn active(&self) -> impl Iterator<Item = (&'static str, &dyn TermSpec)> {
        self.specs().filter(|(_, spec)| !spec.weight().is_zero())
    }

    /// The union of what the [active](Self::active) terms need rendered.
    pub fn needs(&self) -> Vec<Need> {
        union(self.active().flat_map(|(_, spec)| spec.needs()))
    }
}
