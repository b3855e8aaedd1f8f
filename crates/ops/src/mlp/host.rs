//! Host kernel of [`radiance_mlp`](super::radiance_mlp): a block of samples goes through all layers without leaving the cache.

use rayon::prelude::*;

use super::{Dense, RadianceMlp};
use crate::frequency::encoded_width;
use crate::host::buffers::{Scratch, each_with_buffer};
use crate::host::matmul::{InitialSum, Matrix, product};
use crate::host::{Kernel, PARTIAL_SUMS, Pass};

/// Samples in a block: enough for matrix products to be efficient, few enough for two layers to fit into the cache.
const BLOCK: usize = 256;

/// Network as a list of layers, which read and write columns of the *activations* of a block of samples:
///
/// ```text
/// x | h₁ | x h₂ | … | h_L | feature direction | h_view | σ r g b
/// ```
///
/// Each part between two bars is a matrix of [`BLOCK`] rows. The inputs of a layer are adjacent columns, so x is repeated
/// if the trunk reads it again.
#[derive(Debug, Default)]
pub(super) struct MlpKernel {
    layers: Vec<PlacedLayer>,
    encoded: Vec<Columns>,
    direction: Option<Columns>,
    /// Ray of each sample, if directions are an input.
    owners: Vec<i32>,
    output: Columns,
    matrices: Vec<Columns>,
    /// Elements of a block.
    activations: usize,
}

/// Adjacent columns of a matrix of [`BLOCK`] rows within a block's activations.
#[derive(Clone, Copy, Debug, Default)]
struct Columns {
    start: usize,
    stride: usize,
    columns: usize,
}

impl Columns {
    fn matrix(self) -> Matrix {
        Matrix::rows(self.start, self.stride)
    }

    fn row(self, sample: usize) -> std::ops::Range<usize> {
        let start = self.start + sample * self.stride;
        start..start + self.columns
    }

    /// Returns `columns` of these columns from the `first` on.
    fn part(self, first: usize, columns: usize) -> Self {
        Self { start: self.start + first, columns, ..self }
    }
}

#[derive(Debug)]
struct PlacedLayer {
    x: Columns,
    y: Columns,
    relu: bool,
    /// Whether a layer further up also reads x.
    shared: bool,
}

impl MlpKernel {
    fn matrix(&mut self, columns: usize) -> Columns {
        let place = Columns { start: self.activations, stride: columns, columns };
        self.activations += columns * BLOCK;
        self.matrices.push(place);
        place
    }

    fn layer(&mut self, dense: &Dense, x: Columns, y: Columns, relu: bool) {
        assert_eq!(dense.weight.dims(), [x.columns, y.columns], "layers fit on top of each other");
        self.layers.iter_mut().filter(|layer| layer.x.start == x.start).for_each(|layer| layer.shared = true);
        self.layers.push(PlacedLayer { x, y, relu, shared: false });
    }

    /// Returns the kernel for input of `[samples, width]`. Its inputs are x, weights and biases of each of
    /// [`RadianceMlp::layers`], and the encoded direction of each ray if the network has colour.
    pub(super) fn new([samples, width]: [usize; 2], network: &RadianceMlp) -> Self {
        let mut kernel = Self::default();
        let mut x = kernel.matrix(width);
        kernel.encoded.push(x);
        for (index, dense) in network.trunk.iter().enumerate() {
            let [_, outputs] = dense.weight.dims();
            // The next layer reads this one's output, with x before it where it skips.
            let skip = index + 1 == network.skip && network.skip < network.trunk.len();
            let before = if skip { width } else { 0 };
            let next = kernel.matrix(before + outputs);
            kernel.encoded.extend(skip.then(|| next.part(0, width)));
            kernel.layer(dense, x, next.part(before, outputs), true);
            x = next;
        }
        let view = network.color.as_ref().map(|branch| {
            let [_, features] = branch.feature.weight.dims();
            let [_, outputs] = branch.view.weight.dims();
            let columns = encoded_width(3, branch.frequencies);
            let both = kernel.matrix(features + columns);
            let view = kernel.matrix(outputs);
            kernel.layer(&branch.feature, x, both.part(0, features), false);
            kernel.layer(&branch.view, both, view, true);
            kernel.direction = Some(both.part(features, columns));
            kernel.owners = branch.segments.host_owners();
            assert_eq!(kernel.owners.len(), samples, "a ray for every sample");
            (view, branch)
        });
        let output = kernel.matrix(if view.is_some() { 4 } else { 1 });
        kernel.layer(&network.sigma, x, output.part(0, 1), false);
        if let Some((view, branch)) = view {
            kernel.layer(&branch.rgb, view, output.part(1, 3), false);
        }
        Self { output, ..kernel }
    }

