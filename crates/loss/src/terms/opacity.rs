use burn::tensor::Tensor;
use infonerf_scene::{Backdrop, Scene};
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// A penalty on opacity Σ w: mean over the rays in `rays`.
///
/// It removes white fog in front of a white background, which costs nothing in colour but hides the scene from other views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpacityConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// The rays over which it is averaged.
    pub rays: RaySet,
}

impl TermSpec for OpacityConfig {
    fn needs(&self) -> Vec<Need> {
        Need::of(self.rays)
    }

    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        (scene.backdrop == Backdrop::Unknown).then_some("left out: nothing is known of what is behind the scene")
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for OpacityConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        renders.mean(renders.outputs(self.rays), |output| output.acc.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// It needs unseen rays whichever other terms are on.
    #[test]
    fn the_mean_is_over_all_rays() {
        let config = OpacityConfig { weight: 1.0.into(), rays: RaySet::All };
        assert_eq!(config.needs(), [Need::Unseen]);
        let mut renders = testing::renders(&[&[f32::INFINITY]]);
        renders.unseen = Some(testing::renders(&[&[0.0], &[0.0], &[0.0]]).seen);
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), 0.25, epsilon = 1e-6);
    }
}
