//! The rayon body: blocks of samples go through encoding and MLP without leaving the cache.

use std::sync::Arc;

use rayon::prelude::*;

use super::Query;
use super::dense::{self, BLOCK};
use super::encode::{self, level_features, plane_gradient, position_gradient, with_channels};
use super::layout::{Layout, OUTPUTS, PLANES, RAW};
use crate::kernel::{Kernel, Pass};
use crate::simd::{self, Job};

#[derive(Debug)]
pub(super) struct FactoredKernel {
    pub(super) layout: Arc<Layout>,
    pub(super) query: Query,
}

/// Partial sums of the MLP's gradient: a fixed number, so that the result does not depend on the number of threads.
const GROUPS: usize = 16;

impl FactoredKernel {
    fn outputs(&self) -> usize {
        if self.query.color { OUTPUTS } else { 1 }
    }

    /// Rows of the last layer that are computed.
    fn raw(&self) -> usize {
        match (self.query.color, self.layout.view_dependent) {
            (false, _) => 1,
            (true, false) => OUTPUTS,
            (true, true) => RAW,
        }
    }

    /// View directions of the samples from `start` on; none if colour does not depend on them.
    fn directions(&self, start: usize) -> Option<&[f32]> {
        (self.query.color && self.layout.view_dependent).then(|| &self.query.directions[3 * start..])
    }

    /// Numbers that a block's activations take: the MLP's input and each hidden layer's output.
    fn activations(&self) -> usize {
        let hidden: usize = self.layout.layers.iter().rev().skip(1).map(|layer| layer.outputs).sum();
        (self.layout.features() + hidden) * BLOCK
    }
}

impl Kernel for FactoredKernel {
    fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
        vec![inputs[2][0], self.outputs()]
    }

    fn forward(&self, inputs: &[&[f32]], saved: Option<&mut Vec<f32>>) -> Vec<f32> {
        let &[tables, weights, positions] = inputs else { unreachable!("a factored field has three inputs") };
        let samples = positions.len() / 3;
        let mut out = vec![0.0; samples * self.outputs()];
        let job = |(block, positions): (usize, &[f32]), activations: &mut [f32], out: &mut [f32]| {
            let directions = self.directions(block * BLOCK);
            simd::run(Forward { kernel: self, tables, weights, positions, directions, activations, out });
        };
        let positions = positions.par_chunks(3 * BLOCK).enumerate();
        let blocks = positions.zip(out.par_chunks_mut(BLOCK * self.outputs()));
        match saved {
            Some(saved) => {
                saved.resize(samples.div_ceil(BLOCK) * self.activations(), 0.0);
                blocks
                    .zip(saved.par_chunks_mut(self.activations()))
                    .for_each(|((positions, out), activations)| job(positions, activations, out));
            }
            None => blocks.for_each_init(
                || vec![0.0; self.activations()],
                |activations, (positions, out)| job(positions, activations, out),
            ),
        }
        out
    }

    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
        let &[tables, weights, positions] = pass.inputs else { unreachable!("a factored field has three inputs") };
        let layout = &self.layout;
        let samples = positions.len() / 3;
        // The first feature whose gradient is needed: the frequencies' lead to positions alone.
        let first = match layout.levels.first() {
            _ if wanted[2] => 0,
            Some(level) => level.feature,
            None => layout.features(),
        };
        let dx_len = (layout.features() - first) * BLOCK;
        let blocks = samples.div_ceil(BLOCK);
        let per_group = blocks.div_ceil(GROUPS).max(1);

        // The MLP, block by block; the gradient of its input is kept for all samples.
        let mut dx = vec![0.0; blocks * dx_len];
        let groups: Vec<Vec<f32>> = dx
            .par_chunks_mut((per_group * dx_len).max(1))
            .enumerate()
            .map(|(group, dx)| {
                let mut dweights = vec![0.0; layout.weight_len()];
                let mut scratch = Scratch::new(layout);
                for (index, dx) in dx.chunks_mut(dx_len.max(1)).enumerate() {
                    let block = group * per_group + index;
                    let rows = block * BLOCK..((block + 1) * BLOCK).min(samples);
                    let numbers = rows.start * self.outputs()..rows.end * self.outputs();
                    simd::run(Backward {
                        kernel: self,
                        weights,
                        activations: &pass.saved[block * self.activations()..(block + 1) * self.activations()],
                        output: &pass.output[numbers.clone()],
                        grad: &pass.grad[numbers],
                        directions: self.directions(rows.start),
                        samples: rows.len(),
                        first,
                        scratch: &mut scratch,
                        dweights: &mut dweights,
                        dx,
                    });
                }
                dweights
            })
            .collect();
        let dweights = wanted[1].then(|| {
            let mut sum = vec![0.0; layout.weight_len()];
            for group in groups {
                for (sum, part) in sum.iter_mut().zip(group) {
                    *sum += part;
                }
            }
            sum
        });
        let dtables = wanted[0].then(|| self.table_gradient(tables, positions, &dx, dx_len, first));
        let dpositions = wanted[2].then(|| self.position_gradient(tables, positions, pass.saved, &dx));
        vec![dtables, dweights, dpositions]
    }
}

