use std::path::PathBuf;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Semantic consistency (DietNeRF, Jain et al. 2021, Eq. 5): a view from anywhere shows the same thing as a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SemanticConfig {
    /// λ; 0 switches the term off, and nothing is read or computed for it (DietNeRF: 0.1).
    pub weight: f32,
    /// Steps from one such render to the next (DietNeRF: 10 to 16).
    pub every: usize,
    /// Longest side of the render in pixels (DietNeRF: 168).
    pub size: u32,
    /// Safetensors file with the weights of `openai/clip-vit-base-patch32`.
    pub weights: PathBuf,
}

impl SemanticConfig {
    /// λ at `step`.
    pub fn weight_at(&self, step: usize) -> f32 {
        if step.is_multiple_of(self.every.max(1)) { self.weight } else { 0.0 }
    }
}

/// 1 − φᵀφ̂ of two unit-length embeddings, a scalar in [0, 2].
pub fn semantic_loss(embedding: Tensor<1>, target: Tensor<1>) -> Tensor<1> {
    (embedding * target).sum().neg() + 1.0
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn the_loss_is_a_distance_on_the_sphere() {
        let vector = |x: f32, y: f32| Tensor::<1>::from_floats([x, y], &Device::flex());
        let loss = |a, b| semantic_loss(a, b).into_scalar::<f32>();
        assert_eq!(loss(vector(0.6, 0.8), vector(0.6, 0.8)), 0.0);
        assert_eq!(loss(vector(1.0, 0.0), vector(0.0, 1.0)), 1.0);
        assert_eq!(loss(vector(0.0, -1.0), vector(0.0, 1.0)), 2.0);
    }
}
