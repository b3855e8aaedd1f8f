//! Host kernel of a radiance network with products in bfloat16: a block of samples goes through all layers, and back, without
//! leaving the cache.
//!
//! The forward pass keeps no activations. The backward pass recomputes them for the samples that have a gradient: three
//! products per layer instead of two, and gigabytes less memory.

use rayon::prelude::*;

use super::stages::{MlpStage, NetworkInput, Piece, padded, pieces};
use super::{Factor, SIZE_MULTIPLE, product};
use crate::frequency::encoded_width;
use crate::host::simd::{self, Job};
use crate::host::{Kernel, PARTIAL_SUMS, Pass};
use crate::mlp::RadianceMlp;

const BLOCK: usize = 256;

/// Network as matrices of activations, each computed from the one before:
///
/// ```text
/// x │ h₁ │ x h₂ │ … │ h_L │ σ feature direction │ h_view │ r g b
/// ```
///
/// Rows are samples. The width of each part is padded with zeros to the next multiple of 32.
#[derive(Debug)]
pub(crate) struct RoundedMlpKernel {
    stages: Vec<MlpStage>,
    /// Width of x, and of an encoded direction.
    widths: [usize; 2],
    /// Ray of each sample, if directions are an input.
    owners: Vec<i32>,
    /// Sources of the result's columns: index of a matrix, and number of its first columns that are copied.
    outputs: Vec<(usize, usize)>,
}

impl RoundedMlpKernel {
    /// Returns the kernel for input of `[samples, width]`. Its inputs are x, weights and biases of each of
    /// [`RadianceMlp::layers`], and the encoded direction of each ray if the network has colour.
    pub(crate) fn new([samples, width]: [usize; 2], network: &RadianceMlp) -> Self {
        let trunk = network.trunk.len();
        let x = padded(width);
        let mut stages =
            vec![MlpStage { columns: x, network_input: Some((NetworkInput::Encoded, 0)), ..MlpStage::default() }];
        let mut inputs = vec![width];
        for (index, dense) in network.trunk.iter().enumerate() {
            let outputs = dense.bias.dims()[0];
            // The layer with the skip connection reads x, then the output of this layer.
            let skip = index + 1 == network.skip && network.skip < network.trunk.len();
            let first = if skip { x } else { 0 };
            let stage = MlpStage::new((first, padded(outputs)), true, pieces(dense, index, &inputs, 0));
            stages.push(MlpStage { network_input: skip.then_some((NetworkInput::Encoded, 0)), ..stage });
            inputs = if skip { vec![width, outputs] } else { vec![outputs] };
        }
        let sigma = trunk + if network.color.is_some() { 2 } else { 0 };
        let mut heads = MlpStage::new((0, SIZE_MULTIPLE), false, pieces(&network.sigma, sigma, &inputs, 0));
        let (mut owners, mut directions, mut outputs) = (Vec::new(), 0, vec![(stages.len(), 1)]);
        if let Some(branch) = &network.color {
            let [features, views] = [&branch.feature, &branch.view].map(|dense| dense.bias.dims()[0]);
            directions = encoded_width(3, branch.frequencies);
            owners = branch.segments.host_owners();
            assert_eq!(owners.len(), samples, "a ray for every sample");
            let (weights, bias) = pieces(&branch.feature, trunk, &inputs, SIZE_MULTIPLE);
            heads.weights.extend(weights);
            heads.biases.push(bias);
            let computed = SIZE_MULTIPLE + padded(features);
            heads.columns_computed.1 = computed;
            heads.network_input = Some((NetworkInput::Direction, computed));
            heads.columns = computed + padded(directions);
            let view = pieces(&branch.view, trunk + 1, &[features, directions], 0);
            let view = MlpStage { first_input_column: SIZE_MULTIPLE, ..MlpStage::new((0, padded(views)), true, view) };
            let rgb = MlpStage::new((0, SIZE_MULTIPLE), false, pieces(&branch.rgb, trunk + 3, &[views], 0));
            stages.extend([heads, view, rgb]);
            outputs.push((stages.len() - 1, 3));
        } else {
            stages.push(heads);
        }
        Self { stages, widths: [width, directions], owners, outputs }
    }

    fn width(&self) -> usize {
        self.outputs.iter().map(|(_, columns)| columns).sum()
    }

    /// Returns the number of rows of the weights of `stage`.
    fn inputs(&self, stage: usize) -> usize {
        self.stages[stage - 1].columns - self.stages[stage].first_input_column
    }

