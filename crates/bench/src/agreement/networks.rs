//! Networks of density and colour, of sizes that no tile of a product divides.

use burn::tensor::{Device, Tensor};
use fastrand::Rng;
use infonerf_ops::mlp::{Activation, ColorBranch, Dense, Precision, RadianceMlp, density_and_color};
use infonerf_ops::{Segments, from_host};

use super::operations::{Operation, leaf, numbers, operation, pulled};

/// Which outputs have a gradient.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    Both,
    Density,
    Color,
}

struct Case {
    name: &'static str,
    /// Samples of each ray are below this.
    samples: usize,
    rays: usize,
    /// Width of the encoded position, of the trunk, and of the encoded direction.
    widths: [usize; 3],
    layers: usize,
    skip: usize,
    asked: Asked,
}

const CASES: [Case; 5] = [
    Case {
        name: "radiance network",
        samples: 9,
        rays: 60,
        widths: [12, 16, 9],
        layers: 1,
        skip: 0,
        asked: Asked::Both,
    },
    Case {
        name: "radiance network of the authors' sizes",
        samples: 9,
        rays: 40,
        widths: [63, 256, 27],
        layers: 3,
        skip: 1,
        asked: Asked::Both,
    },
    Case {
        name: "radiance network of many samples, colour's gradient",
        samples: 9,
        rays: 1500,
        widths: [5, 22, 9],
        layers: 3,
        skip: 2,
        asked: Asked::Color,
    },
    Case {
        name: "radiance network, density's gradient",
        samples: 9,
        rays: 30,
        widths: [7, 33, 9],
        layers: 2,
        skip: 1,
        asked: Asked::Density,
    },
    Case {
        name: "radiance network of one sample",
        samples: 2,
        rays: 2,
        widths: [3, 6, 3],
        layers: 2,
        skip: 0,
        asked: Asked::Both,
    },
];

/// All of them.
pub(super) fn all(rng: &mut Rng) -> Vec<Operation> {
    let mut operations: Vec<Operation> = CASES.iter().map(|case| network(case, rng)).collect();
    operations.push(density(rng));
    operations
}

/// A layer's outputs, and its matrix and bias one after the other.
type Layer = (usize, Vec<f32>);

/// A layer whose outputs are as large as its inputs.
fn layer(rng: &mut Rng, inputs: usize, outputs: usize) -> Layer {
    let bound = (6.0 / inputs as f32).sqrt();
    (outputs, numbers(rng, (inputs + 1) * outputs, -bound, bound))
}

fn trunk(rng: &mut Rng, [encoded, width, _]: [usize; 3], layers: usize, skip: usize) -> Vec<Layer> {
    let inputs = |index| match index {
        0 => encoded,
        _ if index == skip => encoded + width,
        _ => width,
    };
    (0..layers).map(|index| layer(rng, inputs(index), width)).collect()
}

/// The layer of a leaf.
fn dense(leaf: &Tensor<1>, outputs: usize) -> Dense {
    let weights = leaf.dims()[0] - outputs;
    Dense {
        weight: leaf.clone().narrow(0, 0, weights).reshape([-1, outputs as i32]),
        bias: leaf.clone().narrow(0, weights, outputs),
    }
}

fn leaves(layers: &[Layer], device: &Device) -> (Vec<Tensor<1>>, Vec<Dense>) {
    let leaves: Vec<_> = layers.iter().map(|(_, numbers)| leaf(numbers, device)).collect();
    let dense = leaves.iter().zip(layers).map(|(leaf, (outputs, _))| dense(leaf, *outputs)).collect();
    (leaves, dense)
}

/// A network with directions of rays of which some are empty.
fn network(case: &Case, rng: &mut Rng) -> Operation {
    let Case { widths: [inputs, width, directed], skip, asked, .. } = *case;
    let octaves = (directed / 3 - 1) / 2;
    let rays = (1..case.rays).map(|_| rng.usize(0..case.samples)).collect::<Vec<_>>();
    let segments = Segments::from_counts(std::iter::once(case.samples - 1).chain(rays));
    let encoded = numbers(rng, inputs * segments.samples(), -1.0, 1.0);
    let directions = numbers(rng, 3 * segments.rays(), -1.0, 1.0);
    let mut layers = trunk(rng, case.widths, case.layers, skip);
    for [inputs, outputs] in [[width, 1], [width, width], [width + directed, width / 2], [width / 2, 3]] {
        layers.push(layer(rng, inputs, outputs));
    }
    let in_trunk = case.layers;
    operation(case.name, move |device| {
        let encoded = leaf(&encoded, device);
        let (leaves, mut dense) = leaves(&layers, device);
        let heads: [Dense; 4] = dense.split_off(in_trunk).try_into().expect("there are four");
        let [sigma, feature, view, rgb] = heads;
        let color = ColorBranch {
            feature,
            view,
            rgb,
            directions: from_host(&directions, 3, device),
            frequencies: octaves,
            segments: segments.clone(),
        };
        let network = RadianceMlp { trunk: dense, skip, sigma, color: Some(color), precision: Precision::F32 };
        let points = encoded.clone().reshape([-1, inputs as i32]);
        let (density, color) = density_and_color(points, &network, Activation::ShiftedSoftplus);
        let color = color.expect("the network has colour").flatten::<1>(0, 1);
        let used = leaves.iter().enumerate().filter(|(index, _)| match asked {
            Asked::Both => true,
            Asked::Density => *index <= in_trunk,
            Asked::Color => *index != in_trunk,
        });
        let inputs: Vec<&Tensor<1>> = std::iter::once(&encoded).chain(used.map(|(_, leaf)| leaf)).collect();
        match asked {
            Asked::Both => pulled(Tensor::cat(vec![density, color], 0), &inputs),
            Asked::Density => pulled(density, &inputs),
            Asked::Color => pulled(color, &inputs),
        }
    })
}

/// A network without colour, whose weights have no gradient.
fn density(rng: &mut Rng) -> Operation {
    const WIDTHS: [usize; 3] = [9, 70, 0];
    const LAYERS: usize = 3;
    const SAMPLES: usize = 131;
    let encoded = numbers(rng, WIDTHS[0] * SAMPLES, -1.0, 1.0);
    let mut layers = trunk(rng, WIDTHS, LAYERS, 1);
    layers.push(layer(rng, WIDTHS[1], 1));
    operation("density network with fixed weights", move |device| {
        let encoded = leaf(&encoded, device);
        let (_, mut dense) = leaves(&layers, device);
        for Dense { weight, bias } in &mut dense {
            (*weight, *bias) = (weight.clone().detach(), bias.clone().detach());
        }
        let sigma = dense.pop().expect("there are layers");
        let network = RadianceMlp { trunk: dense, skip: 1, sigma, color: None, precision: Precision::F32 };
        let points = encoded.clone().reshape([-1, WIDTHS[0] as i32]);
        pulled(density_and_color(points, &network, Activation::Relu).0, &[&encoded])
    })
}
