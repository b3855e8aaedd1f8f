use burn::tensor::Tensor;
use infonerf_ops::ray_divergence;
use infonerf_render::RenderOutput;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Bundle, Need, RaySet, Renders, Term, TermSetup, TermSpec};

/// Information gain reduction (InfoNeRF, Sec. 4.3): the divergence of each ray's distribution from its neighbour's, in
/// nats, mean over all pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KlConfig {
    /// λ₂ (paper: halved each 5000 steps).
    pub weight: Schedule,
    /// The order of the two distributions.
    pub direction: Direction,
    /// The rays that get a neighbour.
    pub rays: RaySet,
    /// ε inside the logarithms (released code: 1e-10): bounds the divergence of disjoint rays.
    pub epsilon: f32,
}

/// The order of the two distributions in the divergence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// KL(P(r) ‖ P(r̃)), as in the paper (Eq. 9).
    Paper,
    /// KL(P(r̃) ‖ P(r)), as in the released code.
    Reversed,
}

impl KlConfig {
    /// The divergence of each ray from its neighbour in nats, `[R]`, of the optical depths of paired samples (InfoNeRF, Eq. 9).
    pub fn divergence(&self, output: &RenderOutput, near: &RenderOutput) -> Tensor<1> {
        let segments = output.segments();
        if segments.samples() == 0 {
            return output.acc.zeros_like();
        }
        let (tau, near) = (output.tau.clone(), near.tau.clone());
        let (p, q) = match self.direction {
            Direction::Paper => (tau, near),
            Direction::Reversed => (near, tau),
        };
        ray_divergence(p, q, segments, self.epsilon)
    }
}

impl TermSpec for KlConfig {
    fn needs(&self) -> Vec<Need> {
        Need::neighbours_of(self.rays)
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(1e-12..=0.01, "epsilon", self.epsilon.into())
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for KlConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let divergence =
            |(bundle, near): (&Bundle, &RenderOutput)| (self.divergence(bundle.output(), near).sum(), bundle.rays());
        renders.mean_of_sums(renders.pairs(self.rays).map(divergence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn the_directions_differ_and_equal_rays_gain_nothing() {
        let mut renders = testing::renders(&[&[3.0, 0.1], &[1.0, 1.0]]);
        renders.neighbours.seen = Some(testing::renders(&[&[0.5, 0.5], &[1.0, 1.0]]).seen.passes.fine);
        let value = |direction| {
            let config = KlConfig { weight: 1.0.into(), direction, rays: RaySet::Seen, epsilon: 1e-10 };
            config.value(&renders).into_scalar::<f32>()
        };
        // p = α/Σα of the first ray; its neighbour's is ½, ½. The second pair has divergence 0.
        let alpha = [3.0f32, 0.1].map(|tau| -(-tau).exp_m1());
        let p = alpha.map(|a| a / (alpha[0] + alpha[1]));
        let paper: f32 = p.iter().map(|p| p * (2.0 * p).ln()).sum();
        let reversed: f32 = p.iter().map(|p| 0.5 * (0.5 / p).ln()).sum();
        approx::assert_abs_diff_eq!(value(Direction::Paper), paper / 2.0, epsilon = 1e-6);
        approx::assert_abs_diff_eq!(value(Direction::Reversed), reversed / 2.0, epsilon = 1e-6);
    }
}