    /// Rounds the weights of each layer, for products on the given side, and lists its biases.
    fn layers(&self, parameters: &[&[f32]], left: bool) -> Vec<(Factor, Vec<f32>)> {
        let layer = |index: usize| {
            let stage = &self.stages[index];
            let outputs = stage.columns_computed.1;
            let spread = |pieces: &[Piece], rows: usize| {
                let mut matrix = vec![0.0; rows * outputs];
                for piece in pieces {
                    for (from, row, column) in piece.elements() {
                        matrix[row * outputs + column] = parameters[piece.parameter][from];
                    }
                }
                matrix
            };
            let matrix = spread(&stage.weights, self.inputs(index));
            (Factor::of(&matrix, outputs, left, true), spread(&stage.biases, 1))
        };
        (1..self.stages.len()).into_par_iter().map(layer).collect()
    }

    fn forward_block(
        &self,
        layers: &[(Factor, Vec<f32>)],
        inputs: &[&[f32]],
        rows: impl ExactSizeIterator<Item = usize> + Clone,
        block: &mut BlockBuffers,
        mut out: Option<&mut [f32]>,
    ) {
        let samples = rows.len();
        for (index, stage) in self.stages.iter().enumerate() {
            let ((first, computed), columns) = (stage.columns_computed, stage.columns);
            for strip in (0..samples).step_by(SIZE_MULTIPLE) {
                let y = &mut block.strip[..SIZE_MULTIPLE * columns];
                if let Some((weights, bias)) = index.checked_sub(1).map(|layer| &layers[layer]) {
                    let x = block.stages[index - 1].left(strip, stage.first_input_column);
                    let sizes = [SIZE_MULTIPLE, computed, self.inputs(index)];
                    product(sizes, false, (&mut y[first..], columns), x, weights.right(0, 0));
                    let signs = &mut block.signs[index];
                    simd::run(Finish { y, columns, first, bias, relu: stage.relu, strip, signs });
                }
                if let Some((network_input, at)) = stage.network_input {
                    let width = self.widths[network_input as usize];
                    y.chunks_exact_mut(columns).for_each(|y| y[at..at + padded(width)].fill(0.0));
                    for (sample, y) in rows.clone().skip(strip).zip(y.chunks_exact_mut(columns)) {
                        let (from, row) = match network_input {
                            NetworkInput::Encoded => (inputs[0], sample),
                            NetworkInput::Direction => (inputs[inputs.len() - 1], self.owners[sample] as usize),
                        };
                        y[at..at + width].copy_from_slice(&from[row * width..][..width]);
                    }
                }
                let mut column = 0;
                for &(from, count) in &self.outputs {
                    if let Some(out) = out.as_deref_mut().filter(|_| from == index) {
                        let out = out[strip * self.width()..].chunks_exact_mut(self.width());
                        for (out, y) in out.zip(y.chunks_exact(columns)) {
                            out[column..column + count].copy_from_slice(&y[..count]);
                        }
                    }
                    column += count;
                }
                if index + 1 < self.stages.len() {
                    block.stages[index].set(strip, y);
                }
            }
        }
    }

