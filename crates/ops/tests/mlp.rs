//! NeRF's network: host kernel against plain tensors on two backends.

use crate::common::{Draws, assert_close, joined, vector};
use burn::tensor::{Device, Tensor};
use infonerf_ops::mlp::{self, Activation, ColorBranch, Dense, Precision, RadianceMlp, radiance_mlp};
use infonerf_ops::{Segments, to_host, upload_rows};

/// Width of encoded positions.
const ENCODED: usize = 7;
/// Width of hidden layers.
const WIDTH: usize = 10;

struct MlpCase {
    skip: usize,
    segments: Segments,
    frequencies: usize,
    color: bool,
    x: Vec<f32>,
    directions: Vec<f32>,
    /// Every `reached`-th sample has a gradient.
    reached: usize,
    /// Whether gradients of the result are −1, 0 or 1.
    whole: bool,
    /// Shape `[inputs, outputs]`, weights and biases of every layer: trunk, σ, features, view, rgb.
    layers: Vec<([usize; 2], Vec<f32>, Vec<f32>)>,
}

fn case(seed: u64, counts: &[usize], skip: usize, color: bool) -> MlpCase {
    let (layers, frequencies) = (4, 2);
    let mut draws = Draws(seed);
    let segments = Segments::from_counts(counts.iter().copied());
    let direction = 3 + 6 * frequencies;
    let trunk = (0..layers).map(|layer| match layer {
        0 => [ENCODED, WIDTH],
        layer if layer == skip => [ENCODED + WIDTH, WIDTH],
        _ => [WIDTH, WIDTH],
    });
    let heads = [[WIDTH, 1], [WIDTH, WIDTH], [WIDTH + direction, WIDTH / 2], [WIDTH / 2, 3]];
    let mut numbers = |count: usize| draws.row(count);
    let layers = trunk.chain(heads).map(|size| (size, numbers(size[0] * size[1]), numbers(size[1]))).collect();
    let x = numbers(segments.samples() * ENCODED);
    let directions = numbers(3 * counts.len());
    MlpCase { skip, segments, frequencies, color, x, directions, reached: 1, whole: false, layers }
}

type NetworkBody = fn(Tensor<2>, &RadianceMlp, [Activation; 2]) -> (Tensor<1>, Option<Tensor<2>>);

impl MlpCase {
    /// Returns the value, and the gradients of ⟨u, value⟩ with respect to x and to all weights.
    fn run(&self, device: &Device, precision: Precision, body: NetworkBody) -> [Vec<f32>; 3] {
        let device = device.clone().autodiff();
        let dense = |([_, outputs], weight, bias): &([usize; 2], Vec<f32>, Vec<f32>)| Dense {
            weight: upload_rows(weight, *outputs, &device).require_grad(),
            bias: vector(bias, &device).require_grad(),
        };
        let mut trunk: Vec<Dense> = self.layers.iter().map(dense).collect();
        let parameters = trunk.clone();
        let [sigma, feature, view, rgb] = <[Dense; 4]>::try_from(trunk.split_off(trunk.len() - 4)).unwrap();
        let directions = upload_rows(&self.directions, 3, &device);
        let (frequencies, segments) = (self.frequencies, self.segments.clone());
        let color = self.color.then(|| ColorBranch { feature, view, rgb, directions, frequencies, segments });
        let network = RadianceMlp { trunk, skip: self.skip, sigma, color, precision };
        let x = upload_rows(&self.x, ENCODED, &device).require_grad();
        let out = joined(body(x.clone(), &network, [Activation::None; 2]));
        let u = upload_rows(&self.u(out.dims()[1]), out.dims()[1], &device);
        let sum = (out.clone() * u).sum();
        // Burn keeps no graph of tensors without elements.
        if !sum.is_tracked() {
            return [to_host(out), Vec::new(), Vec::new()];
        }
        let grads = sum.backward();
        let dweights = parameters.iter().flat_map(|Dense { weight, bias }| {
            let dweight = weight.grad(&grads).unwrap_or_else(|| weight.zeros_like());
            [to_host(dweight), to_host(bias.grad(&grads).unwrap_or_else(|| bias.zeros_like()))].concat()
        });
        [to_host(out), to_host(x.grad(&grads).unwrap()), dweights.collect()]
    }

    fn u(&self, columns: usize) -> Vec<f32> {
        let draws = Draws(99).row(self.segments.samples() * columns).into_iter();
        let draws = draws.map(|u| if self.whole { (1.6 * u).trunc() } else { u });
        draws.enumerate().map(|(i, u)| if (i / columns).is_multiple_of(self.reached) { u } else { 0.0 }).collect()
    }
}

/// Lists cases: more samples than a block, and fewer; rays without samples; a skip in the middle, at the last layer,
/// none; most samples without a gradient, as behind ReLU densities.
fn cases() -> Vec<MlpCase> {
    let long: Vec<usize> = (0..60).map(|ray| ray % 19).collect();
    let mut cases = Vec::new();
    for (seed, skip) in [(1, 2), (2, 3), (3, 0)] {
        for color in [true, false] {
            cases.push(case(seed, &long, skip, color));
            cases.push(case(seed, &[5, 0, 2], skip, color));
            cases.push(MlpCase { reached: 3, ..case(seed, &[400, 0, 900], skip, color) });
        }
    }
    cases
}

#[test]
fn bodies_agree_in_value_and_gradient() {
    for case in cases() {
        let host = case.run(&Device::flex(), Precision::F32, radiance_mlp);
        for device in [Device::flex(), Device::ndarray()] {
            let plain = case.run(&device, Precision::F32, mlp::plain);
            for ((host, plain), what) in host.iter().zip(&plain).zip(["value", "x", "weights"]) {
                let what = format!("{what}, {} samples, skip {}, {device:?}", case.segments.samples(), case.skip);
                assert_close(host, plain, &what);
            }
        }
    }
}

#[test]
fn bf16_is_exact_for_integers_of_8_bits() {
    let mut draws = Draws(5);
    let mut whole = |count: usize| -> Vec<f32> { (0..count).map(|_| (1.4 * draws.signed()).trunc()).collect() };
    for mut case in cases() {
        case.frequencies = 0;
        let view = case.layers.len() - 2;
        case.layers[view].0[0] = WIDTH + 3;
        case.layers.iter_mut().for_each(|(size, w, b)| (*w, *b) = (whole(size[0] * size[1]), vec![1.0; size[1]]));
        (case.x, case.directions) = (whole(case.x.len()), whole(case.directions.len()));
        case.whole = true;
        let [exact, rounded] =
            [Precision::F32, Precision::Bf16].map(|precision| case.run(&Device::flex(), precision, radiance_mlp));
        for (exact, rounded) in exact.iter().zip(&rounded) {
            assert!(exact.iter().any(|x| *x != 0.0), "something is computed");
            assert_eq!(exact, rounded);
        }
    }
}

#[test]
fn without_samples_there_are_no_values_and_no_gradients() {
    for precision in [Precision::F32, Precision::Bf16] {
        let [value, dx, dweights] = case(4, &[0, 0], 2, true).run(&Device::flex(), precision, radiance_mlp);
        assert!(value.is_empty() && dx.is_empty() && dweights.is_empty());
    }
}