impl FactoredKernel {
    /// One task for each plane with its line: no two write to the same place, and the order of sums is fixed.
    fn table_gradient(&self, tables: &[f32], positions: &[f32], dx: &[f32], dx_len: usize, first: usize) -> Vec<f32> {
        let mut dtables = vec![0.0; tables.len()];
        let mut rest = dtables.as_mut_slice();
        let mut tasks = Vec::new();
        for (level, &weight) in self.layout.levels.iter().zip(&self.query.level_weights) {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(level.len());
            rest = others;
            let (planes, lines) = own.split_at_mut(3 * level.plane_len());
            let pairs = planes.chunks_exact_mut(level.plane_len()).zip(lines.chunks_exact_mut(level.line_len()));
            if weight != 0.0 {
                tasks.extend(pairs.enumerate().map(|(p, (dplane, dline))| (level, weight, p, dplane, dline)));
            }
        }
        tasks.into_par_iter().for_each(|(level, weight, p, dplane, dline)| {
            let row = level.feature - first + p * level.channels;
            simd::run(PlaneGradient {
                channels: level.channels,
                how: (level.resolution, PLANES[p], weight),
                plane: &tables[level.plane(p)..level.plane(p) + level.plane_len()],
                line: &tables[level.line(p)..level.line(p) + level.line_len()],
                positions,
                dx: &dx[row * BLOCK..],
                dx_len,
                dplane,
                dline,
            });
        });
        dtables
    }

    /// From the gradient of the MLP's whole input, block by block.
    fn position_gradient(&self, tables: &[f32], positions: &[f32], saved: &[f32], dx: &[f32]) -> Vec<f32> {
        let mut dpositions = vec![0.0; positions.len()];
        let dx = dx.par_chunks(self.layout.features() * BLOCK).zip(saved.par_chunks(self.activations()));
        let blocks = positions.par_chunks(3 * BLOCK).zip(dpositions.par_chunks_mut(3 * BLOCK)).zip(dx);
        blocks.for_each(|((positions, dpositions), (dx, features))| {
            simd::run(PositionGradient { kernel: self, tables, positions, features, dx, dpositions });
        });
        dpositions
    }
}

struct Forward<'a> {
    kernel: &'a FactoredKernel,
    tables: &'a [f32],
    weights: &'a [f32],
    /// `[samples, 3]` of this block.
    positions: &'a [f32],
    /// `[samples, 3]`, if colour depends on them.
    directions: Option<&'a [f32]>,
    activations: &'a mut [f32],
    out: &'a mut [f32],
}

impl Job for Forward<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self { kernel, tables, weights, positions, directions, activations, out } = self;
        let (layout, query) = (&kernel.layout, &kernel.query);
        let samples = positions.len() / 3;
        let block = encode::block(positions);
        let (input, hidden) = activations.split_at_mut(layout.features() * BLOCK);
        encode::frequencies(&block, &query.frequency_weights, input, samples);
        for (level, &weight) in layout.levels.iter().zip(&query.level_weights) {
            let rows = &mut input[level.feature * BLOCK..(level.feature + 3 * level.channels) * BLOCK];
            if weight == 0.0 {
                rows.fill(0.0);
                continue;
            }
            with_channels!(level.channels, level_features, level, weight, tables, &block, rows, samples);
        }
        let mut raw = [0.0; RAW * BLOCK];
        let raw = &mut raw[..kernel.raw() * BLOCK];
        let (mut x, mut rest): (&[f32], &mut [f32]) = (input, hidden);
        for (index, layer) in layout.layers.iter().enumerate() {
            if index + 1 == layout.layers.len() {
                dense::forward(weights, layer, x, raw, samples, false);
            } else {
                let (y, others) = rest.split_at_mut(layer.outputs * BLOCK);
                dense::forward(weights, layer, x, y, samples, true);
                (x, rest) = (y, others);
            }
        }
        let outputs = kernel.outputs();
        for (s, out) in out.chunks_exact_mut(outputs).enumerate() {
            out[0] = softplus(raw[s] + layout.density_bias) * layout.density_scale;
            for (k, out) in out.iter_mut().enumerate().skip(1) {
                let mut x = raw[k * BLOCK + s];
                if let Some(directions) = directions {
                    for axis in 0..3 {
                        x += raw[(OUTPUTS + 3 * (k - 1) + axis) * BLOCK + s] * directions[3 * s + axis];
                    }
                }
                *out = sigmoid(x);
            }
        }
    }
}

fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// Gradients that travel back through the layers of one block.
struct Scratch {
    dout: Vec<f32>,
    dhidden: [Vec<f32>; 2],
}

impl Scratch {
    fn new(layout: &Layout) -> Self {
        let widest = layout.layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max().unwrap_or(0);
        Self { dout: vec![0.0; RAW * BLOCK], dhidden: [vec![0.0; widest * BLOCK], vec![0.0; widest * BLOCK]] }
    }
}

