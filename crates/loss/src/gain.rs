use burn::tensor::Tensor;
use infonerf_ops::{Segments, information_gain};
use serde::{Deserialize, Serialize};

use crate::RaySet;

/// Information gain reduction between neighbouring rays (InfoNeRF, Sec. 4.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainConfig {
    /// λ₂ at the start; 0 switches the term off, and nothing is computed for it.
    pub weight: f32,
    /// λ₂ is halved each time this many steps have passed (paper: 5000); 0 keeps it.
    pub halve_every: usize,
    /// Which of the two densities comes first.
    pub direction: Direction,
    /// Which rays get a neighbour.
    pub rays: RaySet,
    /// Largest rotation of the neighbour's camera about each axis of the world, degrees (paper: 5).
    pub max_angle_deg: f64,
    /// ε inside the logarithms (released code: 1e-10): bounds the divergence of disjoint rays.
    pub epsilon: f32,
}

/// Which of the two densities comes first in the divergence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// KL(P(r) ‖ P(r̃)), as in the paper (Eq. 9).
    Paper,
    /// KL(P(r̃) ‖ P(r)), as in the released code.
    Reversed,
}

impl GainConfig {
    /// λ₂ at `step`.
    pub fn weight_at(&self, step: usize) -> f32 {
        match step.checked_div(self.halve_every) {
            Some(halvings) => self.weight * 0.5f32.powi(halvings.min(1000) as i32),
            None => self.weight,
        }
    }
}

/// Mean divergence of rays and their neighbours in nats (InfoNeRF, Eq. 9); a scalar.
///
/// `tau` and `near` are optical depths `[M]` of paired samples.
pub fn gain_loss(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, config: &GainConfig) -> Tensor<1> {
    let (p, q) = match config.direction {
        Direction::Paper => (tau, near),
        Direction::Reversed => (near, tau),
    };
    information_gain(p, q, segments, config.epsilon).mean()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lambda_halves() {
        let config = GainConfig {
            weight: 1.0,
            halve_every: 5000,
            direction: Direction::Paper,
            rays: RaySet::Seen,
            max_angle_deg: 5.0,
            epsilon: 1e-10,
        };
        assert_eq!([0, 4999, 5000, 10_000].map(|step| config.weight_at(step)), [1.0, 1.0, 0.5, 0.25]);
        assert_eq!(GainConfig { halve_every: 0, ..config }.weight_at(10_000), 1.0);
    }
}
