//! MLP of a factored field as 4 × 4 matrices for a fragment shader.

use infonerf_ops::factored::FactoredLayout;

/// Index of an input or output of a layer at a place of the shader's vector, and a factor of its weights; `None` if empty.
pub(crate) type Place = Option<(usize, f32)>;

/// Weights of an MLP in the order of a uniform block.
pub(crate) struct PackedNetwork {
    /// Matrices `[layers, outputs/4, inputs/4]`, column-major.
    pub(crate) matrices: Vec<f32>,
    /// Biases `[layers, outputs]`, filled up to a multiple of four.
    pub(crate) biases: Vec<f32>,
    /// Numbers of input and output vectors of four of each layer.
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
            let outputs: Vec<Place> = if index + 1 == layout.layers.len() {
                let colors = if layout.view_dependent { 0..3 } else { 0..0 };
                let derivative = |o| Some((o, view_dependence));
                let of_color = |c: usize| [derivative(4 + 3 * c), derivative(5 + 3 * c), derivative(6 + 3 * c), None];
                (0..4).map(|o| Some((o, 1.0))).chain(colors.flat_map(of_color)).collect()
            } else {
                (0..layer.outputs.next_multiple_of(4)).map(|o| (o < layer.outputs).then_some((o, 1.0))).collect()
            };
            let weight = |output: Place, input: Place| match (output, input) {
                (Some((o, to)), Some((i, from))) => to * from * weights[layer.weight + o * layer.inputs + i],
                _ => 0.0,
            };
            let bias = |output: Place| output.map_or(0.0, |(o, to)| to * weights[layer.bias() + o]);
            for rows in outputs.chunks_exact(4) {
                for &input in &inputs {
                    packed.matrices.extend(rows.iter().map(|&output| weight(output, input)));
                }
                packed.biases.extend(rows.iter().map(|&output| bias(output)));
            }
            packed.layers.push((inputs.len() / 4, outputs.len() / 4));
            inputs = outputs;
        }
        packed
    }
}
