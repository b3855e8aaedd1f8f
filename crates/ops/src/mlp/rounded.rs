//! The rayon body of products in bfloat16: a block of samples goes through all layers, and back, without leaving the cache.
//!
//! The forward pass keeps nothing: the backward one computes the activations again, of those samples alone that a gradient
//! reaches. That is one more product for every two, and saves gigabytes.

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::{Dense, RadianceMlp};
use crate::bf16::{Factor, GRAIN, product};
use crate::frequency::encoded_width;
use crate::kernel::{Kernel, Pass};
use crate::simd::{self, Job};

/// Samples in a block.
const BLOCK: usize = 256;
/// Partial sums of the weights' gradient: a fixed number, so that the result does not depend on the number of threads.
const GROUPS: usize = 16;

/// The network as matrices of activations, each made from the one before:
///
/// ```text
/// x │ h₁ │ x h₂ │ … │ h_L │ σ feature direction │ h_view │ r g b
/// ```
///
/// A row is a sample. Each part is as wide as the next multiple of 32 and ends with zeros.
#[derive(Debug)]
pub(super) struct RoundedKernel {
    stages: Vec<Stage>,
    /// Width of x, and of an encoded direction.
    widths: [usize; 2],
    /// The ray of each sample, where directions are seen.
    owners: Vec<i32>,
    /// Where the result's columns come from: a matrix, whose first columns they are, and how many.
    outputs: Vec<(usize, usize)>,
}

/// A matrix of activations, and the layer that makes it.
#[derive(Debug, Default)]
struct Stage {
    columns: usize,
    /// The first of the columns that the layer makes, and how many there are.
    made: (usize, usize),
    /// The first column that the layer reads of the matrix before.
    reads: usize,
    relu: bool,
    /// Where its weights `[inputs, outputs]` and its biases `[1, outputs]` stand.
    weights: Vec<Piece>,
    biases: Vec<Piece>,
    /// What comes from outside, and at which column.
    outside: Option<(Outside, usize)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Outside {
    Encoded = 0,
    Direction = 1,
}

/// A matrix within the list of weights, and where it stands in one that is filled up with zeros.
#[derive(Clone, Copy, Debug)]
struct Piece {
    start: usize,
    rows: usize,
    columns: usize,
    at: [usize; 2],
}

impl Piece {
    /// (place in the list, row, column) of every element.
    fn elements(self) -> impl Iterator<Item = (usize, usize, usize)> {
        let Self { start, rows, columns, at } = self;
        (0..rows * columns).map(move |i| (start + i, at[0] + i / columns, at[1] + i % columns))
    }
}

fn filled(columns: usize) -> usize {
    columns.next_multiple_of(GRAIN)
}

/// Weights as they come.
#[derive(Default)]
struct List {
    tensors: Vec<Tensor<1>>,
    length: usize,
}

impl List {
    /// Pieces of a layer's weights, whose inputs are in parts of these widths, and of its biases; its outputs from `column` on.
    fn dense(&mut self, dense: &Dense, inputs: &[usize], column: usize) -> (Vec<Piece>, Piece) {
        let [rows, columns] = dense.weight.dims();
        assert_eq!(rows, inputs.iter().sum::<usize>(), "layers fit on top of each other");
        let (mut row, mut weights) = (0, Vec::new());
        for &rows in inputs {
            weights.push(Piece { start: self.length, rows, columns, at: [row, column] });
            self.length += rows * columns;
            row += filled(rows);
        }
        let bias = Piece { start: self.length, rows: 1, columns, at: [0, column] };
        self.length += columns;
        self.tensors.extend([dense.weight.clone().flatten(0, 1), dense.bias.clone()]);
        (weights, bias)
    }
}

impl RoundedKernel {
    /// The kernel for input of `[samples, width]`, and all weights one after another.
    pub(super) fn new([samples, width]: [usize; 2], network: &RadianceMlp) -> (Self, Tensor<1>) {
        let mut list = List::default();
        let x = filled(width);
        let mut stages = vec![Stage { columns: x, outside: Some((Outside::Encoded, 0)), ..Stage::default() }];
        let mut inputs = vec![width];
        for (index, dense) in network.trunk.iter().enumerate() {
            let outputs = dense.bias.dims()[0];
            // The next layer reads this one's output, with x before it where it skips.
            let skip = index + 1 == network.skip && network.skip < network.trunk.len();
            let first = if skip { x } else { 0 };
            let (weights, bias) = list.dense(dense, &inputs, 0);
            stages.push(Stage {
                columns: first + filled(outputs),
                made: (first, filled(outputs)),
                relu: true,
                weights,
                biases: vec![bias],
                outside: skip.then_some((Outside::Encoded, 0)),
                ..Stage::default()
            });
            inputs = if skip { vec![width, outputs] } else { vec![outputs] };
        }
        let (weights, bias) = list.dense(&network.sigma, &inputs, 0);
        let mut heads = Stage { columns: GRAIN, made: (0, GRAIN), weights, biases: vec![bias], ..Stage::default() };
        let (mut owners, mut directions, mut outputs) = (Vec::new(), 0, vec![(stages.len(), 1)]);
        if let Some(branch) = &network.color {
            let [features, views] = [&branch.feature, &branch.view].map(|dense| dense.bias.dims()[0]);
            directions = encoded_width(3, branch.frequencies);
            owners = branch.segments.host_owners().to_vec();
            assert_eq!(owners.len(), samples, "a ray for every sample");
            let (weights, bias) = list.dense(&branch.feature, &inputs, GRAIN);
            heads.weights.extend(weights);
            heads.biases.push(bias);
            let made = GRAIN + filled(features);
            heads.made.1 = made;
            heads.outside = Some((Outside::Direction, made));
            heads.columns = made + filled(directions);
            let (weights, bias) = list.dense(&branch.view, &[features, directions], 0);
            let view = Stage {
                columns: filled(views),
                made: (0, filled(views)),
                reads: GRAIN,
                relu: true,
                weights,
                biases: vec![bias],
                outside: None,
            };
            let (weights, bias) = list.dense(&branch.rgb, &[views], 0);
            let rgb = Stage { columns: GRAIN, made: (0, GRAIN), weights, biases: vec![bias], ..Stage::default() };
            stages.extend([heads, view, rgb]);
            outputs.push((stages.len() - 1, 3));
        } else {
            stages.push(heads);
        }
        (Self { stages, widths: [width, directions], owners, outputs }, Tensor::cat(list.tensors, 0))
    }

