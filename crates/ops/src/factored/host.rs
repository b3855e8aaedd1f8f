//! The rayon body: blocks of samples go through encoding and MLP without leaving the cache.

use std::cell::RefCell;
use std::sync::Arc;

use rayon::prelude::*;

use super::dense::{self, BLOCK, padded};
use super::encode::{self, Block, level_features, plane_gradient, position_gradient, with_channels};
use super::layout::{Layout, OUTPUTS, PLANES, RAW};
use super::{HostField, Query};
use crate::kernel::{Kernel, Pass};
use crate::numeric::{Opacity, sigmoid, softplus};
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

    /// Whether directions are an input.
    pub(super) fn sees_directions(&self) -> bool {
        self.query.color && self.layout.view_dependent
    }

    /// Features before those that come from tables.
    fn before_tables(&self) -> usize {
        self.layout.levels.first().map_or(self.layout.features(), |level| level.feature)
    }

    /// Features that come from tables.
    fn of_tables(&self) -> usize {
        self.layout.features() - self.before_tables()
    }
}

impl Kernel for FactoredKernel {
    fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
        vec![inputs[2][0], self.outputs()]
    }

    fn forward(&self, inputs: &[&[f32]], saved: Option<&mut Vec<f32>>) -> Vec<f32> {
        let &[tables, weights, positions, ref directions @ ..] = inputs else { unreachable!("three inputs at least") };
        let samples = positions.len() / 3;
        let mut out = vec![0.0; samples * self.outputs()];
        let layers = packed(&self.layout, weights);
        let query = &self.query;
        let field = Parameters {
            layout: &self.layout,
            tables,
            layers: &layers,
            detail: (&query.frequency_weights, &query.level_weights),
        };
        let job = |(block, positions): (usize, &[f32]), activations: &mut [f32], out: &mut [f32]| {
            let directions = directions.first().map(|directions| &directions[3 * block * BLOCK..]);
            simd::run(Forward { field, color: query.color, positions, directions, activations, out });
        };
        let positions = positions.par_chunks(3 * BLOCK).enumerate();
        let blocks = positions.zip(out.par_chunks_mut(BLOCK * self.outputs()));
        match saved {
            Some(saved) => {
                saved.resize(samples.div_ceil(BLOCK) * activations(&self.layout), 0.0);
                blocks
                    .zip(saved.par_chunks_mut(activations(&self.layout)))
                    .for_each(|((positions, out), activations)| job(positions, activations, out));
            }
            None => blocks.for_each_init(
                || vec![0.0; activations(&self.layout)],
                |activations, (positions, out)| job(positions, activations, out),
            ),
        }
        out
    }

    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
        let &[tables, weights, positions, ref directions @ ..] = pass.inputs else {
            unreachable!("three inputs at least")
        };
        let layout = &self.layout;
        let samples = positions.len() / 3;
        // The first feature whose gradient is needed: the frequencies' lead to positions alone.
        let first = if wanted[2] { 0 } else { self.before_tables() };
        let blocks = samples.div_ceil(BLOCK);
        let per_group = blocks.div_ceil(GROUPS).max(1);
        let skipped = |index: usize| if index == 0 { first } else { 0 };
        let layers = layout.layers.iter().enumerate();
        let layers: Vec<Vec<f32>> = layers.map(|(index, layer)| dense::rows(weights, layer, skipped(index))).collect();

        // The MLP, block by block; the gradient of what comes from tables is kept for all samples.
        let of_tables = self.of_tables() * BLOCK;
        let mut dfeatures = vec![0.0; blocks * of_tables];
        let mut dpositions = vec![0.0; positions.len()];
        let groups: Vec<Vec<Vec<f32>>> = dfeatures
            .par_chunks_mut((per_group * of_tables).max(1))
            .zip(dpositions.par_chunks_mut(per_group * 3 * BLOCK))
            .enumerate()
            .map(|(group, (dfeatures, dpositions))| {
                let mut scratch = Scratch::new(layout);
                let blocks = dfeatures.chunks_mut(of_tables.max(1)).zip(dpositions.chunks_mut(3 * BLOCK));
                for (index, (dfeatures, dpositions)) in blocks.enumerate() {
                    let block = group * per_group + index;
                    let rows = block * BLOCK..((block + 1) * BLOCK).min(samples);
                    let numbers = rows.start * self.outputs()..rows.end * self.outputs();
                    let activations =
                        &pass.saved[block * activations(&self.layout)..(block + 1) * activations(&self.layout)];
                    simd::run(Backward {
                        kernel: self,
                        layers: &layers,
                        activations,
                        output: &pass.output[numbers.clone()],
                        grad: &pass.grad[numbers],
                        directions: directions.first().map(|directions| &directions[3 * rows.start..]),
                        samples: rows.len(),
                        first,
                        scratch: &mut scratch,
                        dfeatures,
                    });
                    if wanted[2] {
                        let positions = &positions[3 * rows.start..3 * rows.end];
                        let (features, dx) = (activations, &scratch.dx);
                        simd::run(PositionGradient { kernel: self, tables, positions, features, dx, dpositions });
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
        let dtables = wanted[0].then(|| self.table_gradient(tables, positions, &dfeatures));
        vec![dtables, dweights, wanted[2].then_some(dpositions), None]
    }
}

impl FactoredKernel {
    /// One task for each plane with its line: no two write to the same place, and the order of sums is fixed.
    fn table_gradient(&self, tables: &[f32], positions: &[f32], dfeatures: &[f32]) -> Vec<f32> {
        let blocks: Vec<Block> = positions.par_chunks(3 * BLOCK).map(encode::block).collect();
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
            simd::run(PlaneGradient {
                channels: level.channels,
                resolution: level.resolution,
                axes: PLANES[p],
                weight,
                tables: encode::tables_of(tables, level, p),
                blocks: &blocks,
                samples: positions.len() / 3,
                dfeatures,
                first: (level.feature - self.before_tables() + p * level.channels) * BLOCK,
                of_block: self.of_tables() * BLOCK,
                dplane,
                dline,
            });
        });
        dtables
    }
}

