//! NeRF's network with matrix products in bfloat16.

use burn::tensor::{Device, Tensor};
use fastrand::Rng;
use infonerf_ops::mlp::{Dense, Precision, RadianceMlp, radiance_mlp};
use infonerf_ops::{from_host, to_host};

use super::errors::Errors;
use crate::values::{gradient_of, wide};

pub(super) const OPERATION: &str = "network";
pub(super) const CASE: &str = "bf16 products";

/// Width of an encoded position: NeRF's 10 frequencies.
const ENCODED: usize = 63;
const WIDTH: usize = 64;
const LAYERS: usize = 4;

/// Measures a trunk of 4 layers of 64 and its density at `count` encoded positions, with the gradient of Σ uσ with respect to
/// every weight, against single precision. Weights are initial ones (He et al. 2015).
pub(super) fn rounded(count: usize, device: &Device, rng: &mut Rng) -> Errors {
    let device = device.clone().autodiff();
    let mut uniform =
        |count: usize, half: f32| -> Vec<f32> { (0..count).map(|_| half * (2.0 * rng.f32() - 1.0)).collect() };
    let inputs = |layer| if layer == 0 { ENCODED } else { WIDTH };
    let sizes: Vec<[usize; 2]> = (0..=LAYERS).map(|l| [inputs(l), if l < LAYERS { WIDTH } else { 1 }]).collect();
    let weights: Vec<Vec<f32>> = sizes.iter().map(|[i, o]| uniform(i * o, (6.0 / *i as f32).sqrt())).collect();
    let (encoded, upstream) = (uniform(count * ENCODED, 1.0), uniform(count, 1.0));
    let matrix = |values: &[f32], columns: usize| from_host(values, columns, &device);
    let run = |precision| {
        let layer = |(values, [_, outputs]): (&Vec<f32>, &[usize; 2])| Dense {
            weight: matrix(values, *outputs).require_grad(),
            bias: Tensor::zeros([*outputs], &device),
        };
        let mut trunk: Vec<Dense> = weights.iter().zip(&sizes).map(layer).collect();
        let parameters: Vec<Tensor<2>> = trunk.iter().map(|dense| dense.weight.clone()).collect();
        let sigma = trunk.pop().expect("there is a last layer");
        let network = RadianceMlp { trunk, skip: 0, sigma, color: None, precision };
        let out = radiance_mlp(matrix(&encoded, ENCODED), &network);
        let grads = (out.clone() * matrix(&upstream, 1)).sum().backward();
        let gradients = parameters.iter().map(|weight| gradient_of(weight, &grads));
        (to_host(out.detach()), gradients.collect::<Vec<Vec<f32>>>())
    };
    let ((got, got_gradients), (want, want_gradients)) = (run(Precision::Bf16), run(Precision::F32));
    let mut errors = Errors::default();
    errors.values(&got, &wide(&want));
    for (got, want) in got_gradients.iter().zip(&want_gradients) {
        errors.gradient(got, &wide(want), |_| false);
    }
    errors
}