struct Backward<'a> {
    kernel: &'a FactoredKernel,
    weights: &'a [f32],
    activations: &'a [f32],
    output: &'a [f32],
    grad: &'a [f32],
    directions: Option<&'a [f32]>,
    samples: usize,
    /// The first feature whose gradient is needed.
    first: usize,
    scratch: &'a mut Scratch,
    dweights: &'a mut [f32],
    dx: &'a mut [f32],
}

impl Job for Backward<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self { kernel, weights, activations, output, grad, directions, samples, first, scratch, dweights, dx } =
            self;
        let layout = &kernel.layout;
        let outputs = kernel.outputs();
        let dout = &mut scratch.dout[..kernel.raw() * BLOCK];
        dout.fill(0.0);
        for (s, (y, g)) in output.chunks_exact(outputs).zip(grad.chunks_exact(outputs)).enumerate() {
            // softplus′ = sigmoid = 1 − e^−softplus, from the output itself.
            dout[s] = -g[0] * layout.density_scale * (-y[0] / layout.density_scale).exp_m1();
            for k in 1..outputs {
                let slope = g[k] * y[k] * (1.0 - y[k]);
                dout[k * BLOCK + s] = slope;
                if let Some(directions) = directions {
                    for axis in 0..3 {
                        dout[(OUTPUTS + 3 * (k - 1) + axis) * BLOCK + s] = slope * directions[3 * s + axis];
                    }
                }
            }
        }
        let (input, hidden) = activations.split_at(layout.features() * BLOCK);
        let mut ends = Vec::with_capacity(layout.layers.len());
        let mut end = 0;
        for layer in &layout.layers[..layout.layers.len() - 1] {
            ends.push(end..end + layer.outputs * BLOCK);
            end += layer.outputs * BLOCK;
        }
        let [ping, pong] = &mut scratch.dhidden;
        let (mut dy, mut spare): (&mut [f32], &mut [f32]) = (ping, pong);
        dy[..dout.len()].copy_from_slice(dout);
        for (index, layer) in layout.layers.iter().enumerate().rev() {
            let x = if index == 0 { input } else { &hidden[ends[index - 1].clone()] };
            // Without colour only the first row of the last layer was computed.
            let used = if index + 1 == layout.layers.len() { kernel.raw() } else { layer.outputs };
            let above = &dy[..used * BLOCK];
            dense::weight_gradient(dweights, layer, above, x, samples);
            if index == 0 {
                dense::input_gradient(weights, layer, first, above, dx, samples);
                break;
            }
            let below = &mut spare[..layer.inputs * BLOCK];
            dense::input_gradient(weights, layer, 0, above, below, samples);
            for (row, y) in below.chunks_exact_mut(BLOCK).zip(x.chunks_exact(BLOCK)) {
                dense::relu_gradient(&y[..samples], &mut row[..samples]);
            }
            std::mem::swap(&mut dy, &mut spare);
        }
    }
}

struct PlaneGradient<'a> {
    channels: usize,
    how: (usize, [usize; 3], f32),
    plane: &'a [f32],
    line: &'a [f32],
    positions: &'a [f32],
    dx: &'a [f32],
    /// Numbers of a block in `dx`.
    dx_len: usize,
    dplane: &'a mut [f32],
    dline: &'a mut [f32],
}

impl Job for PlaneGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        for (block, positions) in self.positions.chunks(3 * BLOCK).enumerate() {
            let dx = &self.dx[block * self.dx_len..];
            let tables = (self.plane, self.line);
            let gradients = (&mut *self.dplane, &mut *self.dline);
            with_channels!(self.channels, plane_gradient, self.how, tables, positions, dx, gradients);
        }
    }
}

struct PositionGradient<'a> {
    kernel: &'a FactoredKernel,
    tables: &'a [f32],
    positions: &'a [f32],
    /// The MLP's input, and the gradient with respect to it.
    features: &'a [f32],
    dx: &'a [f32],
    dpositions: &'a mut [f32],
}

impl Job for PositionGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self { kernel, tables, positions, features, dx, dpositions } = self;
        let (layout, query) = (&kernel.layout, &kernel.query);
        let samples = positions.len() / 3;
        let block = encode::block(positions);
        let mut gradient = encode::frequency_gradient(features, dx, query.frequency_weights.len(), samples);
        for (level, &weight) in layout.levels.iter().zip(&query.level_weights).filter(|(_, weight)| **weight != 0.0) {
            let dx = &dx[level.feature * BLOCK..];
            with_channels!(
                level.channels,
                position_gradient,
                level,
                weight,
                tables,
                &block,
                dx,
                samples,
                &mut gradient
            );
        }
        for (s, dposition) in dpositions.chunks_exact_mut(3).enumerate() {
            for axis in 0..3 {
                dposition[axis] = gradient[axis][s];
            }
        }
    }
}