/// Numbers that a block's activations take: the MLP's input and each hidden layer's output.
fn activations(layout: &Layout) -> usize {
    layout.layers.iter().map(|layer| padded(layer.inputs)).sum::<usize>() * BLOCK
}

/// Each layer, packed.
fn packed(layout: &Layout, weights: &[f32]) -> Vec<Vec<f32>> {
    layout.layers.iter().map(|layer| dense::packed(weights, layer)).collect()
}

/// [`super::on_host`] of these parameters.
pub(super) fn field(
    tables: Vec<f32>,
    weights: &[f32],
    layout: Arc<Layout>,
    (frequencies, levels): (Vec<f32>, Vec<f32>),
) -> HostField {
    let layers = packed(&layout, weights);
    Box::new(move |positions, directions| {
        let field = Parameters { layout: &layout, tables: &tables, layers: &layers, detail: (&frequencies, &levels) };
        // Kept from call to call: zeros take long.
        thread_local!(static ROOM: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) });
        let mut activations = ROOM.take();
        activations.resize(self::activations(&layout), 0.0);
        let mut out = vec![[0.0; OUTPUTS]; positions.len()];
        let blocks = positions.chunks(BLOCK).zip(directions.chunks(BLOCK)).zip(out.chunks_mut(BLOCK));
        for ((positions, directions), out) in blocks {
            simd::run(Forward {
                field,
                color: true,
                positions: positions.as_flattened(),
                directions: layout.view_dependent.then_some(directions.as_flattened()),
                activations: &mut activations,
                out: out.as_flattened_mut(),
            });
        }
        ROOM.set(activations);
        out
    })
}

/// What a field is evaluated from.
#[derive(Clone, Copy)]
struct Parameters<'a> {
    layout: &'a Layout,
    tables: &'a [f32],
    /// Each layer, packed.
    layers: &'a [Vec<f32>],
    /// Weights of frequencies and of levels.
    detail: (&'a [f32], &'a [f32]),
}

