//! MLP of a factored field as 4 × 4 matrices for a fragment shader.

use infonerf_ops::factored::{FactoredLayout, Layer};

use crate::tables::groups;

/// Input or output of a layer at a place of the shader's vector, and the factor of its weights; `None` for an empty
/// place.
pub(crate) type Place = Option<(usize, f32)>;

/// Weights of an MLP in the order of a uniform block.
pub(crate) struct PackedNetwork {
    /// Matrices `[layers, outputs/4, inputs/4]`, column-major.
    pub(crate) matrices: Vec<f32>,
    /// Biases `[layers, outputs]`, filled up to a multiple of four.
    pub(crate) biases: Vec<f32>,
    /// Number of vectors of four that go into each layer, and that come out.
    pub(crate) layers: Vec<(usize, usize)>,
}

impl PackedNetwork {
    /// Packs `weights`; `inputs` are the shader's inputs of the first layer, in vectors of four.
    ///
    /// The last layer's first vector is density and colour; if colour depends on the direction, one follows for each of
    /// red, green and blue, with its three derivatives, multiplied by `view_dependence`, and a zero.
    pub(crate) fn pack(weights: &[f32], layout: &FactoredLayout, view_dependence: f32, inputs: &[Place]) -> Self {
        let mut packed = Self { matrices: Vec::new(), biases: Vec::new(), layers: Vec::new() };
        let mut inputs = inputs.to_vec();
        for (index, layer) in layout.layers.iter().enumerate() {
            let outputs = if index + 1 == layout.layers.len() {
                last_outputs(layout.view_dependent, view_dependence)
            } else {
                (0..4 * groups(layer.outputs)).map(|o| (o < layer.outputs).then_some((o, 1.0))).collect()
            };
            packed.push(weights, layer, &inputs, &outputs);
            inputs = outputs;
        }
        packed
    }

    fn push(&mut self, weights: &[f32], layer: &Layer, inputs: &[Place], outputs: &[Place]) {
        let weight = |output: Place, input: Place| match (output, input) {
            (Some((o, to)), Some((i, from))) => to * from * weights[layer.weight + o * layer.inputs + i],
            _ => 0.0,
        };
        let bias = |output: Place| output.map_or(0.0, |(o, to)| to * weights[layer.bias() + o]);
        for rows in outputs.chunks_exact(4) {
            for &input in inputs {
                self.matrices.extend(rows.iter().map(|&output| weight(output, input)));
            }
            self.biases.extend(rows.iter().map(|&output| bias(output)));
        }
        self.layers.push((inputs.len() / 4, outputs.len() / 4));
    }
}

fn last_outputs(view_dependent: bool, view_dependence: f32) -> Vec<Place> {
    let colors = if view_dependent { 0..3 } else { 0..0 };
    let derivatives = colors.flat_map(|c| [Some(4 + 3 * c), Some(5 + 3 * c), Some(6 + 3 * c), None]);
    let derivatives = derivatives.map(|output| output.map(|o| (o, view_dependence)));
    (0..4).map(|o| Some((o, 1.0))).chain(derivatives).collect()
}
