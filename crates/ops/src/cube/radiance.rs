//! The network of NeRF and mip-NeRF in `f32`: a launch per layer, and two on the way back.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::tensor::CubeTensor;

use super::activation::before_activation;
use super::gemm::{Below, Gradients, Layer, Order, Rows};
use super::outputs::{ALIGNMENT, Outputs, part_or_copy};
use super::parameters::Parameters;
use super::{CubeKernel, Pass, apply, empty, empty_like, zeros};
use crate::mlp::{Activation, RadianceMlp};

/// Density `[M, 1]` and colour `[M, 3]`, after `functions` of each, of encoded positions `[M, E]`, M not being 0.
pub(crate) fn radiance(
    encoded: tensor::Tensor<2>,
    network: &RadianceMlp,
    functions: [Activation; 2],
) -> (tensor::Tensor<2>, Option<tensor::Tensor<2>>) {
    let samples = encoded.dims()[0];
    let color = network.color.as_ref();
    let layers = network.trunk.iter().chain([&network.sigma]);
    let layers = layers.chain(color.into_iter().flat_map(|branch| [&branch.feature, &branch.view, &branch.rgb]));
    let (parameters, token) = Parameters::new(layers);
    // Not even of no colours is a buffer empty.
    let outputs = Outputs::new([Shape::new([samples, 1]), Shape::new([if color.is_some() { samples } else { 1 }, 3])]);
    let kernel =
        Radiance { parameters, outputs: outputs.clone(), trunk: network.trunk.len(), skip: network.skip, functions };
    let buffer = match color {
        Some(branch) => apply(kernel, (encoded, token, branch.segments.spread(branch.encoded_directions()))),
        None => apply(kernel, (encoded, token)),
    };
    (outputs.output(&buffer, 0), color.map(|_| outputs.output(&buffer, 1)))
}

/// Of encoded positions, the token of its parameters and, if it has colour, encoded directions.
#[derive(Debug)]
struct Radiance {
    parameters: Arc<Parameters>,
    outputs: Arc<Outputs<2>>,
    /// Layers of the trunk; then there are σ, and perhaps features, the layer that sees directions, and colour.
    trunk: usize,
    skip: usize,
    functions: [Activation; 2],
}

impl Radiance {
    /// What a layer of the trunk is given, `h` being the output of the one before.
    fn input<'a>(&self, layer: usize, encoded: &'a CubeTensor, h: &'a CubeTensor) -> Rows<'a> {
        match layer {
            0 => Rows::of(encoded),
            _ if layer == self.skip => Rows::beside(encoded, h),
            _ => Rows::of(h),
        }
    }

    /// The output. Each hidden layer's, which is not kept here, is given to `keep`.
    fn run(&self, inputs: &[CubeTensor], mut keep: impl FnMut(&CubeTensor)) -> CubeTensor {
        let (encoded, samples) = (&inputs[0], inputs[0].meta.shape()[0]);
        let values = self.parameters.values();
        let layers: Vec<Layer<'_>> = values.iter().map(layer).collect();
        let (trunk, heads) = layers.split_at(self.trunk);
        let buffer = self.outputs.buffer(encoded);
        let [density, color] = self.outputs.parts(&buffer);
        let mut hidden = |layer: &Layer<'_>, x: Rows<'_>, function| {
            let out = empty(encoded, [samples, layer.outputs]);
            layer.forward(x, function, &out);
            keep(&out);
            out
        };
        let mut h = encoded.clone();
        for (index, layer) in trunk.iter().enumerate() {
            h = hidden(layer, self.input(index, encoded, &h), Activation::Relu);
        }
        heads[0].forward(Rows::of(&h), self.functions[0], &density);
        if let [_, feature, view, rgb] = heads {
            h = hidden(feature, Rows::of(&h), Activation::None);
            h = hidden(view, Rows::beside(&h, &inputs[2]), Activation::Relu);
            rgb.forward(Rows::of(&h), self.functions[1], &color);
        }
        buffer
    }

    /// The gradients of density and colour before their functions, of those that have one.
    fn heads(&self, output: &CubeTensor) -> [Option<CubeTensor>; 2] {
        let values = self.outputs.parts(output);
        let grads = self.outputs.gradients();
        let before = grads.each_ref().map(|grad| grad.as_ref().map(empty_like));
        let of = |tensors: &[Option<CubeTensor>; 2], index: usize| tensors[index].clone().unwrap_or(output.clone());
        let count = before.iter().flatten().map(|grad| grad.meta.num_elements()).max().unwrap_or(0);
        let [has_density, has_color] = before.each_ref().map(Option::is_some);
        launch!(
            heads_backward::launch, count;
            &values[0], &values[1], &of(&grads, 0), &of(&grads, 1), &of(&before, 0), &of(&before, 1);
            self.functions[0], self.functions[1], has_density, has_color
        );
        before
    }
}

/// W `[inputs, outputs]` and b.
fn layer([weight, bias]: &[CubeTensor; 2]) -> Layer<'_> {
    let [inputs, outputs] = weight.meta.shape().dims();
    Layer { weight: (weight, 0), bias: (bias, 0), inputs, outputs, order: Order::ByInput }
}

/// Where the gradients of a layer's W and b begin.
type Starts = [usize; 2];

