//! Gradients of every body against central differences of the same function in `f64`.

#![allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]

use std::sync::Arc;

use crate::common::{Draws, vector, wide};
use burn::tensor::{Device, Tensor};
use infonerf_ops::bilinear::{self, Taps, bilinear};
use infonerf_ops::factored::{self, FactoredLayout, plane_variation};
use infonerf_ops::{RayGaussians, frustum_gaussians, to_host};

/// Step of the central differences, relative to an input of size 1.
const STEP: f64 = 1e-5;
/// Largest error of a gradient, relative to the largest element.
const TOLERANCE: f64 = 2e-5;

type ExactFunction = Box<dyn Fn(&[Vec<f64>]) -> Vec<f64>>;
type Function = Box<dyn Fn(&[Tensor<1>]) -> Tensor<1>>;

/// Differentiable function of flat inputs.
struct GradientCase {
    name: &'static str,
    inputs: Vec<Vec<f32>>,
    /// Implementations, with the device of each.
    bodies: Vec<(Device, Function)>,
    /// The function in `f64`.
    exact: ExactFunction,
}

impl GradientCase {
    fn check(&self) {
        let exact_inputs: Vec<Vec<f64>> = self.inputs.iter().map(|input| wide(input)).collect();
        let mut draws = Draws(3);
        let u: Vec<f32> = (self.exact)(&exact_inputs).iter().map(|_| draws.signed()).collect();
        let along_u =
            |inputs: &[Vec<f64>]| -> f64 { (self.exact)(inputs).iter().zip(&u).map(|(y, u)| y * f64::from(*u)).sum() };
        for (device, body) in &self.bodies {
            let device = device.clone().autodiff();
            let inputs: Vec<Tensor<1>> = self.inputs.iter().map(|x| vector(x, &device).require_grad()).collect();
            let gradients = (body(&inputs) * vector(&u, &device)).sum().backward();
            for (which, input) in inputs.iter().enumerate() {
                let found = to_host(input.grad(&gradients).expect("every input has a gradient"));
                let difference = |at: usize| {
                    let moved = |by: f64| {
                        let mut inputs = exact_inputs.clone();
                        inputs[which][at] += by;
                        along_u(&inputs)
                    };
                    (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
                };
                let want: Vec<f64> = (0..found.len()).map(difference).collect();
                let scale = want.iter().fold(0f64, |max, x| max.max(x.abs()));
                assert!(scale > 0.0, "{}: input {which} has an effect", self.name);
                for (found, want) in found.iter().zip(want) {
                    let error = (f64::from(*found) - want).abs();
                    assert!(error <= TOLERANCE * scale, "{}, input {which}, {device:?}: {found} {want}", self.name);
                }
            }
        }
    }
}

fn values(count: usize, seed: u64) -> Vec<f32> {
    let mut draws = Draws(seed);
    (0..count).map(|_| draws.signed()).collect()
}

/// Total variation of the planes: Σ_levels (res/64)/(3 res²) Σ over neighbours of squared differences.
fn variation() -> GradientCase {
    let layout = Arc::new(FactoredLayout::new(0, &[(3, 2), (5, 4)], (1, 4), false, (1.0, 0.0)));
    let [host, plain] = [(); 2].map(|()| layout.clone());
    let kernel: Function = Box::new(move |x| plane_variation(x[0].clone(), &host));
    let bodies = [Device::flex(), Device::ndarray()].map(|device| {
        let plain = plain.clone();
        (device, Box::new(move |x: &[Tensor<1>]| factored::plain_variation(x[0].clone(), &plain)) as Function)
    });
    let inputs = vec![values(layout.table_len(), 1)];
    let exact = move |x: &[Vec<f64>]| {
        let mut sum = 0.0;
        for level in &layout.levels {
            let (r, c) = (level.resolution, level.channels);
            let texel = |p: usize, i: usize, j: usize, k: usize| x[0][level.plane(p) + (j * r + i) * c + k];
            for (p, k) in (0..3).flat_map(|p| (0..c).map(move |k| (p, k))) {
                for (i, j) in (0..r).flat_map(|i| (0..r - 1).map(move |j| (i, j))) {
                    let squares = (texel(p, i, j + 1, k) - texel(p, i, j, k)).powi(2)
                        + (texel(p, j + 1, i, k) - texel(p, j, i, k)).powi(2);
                    sum += squares / (64.0 * 3.0 * r as f64);
                }
            }
        }
        vec![sum]
    };
    let bodies = std::iter::once((Device::flex(), kernel)).chain(bodies).collect();
    GradientCase { name: "plane variation", inputs, bodies, exact: Box::new(exact) }
}

/// Bilinear reading with repeated, border and corner places.
fn bilinear_reading() -> GradientCase {
    const SIZE: [usize; 2] = [3, 4];
    const CHANNELS: usize = 2;
    let places = [(0, 0.3, 1.6), (1, 2.2, 0.1), (0, 0.3, 1.6), (1, 9.0, -1.0), (0, 3.0, 2.0), (1, 1.5, 1.5)];
    let taps = Taps::new(places.into_iter(), SIZE[0], SIZE[1]);
    let body = |device: Device, read: fn(Tensor<2>, &Taps) -> Tensor<2>| {
        let taps = taps.clone();
        let function = move |x: &[Tensor<1>]| read(x[0].clone().reshape([-1, CHANNELS as i32]), &taps).flatten(0, 1);
        (device, Box::new(function) as Function)
    };
    let bodies = vec![
        body(Device::flex(), bilinear),
        body(Device::flex(), bilinear::plain),
        body(Device::ndarray(), bilinear::plain),
    ];
    let exact = move |x: &[Vec<f64>]| {
        // Weights of the texels along an axis are max(0, 1 − distance).
        let tent = |at: f32, size: usize, texel: usize| {
            (1.0 - (f64::from(at).clamp(0.0, (size - 1) as f64) - texel as f64).abs()).max(0.0)
        };
        let read = |&(map, px, py): &(usize, f32, f32), k: usize| -> f64 {
            let texels = (0..SIZE[0]).flat_map(|j| (0..SIZE[1]).map(move |i| (i, j)));
            texels
                .map(|(i, j)| {
                    let at = ((map * SIZE[0] + j) * SIZE[1] + i) * CHANNELS + k;
                    tent(px, SIZE[1], i) * tent(py, SIZE[0], j) * x[0][at]
                })
                .sum()
        };
        places.iter().flat_map(|place| (0..CHANNELS).map(move |k| read(place, k)).collect::<Vec<f64>>()).collect()
    };
    let inputs = vec![values(2 * SIZE[0] * SIZE[1] * CHANNELS, 2)];
    GradientCase { name: "bilinear reading", inputs, bodies, exact: Box::new(exact) }
}

/// Moments of frustums in distance, length and radius.
fn frustums() -> GradientCase {
    let function = |x: &[Tensor<1>]| {
        let RayGaussians { mean, along, across } = frustum_gaussians(x[0].clone(), x[1].clone(), x[2].clone());
        Tensor::cat(vec![mean, along, across], 0)
    };
    let exact = |x: &[Vec<f64>]| {
        let moments: Vec<[f64; 3]> = (0..x[0].len())
            .map(|i| {
                let (t, half) = (x[0][i], 0.5 * x[1][i]);
                infonerf_oracle::frustum_moments(t - half, t + half, x[2][i])
            })
            .collect();
        (0..3).flat_map(|k| moments.iter().map(move |moment| moment[k]).collect::<Vec<f64>>()).collect()
    };
    GradientCase {
        name: "frustum Gaussians",
        inputs: vec![vec![0.5, 2.0, 4.0, 1.0], vec![0.8, 0.1, 1.0, 2.0], vec![0.1, 0.5, 0.02, 0.3]],
        bodies: [Device::flex(), Device::ndarray()].map(|device| (device, Box::new(function) as Function)).into(),
        exact: Box::new(exact),
    }
}

#[test]
fn gradients_are_differences_of_the_function_in_f64() {
    for case in [variation(), bilinear_reading(), frustums()] {
        case.check();
    }
}