    /// Columns of the result.
    fn width(&self) -> usize {
        self.outputs.iter().map(|(_, columns)| columns).sum()
    }

    /// Rows of the matrix of weights that make `stage`.
    fn inputs(&self, stage: usize) -> usize {
        self.stages[stage - 1].columns - self.stages[stage].reads
    }

    /// Rounded weights and the biases of each layer, for products from these sides.
    fn layers(&self, weights: &[f32], left: bool) -> Vec<(Factor, Vec<f32>)> {
        let layer = |index: usize| {
            let stage = &self.stages[index];
            let outputs = stage.made.1;
            let spread = |pieces: &[Piece], rows: usize| {
                let mut matrix = vec![0.0; rows * outputs];
                for (from, row, column) in pieces.iter().flat_map(|piece| piece.elements()) {
                    matrix[row * outputs + column] = weights[from];
                }
                matrix
            };
            let matrix = spread(&stage.weights, self.inputs(index));
            (Factor::of(&matrix, outputs, left, true), spread(&stage.biases, 1))
        };
        (1..self.stages.len()).into_par_iter().map(layer).collect()
    }

    /// The activations of samples `rows`, and their results; `inputs` are x, the weights and the encoded direction of each ray.
    fn forward_block(
        &self,
        layers: &[(Factor, Vec<f32>)],
        inputs: &[&[f32]],
        rows: impl ExactSizeIterator<Item = usize> + Clone,
        block: &mut Block,
        mut out: Option<&mut [f32]>,
    ) {
        let samples = rows.len();
        for (index, stage) in self.stages.iter().enumerate() {
            let ((first, made), columns) = (stage.made, stage.columns);
            for strip in (0..samples).step_by(GRAIN) {
                let y = &mut block.strip[..GRAIN * columns];
                if let Some((weights, bias)) = index.checked_sub(1).map(|layer| &layers[layer]) {
                    let x = block.stages[index - 1].left(strip, stage.reads);
                    let sizes = [GRAIN, made, self.inputs(index)];
                    product(sizes, false, (&mut y[first..], columns), x, weights.right(0, 0));
                    let signs = &mut block.signs[index];
                    simd::run(Finish { y, columns, first, bias, relu: stage.relu, strip, signs });
                }
                if let Some((outside, at)) = stage.outside {
                    let width = self.widths[outside as usize];
                    y.chunks_exact_mut(columns).for_each(|y| y[at..at + filled(width)].fill(0.0));
                    for (sample, y) in rows.clone().skip(strip).zip(y.chunks_exact_mut(columns)) {
                        let (from, row) = match outside {
                            Outside::Encoded => (inputs[0], sample),
                            Outside::Direction => (inputs[2], self.owners[sample] as usize),
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

    /// Adds a block's part to the gradients, `rows` being counted within the group, and `grad` being theirs.
    fn backward_block(
        &self,
        layers: &[(Factor, Vec<f32>)],
        grad: &[f32],
        rows: &[usize],
        block: &mut Block,
        sums: &mut Gradients,
    ) {
        let samples = filled(rows.len());
        for (index, stage) in self.stages.iter().enumerate().rev() {
            let [slopes, slopes_above] = &mut block.slopes;
            let above = self.stages.get(index + 1).map(|above| (above, &layers[index].0, &*slopes_above));
            let x_wanted = matches!(stage.outside, Some((Outside::Encoded, _))) && sums.dencoded.is_some();
            let product_of = |column: usize, strip: &mut [f32]| match above {
                Some((above, weights, dy)) if column >= above.reads => {
                    let sizes = [GRAIN, samples, above.made.1];
                    product(sizes, false, (strip, samples), weights.left(column - above.reads, 0), dy.right(0, 0));
                }
                _ => strip.fill(0.0),
            };
            let strip = &mut block.strip[..GRAIN * samples];
            if let Some((Outside::Encoded, at)) = stage.outside.filter(|_| x_wanted) {
                let width = self.widths[0];
                for column in (0..width).step_by(GRAIN) {
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
            let (first, made) = stage.made;
            slopes.columns = samples;
            for column in (0..made).step_by(GRAIN) {
                product_of(first + column, strip);
                let mut from = 0;
                for &(output, count) in &self.outputs {
                    for c in (0..count).filter(|_| output == index && column == 0) {
                        let grad = grad.chunks_exact(self.width()).map(|grad| grad[from + c]);
                        strip[c * samples..].iter_mut().zip(grad).for_each(|(dy, grad)| *dy += grad);
                    }
                    from += count;
                }
                let signs = stage.relu.then(|| &block.signs[index][column / GRAIN * BLOCK..][..samples]);
                let db = &mut sums.biases[index - 1][column..column + GRAIN];
                simd::run(Slopes { dy: strip, samples, signs, db });
                slopes.set(column, strip);
            }
            let x = block.stages[index - 1].right(0, stage.reads);
            let sizes = [made, self.inputs(index), samples];
            product(sizes, true, (&mut sums.weights[index - 1], sizes[1]), slopes.left(0, 0), x);
            block.slopes.swap(0, 1);
        }
    }

    /// The gradients of a group of samples from `first` on. Samples whose output has no gradient add exactly 0 and are left out.
    fn backward_group(
        &self,
        layers: &[(Factor, Vec<f32>)],
        inputs: &[&[f32]],
        first: usize,
        grad: &[f32],
        dencoded: bool,
    ) -> Gradients {
        let outputs = self.width();
        let mut sums = Gradients {
            weights: (1..self.stages.len()).map(|i| vec![0.0; self.stages[i].made.1 * self.inputs(i)]).collect(),
            biases: self.stages[1..].iter().map(|stage| vec![0.0; stage.made.1]).collect(),
            dencoded: dencoded.then(|| vec![0.0; grad.len() / outputs * self.widths[0]]),
        };
        // Not a number counts as reached.
        let reached = grad.chunks_exact(outputs).enumerate().filter(|(_, grad)| grad.iter().any(|g| *g != 0.0));
        let (rows, grads): (Vec<usize>, Vec<&[f32]>) = reached.unzip();
        let mut block = Block::new(&self.stages, true);
        for (rows, grads) in rows.chunks(BLOCK).zip(grads.chunks(BLOCK)) {
            self.forward_block(layers, inputs, rows.iter().map(|row| first + row), &mut block, None);
            self.backward_block(layers, &grads.concat(), rows, &mut block, &mut sums);
        }
        sums
    }
}

/// What a block of samples goes through.
struct Block {
    /// 32 rows of whatever is at hand, before it is rounded.
    strip: Vec<f32>,
    stages: Vec<Factor>,
    /// Bit f of number s of row r says whether a ReLU lets the gradient of feature 32 r + f of sample s pass.
    signs: Vec<Vec<u32>>,
    /// dy of the layer at hand and of the one above it, a row for each feature.
    slopes: [Factor; 2],
}

impl Block {
    fn new(stages: &[Stage], backward: bool) -> Self {
        let widest = stages.iter().map(|stage| stage.columns).max().unwrap_or(0);
        let signs = |stage: &Stage| vec![0; if backward && stage.relu { stage.made.1 / GRAIN * BLOCK } else { 0 }];
        Self {
            strip: vec![0.0; GRAIN * widest.max(BLOCK)],
            stages: stages.iter().map(|stage| Factor::new(BLOCK, stage.columns, true, backward)).collect(),
            signs: stages.iter().map(signs).collect(),
            slopes: [(); 2].map(|()| if backward { Factor::new(widest, BLOCK, true, true) } else { Factor::default() }),
        }
    }
}

/// The gradients of a group of samples.
struct Gradients {
    /// Of each layer, `[outputs, inputs]`.
    weights: Vec<Vec<f32>>,
    biases: Vec<Vec<f32>>,
    /// With respect to x, if that is wanted.
    dencoded: Option<Vec<f32>>,
}

/// Adds biases to a strip of 32 rows, and bends it.
struct Finish<'a> {
    y: &'a mut [f32],
    columns: usize,
    first: usize,
    bias: &'a [f32],
    relu: bool,
    /// The strip's first sample.
    strip: usize,
    /// Empty if no gradient will be asked for.
    signs: &'a mut [u32],
}

impl Job for Finish<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { y, columns, first, bias, relu, strip, signs } = self;
        for (r, y) in y.chunks_exact_mut(columns).enumerate() {
            for (part, bias) in bias.chunks_exact(GRAIN).enumerate() {
                let y = &mut y[first + GRAIN * part..][..GRAIN];
                for i in 0..GRAIN {
                    let sum = y[i] + bias[i];
                    // NaN stays NaN, and so does its gradient.
                    y[i] = if relu && sum < 0.0 { 0.0 } else { sum };
                }
                if let Some(signs) = signs.get_mut(part * BLOCK + strip + r) {
                    *signs = (0..GRAIN).fold(0, |signs, i| signs | u32::from(y[i] > 0.0 || y[i].is_nan()) << i);
                }
            }
        }
    }
}

/// Takes what does not pass a ReLU from the gradients of 32 features, and adds those of their biases.
struct Slopes<'a> {
    dy: &'a mut [f32],
    samples: usize,
    signs: Option<&'a [u32]>,
    db: &'a mut [f32],
}

impl Job for Slopes<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { dy, samples, signs, db } = self;
        for (feature, (dy, db)) in dy.chunks_exact_mut(samples).zip(db).enumerate() {
            let mut sums = [0f32; GRAIN];
            for at in (0..samples).step_by(GRAIN) {
                let dy = &mut dy[at..at + GRAIN];
                if let Some(signs) = signs {
                    let signs = &signs[at..at + GRAIN];
                    for i in 0..GRAIN {
                        dy[i] = if signs[i] >> feature & 1 == 1 { dy[i] } else { 0.0 };
                    }
                }
                for i in 0..GRAIN {
                    sums[i] += dy[i];
                }
            }
            *db += sums.iter().sum::<f32>();
        }
    }
}

impl Kernel for RoundedKernel {
    fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
        vec![inputs[0][0], self.width()]
    }

    fn forward(&self, inputs: &[&[f32]], saved: Option<&mut Vec<f32>>) -> Vec<f32> {
        saved.into_iter().for_each(Vec::clear);
        let samples = inputs[0].len() / self.widths[0];
        let mut out = vec![0.0; samples * self.width()];
        let layers = self.layers(inputs[1], false);
        out.par_chunks_mut(self.width() * BLOCK).enumerate().for_each_init(
            || Block::new(&self.stages, false),
            |block, (index, out)| {
                let first = index * BLOCK;
                let rows = first..samples.min(first + BLOCK);
                self.forward_block(&layers, inputs, rows, block, Some(out));
            },
        );
        out
    }

    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
        let weights = pass.inputs[1];
        let layers = self.layers(weights, true);
        let samples = pass.grad.len() / self.width();
        let per_group = samples.div_ceil(BLOCK).div_ceil(GROUPS).max(1) * BLOCK;
        let grads = pass.grad.par_chunks(self.width() * per_group).enumerate();
        let groups: Vec<Gradients> = grads
            .map(|(group, grad)| self.backward_group(&layers, pass.inputs, group * per_group, grad, wanted[0]))
            .collect();
        let dencoded =
            wanted[0].then(|| groups.iter().filter_map(|part| part.dencoded.as_deref()).flatten().copied().collect());
        let dweights = wanted[1].then(|| {
            let mut sum = vec![0.0; weights.len()];
            for (index, stage) in self.stages.iter().enumerate().skip(1) {
                let inputs = self.inputs(index);
                for part in &groups {
                    for (to, row, column) in stage.weights.iter().flat_map(|piece| piece.elements()) {
                        sum[to] += part.weights[index - 1][column * inputs + row];
                    }
                    for (to, _, column) in stage.biases.iter().flat_map(|piece| piece.elements()) {
                        sum[to] += part.biases[index - 1][column];
                    }
                }
            }
            sum
        });
        let gradients = [dencoded, dweights, None];
        gradients.into_iter().take(pass.inputs.len()).collect()
    }
}