struct Forward<'a> {
    field: Parameters<'a>,
    /// Whether to compute colour beside density.
    color: bool,
    /// `[samples, 3]` of this block.
    positions: &'a [f32],
    /// `[samples, 3]`, if colour depends on them.
    directions: Option<&'a [f32]>,
    activations: &'a mut [f32],
    out: &'a mut [f32],
}

impl Job for Forward<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { field, color, positions, directions, activations, out } = self;
        let Parameters { layout, tables, layers, detail: (frequencies, levels) } = field;
        let samples = positions.len() / 3;
        let block = encode::block(positions);
        let stride = padded(layout.features());
        let (mut x, mut rest) = activations.split_at_mut(stride * BLOCK);
        encode::frequencies(&block, frequencies, x, stride, samples);
        for (level, &weight) in layout.levels.iter().zip(levels) {
            if weight == 0.0 {
                for row in x.chunks_exact_mut(stride) {
                    row[level.feature..level.feature + 3 * level.channels].fill(0.0);
                }
                continue;
            }
            let places = encode::places(&block, level.resolution);
            let rows = (&mut *x, stride);
            with_channels!(level.channels, level_features, (level, weight), tables, &places, rows, samples);
        }
        let mut raw = [0.0; padded(RAW) * BLOCK];
        for (index, (layer, packed)) in layout.layers.iter().zip(layers).enumerate() {
            if index + 1 == layout.layers.len() {
                dense::forward(packed, layer, x, &mut raw, samples, false);
            } else {
                let (y, others) = rest.split_at_mut(padded(layer.outputs) * BLOCK);
                dense::forward(packed, layer, x, y, samples, true);
                (x, rest) = (y, others);
            }
        }
        let raw = raw.as_chunks::<{ padded(RAW) }>().0;
        let mut sigma = [0.0; BLOCK];
        for s in 0..samples {
            sigma[s] = raw[s][0] + layout.density_bias;
        }
        softplus(&mut sigma);
        if !color {
            for (out, sigma) in out.iter_mut().zip(sigma) {
                *out = sigma * layout.density_scale;
            }
            return;
        }
        let mut color = [[0.0; 3]; BLOCK];
        for s in 0..samples {
            for k in 0..3 {
                color[s][k] = raw[s][1 + k];
                if let Some(directions) = directions {
                    for axis in 0..3 {
                        color[s][k] += raw[s][OUTPUTS + 3 * k + axis] * directions[3 * s + axis];
                    }
                }
            }
        }
        sigmoid(color.as_flattened_mut());
        for (s, out) in out.chunks_exact_mut(OUTPUTS).enumerate() {
            out[0] = sigma[s] * layout.density_scale;
            out[1..].copy_from_slice(&color[s]);
        }
    }
}

/// What a group of blocks adds up, and gradients that travel back through the layers of one block.
struct Scratch {
    /// Of each layer, packed.
    dweights: Vec<Vec<f32>>,
    dhidden: [Vec<f32>; 2],
    /// Gradient of the MLP's input, without that of its first features if nobody asks for it.
    dx: Vec<f32>,
}

impl Scratch {
    fn new(layout: &Layout) -> Self {
        let widest = layout.layers.iter().map(|layer| padded(layer.inputs.max(layer.outputs))).max().unwrap_or(0);
        let zeros = |layer: &super::Layer| vec![0.0; (layer.inputs + 1) * padded(layer.outputs)];
        Self {
            dweights: layout.layers.iter().map(zeros).collect(),
            dhidden: [vec![0.0; widest * BLOCK], vec![0.0; widest * BLOCK]],
            dx: vec![0.0; padded(layout.features()) * BLOCK],
        }
    }
}

struct Backward<'a> {
    kernel: &'a FactoredKernel,
    /// Each layer's rows.
    layers: &'a [Vec<f32>],
    activations: &'a [f32],
    output: &'a [f32],
    grad: &'a [f32],
    directions: Option<&'a [f32]>,
    samples: usize,
    /// The first feature whose gradient is needed.
    first: usize,
    scratch: &'a mut Scratch,
    /// For each plane `[BLOCK, channels]`.
    dfeatures: &'a mut [f32],
}