    /// Adds a block's gradients to `sums`. `rows` are indices of samples in the group, `grad` the gradients of their outputs.
    fn backward_block(
        &self,
        layers: &[(Factor, Vec<f32>)],
        grad: &[f32],
        rows: &[usize],
        block: &mut BlockBuffers,
        sums: &mut Gradients,
    ) {
        let samples = padded(rows.len());
        for (index, stage) in self.stages.iter().enumerate().rev() {
            let [dy, dy_above] = &mut block.dy;
            let above = self.stages.get(index + 1).map(|above| (above, &layers[index].0, &*dy_above));
            let x_wanted = matches!(stage.network_input, Some((NetworkInput::Encoded, _))) && sums.dencoded.is_some();
            let product_of = |column: usize, strip: &mut [f32]| match above {
                Some((above, weights, dy)) if column >= above.first_input_column => {
                    let sizes = [SIZE_MULTIPLE, samples, above.columns_computed.1];
                    let weights = weights.left(column - above.first_input_column, 0);
                    product(sizes, false, (strip, samples), weights, dy.right(0, 0));
                }
                _ => strip.fill(0.0),
            };
            let strip = &mut block.strip[..SIZE_MULTIPLE * samples];
            if let Some((NetworkInput::Encoded, at)) = stage.network_input.filter(|_| x_wanted) {
                let width = self.widths[0];
                for column in (0..width).step_by(SIZE_MULTIPLE) {
                    product_of(at + column, strip);
                    for (c, strip) in (column..width).zip(strip.chunks_exact(samples)) {
                        let dx = sums.dencoded.as_mut().expect("is wanted");
                        rows.iter().zip(strip).for_each(|(row, d)| dx[row * width + c] += d);
                    }
                }
            }
            if index == 0 {
                break;
            }
            let (first, computed) = stage.columns_computed;
            dy.columns = samples;
            for column in (0..computed).step_by(SIZE_MULTIPLE) {
                product_of(first + column, strip);
                let mut from = 0;
                for &(output, count) in &self.outputs {
                    for c in (0..count).filter(|_| output == index && column == 0) {
                        let grad = grad.chunks_exact(self.width()).map(|grad| grad[from + c]);
                        strip[c * samples..].iter_mut().zip(grad).for_each(|(dy, grad)| *dy += grad);
                    }
                    from += count;
                }
                let signs = stage.relu.then(|| &block.signs[index][column / SIZE_MULTIPLE * BLOCK..][..samples]);
                let db = &mut sums.biases[index - 1][column..column + SIZE_MULTIPLE];
                simd::run(ReluGradient { dy: strip, samples, signs, db });
                dy.set(column, strip);
            }
            let x = block.stages[index - 1].right(0, stage.first_input_column);
            let sizes = [computed, self.inputs(index), samples];
            product(sizes, true, (&mut sums.weights[index - 1], sizes[1]), dy.left(0, 0), x);
            block.dy.swap(0, 1);
        }
    }

    /// Computes the gradients of a group of samples from `first` on, without samples whose output has no gradient: they add 0.
    fn backward_group(
        &self,
        layers: &[(Factor, Vec<f32>)],
        inputs: &[&[f32]],
        first: usize,
        grad: &[f32],
        dencoded: bool,
    ) -> Gradients {
        let outputs = self.width();
        let weights = |stage: usize| vec![0.0; self.stages[stage].columns_computed.1 * self.inputs(stage)];
        let mut sums = Gradients {
            weights: (1..self.stages.len()).map(weights).collect(),
            biases: self.stages[1..].iter().map(|stage| vec![0.0; stage.columns_computed.1]).collect(),
            dencoded: dencoded.then(|| vec![0.0; grad.len() / outputs * self.widths[0]]),
        };
        // NaN counts as a gradient.
        let nonzero = grad.chunks_exact(outputs).enumerate().filter(|(_, grad)| grad.iter().any(|g| *g != 0.0));
        let (rows, grads): (Vec<usize>, Vec<&[f32]>) = nonzero.unzip();
        let mut block = BlockBuffers::new(&self.stages, true);
        for (rows, grads) in rows.chunks(BLOCK).zip(grads.chunks(BLOCK)) {
            self.forward_block(layers, inputs, rows.iter().map(|row| first + row), &mut block, None);
            self.backward_block(layers, &grads.concat(), rows, &mut block, &mut sums);
        }
        sums
    }
}

struct BlockBuffers {
    /// 32 rows of the current matrix, before they are rounded.
    strip: Vec<f32>,
    stages: Vec<Factor>,
    /// Signs of each ReLU's outputs: bit f of element s of row r is 1 if the gradient of feature 32 r + f of sample s passes.
    signs: Vec<Vec<u32>>,
    /// dy of the current layer and of the layer above it, one row per feature.
    dy: [Factor; 2],
}

impl BlockBuffers {
    fn new(stages: &[MlpStage], backward: bool) -> Self {
        let widest = stages.iter().map(|stage| stage.columns).max().unwrap_or(0);
        let signs = |stage: &MlpStage| {
            vec![0; if backward && stage.relu { stage.columns_computed.1 / SIZE_MULTIPLE * BLOCK } else { 0 }]
        };
        Self {
            strip: vec![0.0; SIZE_MULTIPLE * widest.max(BLOCK)],
            stages: stages.iter().map(|stage| Factor::new(BLOCK, stage.columns, true, backward)).collect(),
            signs: stages.iter().map(signs).collect(),
            dy: [(); 2].map(|()| if backward { Factor::new(widest, BLOCK, true, true) } else { Factor::default() }),
        }
    }
}

struct Gradients {
    /// Gradient of each layer's weights, `[outputs, inputs]`.
    weights: Vec<Vec<f32>>,
    biases: Vec<Vec<f32>>,
    dencoded: Option<Vec<f32>>,
}

