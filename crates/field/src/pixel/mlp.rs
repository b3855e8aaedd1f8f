//! The MLP of PixelNeRF: ResNet blocks, with features added before each of the first blocks, after which views are averaged.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor, activation::relu};
use infonerf_ops::frequency::encoded_width;
use rand::Rng;

use super::PixelNerfConfig;
use crate::init::he_linear;

/// Position, direction and features in each view → density and colour of each point (Yu et al., Fig. 2 and Sec. B.1).
#[derive(Module, Debug)]
pub(super) struct ResnetMlp {
    input: Linear,
    /// The layers that read features, of all blocks before the average, side by side: `[P, C]` → `[P, pool_after·width]`.
    pub(super) features: Linear,
    blocks: Vec<MlpBlock>,
    output: Linear,
    #[module(skip)]
    pool_after: usize,
    #[module(skip)]
    width: usize,
}

/// x + W₂ relu(W₁ relu(x)).
#[derive(Module, Debug)]
struct MlpBlock {
    first: Linear,
    second: Linear,
}

impl MlpBlock {
    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let h = self.first.forward(relu(x.clone()));
        x + self.second.forward(relu(h))
    }
}

impl ResnetMlp {
    /// Builds an MLP for features of `channels` channels.
    pub(super) fn new(config: &PixelNerfConfig, channels: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let &PixelNerfConfig { width, blocks, pool_after, frequencies, .. } = config;
        // The second layer of a block begins at 0: a block begins as the identity.
        let mut block = || MlpBlock {
            first: he_linear(rng, width, width, 1.0, device),
            second: he_linear(rng, width, width, 0.0, device),
        };
        let blocks = (0..blocks).map(|_| block()).collect();
        let input = he_linear(rng, encoded_width(3, frequencies) + 3, width, 1.0, device);
        let features = he_linear(rng, channels, pool_after * width, 1.0, device);
        let output = he_linear(rng, width, 4, 1.0, device);
        Self { input, features, blocks, output, pool_after, width }
    }

    /// Returns raw red, green, blue and density, `[M, 4]`.
    ///
    /// - `x`: encoded points in each of `views` views, `[V·M, inputs]`, view by view.
    /// - `injected`: output of `features` at the same points, `[V·M, pool_after·width]`.
    pub(super) fn forward(&self, x: Tensor<2>, injected: Tensor<2>, views: usize) -> Tensor<2> {
        let mut h = self.input.forward(x);
        for (index, block) in self.blocks.iter().enumerate() {
            if index < self.pool_after {
                h = h + injected.clone().narrow(1, index * self.width, self.width);
            }
            h = block.forward(h);
            if index + 1 == self.pool_after && views > 1 {
                let samples = h.dims()[0] / views;
                h = h.reshape([views, samples, self.width]).mean_dim(0).squeeze_dim(0);
            }
        }
        self.output.forward(relu(h))
    }
}
