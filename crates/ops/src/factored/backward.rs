//! Backward pass of the [host kernel](FactoredKernel), for the samples whose gradients matter.

use rayon::prelude::*;

use super::dense::{self, BLOCK, padded};
use super::encode::{self, Block, plane_gradient, position_gradient, with_channels};
use super::host::{FactoredKernel, activations};
use super::layout::{FactoredLayout, Layer, Level, OUTPUTS, PLANES};
use super::negligible;
use crate::host::buffers::{Scratch, zeros};
use crate::host::numeric::SampleOpacity;
use crate::host::simd::{self, Job};
use crate::host::{PARTIAL_SUMS, Pass};

impl FactoredKernel {
    /// Returns the number of features that depend on the position alone, which precede those of tables.
    fn position_features(&self) -> usize {
        self.layout.levels[0].feature
    }

    fn table_features(&self) -> usize {
        self.layout.features() - self.position_features()
    }

    /// Selects the samples whose gradients before the activations are not [`negligible`]. The derivative of the softplus
    /// at its value y, 1 − e^−y, is bounded by min(1, y).
    fn kept(&self, pass: Pass<'_>) -> Vec<usize> {
        let scale = self.layout.density_scale;
        let rows = pass.output.par_chunks_exact(self.outputs()).zip(pass.grad.par_chunks_exact(self.outputs()));
        let size = |(y, g): (&[f32], &[f32])| {
            let colors = y[1..].iter().zip(&g[1..]).map(|(y, g)| (g * y * (1.0 - y)).abs());
            (g[0] * scale.min(y[0])).abs() + colors.sum::<f32>()
        };
        let sizes: Vec<f32> = rows.with_min_len(1024).map(size).collect();
        let min = negligible::min_kept(&sizes, self.query.negligible);
        (0..sizes.len()).filter(|&s| negligible::is_kept(sizes[s], min)).collect()
    }

    /// Computes the gradient of the tables, with one task for each plane with its line: no two tasks write to the same place, and
    /// the order of sums is fixed.
    fn table_gradient(&self, tables: &[f32], (blocks, samples): (&[Block], usize), dfeatures: &[f32]) -> Vec<f32> {
        let mut gradient = zeros(tables.len());
        let mut tasks = Vec::new();
        let mut parts = self.layout.split_tables(&mut gradient).into_iter();
        for (level, &weight) in self.layout.levels.iter().zip(&self.query.level_weights) {
            let planes: Vec<_> = parts.by_ref().take(3).collect();
            let pairs = planes.into_iter().zip(parts.by_ref().take(3)).enumerate();
            tasks.extend(pairs.map(|(p, gradients)| (level, weight, p, gradients)));
        }
        let weighted = tasks.into_par_iter().filter(|(_, weight, ..)| *weight != 0.0);
        weighted.for_each(|(level, weight, p, (dplane, dline))| {
            simd::run(PlaneGradient {
                level,
                axes: PLANES[p],
                weight,
                tables: encode::tables_of(tables, level, p),
                blocks,
                samples,
                dfeatures,
                first: (level.feature - self.position_features() + p * level.channels) * BLOCK,
                per_block: self.table_features() * BLOCK,
                dplane,
                dline,
            });
        });
        gradient
    }

    /// Computes the gradients of tables, weights and positions that are wanted.
    pub(super) fn gradients(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let &[tables, weights, positions, ..] = pass.inputs else { unreachable!("three inputs at least") };
        let wanted = pass.wanted;
        let layout = &self.layout;
        // The first feature whose gradient is needed: frequencies depend on positions alone.
        let first = if wanted[2] { 0 } else { self.position_features() };
        let skipped = |index: usize| if index == 0 { first } else { 0 };
        let layers = layout.layers.iter().enumerate();
        let layers: Vec<Vec<f32>> = layers.map(|(index, layer)| dense::rows(weights, layer, skipped(index))).collect();
        let kept = self.kept(pass);
        let position = |s: &usize| &positions[3 * s..3 * s + 3];
        let blocks: Vec<Block> = kept.par_chunks(BLOCK).map(|rows| encode::block(rows.iter().map(position))).collect();
        let per_group = blocks.len().div_ceil(PARTIAL_SUMS).max(1);

        // The MLP, block by block; the gradient of the features of tables is kept for all samples.
        let per_block = self.table_features() * BLOCK;
        let mut dfeatures = Scratch::of_len(blocks.len() * per_block);
        let mut dpositions = vec![0.0; 3 * kept.len()];
        let groups: Vec<Vec<Vec<f32>>> = dfeatures
            .par_chunks_mut(per_group * per_block)
            .zip(dpositions.par_chunks_mut(per_group * 3 * BLOCK))
            .zip(kept.par_chunks(per_group * BLOCK).zip(blocks.par_chunks(per_group)))
            .map(|((dfeatures, dpositions), (kept, blocks))| {
                let mut scratch = GroupBuffers::new(layout);
                let mut gathered = GatheredSamples::default();
                let results = dfeatures.chunks_mut(per_block).zip(dpositions.chunks_mut(3 * BLOCK));
                for ((rows, block), (dfeatures, dpositions)) in kept.chunks(BLOCK).zip(blocks).zip(results) {
                    gathered.gather(self, pass, rows);
                    let (kernel, layers, gathered, scratch) = (self, &layers, &gathered, &mut scratch);
                    simd::run(BlockBackward { kernel, layers, gathered, first, scratch, dfeatures });
                    if wanted[2] {
                        let (features, dx) = (&gathered.activations, &scratch.dx);
                        simd::run(PositionGradient { kernel, tables, block, features, dx, dpositions });
                    }
                }
                scratch.dweights
            })
            .collect();
        let dweights = wanted[1].then(|| {
            let mut sum = vec![0.0; layout.weight_len()];
            for (packed, layer) in groups.iter().flat_map(|group| group.iter().zip(&layout.layers)) {
                dense::unpacked(packed, layer, &mut sum);
            }
            sum
        });
        let dtables = wanted[0].then(|| self.table_gradient(tables, (&blocks, kept.len()), &dfeatures));
        let dpositions = wanted[2].then(|| {
            let mut all = vec![0.0; positions.len()];
            for (s, dposition) in kept.iter().zip(dpositions.chunks_exact(3)) {
                all[3 * s..3 * s + 3].copy_from_slice(dposition);
            }
            all
        });
        vec![dtables, dweights, dpositions]
    }
}