impl Job for Backward<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { kernel, layers, activations, output, grad, directions, samples, first, scratch, dfeatures } = self;
        let layout = &kernel.layout;
        let outputs = kernel.outputs();
        let [dy, spare] = &mut scratch.dhidden;
        let width = padded(layout.layers[layout.layers.len() - 1].outputs);
        // softplus′ = sigmoid = 1 − e^−softplus, from the output itself.
        let mut depths = [0.0; BLOCK];
        for s in 0..samples {
            depths[s] = output[s * outputs] / layout.density_scale;
        }
        let slopes = Opacity::of::<FMA>(&depths[..samples]).alpha;
        for (s, dout) in dy.chunks_exact_mut(width).take(samples).enumerate() {
            dout.fill(0.0);
            let (y, g) = (&output[s * outputs..][..outputs], &grad[s * outputs..][..outputs]);
            dout[0] = g[0] * layout.density_scale * slopes[s] as f32;
            for k in 1..outputs {
                let slope = g[k] * y[k] * (1.0 - y[k]);
                dout[k] = slope;
                if let Some(directions) = directions {
                    for axis in 0..3 {
                        dout[OUTPUTS + 3 * (k - 1) + axis] = slope * directions[3 * s + axis];
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
            dense::relu_gradient(&x[..samples * padded(layer.inputs)], spare);
            std::mem::swap(&mut dy, &mut spare);
        }
        let stride = padded(layout.features() - first);
        let mut rest = dfeatures;
        for level in &layout.levels {
            for p in 0..3 {
                let (plane, others) = std::mem::take(&mut rest).split_at_mut(BLOCK * level.channels);
                rest = others;
                let dx = &scratch.dx[level.feature - first + p * level.channels..];
                with_channels!(level.channels, gathered, dx, stride, plane, samples);
            }
        }
    }
}

/// The first `C` numbers of each row of `dx`, side by side.
#[inline(always)]
fn gathered<const C: usize>(dx: &[f32], stride: usize, plane: &mut [f32], samples: usize) {
    for (s, out) in plane.as_chunks_mut::<C>().0.iter_mut().take(samples).enumerate() {
        out.copy_from_slice(&dx[s * stride..s * stride + C]);
    }
}

struct PlaneGradient<'a> {
    channels: usize,
    resolution: usize,
    /// Of the plane, then of its line.
    axes: [usize; 3],
    weight: f32,
    /// The plane and its line.
    tables: (&'a [f32], &'a [f32]),
    blocks: &'a [Block],
    samples: usize,
    /// Gradient of the features of all blocks.
    dfeatures: &'a [f32],
    /// Where the plane's are in a block.
    first: usize,
    /// Numbers of a block.
    of_block: usize,
    dplane: &'a mut [f32],
    dline: &'a mut [f32],
}

impl Job for PlaneGradient<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        for (index, block) in self.blocks.iter().enumerate() {
            let samples = BLOCK.min(self.samples - index * BLOCK);
            let places = encode::places(block, self.resolution);
            let dx = &self.dfeatures[index * self.of_block + self.first..];
            let gradients = (&mut *self.dplane, &mut *self.dline);
            let how = (self.axes, self.weight);
            with_channels!(self.channels, plane_gradient, how, self.tables, &places, dx, gradients, samples);
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
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { kernel, tables, positions, features, dx, dpositions } = self;
        let (layout, query) = (&kernel.layout, &kernel.query);
        let samples = positions.len() / 3;
        let block = encode::block(positions);
        let stride = padded(layout.features());
        let mut gradient = encode::frequency_gradient(features, dx, query.frequency_weights.len(), stride, samples);
        for (level, &weight) in layout.levels.iter().zip(&query.level_weights).filter(|(_, weight)| **weight != 0.0) {
            let (level, dx) = ((level, weight), (dx, stride));
            with_channels!(level.0.channels, position_gradient, level, tables, &block, dx, samples, &mut gradient);
        }
        for (s, dposition) in dpositions.chunks_exact_mut(3).enumerate() {
            for axis in 0..3 {
                dposition[axis] = gradient[axis][s];
            }
        }
    }
}
