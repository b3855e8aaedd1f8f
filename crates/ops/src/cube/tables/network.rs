//! The MLP of a factored field: matrix products in `f32`, what lies between them is fused.

use std::sync::Arc;

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape, Slice};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::reshape;
use burn_cubecl::tensor::CubeTensor;

use crate::cube::outputs::Outputs;
use crate::cube::product::multiplied;
use crate::cube::rays::ln_1p;
use crate::cube::{CubeKernel, Pass, apply, empty};
use crate::factored::{Layer, Layout};

/// Partial sums of a layer's bias gradient.
const SUMS: usize = 64;

/// Density `[samples]` and, if asked for, colour `[samples, 3]` of the MLP's input `[M, layout.features()]`, whose rows from
/// `samples` on are zero and M a multiple of `parts`.
pub(crate) fn network(
    features: tensor::Tensor<2>,
    weights: tensor::Tensor<1>,
    directions: Option<tensor::Tensor<2>>,
    layout: &Arc<Layout>,
    [samples, parts]: [usize; 2],
    color: bool,
) -> (tensor::Tensor<1>, Option<tensor::Tensor<2>>) {
    // Not even of no colours is a buffer empty.
    let outputs = Outputs::new([Shape::new([samples]), Shape::new([if color { samples } else { 1 }, 3])]);
    let kernel = Network { layout: layout.clone(), outputs: outputs.clone(), parts, color };
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
    parts: usize,
    color: bool,
}

impl Network {
    /// W of a layer, `[outputs, inputs]`: where a buffer may begin there, without a copy.
    fn matrix(layer: &Layer, weights: &CubeTensor) -> CubeTensor {
        let [start, behind] =
            [layer.weight, weights.meta.num_elements() - layer.bias()].map(|numbers| 4 * numbers as u64);
        if start.is_multiple_of(weights.client.properties().memory.alignment) {
            let CubeTensor { client, device, handle, dtype, .. } = weights.clone();
            let handle = handle.offset_start(start).offset_end(behind);
            return CubeTensor::new_contiguous(
                client,
                device,
                Shape::new([layer.outputs, layer.inputs]),
                handle,
                dtype,
            );
        }
        let range = Slice::from(layer.weight..layer.bias());
        reshape(CubeBackend::float_slice(weights.clone(), &[range]), Shape::new([layer.outputs, layer.inputs]))
    }
}

impl CubeKernel for Network {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.forward_keeping(inputs).0
    }

    /// Keeps each layer's output, the last one's as the product alone, and then their matrices.
    fn forward_keeping(&self, inputs: &[CubeTensor]) -> (CubeTensor, Vec<CubeTensor>) {
        let weights = &inputs[1];
        let mut kept: Vec<CubeTensor> = Vec::with_capacity(2 * self.layout.layers.len());
        let matrices: Vec<CubeTensor> = self.layout.layers.iter().map(|layer| Self::matrix(layer, weights)).collect();
        for (index, (layer, matrix)) in self.layout.layers.iter().zip(&matrices).enumerate() {
            let x = kept.last().unwrap_or(&inputs[0]).clone();
            let y = into_contiguous(multiplied(x, CubeBackend::float_transpose(matrix.clone())));
            if index + 1 < self.layout.layers.len() {
                let count = y.meta.num_elements();
                launch!(bias_relu::launch, count; &y, weights; layer.bias(), layer.outputs);
            }
            kept.push(y);
        }
        let (raw, last) = (&kept[kept.len() - 1], &self.layout.layers[kept.len() - 1]);
        let buffer = self.outputs.buffer(raw);
        let [density, color] = self.outputs.parts(&buffer);
        let (scale, bias) = (self.layout.density_scale, self.layout.density_bias);
        launch!(
            head::launch, density.meta.num_elements();
            raw, weights, inputs.get(2).unwrap_or(raw), &density, &color;
            last.bias(), scale, bias, self.color, self.color && self.layout.view_dependent
        );
        kept.extend(matrices);
        (buffer, kept)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (features, weights) = (&pass.inputs[0], &pass.inputs[1]);
        let (layers, rows) = (&self.layout.layers, features.meta.shape()[0]);
        let raw = &pass.kept[layers.len() - 1];
        let last = &layers[layers.len() - 1];
        let mut dy = empty(raw, [rows, last.outputs]);
        let [density, color] = self.outputs.parts(pass.output);
        let [ddensity, dcolor] = self.outputs.gradients();
        let of = |grad: &Option<CubeTensor>| grad.clone().unwrap_or_else(|| raw.clone());
        launch!(
            head_backward::launch, rows;
            raw, weights, pass.inputs.get(2).unwrap_or(raw), &color, &of(&ddensity), &of(&dcolor), &dy;
            last.bias(), density.meta.num_elements(), self.layout.density_scale, self.layout.density_bias,
            ddensity.is_some(), dcolor.is_some(), self.layout.view_dependent
        );
        let dweights = empty(weights, [self.layout.weight_len()]);
        for (index, layer) in layers.iter().enumerate().rev() {
            let x = if index == 0 { features } else { &pass.kept[index - 1] };
            let sums = empty(weights, [SUMS, layer.outputs]);
            let is_hidden = index + 1 < layers.len();
            launch!(relu_bias_backward::launch, SUMS * layer.outputs; &pass.kept[index], &dy, &sums; SUMS, is_hidden);
            // As many partial sums as fill a large GPU: see `split.rs`.
            let split = |tensor: &CubeTensor, columns: usize| {
                reshape(tensor.clone(), Shape::new([self.parts, rows / self.parts, columns]))
            };
            let parts = into_contiguous(multiplied(
                CubeBackend::float_swap_dims(split(&dy, layer.outputs), 1, 2),
                split(x, layer.inputs),
            ));
            launch!(
                add_up::launch, layer.end() - layer.weight; &parts, &sums, &dweights;
                layer.weight, layer.bias() - layer.weight, layer.outputs, self.parts, SUMS
            );
            dy = into_contiguous(multiplied(dy, pass.kept[layers.len() + index].clone()));
        }
        vec![Some(dy), Some(dweights), None]
    }
}

