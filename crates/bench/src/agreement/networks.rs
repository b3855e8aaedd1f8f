//! Networks of density and colour, with sizes that are no multiples of the tiles of a matrix product.

use burn::tensor::Tensor;
use fastrand::Rng;
use infonerf_ops::mlp::{Activation, ColorBranch, Dense, Precision, RadianceMlp, radiance_mlp};
use infonerf_ops::{Segments, upload_rows};

use super::comparison::{DeviceComparisons, value_and_gradients};
use crate::values::{layer, leaf, leaves, trunk, uniform};

/// Outputs whose gradient is compared.
#[derive(Clone, Copy)]
enum GradientOf {
    Both,
    Density,
    Color,
}

/// Name, `[exclusive maximum of the samples of a ray, rays]`, widths of the encoded position, the trunk, and the encoded
/// direction, `[layers, skip]`, and outputs with a gradient.
type NetworkCase = (&'static str, [usize; 2], [usize; 3], [usize; 2], GradientOf);

const CASES: [NetworkCase; 5] = [
    ("radiance network", [9, 60], [12, 16, 9], [1, 0], GradientOf::Both),
    ("radiance network of the authors' sizes", [9, 40], [63, 256, 27], [3, 1], GradientOf::Both),
    ("radiance network of many samples, colour's gradient", [9, 1500], [5, 22, 9], [3, 2], GradientOf::Color),
    ("radiance network, density's gradient", [9, 30], [7, 33, 9], [2, 1], GradientOf::Density),
    ("radiance network of one sample", [2, 2], [3, 6, 3], [2, 0], GradientOf::Both),
];

pub(super) fn all(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    CASES.iter().for_each(|case| network(case, rng, compare));
    density(rng, compare);
}

/// Compares a network with colour; directions are per ray, and some rays have no samples.
fn network(case: &NetworkCase, rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    let (name, [samples, rays], [inputs, width, directed], [in_trunk, skip], upstream) = *case;
    let frequencies = (directed / 3 - 1) / 2;
    let counts = (1..rays).map(|_| rng.usize(0..samples)).collect::<Vec<_>>();
    let segments = Segments::from_counts(std::iter::once(samples - 1).chain(counts));
    let encoded = uniform(rng, inputs * segments.samples(), -1.0, 1.0);
    let directions = uniform(rng, 3 * segments.rays(), -1.0, 1.0);
    let mut layers = trunk(rng, [inputs, width], in_trunk, skip);
    let heads = [[width, 1], [width, width], [width + directed, width / 2], [width / 2, 3]];
    layers.extend(heads.map(|[inputs, outputs]| layer(rng, inputs, outputs)));
    compare.operation(name, |device| {
        let encoded = leaf(&encoded, device);
        let (leaves, mut dense) = leaves(&layers, device);
        let [sigma, feature, view, rgb]: [Dense; 4] = dense.split_off(in_trunk).try_into().expect("there are four");
        let (directions, segments) = (upload_rows(&directions, 3, device), segments.clone());
        let color = ColorBranch { feature, view, rgb, directions, frequencies, segments };
        let network = RadianceMlp { trunk: dense, skip, sigma, color: Some(color), precision: Precision::F32 };
        let points = encoded.clone().reshape([-1, inputs as i32]);
        let activations = [Activation::ShiftedSoftplus, Activation::Sigmoid];
        let (density, color) = radiance_mlp(points, &network, activations);
        let color = color.expect("the network has colour").flatten::<1>(0, 1);
        let used = leaves.iter().enumerate().filter(|(index, _)| match upstream {
            GradientOf::Both => true,
            GradientOf::Density => *index <= in_trunk,
            GradientOf::Color => *index != in_trunk,
        });
        let inputs: Vec<&Tensor<1>> = std::iter::once(&encoded).chain(used.map(|(_, leaf)| leaf)).collect();
        match upstream {
            GradientOf::Both => value_and_gradients(Tensor::cat(vec![density, color], 0), &inputs),
            GradientOf::Density => value_and_gradients(density, &inputs),
            GradientOf::Color => value_and_gradients(color, &inputs),
        }
    });
}

/// Compares a network without colour and without gradients of the weights.
fn density(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const WIDTHS: [usize; 2] = [9, 70];
    const LAYERS: usize = 3;
    const SAMPLES: usize = 131;
    let encoded = uniform(rng, WIDTHS[0] * SAMPLES, -1.0, 1.0);
    let mut layers = trunk(rng, WIDTHS, LAYERS, 1);
    layers.push(layer(rng, WIDTHS[1], 1));
    compare.operation("density network with fixed weights", |device| {
        let encoded = leaf(&encoded, device);
        let (_, mut dense) = leaves(&layers, device);
        for Dense { weight, bias } in &mut dense {
            (*weight, *bias) = (weight.clone().detach(), bias.clone().detach());
        }
        let sigma = dense.pop().expect("there are layers");
        let network = RadianceMlp { trunk: dense, skip: 1, sigma, color: None, precision: Precision::F32 };
        let points = encoded.clone().reshape([-1, WIDTHS[0] as i32]);
        value_and_gradients(radiance_mlp(points, &network, [Activation::Relu; 2]).0, &[&encoded])
    });
}