    /// Returns a zero for each weight and each bias of every layer.
    fn zeros(&self) -> Vec<[Vec<f32>; 2]> {
        let sizes = |layer: &PlacedLayer| [layer.x.columns * layer.y.columns, layer.y.columns];
        self.layers.iter().map(|layer| sizes(layer).map(|size| vec![0.0; size])).collect()
    }

    /// Evaluates a block whose first sample is `first` and whose rows of x are `encoded`.
    fn forward_block(&self, inputs: &[&[f32]], encoded: &[f32], first: usize, block: &mut [f32], out: &mut [f32]) {
        let width = self.encoded[0].columns;
        let samples = encoded.len() / width;
        for place in &self.encoded {
            for (s, x) in encoded.chunks_exact(width).enumerate() {
                block[place.row(s)].copy_from_slice(x);
            }
        }
        if let Some(place) = self.direction {
            let directions = inputs[inputs.len() - 1];
            for (s, &owner) in self.owners[first..first + samples].iter().enumerate() {
                let direction = &directions[owner as usize * place.columns..][..place.columns];
                block[place.row(s)].copy_from_slice(direction);
            }
        }
        let parameters = inputs[1..].as_chunks::<2>().0;
        for (layer, [weights, bias]) in self.layers.iter().zip(parameters) {
            // A layer's inputs always precede its outputs.
            let (before, after) = block.split_at_mut(layer.y.start);
            let y = Columns { start: 0, ..layer.y };
            let sizes = [samples, layer.y.columns, layer.x.columns];
            let (x, w) = ((&*before, layer.x.matrix()), (*weights, Matrix::rows(0, layer.y.columns)));
            product(sizes, InitialSum::Bias(bias), (after, y.matrix()), x, w);
            for s in (0..samples).filter(|_| layer.relu) {
                for y in &mut after[y.row(s)] {
                    // Not `f32::max`, which would turn NaN into 0.
                    *y = if *y < 0.0 { 0.0 } else { *y };
                }
            }
        }
        for (s, out) in out.chunks_exact_mut(self.output.columns).enumerate() {
            out.copy_from_slice(&block[self.output.row(s)]);
        }
    }

    /// Transposes each layer's weights to `[outputs, inputs]`.
    fn transposed(&self, inputs: &[&[f32]]) -> Vec<Vec<f32>> {
        let weights = inputs[1..].iter().step_by(2);
        let transpose = |(layer, weights): (&PlacedLayer, &&[f32])| {
            let (inputs, outputs) = (layer.x.columns, layer.y.columns);
            (0..inputs * outputs).map(|at| weights[at % inputs * outputs + at / inputs]).collect()
        };
        self.layers.iter().zip(weights).map(transpose).collect()
    }

    /// Adds a block's share to the gradients; its samples are `rows`, counted within the group.
    fn backward_block(
        &self,
        transposed: &[Vec<f32>],
        block: &[f32],
        grad: &[f32],
        rows: &[usize],
        sums: &mut GroupGradients,
    ) {
        let GroupGradients { dparameters, dencoded, dactivations: gradients } = sums;
        let samples = grad.len() / self.output.columns;
        for (s, grad) in grad.chunks_exact(self.output.columns).enumerate() {
            gradients[self.output.row(s)].copy_from_slice(grad);
        }
        let layers = self.layers.iter().zip(transposed).zip(dparameters.iter_mut());
        for ((layer, transposed), [dweights, dbias]) in layers.rev() {
            let (below, above) = gradients.split_at_mut(layer.y.start);
            let y = Columns { start: 0, ..layer.y };
            for s in 0..samples {
                let dy = &mut above[y.row(s)];
                if layer.relu {
                    let outputs = &block[layer.y.row(s)];
                    dy.iter_mut().zip(outputs).for_each(|(dy, y)| *dy = if *y <= 0.0 { 0.0 } else { *dy });
                }
                dbias.iter_mut().zip(&*dy).for_each(|(db, dy)| *db += dy);
            }
            let dy = (&*above, y.matrix());
            let x = (block, layer.x.matrix().transposed());
            let sizes = [layer.x.columns, layer.y.columns, samples];
            product(sizes, InitialSum::Previous, (dweights, Matrix::rows(0, layer.y.columns)), x, dy);
            // x itself is rarely a parameter: its columns, the first that a layer reads, are then left out.
            let own = self.encoded.iter().any(|place| place.start == layer.x.start);
            let skipped = if own && dencoded.is_none() { self.encoded[0].columns } else { 0 };
            let dx = layer.x.part(skipped, layer.x.columns - skipped);
            let w = Matrix::rows(skipped, layer.x.columns);
            let initial = if layer.shared { InitialSum::Previous } else { InitialSum::Zero };
            product([samples, dx.columns, layer.y.columns], initial, (below, dx.matrix()), dy, (transposed, w));
        }
        if let Some(dencoded) = dencoded {
            let width = self.encoded[0].columns;
            for (s, row) in rows.iter().enumerate() {
                let all = |column: usize| self.encoded.iter().map(|place| gradients[place.row(s)][column]).sum::<f32>();
                let row = &mut dencoded[row * width..][..width];
                row.iter_mut().enumerate().for_each(|(column, dx)| *dx = all(column));
            }
        }
    }

