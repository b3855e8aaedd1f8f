//! The quantities that the paper's losses minimise, per ray (InfoNeRF, Sec. 4).

use burn::tensor::Tensor;
use infonerf_render::RenderOutput;

use crate::list::LossConfig;
use crate::terms::entropy::masked_entropy;

impl LossConfig {
    /// The entropy of each ray in bits as `[loss.entropy]` defines it, `[R]` (InfoNeRF, Eq. 5 and 6); 0 for masked rays.
    pub fn ray_entropy(&self, output: &RenderOutput) -> Tensor<1> {
        let entropy = &self.entropy;
        masked_entropy(output, entropy.distribution, entropy.mask, entropy.epsilon)
    }

    /// The divergence of each ray from its neighbour in nats as `[loss.kl]` defines it, `[R]` (InfoNeRF, Eq. 9). Samples of
    /// `near` are paired with those of `output`.
    pub fn information_gain(&self, output: &RenderOutput, near: &RenderOutput) -> Tensor<1> {
        self.kl.divergence(output, near)
    }
}
