//! NeRF's network with matrix products in bfloat16.

use burn::tensor::Device;
use fastrand::Rng;
use infonerf_ops::mlp::{Activation, Precision, RadianceMlp, radiance_mlp};
use infonerf_ops::{to_host, upload_rows};

use super::errors::Errors;
use crate::values::{gradient_of, joined, layer, leaves, trunk, uniform, wide};

pub(super) const OPERATION: &str = "network";
pub(super) const CASE: &str = "bf16 products";

/// Width of an encoded position: NeRF's 10 frequencies.
const ENCODED: usize = 63;
const WIDTH: usize = 64;
const LAYERS: usize = 4;

/// Measures a trunk of 4 layers of 64 and its density at `count` encoded positions, with the gradient of Σ uσ with respect to
/// every layer, against single precision. Weights are initial ones (He et al. 2015), and biases 0.
pub(super) fn rounded(count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let mut layers = trunk(rng, [ENCODED, WIDTH], LAYERS, 0);
    layers.push(layer(rng, WIDTH, 1));
    for (outputs, values) in &mut layers {
        let weights = values.len() - *outputs;
        values[weights..].fill(0.0);
    }
    let (encoded, upstream) = (uniform(rng, count * ENCODED, -1.0, 1.0), uniform(rng, count, -1.0, 1.0));
    let run = |precision| {
        let (leaves, mut trunk) = leaves(&layers, device);
        let sigma = trunk.pop().expect("there is a last layer");
        let network = RadianceMlp { trunk, skip: 0, sigma, color: None, precision };
        let encoded = upload_rows(&encoded, ENCODED, &device.clone().autodiff());
        let out = joined(radiance_mlp(encoded, &network, [Activation::None; 2]));
        let grads = (out.clone() * upload_rows(&upstream, 1, &out.device())).sum().backward();
        (to_host(out.detach()), leaves.iter().map(|leaf| gradient_of(leaf, &grads)).collect::<Vec<Vec<f32>>>())
    };
    let ((got, got_gradients), (want, want_gradients)) = (run(Precision::Bf16), run(Precision::F32));
    let mut errors = Errors::default();
    errors.values(&got, &wide(&want));
    for (got, want) in got_gradients.iter().zip(&want_gradients) {
        errors.gradient(got, &wide(want), |_| false);
    }
    errors
}