    /// Computes the gradients of consecutive blocks. Samples whose output has no gradient add exactly 0 and are left out: behind
    /// ReLU densities, whose gradient vanishes in empty space, that is most of a scene.
    fn backward_group(&self, transposed: &[Vec<f32>], saved: &[f32], grad: &[f32], dencoded: bool) -> GroupGradients {
        let outputs = self.output.columns;
        let width = self.encoded[0].columns;
        let mut sums = GroupGradients {
            dparameters: self.zeros(),
            dencoded: dencoded.then(|| vec![0.0; grad.len() / outputs * width]),
            dactivations: vec![0.0; self.activations],
        };
        // Samples of several blocks: their activations, the gradients of their outputs, and their places in the group.
        let (mut gathered, mut gathered_grad, mut places) = (vec![0.0; self.activations], Vec::new(), Vec::new());
        for (index, (grad, block)) in grad.chunks(outputs * BLOCK).zip(saved.chunks_exact(self.activations)).enumerate()
        {
            let first = index * BLOCK;
            // NaN counts as a gradient.
            let rows =
                || (0..grad.len() / outputs).filter(|s| grad[s * outputs..][..outputs].iter().any(|g| *g != 0.0));
            if rows().count() * outputs == grad.len() {
                let rows: Vec<usize> = rows().map(|s| first + s).collect();
                self.backward_block(transposed, block, grad, &rows, &mut sums);
                continue;
            }
            for s in rows() {
                for matrix in &self.matrices {
                    gathered[matrix.row(places.len())].copy_from_slice(&block[matrix.row(s)]);
                }
                gathered_grad.extend_from_slice(&grad[s * outputs..][..outputs]);
                places.push(first + s);
                if places.len() == BLOCK {
                    self.backward_block(transposed, &gathered, &gathered_grad, &places, &mut sums);
                    gathered_grad.clear();
                    places.clear();
                }
            }
        }
        self.backward_block(transposed, &gathered, &gathered_grad, &places, &mut sums);
        sums
    }

    /// Computes the output, and the activations of each block in `saved`, if it is given.
    fn evaluate(&self, inputs: &[&[f32]], saved: Option<&mut [f32]>) -> Vec<f32> {
        let encoded = inputs[0];
        let (width, outputs) = (self.encoded[0].columns, self.output.columns);
        let samples = encoded.len() / width;
        let mut out = vec![0.0; samples * outputs];
        let blocks = encoded.par_chunks(width * BLOCK).zip(out.par_chunks_mut(outputs * BLOCK)).enumerate();
        each_with_buffer(blocks, self.activations, saved, |(index, (x, out)), block| {
            self.forward_block(inputs, x, index * BLOCK, block, out);
        });
        out
    }
}

struct GroupGradients {
    dparameters: Vec<[Vec<f32>; 2]>,
    dencoded: Option<Vec<f32>>,
    /// Gradient with respect to the activations of the current block.
    dactivations: Vec<f32>,
}

impl Kernel for MlpKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        self.evaluate(inputs, None)
    }

    fn forward_saving(&self, inputs: &[&[f32]]) -> (Vec<f32>, Scratch) {
        let blocks = inputs[0].len().div_ceil(self.encoded[0].columns * BLOCK);
        let mut saved = Scratch::of_len(blocks * self.activations);
        (self.evaluate(inputs, Some(&mut saved)), saved)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let per_group = (pass.saved.len() / self.activations).div_ceil(PARTIAL_SUMS).max(1);
        let transposed = self.transposed(pass.inputs);
        let grads = pass.grad.par_chunks(self.output.columns * BLOCK * per_group);
        let groups: Vec<GroupGradients> = grads
            .zip(pass.saved.par_chunks(self.activations * per_group))
            .map(|(grad, saved)| self.backward_group(&transposed, saved, grad, pass.wanted[0]))
            .collect();
        let dencoded = pass.wanted[0]
            .then(|| groups.iter().filter_map(|part| part.dencoded.as_deref()).flatten().copied().collect());
        let mut sums = self.zeros();
        for part in groups {
            for (sum, part) in sums.iter_mut().flatten().zip(part.dparameters.iter().flatten()) {
                sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            }
        }
        std::iter::once(dencoded).chain(sums.into_iter().flatten().map(Some)).collect()
    }
}
