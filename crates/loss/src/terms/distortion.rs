use burn::tensor::Tensor;
use infonerf_ops::{Intervals, ray_distortion};
use infonerf_render::{Samples, Warp};
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// Distortion of the weights along a ray (mip-NeRF 360, Barron et al. 2022, Eq. 15), mean over the rays in `rays`.
/// Distances are shares of the scene's [near, far], so that the weight does not depend on the scene's unit.
///
/// It concentrates the weights of each ray: against floaters, and against fog in front of surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistortionConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// The rays over which it is averaged.
    pub rays: RaySet,
}

impl TermSpec for DistortionConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        (!scene.space.bounded).then_some("left out: the scene has no end, so that shares of its depth say nothing")
    }

    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        let (near, far) = (setup.scene.space.near, setup.scene.space.far);
        Ok(Box::new(Distortion { rays: self.rays, near, far, warp: setup.warp.clone() }))
    }
}

#[derive(Debug)]
struct Distortion {
    rays: RaySet,
    near: f32,
    far: f32,
    /// Intervals are measured in its coordinate.
    warp: Warp,
}

impl Distortion {
    /// Intervals as shares of [near, far], at most 1.
    fn intervals(&self, samples: &Samples) -> Intervals {
        let range = self.far - self.near;
        Intervals {
            middle: (samples.distance.clone() - self.near) / range,
            length: (self.warp.lengths(&samples.distance, samples.delta.clone()) / range).clamp_max(1.0),
        }
    }
}

impl Term for Distortion {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        renders.mean(renders.outputs(self.rays), |output| {
            ray_distortion(output.tau.clone(), self.intervals(&output.samples), output.segments())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// One opaque sample is one interval's width; two that share a ray are further apart; an empty ray counts as 0.
    #[test]
    fn spread_costs_more_than_a_surface() {
        let term = Distortion { rays: RaySet::Seen, near: 0.0, far: 2.0, warp: Warp::Identity };
        let value = |tau: &[&[f32]]| term.value(&testing::renders(tau)).into_scalar::<f32>();
        approx::assert_abs_diff_eq!(value(&[&[f32::INFINITY]]), 0.5 / 3.0, epsilon = 1e-6);
        approx::assert_abs_diff_eq!(value(&[&[f32::INFINITY], &[0.0]]), 0.25 / 3.0, epsilon = 1e-6);
        let half = std::f32::consts::LN_2;
        let spread = 2.0 * 0.5 * 0.5 * 0.5 + (0.25 + 0.25) * 0.5 / 3.0;
        approx::assert_abs_diff_eq!(value(&[&[half, f32::INFINITY]]), spread, epsilon = 1e-6);
    }
}