/// One after the other, of those layers that any gradient reaches, at multiples of [`ALIGNMENT`]; and where all end.
fn places(layers: &[Layer<'_>], has_gradient: impl Fn(usize) -> bool) -> (Vec<Option<Starts>>, usize) {
    let mut end = 0;
    let mut place = |numbers: usize| {
        let start = end;
        end += numbers.next_multiple_of(ALIGNMENT);
        start
    };
    let starts = layers
        .iter()
        .enumerate()
        .map(|(index, layer)| has_gradient(index).then(|| [place(layer.inputs * layer.outputs), place(layer.outputs)]));
    (starts.collect(), end)
}

impl CubeKernel for Radiance {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        self.run(inputs, |_| ())
    }

    /// Keeps the output of each hidden layer.
    fn forward_keeping(&self, inputs: &[CubeTensor]) -> (CubeTensor, Vec<CubeTensor>) {
        let mut kept = Vec::new();
        let output = self.run(inputs, |hidden| kept.push(hidden.clone()));
        (output, kept)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (encoded, samples) = (&pass.inputs[0], pass.inputs[0].meta.shape()[0]);
        let (kept, values) = (pass.kept, self.parameters.values());
        let layers: Vec<Layer<'_>> = values.iter().map(layer).collect();
        let (trunk, heads) = layers.split_at(self.trunk);
        let [dsigma, drgb] = self.heads(pass.output);

        let (starts, numbers) = places(&layers, |index| match index {
            _ if index < self.trunk => true,
            _ if index == self.trunk => dsigma.is_some(),
            _ => drgb.is_some(),
        });
        let sums = pass.wanted[1].then(|| Gradients::new(encoded, samples, numbers));
        let add = |index: usize, x: Rows<'_>, dy: &CubeTensor| {
            if let (Some(sums), Some(starts)) = (&sums, starts[index]) {
                sums.add(&layers[index], x, dy, starts);
            }
        };
        let matrix = |columns: usize| empty(encoded, [samples, columns]);

        let h = &kept[self.trunk - 1];
        if let Some(dsigma) = &dsigma {
            add(self.trunk, Rows::of(h), dsigma);
        }
        let mut dy = matrix(heads[0].inputs);
        match (&drgb, heads, &kept[self.trunk..]) {
            (Some(drgb), [sigma, feature, view, rgb], [features, seen]) => {
                add(self.trunk + 3, Rows::of(seen), drgb);
                let dseen = empty_like(seen);
                rgb.input_gradient(0, drgb, Below::Function(seen, Activation::Relu), &dseen);
                add(self.trunk + 2, Rows::beside(features, &pass.inputs[2]), &dseen);
                let dfeatures = empty_like(features);
                view.input_gradient(0, &dseen, Below::Nothing, &dfeatures);
                add(self.trunk + 1, Rows::of(h), &dfeatures);
                let below = match &dsigma {
                    Some(dsigma) => Below::FunctionOfMore(h, Activation::Relu, [dsigma, sigma.weight.0]),
                    None => Below::Function(h, Activation::Relu),
                };
                feature.input_gradient(0, &dfeatures, below, &dy);
            }
            _ => {
                let dsigma = dsigma.as_ref().expect("density or colour has a gradient");
                heads[0].input_gradient(0, dsigma, Below::Function(h, Activation::Relu), &dy);
            }
        }

        let mut dencoded = None;
        for (index, layer) in trunk.iter().enumerate().rev() {
            let below = &kept[index.saturating_sub(1)];
            add(index, self.input(index, encoded, below), &dy);
            let sees_encoded = index == 0 || index == self.skip;
            if pass.wanted[0] && sees_encoded {
                let how = if dencoded.is_none() { Below::Nothing } else { Below::Shared };
                layer.input_gradient(0, &dy, how, dencoded.get_or_insert_with(|| empty_like(encoded)));
            }
            if index > 0 {
                let dbelow = empty_like(below);
                let first = if sees_encoded { layer.inputs - dbelow.meta.shape()[1] } else { 0 };
                layer.input_gradient(first, &dy, Below::Function(below, Activation::Relu), &dbelow);
                dy = dbelow;
            }
        }

        let dtoken = sums.map(|sums| {
            let all = sums.added_up();
            let part = |start, shape: &CubeTensor| part_or_copy(&all, start, shape.meta.shape().clone());
            let own = |(own, starts): (&[CubeTensor; 2], Option<Starts>)| match (own, starts) {
                ([weight, bias], Some([weight_start, bias_start])) => {
                    [part(weight_start, weight), part(bias_start, bias)]
                }
                (own, None) => own.each_ref().map(|own| zeros(own, own.meta.shape().clone())),
            };
            self.parameters.leave(values.iter().zip(starts).map(own).collect());
            all
        });
        vec![dencoded, dtoken, None]
    }
}

/// Takes the gradients of density and colour back through their functions, one thread for each number of the longer one.
#[cube(launch)]
fn heads_backward(
    density: &Tensor<f32>,
    color: &Tensor<f32>,
    ddensity: &Tensor<f32>,
    dcolor: &Tensor<f32>,
    dsigma: &mut Tensor<f32>,
    drgb: &mut Tensor<f32>,
    #[comptime] density_function: Activation,
    #[comptime] color_function: Activation,
    #[comptime] has_density: bool,
    #[comptime] has_color: bool,
) {
    let at = ABSOLUTE_POS;
    if comptime!(has_density) {
        if at < dsigma.len() {
            dsigma[at] = before_activation(density[at], ddensity[at], density_function);
        }
    }
    if comptime!(has_color) {
        if at < drgb.len() {
            drgb[at] = before_activation(color[at], dcolor[at], color_function);
        }
    }
}
