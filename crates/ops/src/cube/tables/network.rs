//! The MLP of a factored field in `f32`: a launch per layer and one for what follows, and two per layer on the way back.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::tensor::CubeTensor;

use crate::cube::activation::{sigmoid, softplus};
use crate::cube::gemm::{self, Below, Gradients, Order, Rows};
use crate::cube::outputs::Outputs;
use crate::cube::{CubeKernel, Pass, apply, empty, empty_like};
use crate::factored::{Layer, Layout};
use crate::mlp::Activation;

/// Density `[M]` and, if asked for, colour `[M, 3]` of the MLP's input `[M, layout.features()]`.
pub(crate) fn network(
    features: tensor::Tensor<2>,
    weights: tensor::Tensor<1>,
    directions: Option<tensor::Tensor<2>>,
    layout: &Arc<Layout>,
    color: bool,
) -> (tensor::Tensor<1>, Option<tensor::Tensor<2>>) {
    let samples = features.dims()[0];
    // Not even of no colours is a buffer empty.
    let outputs = Outputs::new([Shape::new([samples]), Shape::new([if color { samples } else { 1 }, 3])]);
    let kernel = Network { layout: layout.clone(), outputs: outputs.clone(), color };
    let buffer = match directions {
        Some(directions) => apply(kernel, (features, weights, directions)),
        None => apply(kernel, (features, weights)),
    };
    (outputs.output(&buffer, 0), color.then(|| outputs.output(&buffer, 1)))
}

#[derive(Debug)]
struct Network {
    layout: Arc<Layout>,
    outputs: Arc<Outputs<2>>,
    color: bool,
}

/// W, `[outputs, inputs]`, and b among all `weights`.
fn among<'a>(weights: &'a CubeTensor, layer: &Layer) -> gemm::Layer<'a> {
    gemm::Layer {
        weight: (weights, layer.weight),
        bias: (weights, layer.bias()),
        inputs: layer.inputs,
        outputs: layer.outputs,
        order: Order::ByOutput,
    }
}

impl Network {
    /// The last layer's output, before what follows it. Each layer's, which is not kept here, is given to `keep`.
    fn layers(&self, inputs: &[CubeTensor], mut keep: impl FnMut(&CubeTensor)) -> CubeTensor {
        let [features, weights, ..] = inputs else { unreachable!("a network has features and weights") };
        let mut x = features.clone();
        for (index, layer) in self.layout.layers.iter().enumerate() {
            let is_last = index + 1 == self.layout.layers.len();
            let y = empty(&x, [x.meta.shape()[0], layer.outputs]);
            let function = if is_last { Activation::None } else { Activation::Relu };
            among(weights, layer).forward(Rows::of(&x), function, &y);
            keep(&y);
            x = y;
        }
        x
    }

    fn head(&self, raw: &CubeTensor, directions: Option<&CubeTensor>) -> CubeTensor {
        let buffer = self.outputs.buffer(raw);
        let [density, color] = self.outputs.parts(&buffer);
        launch!(
            head::launch, density.meta.num_elements();
            raw, directions.unwrap_or(raw), &density, &color;
            self.layout.density_scale, self.layout.density_bias, self.color, self.color && self.layout.view_dependent
        );
        buffer
    }

    /// The gradient with respect to the last layer's output.
    fn head_backward(&self, pass: &Pass<'_>, raw: &CubeTensor) -> CubeTensor {
        let draw = empty_like(raw);
        let [_, color] = self.outputs.parts(pass.output);
        let [ddensity, dcolor] = self.outputs.gradients();
        let of = |grad: &Option<CubeTensor>| grad.clone().unwrap_or_else(|| raw.clone());
        launch!(
            head_backward::launch, raw.meta.shape()[0];
            raw, pass.inputs.get(2).unwrap_or(raw), &color, &of(&ddensity), &of(&dcolor), &draw;
            self.layout.density_scale, self.layout.density_bias,
            ddensity.is_some(), dcolor.is_some(), self.layout.view_dependent
        );
        draw
    }
}

impl CubeKernel for Network {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.head(&self.layers(inputs, |_| ()), inputs.get(2))
    }

    /// Keeps each layer's output.
    fn forward_keeping(&self, inputs: &[CubeTensor]) -> (CubeTensor, Vec<CubeTensor>) {
        let mut kept = Vec::with_capacity(self.layout.layers.len());
        let raw = self.layers(inputs, |y| kept.push(y.clone()));
        (self.head(&raw, inputs.get(2)), kept)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (features, weights) = (&pass.inputs[0], &pass.inputs[1]);
        let gradients = Gradients::new(weights, features.meta.shape()[0], self.layout.weight_len());
        let mut dy = self.head_backward(&pass, &pass.kept[self.layout.layers.len() - 1]);
        for (index, layer) in self.layout.layers.iter().enumerate().rev() {
            let x = if index == 0 { features } else { &pass.kept[index - 1] };
            gradients.add(&among(weights, layer), Rows::of(x), &dy, [layer.weight, layer.bias()]);
            let dx = empty_like(x);
            let below = if index == 0 { Below::Nothing } else { Below::Function(x, Activation::Relu) };
            among(weights, layer).input_gradient(0, &dy, below, &dx);
            dy = dx;
        }
        vec![Some(dy), Some(gradients.added_up()), None]
    }
}

/// One thread per sample: s·softplus of density, the sigmoid of colour, which may change with the view direction.
#[cube(launch)]
fn head(
    raw: &Tensor<f32>,
    directions: &Tensor<f32>,
    density: &mut Tensor<f32>,
    colors: &mut Tensor<f32>,
    scale: f32,
    offset: f32,
    #[comptime] color: bool,
    #[comptime] views: bool,
) {
    let (sample, columns) = (ABSOLUTE_POS, raw.shape(1));
    if sample >= density.len() {
        terminate!();
    }
    let first = sample * columns;
    density[sample] = softplus(raw[first] + offset) * scale;
    if color {
        for k in 0..3usize {
            let mut x = raw[first + 1 + k];
            if views {
                for axis in 0..3usize {
                    let at = 4 + 3 * k + axis;
                    x += raw[first + at] * directions[3 * sample + axis];
                }
            }
            colors[3 * sample + k] = sigmoid(x);
        }
    }
}

/// The gradient with respect to `raw`.
#[cube(launch)]
fn head_backward(
    raw: &Tensor<f32>,
    directions: &Tensor<f32>,
    colors: &Tensor<f32>,
    ddensity: &Tensor<f32>,
    dcolors: &Tensor<f32>,
    draw: &mut Tensor<f32>,
    scale: f32,
    offset: f32,
    #[comptime] has_ddensity: bool,
    #[comptime] has_dcolors: bool,
    #[comptime] views: bool,
) {
    let (sample, columns) = (ABSOLUTE_POS, draw.shape(1));
    if sample >= draw.shape(0) {
        terminate!();
    }
    let first = sample * columns;
    for column in 0..columns {
        draw[first + column] = 0.0f32;
    }
    if has_ddensity {
        draw[first] = ddensity[sample] * scale * sigmoid(raw[first] + offset);
    }
    if has_dcolors {
        for k in 0..3usize {
            let y = colors[3 * sample + k];
            let slope = dcolors[3 * sample + k] * y * (1.0f32 - y);
            draw[first + 1 + k] = slope;
            if views {
                for axis in 0..3usize {
                    draw[first + 4 + 3 * k + axis] = slope * directions[3 * sample + axis];
                }
            }
        }
    }
}
