use burn::module::Module;
use burn::nn::Linear;
use burn::nn::conv::{ConvTranspose3d, ConvTranspose3dConfig};
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{LEAKY_GAIN, LEAKY_SLOPE};
use crate::init::{glorot_linear, parameter, uniform};

/// Kernel of the transposed convolutions, whose stride is 2 and whose padding is 1: each doubles the resolution.
const KERNEL: usize = 4;
const CHANNELS: usize = 4;

/// Code → dense layer to one voxel → transposed convolutions that double the resolution, with leaky ReLUs between.
#[derive(Module, Debug)]
pub(super) struct Template {
    dense: Linear,
    layers: Vec<ConvTranspose3d>,
}

/// Returns the channels of the dense layer and of each transposed convolution but the last: 2w, then w, w, w/2, w/2, w/4 …
pub(super) fn channels(resolution: usize, width: usize) -> Vec<usize> {
    let layers = resolution.ilog2() as usize;
    std::iter::once(2 * width).chain((0..layers - 1).map(|layer| width >> (layer / 2))).collect()
}

impl Template {
    /// Builds a template of `resolution`³ voxels, a power of two, for codes of `latent` elements.
    pub(super) fn new(latent: usize, resolution: usize, width: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let channels = channels(resolution, width);
        let dense = glorot_linear(rng, latent, channels[0], LEAKY_GAIN, device);
        let layer = |index: usize| match channels.get(index + 1) {
            Some(&outputs) => transposed_convolution(rng, [channels[index], outputs], LEAKY_GAIN, device),
            None => transposed_convolution(rng, [channels[index], CHANNELS], 1.0, device),
        };
        Self { dense, layers: (0..channels.len()).map(layer).collect() }
    }

    /// Decodes a code `[1, latent]` to voxels before activation: `[resolution³, 4]`, x fastest and z slowest.
    pub(super) fn voxels(&self, code: Tensor<2>) -> Tensor<2> {
        let dense = self.dense.forward(code);
        let [_, width] = dense.dims();
        let one = dense.reshape([1, width, 1, 1, 1]);
        let x = self.layers.iter().fold(one, |x, layer| layer.forward(leaky_relu(x, LEAKY_SLOPE)));
        let [_, channels, depth, height, width] = x.dims();
        x.reshape([channels, depth * height * width]).swap_dims(0, 1)
    }
}

/// Builds a transposed convolution that doubles the resolution. Before training each voxel becomes 2³ equal ones, overlapping with
/// its neighbours': weights are uniform in ±gain·√(6/(8 (inputs + outputs))), the same within each 2³ block of the kernel.
fn transposed_convolution(rng: &mut impl Rng, channels: [usize; 2], gain: f32, device: &Device) -> ConvTranspose3d {
    let mut layer =
        ConvTranspose3dConfig::new(channels, [KERNEL; 3]).with_stride([2; 3]).with_padding([1; 3]).init(device);
    let [inputs, outputs] = channels;
    let blocks = uniform(rng, inputs * outputs * 8, gain * (6.0 / (8 * (inputs + outputs)) as f32).sqrt());
    let of_kernel = |block: &[f32; 8]| {
        std::array::from_fn::<_, { KERNEL.pow(3) }, _>(|i| block[i / 32 * 4 + i / 8 % 2 * 2 + i / 2 % 2])
    };
    let weight: Vec<f32> = blocks.as_chunks().0.iter().flat_map(of_kernel).collect();
    layer.weight = parameter(weight, [inputs, outputs, KERNEL, KERNEL, KERNEL], device);
    layer.bias = Some(parameter(vec![0.0; outputs], [outputs], device));
    layer
}