/// max(y + b, 0) in place; what is no number stays that.
#[cube(launch)]
fn bias_relu(y: &mut Tensor<f32>, weights: &Tensor<f32>, bias: usize, columns: usize) {
    if ABSOLUTE_POS >= y.len() {
        terminate!();
    }
    let mut sum = y[ABSOLUTE_POS] + weights[bias + ABSOLUTE_POS % columns];
    if sum < 0.0f32 {
        sum = 0.0f32;
    }
    y[ABSOLUTE_POS] = sum;
}

/// ln(1 + e^x).
#[cube]
pub(in crate::cube) fn softplus(x: f32) -> f32 {
    f32::max(x, 0.0f32) + ln_1p(f32::exp(-f32::abs(x)))
}

#[cube]
pub(in crate::cube) fn sigmoid(x: f32) -> f32 {
    1.0f32 / (1.0f32 + f32::exp(-x))
}

/// One thread per sample: s·softplus of density, the sigmoid of colour, which may change with the view direction.
#[cube(launch)]
fn head(
    raw: &Tensor<f32>,
    weights: &Tensor<f32>,
    directions: &Tensor<f32>,
    density: &mut Tensor<f32>,
    colors: &mut Tensor<f32>,
    bias: usize,
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
    density[sample] = softplus(raw[first] + weights[bias] + offset) * scale;
    if color {
        for k in 0..3usize {
            let mut x = raw[first + 1 + k] + weights[bias + 1 + k];
            if views {
                for axis in 0..3usize {
                    let at = 4 + 3 * k + axis;
                    x += (raw[first + at] + weights[bias + at]) * directions[3 * sample + axis];
                }
            }
            colors[3 * sample + k] = sigmoid(x);
        }
    }
}

/// The gradient with respect to `raw`; 0 of rows that fill up.
#[cube(launch)]
fn head_backward(
    raw: &Tensor<f32>,
    weights: &Tensor<f32>,
    directions: &Tensor<f32>,
    colors: &Tensor<f32>,
    ddensity: &Tensor<f32>,
    dcolors: &Tensor<f32>,
    draw: &mut Tensor<f32>,
    bias: usize,
    samples: usize,
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
    if sample < samples {
        if has_ddensity {
            draw[first] = ddensity[sample] * scale * sigmoid(raw[first] + weights[bias] + offset);
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
}

/// Takes the gradient back through a ReLU in place, and adds it up over every `sums`-th row.
#[cube(launch)]
fn relu_bias_backward(
    y: &Tensor<f32>,
    dy: &mut Tensor<f32>,
    bias_sums: &mut Tensor<f32>,
    sums: usize,
    #[comptime] relu: bool,
) {
    let columns = dy.shape(1);
    if ABSOLUTE_POS >= sums * columns {
        terminate!();
    }
    let mut sum = 0.0f32;
    let mut row = ABSOLUTE_POS / columns;
    while row < dy.shape(0) {
        let at = row * columns + ABSOLUTE_POS % columns;
        if relu {
            if y[at] <= 0.0f32 {
                dy[at] = 0.0f32;
            }
        }
        sum += dy[at];
        row += sums;
    }
    bias_sums[ABSOLUTE_POS] = sum;
}

/// A layer's gradient from its partial sums: of the matrix `[parts, outputs, inputs]`, then of the biases `[sums, outputs]`.
#[cube(launch)]
fn add_up(
    parts: &Tensor<f32>,
    bias_sums: &Tensor<f32>,
    dweights: &mut Tensor<f32>,
    first: usize,
    numbers: usize,
    outputs: usize,
    part_count: usize,
    sums: usize,
) {
    if ABSOLUTE_POS >= numbers + outputs {
        terminate!();
    }
    let mut sum = 0.0f32;
    if ABSOLUTE_POS < numbers {
        for part in 0..part_count {
            sum += parts[part * numbers + ABSOLUTE_POS];
        }
    } else {
        for part in 0..sums {
            sum += bias_sums[part * outputs + ABSOLUTE_POS - numbers];
        }
    }
    dweights[first + ABSOLUTE_POS] = sum;
}
