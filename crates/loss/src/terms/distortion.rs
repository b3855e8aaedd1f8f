use burn::tensor::Tensor;
use infonerf_ops::{Intervals, ray_distortion};
use infonerf_render::{Samples, Warp};
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, RaySet, Renders};
use crate::term::{Term, TermSetup, TermSpec};

/// Distortion of the weights along a ray (mip-NeRF 360, Barron et al. 2022, Eq. 15), mean over the rays in `rays`.
/// Distances are shares of the scene's [near, far], so that the weight does not depend on the scene's unit.
///
/// It concentrates the weights of each ray: against floaters, and against fog in front of surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistortionConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
    /// The rays over which the term is averaged.
    pub rays: RaySet,
}

impl TermSpec for DistortionConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        (!scene.space.bounded).then_some("left out: the scene has no end, so that shares of its depth mean nothing")
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
    /// Map whose coordinate intervals are measured in.
    warp: Warp,
}

impl Distortion {
    /// Returns intervals as shares of [near, far], at most 1 long.
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
        renders.mean(renders.outputs(self.rays).map(|output| {
            let segments = output.segments();
            (ray_distortion(output.tau.clone(), self.intervals(&output.samples), segments).sum(), segments.rays())
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SEEN, UNSEEN, check, mean};

    #[test]
    fn distortion_of_shares_of_the_scenes_depth() {
        let (near, far) = (0.25, 4.25);
        let formula = |ray: &[f64]| {
            let middle: Vec<f64> = (0..ray.len()).map(|i| (i as f64 + 0.5 - 0.25) / 4.0).collect();
            infonerf_oracle::distortion(ray, &middle, &vec![0.25; ray.len()])
        };
        let term = |rays| Distortion { rays, near, far, warp: Warp::Identity };
        check(&term(RaySet::All), |_| (), |d| mean(d[SEEN].iter().chain(&d[UNSEEN]), formula));
        check(&term(RaySet::Seen), |_| (), |d| mean(d[SEEN].iter(), formula));
        check(&term(RaySet::Unseen), |_| (), |d| mean(d[UNSEEN].iter(), formula));
    }

    /// Intervals longer than the scene count as long as the scene.
    #[test]
    fn intervals_are_at_most_as_long_as_the_scene() {
        let term = Distortion { rays: RaySet::Seen, near: 0.0, far: 0.5, warp: Warp::Identity };
        let formula = |ray: &[f64]| {
            let middle: Vec<f64> = (0..ray.len()).map(|i| 2.0 * (i as f64 + 0.5)).collect();
            infonerf_oracle::distortion(ray, &middle, &vec![1.0; ray.len()])
        };
        check(&term, |_| (), |d| mean(d[SEEN].iter(), formula));
    }
}
