//! Host kernel of [`factored_field`](super::factored_field): blocks of samples go through encoding and MLP without leaving the
//! cache.

use std::sync::Arc;

use rayon::prelude::*;

use super::dense::{self, BLOCK, padded};
use super::encode::{self, level_features, with_channels};
use super::layout::{FactoredLayout, OUTPUTS, RAW};
use super::{HostField, Query};
use crate::host::buffers::{Scratch, each_with_buffer};
use crate::host::numeric::{sigmoid, softplus};
use crate::host::simd::{self, Job};
use crate::host::{Kernel, Pass};

#[derive(Debug)]
pub(super) struct FactoredKernel {
    pub(super) layout: Arc<FactoredLayout>,
    pub(super) query: Query,
}

impl FactoredKernel {
    pub(super) fn outputs(&self) -> usize {
        if self.query.color { OUTPUTS } else { 1 }
    }

    /// Computes the output, and the activations of each block in `saved`, if it is given.
    fn evaluate(&self, inputs: &[&[f32]], saved: Option<&mut [f32]>) -> Vec<f32> {
        let &[tables, weights, positions, ref directions @ ..] = inputs else { unreachable!("three inputs at least") };
        let samples = positions.len() / 3;
        let mut out = vec![0.0; samples * self.outputs()];
        let (layers, query) = (packed(&self.layout, weights), &self.query);
        let detail = (query.frequency_weights.as_slice(), query.level_weights.as_slice());
        let field = FieldParameters { layout: &self.layout, tables, layers: &layers, detail };
        let positions = positions.par_chunks(3 * BLOCK).enumerate();
        let blocks = positions.zip(out.par_chunks_mut(BLOCK * self.outputs()));
        each_with_buffer(blocks, activations(&self.layout), saved, |((block, positions), out), activations| {
            let directions = directions.first().map(|directions| &directions[3 * block * BLOCK..]);
            simd::run(BlockForward { field, color: query.color, positions, directions, activations, out });
        });
        out
    }
}

impl Kernel for FactoredKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        self.evaluate(inputs, None)
    }

    fn forward_saving(&self, inputs: &[&[f32]]) -> (Vec<f32>, Scratch) {
        let blocks = (inputs[2].len() / 3).div_ceil(BLOCK);
        let mut saved = Scratch::of_len(blocks * activations(&self.layout));
        (self.evaluate(inputs, Some(&mut saved)), saved)
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        self.gradients(pass)
    }
}

/// Returns the number of a block's activations: the MLP's input and each hidden layer's output.
pub(super) fn activations(layout: &FactoredLayout) -> usize {
    layout.layers.iter().map(|layer| padded(layer.inputs)).sum::<usize>() * BLOCK
}

fn packed(layout: &FactoredLayout, weights: &[f32]) -> Vec<Vec<f32>> {
    layout.layers.iter().map(|layer| dense::packed(weights, layer)).collect()
}

pub(super) fn field(
    tables: Vec<f32>,
    weights: &[f32],
    layout: Arc<FactoredLayout>,
    (frequencies, levels): (Vec<f32>, Vec<f32>),
) -> HostField {
    let layers = packed(&layout, weights);
    Box::new(move |positions, directions| {
        let field =
            FieldParameters { layout: &layout, tables: &tables, layers: &layers, detail: (&frequencies, &levels) };
        let mut activations = Scratch::of_len(activations(&layout));
        let mut out = vec![[0.0; OUTPUTS]; positions.len()];
        let blocks = positions.chunks(BLOCK).zip(directions.chunks(BLOCK)).zip(out.chunks_mut(BLOCK));
        for ((positions, directions), out) in blocks {
            simd::run(BlockForward {
                field,
                color: true,
                positions: positions.as_flattened(),
                directions: layout.view_dependent.then_some(directions.as_flattened()),
                activations: &mut activations,
                out: out.as_flattened_mut(),
            });
        }
        out
    })
}

#[derive(Clone, Copy)]
struct FieldParameters<'a> {
    layout: &'a FactoredLayout,
    tables: &'a [f32],
    layers: &'a [Vec<f32>],
    /// Weights of frequencies and of levels.
    detail: (&'a [f32], &'a [f32]),
}

struct BlockForward<'a> {
    field: FieldParameters<'a>,
    color: bool,
    /// Positions of this block, `[samples, 3]`.
    positions: &'a [f32],
    /// Directions, `[samples, 3]`, if colour depends on them.
    directions: Option<&'a [f32]>,
    activations: &'a mut [f32],
    out: &'a mut [f32],
}

impl Job for BlockForward<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { field, color, positions, directions, activations, out } = self;
        let FieldParameters { layout, tables, layers, detail: (frequencies, levels) } = field;
        let samples = positions.len() / 3;
        let block = encode::block(positions.chunks_exact(3));
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