/// Adds biases to a strip of 32 rows, and applies the ReLU.
struct Finish<'a> {
    y: &'a mut [f32],
    columns: usize,
    first: usize,
    bias: &'a [f32],
    relu: bool,
    /// First sample of the strip.
    strip: usize,
    /// Signs of the outputs; empty if no backward pass follows.
    signs: &'a mut [u32],
}

impl Job for Finish<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { y, columns, first, bias, relu, strip, signs } = self;
        for (r, y) in y.chunks_exact_mut(columns).enumerate() {
            for (part, bias) in bias.chunks_exact(SIZE_MULTIPLE).enumerate() {
                let y = &mut y[first + SIZE_MULTIPLE * part..][..SIZE_MULTIPLE];
                for i in 0..SIZE_MULTIPLE {
                    let sum = y[i] + bias[i];
                    // NaN stays NaN, and so does its gradient.
                    y[i] = if relu && sum < 0.0 { 0.0 } else { sum };
                }
                if let Some(signs) = signs.get_mut(part * BLOCK + strip + r) {
                    *signs = (0..SIZE_MULTIPLE).fold(0, |signs, i| signs | u32::from(y[i] > 0.0 || y[i].is_nan()) << i);
                }
            }
        }
    }
}

/// Clears the gradients of 32 features where the ReLU is 0, and adds up the gradients of their biases.
struct ReluGradient<'a> {
    dy: &'a mut [f32],
    samples: usize,
    signs: Option<&'a [u32]>,
    db: &'a mut [f32],
}

impl Job for ReluGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { dy, samples, signs, db } = self;
        for (feature, (dy, db)) in dy.chunks_exact_mut(samples).zip(db).enumerate() {
            let mut sums = [0f32; SIZE_MULTIPLE];
            for at in (0..samples).step_by(SIZE_MULTIPLE) {
                let dy = &mut dy[at..at + SIZE_MULTIPLE];
                if let Some(signs) = signs {
                    let signs = &signs[at..at + SIZE_MULTIPLE];
                    for i in 0..SIZE_MULTIPLE {
                        dy[i] = if signs[i] >> feature & 1 == 1 { dy[i] } else { 0.0 };
                    }
                }
                for i in 0..SIZE_MULTIPLE {
                    sums[i] += dy[i];
                }
            }
            *db += sums.iter().sum::<f32>();
        }
    }
}

impl Kernel for RoundedMlpKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let samples = inputs[0].len() / self.widths[0];
        let mut out = vec![0.0; samples * self.width()];
        let layers = self.layers(&inputs[1..], false);
        out.par_chunks_mut(self.width() * BLOCK).enumerate().for_each_init(
            || BlockBuffers::new(&self.stages, false),
            |block, (index, out)| {
                let first = index * BLOCK;
                let rows = first..samples.min(first + BLOCK);
                self.forward_block(&layers, inputs, rows, block, Some(out));
            },
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        // Pairs of weights and biases, without encoded directions.
        let parameters = pass.inputs[1..].as_chunks::<2>().0.as_flattened();
        let layers = self.layers(parameters, true);
        let samples = pass.grad.len() / self.width();
        let per_group = samples.div_ceil(BLOCK).div_ceil(PARTIAL_SUMS).max(1) * BLOCK;
        let grads = pass.grad.par_chunks(self.width() * per_group).enumerate();
        let groups: Vec<Gradients> = grads
            .map(|(group, grad)| self.backward_group(&layers, pass.inputs, group * per_group, grad, pass.wanted[0]))
            .collect();
        let dencoded = pass.wanted[0]
            .then(|| groups.iter().filter_map(|part| part.dencoded.as_deref()).flatten().copied().collect());
        let mut sums: Vec<Vec<f32>> = parameters.iter().map(|parameter| vec![0.0; parameter.len()]).collect();
        for (index, stage) in self.stages.iter().enumerate().skip(1) {
            let inputs = self.inputs(index);
            for part in &groups {
                for piece in &stage.weights {
                    for (to, row, column) in piece.elements() {
                        sums[piece.parameter][to] += part.weights[index - 1][column * inputs + row];
                    }
                }
                for piece in &stage.biases {
                    for (to, _, column) in piece.elements() {
                        sums[piece.parameter][to] += part.biases[index - 1][column];
                    }
                }
            }
        }
        std::iter::once(dencoded).chain(sums.into_iter().map(Some)).collect()
    }
}
