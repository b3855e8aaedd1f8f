use burn::tensor::Tensor;
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// A penalty on density near the cameras (FreeNeRF, Yang et al. 2023, Eq. 8): optical depth of the first `share` of
/// each ray, mean over the rays in `rays`.
///
/// With few views, matter right in front of a camera can explain its picture, and no other camera sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OcclusionConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// The penalised share of the ray from its near end: of the distances between near and far or, in an unbounded scene,
    /// of the disparities.
    pub share: f32,
    /// The rays over which it is averaged.
    pub rays: RaySet,
}

impl OcclusionConfig {
    /// The distance up to which density is penalised.
    fn reach(&self, scene: &Scene) -> f32 {
        let (near, far) = (scene.space.near, scene.space.far);
        if scene.space.bounded {
            near + self.share * (far - near)
        } else {
            let near = near.max(1e-6 * far);
            1.0 / (1.0 / near - self.share * (1.0 / near - 1.0 / far))
        }
    }
}

impl TermSpec for OcclusionConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=1.0, "share", self.share.into())
    }

    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(Occlusion { rays: self.rays, reach: self.reach(setup.scene) }))
    }
}

#[derive(Debug)]
struct Occlusion {
    rays: RaySet,
    /// Distance along the ray, scene units.
    reach: f32,
}

impl Term for Occlusion {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let (mut sum, mut rays) = (renders.zero(), 0);
        for output in renders.bundles(self.rays).map(|bundle| bundle.output()) {
            rays += output.segments().rays();
            if output.segments().samples() > 0 {
                let is_near = output.samples.distance.clone().lower_elem(self.reach).float();
                sum = sum + (output.tau.clone() * is_near).sum();
            }
        }
        sum / rays.max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use infonerf_scene::Space;

    use super::*;
    use crate::testing;

    /// Samples of the test's rays are at 0.5, 1.5, …
    #[test]
    fn only_what_is_near_counts() {
        let term = Occlusion { rays: RaySet::Seen, reach: 2.0 };
        let value = term.value(&testing::renders(&[&[1.0, 2.0, 40.0], &[0.0], &[3.0, 0.0, 5.0]]));
        approx::assert_abs_diff_eq!(value.into_scalar::<f32>(), 2.0, epsilon = 1e-6);
    }

    #[test]
    fn the_reach_is_a_share_of_distance_or_disparity() {
        let config = OcclusionConfig { weight: 1.0.into(), share: 0.25, rays: RaySet::Seen };
        let scene = Scene::default();
        approx::assert_relative_eq!(config.reach(&scene), 3.0);
        // Disparities from 1 to 0.2, of which 0.8 is a quarter of the way.
        let scene =
            Scene { space: Space { near: 1.0, far: 5.0, bounded: false, ..Space::default() }, ..Scene::default() };
        approx::assert_relative_eq!(config.reach(&scene), 1.25);
        assert!(OcclusionConfig { share: 1.5, ..config }.validate().is_err());
    }
}