/// Sums of a group of blocks, and gradients with respect to the activations of one block.
struct GroupBuffers {
    /// Gradient of each layer's weights, packed.
    dweights: Vec<Vec<f32>>,
    dhidden: [Vec<f32>; 2],
    /// Gradient of the MLP's input, without the first features if their gradient is not needed.
    dx: Vec<f32>,
}

impl GroupBuffers {
    fn new(layout: &FactoredLayout) -> Self {
        let widest = layout.layers.iter().map(|layer| padded(layer.inputs.max(layer.outputs))).max().unwrap_or(0);
        let zeros = |layer: &Layer| vec![0.0; (layer.inputs + 1) * padded(layer.outputs)];
        Self {
            dweights: layout.layers.iter().map(zeros).collect(),
            dhidden: [vec![0.0; widest * BLOCK], vec![0.0; widest * BLOCK]],
            dx: vec![0.0; padded(layout.features()) * BLOCK],
        }
    }
}

/// Activations and gradients of the samples of a block, gathered from all blocks.
#[derive(Default)]
struct GatheredSamples {
    samples: usize,
    activations: Vec<f32>,
    output: Vec<f32>,
    grad: Vec<f32>,
    /// View directions; empty unless they are an input.
    directions: Vec<f32>,
}

impl GatheredSamples {
    fn gather(&mut self, kernel: &FactoredKernel, pass: Pass<'_>, rows: &[usize]) {
        let of_block = activations(&kernel.layout);
        self.samples = rows.len();
        self.activations.resize(of_block, 0.0);
        let mut start = 0;
        for width in kernel.layout.layers.iter().map(|layer| padded(layer.inputs)) {
            for (to, s) in self.activations[start..].chunks_exact_mut(width).zip(rows) {
                let from = s / BLOCK * of_block + start + s % BLOCK * width;
                to.copy_from_slice(&pass.saved[from..from + width]);
            }
            start += BLOCK * width;
        }
        let collect = |to: &mut Vec<f32>, from: &[f32], width: usize| {
            to.clear();
            rows.iter().for_each(|s| to.extend_from_slice(&from[s * width..(s + 1) * width]));
        };
        collect(&mut self.output, pass.output, kernel.outputs());
        collect(&mut self.grad, pass.grad, kernel.outputs());
        if let Some(directions) = pass.inputs.get(3) {
            collect(&mut self.directions, directions, 3);
        }
    }
}

struct BlockBackward<'a> {
    kernel: &'a FactoredKernel,
    layers: &'a [Vec<f32>],
    gathered: &'a GatheredSamples,
    /// The first feature whose gradient is needed.
    first: usize,
    scratch: &'a mut GroupBuffers,
    /// Gradient of the features, `[BLOCK, channels]` for each plane.
    dfeatures: &'a mut [f32],
}

