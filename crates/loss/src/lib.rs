//! The training objective: L = Σ weight · term, over a list of terms.
//!
//! A term is one file in `terms/` and one line in the list of [`LossConfig`]. It has a name, which is its table in config
//! files, a scheduled weight, what it [needs](Need) rendered, and a value, usually a mean over rays. The trainer renders the
//! union of the needs of the terms that are on: nothing else lists losses, and no term depends on another.
//!
//! InfoNeRF's objective is L_RGB + λ₁ L_entropy + λ₂ L_KL (Eq. 10): the terms `rgb`, `entropy` and `kl`.
//!
//! ```
//! use infonerf_loss::{EntropyConfig, HitMask, HitRule, Need, RaySet, TermSpec};
//! use infonerf_ops::RayDistribution;
//!
//! // λ₁ = 1e-3, on the rays of training images and on unseen rays.
//! let entropy = EntropyConfig {
//!     weight: 1e-3.into(),
//!     rays: RaySet::All,
//!     neighbours: false,
//!     distribution: RayDistribution::Alpha,
//!     mask: HitMask { rule: HitRule::Acc, threshold: 0.1 },
//!     epsilon: 1e-10,
//! };
//! // Unseen rays are rendered for it, without colour.
//! assert_eq!(entropy.needs(), [Need::Unseen]);
//! ```

mod information;
mod list;
mod objective;
mod renders;
mod term;
mod terms;

pub use list::LossConfig;
pub use objective::{DueTerm, LossValues, Objective, needs};
pub use renders::{Bundle, Need, NeighbourBundles, Picture, RaySet, Renders, Target, is_foreground, pixel_class};
pub use term::{Term, TermSetup, TermSpec, Weighted};
pub use terms::distortion::DistortionConfig;
pub use terms::entropy::{EntropyConfig, HitMask, HitRule};
pub use terms::kl::{Direction, KlConfig};
pub use terms::latent::LatentConfig;
pub use terms::mask::MaskConfig;
pub use terms::occlusion::OcclusionConfig;
pub use terms::opacity::OpacityConfig;
pub use terms::opacity_prior::OpacityPriorConfig;
pub use terms::photometric::{Norm, PhotometricConfig, photometric_loss};
pub use terms::semantic::{SemanticConfig, semantic_loss};
pub use terms::silhouette::SilhouetteConfig;
pub use terms::stereo::StereoConfig;
pub use terms::tv::TvConfig;

#[cfg(test)]
pub(crate) mod testing {
    //! Renders for the tests of terms.

    use std::collections::BTreeMap;

    use burn::tensor::{Device, Tensor, TensorData};
    use infonerf_ops::{Segments, composite};
    use infonerf_render::{Passes, RenderOutput, Samples};

    use crate::{Bundle, NeighbourBundles, Renders, Target};

    /// Black seen rays with samples of length 1 and optical depths `tau`.
    pub fn renders(tau: &[&[f32]]) -> Renders {
        let device = Device::flex();
        let segments = Segments::from_counts(tau.iter().map(|ray| ray.len()));
        let (rays, count) = (segments.rays(), segments.samples());
        let t: Vec<f32> = tau.iter().flat_map(|ray| (0..ray.len()).map(|i| i as f32 + 0.5)).collect();
        let tau = Tensor::<1>::from_data(TensorData::new(tau.concat(), [count]), &device);
        let values = Tensor::<2>::zeros([count, 3], &device);
        let composite = composite(tau.clone(), values, &segments);
        let output = RenderOutput {
            samples: Samples::new(
                segments,
                Tensor::from_floats(t.as_slice(), &device),
                Tensor::ones([count], &device),
                count,
            ),
            tau,
            color: Some(composite.values),
            depth: Tensor::zeros([rays], &device),
            acc: composite.acc,
            background: [0.0; 3],
        };
        let target = Target {
            rgb: Tensor::zeros([rays, 3], &device),
            rgba: vec![[0.0, 0.0, 0.0, 1.0]; rays],
            coverage: vec![1.0; rays],
            classes: None,
            pixels: vec![infonerf_scene::PixelAt { view: 0, x: 0.5, y: 0.5 }; rays],
            background: [1.0; 3],
        };
        let seen = Bundle { passes: Passes { coarse: None, fine: output }, target: Some(target) };
        Renders {
            squared_error: seen.squared_error(),
            seen,
            unseen: None,
            neighbours: NeighbourBundles::default(),
            picture: None,
            penalties: BTreeMap::new(),
        }
    }
}
