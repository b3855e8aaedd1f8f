use burn::tensor::{Device, Tensor};
use infonerf_ops::ray_divergence;
use infonerf_render::RenderOutput;
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, RaySet, Renders};
use crate::term::{Term, TermSpec};

/// Information gain reduction (InfoNeRF, Sec. 4.3): the divergence of each ray's distribution from its neighbour's, in nats,
/// mean over all pairs.
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
    /// Computes the divergence of each ray from its neighbour in nats, `[R]`; samples are paired by index (InfoNeRF, Eq. 9).
    pub fn of_rays(&self, output: &RenderOutput, near: &RenderOutput) -> Tensor<1> {
        let (tau, near) = (output.tau.clone(), near.tau.clone());
        let (p, q) = match self.direction {
            Direction::Paper => (tau, near),
            Direction::Reversed => (near, tau),
        };
        ray_divergence(p, q, output.segments(), self.epsilon)
    }
}

impl TermSpec for KlConfig {
    fn needs(&self) -> Vec<Need> {
        Need::neighbours_of(self.rays)
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(1e-12..=0.01, "epsilon", self.epsilon)
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl Term for KlConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        renders.mean(renders.pairs(self.rays).map(|(output, near)| self.of_rays(output, near)))
    }
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::divergence;

    use crate::testing::{Depths, NEAR_SEEN, NEAR_UNSEEN, SEEN, UNSEEN, check, config};

    #[test]
    fn divergence_from_neighbours_in_both_directions() {
        for (rays, pairs) in [
            ("seen", &[(SEEN, NEAR_SEEN)][..]),
            ("unseen", &[(UNSEEN, NEAR_UNSEEN)]),
            ("all", &[(SEEN, NEAR_SEEN), (UNSEEN, NEAR_UNSEEN)]),
        ] {
            for direction in ["paper", "reversed"] {
                let term = config(&format!("kl = {{ rays = '{rays}', direction = '{direction}', epsilon = 1e-3 }}")).kl;
                check(&term, |d: &Depths<f64>| {
                    let pairs: Vec<_> = pairs.iter().flat_map(|&(of, near)| d[of].iter().zip(&d[near])).collect();
                    let gain = |(p, q): &(&Vec<f64>, &Vec<f64>)| match direction {
                        "paper" => divergence(p, q, 1e-3f32.into()),
                        _ => divergence(q, p, 1e-3f32.into()),
                    };
                    pairs.iter().map(gain).sum::<f64>() / pairs.len() as f64
                });
            }
        }
    }
}