impl Job for BlockBackward<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { kernel, layers, gathered, first, scratch, dfeatures } = self;
        let GatheredSamples { samples, activations, output, grad, directions } = gathered;
        let (layout, samples) = (&kernel.layout, *samples);
        let outputs = kernel.outputs();
        let [dy, spare] = &mut scratch.dhidden;
        let width = padded(layout.layers[layout.layers.len() - 1].outputs);
        // softplus′ = 1 − e^−softplus, computed from the output.
        let mut depths = [0.0; BLOCK];
        for s in 0..samples {
            depths[s] = output[s * outputs] / layout.density_scale;
        }
        let derivatives = SampleOpacity::new::<FMA>(&depths[..samples]).alpha;
        for (s, dout) in dy.chunks_exact_mut(width).take(samples).enumerate() {
            dout.fill(0.0);
            let (y, g) = (&output[s * outputs..][..outputs], &grad[s * outputs..][..outputs]);
            dout[0] = g[0] * layout.density_scale * derivatives[s] as f32;
            for k in 1..outputs {
                let d = g[k] * y[k] * (1.0 - y[k]);
                dout[k] = d;
                if !directions.is_empty() {
                    for axis in 0..3 {
                        dout[OUTPUTS + 3 * (k - 1) + axis] = d * directions[3 * s + axis];
                    }
                }
            }
        }
        let mut end = activations.len();
        let (mut dy, mut spare): (&mut [f32], &mut [f32]) = (dy, spare);
        for (index, layer) in layout.layers.iter().enumerate().rev() {
            let x = &activations[end - padded(layer.inputs) * BLOCK..end];
            end -= x.len();
            dense::weight_gradient(&mut scratch.dweights[index], layer, dy, x, samples);
            // Without colour only the density has a gradient.
            let used = if index + 1 == layout.layers.len() && !kernel.query.color { 1 } else { layer.outputs };
            if index == 0 {
                dense::input_gradient(&layers[0], layer, used, dy, &mut scratch.dx, samples);
                break;
            }
            dense::input_gradient(&layers[index], layer, used, dy, spare, samples);
            for (dy, y) in spare.iter_mut().zip(&x[..samples * padded(layer.inputs)]) {
                *dy = if *y <= 0.0 { 0.0 } else { *dy };
            }
            std::mem::swap(&mut dy, &mut spare);
        }
        let stride = padded(layout.features() - first);
        let mut rest = dfeatures;
        for level in &layout.levels {
            for p in 0..3 {
                let (plane, others) = std::mem::take(&mut rest).split_at_mut(BLOCK * level.channels);
                rest = others;
                let dx = &scratch.dx[level.feature - first + p * level.channels..];
                with_channels!(level.channels, copy_columns, dx, stride, plane, samples);
            }
        }
    }
}

/// Copies the first `C` elements of each row of `dx` to contiguous rows.
#[inline(always)]
fn copy_columns<const C: usize>(dx: &[f32], stride: usize, plane: &mut [f32], samples: usize) {
    for (s, out) in plane.as_chunks_mut::<C>().0.iter_mut().take(samples).enumerate() {
        out.copy_from_slice(&dx[s * stride..s * stride + C]);
    }
}

struct PlaneGradient<'a> {
    level: &'a Level,
    /// Axes of the plane, then of its line.
    axes: [usize; 3],
    weight: f32,
    tables: (&'a [f32], &'a [f32]),
    blocks: &'a [Block],
    samples: usize,
    /// Gradient of the features of all blocks.
    dfeatures: &'a [f32],
    /// Start of the plane's features in a block.
    first: usize,
    /// Number of elements of a block in `dfeatures`.
    per_block: usize,
    dplane: &'a mut [f32],
    dline: &'a mut [f32],
}

impl Job for PlaneGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        for (index, block) in self.blocks.iter().enumerate() {
            let samples = BLOCK.min(self.samples - index * BLOCK);
            let places = encode::places(block, self.level.resolution);
            let dx = &self.dfeatures[index * self.per_block + self.first..];
            let gradients = (&mut *self.dplane, &mut *self.dline);
            let how = (self.axes, self.weight);
            with_channels!(self.level.channels, plane_gradient, how, self.tables, &places, dx, gradients, samples);
        }
    }
}

struct PositionGradient<'a> {
    kernel: &'a FactoredKernel,
    tables: &'a [f32],
    block: &'a Block,
    /// The MLP's input, and the gradient with respect to it.
    features: &'a [f32],
    dx: &'a [f32],
    dpositions: &'a mut [f32],
}

impl Job for PositionGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { kernel, tables, block, features, dx, dpositions } = self;
        let (layout, query) = (&kernel.layout, &kernel.query);
        let samples = dpositions.len() / 3;
        let stride = padded(layout.features());
        let mut gradient = encode::frequency_gradient(features, dx, query.frequency_weights.len(), stride, samples);
        for (level, &weight) in layout.levels.iter().zip(&query.level_weights).filter(|(_, weight)| **weight != 0.0) {
            let (level, dx) = ((level, weight), (dx, stride));
            with_channels!(level.0.channels, position_gradient, level, tables, block, dx, samples, &mut gradient);
        }
        for (s, dposition) in dpositions.chunks_exact_mut(3).enumerate() {
            for axis in 0..3 {
                dposition[axis] = gradient[axis][s];
            }
        }
    }
}
