//! Stages of a radiance network: matrices of activations, whose columns are padded, and the layers that compute them.

use super::SIZE_MULTIPLE;
use crate::mlp::Dense;

/// Matrix of activations, and the layer that computes it.
#[derive(Debug, Default)]
pub(super) struct MlpStage {
    pub(super) columns: usize,
    /// First column that the layer computes, and number of these columns.
    pub(super) columns_computed: (usize, usize),
    /// First column of the previous matrix that the layer reads.
    pub(super) first_input_column: usize,
    pub(super) relu: bool,
    pub(super) weights: Vec<Piece>,
    pub(super) biases: Vec<Piece>,
    /// Input of the network that is copied into this matrix, and its first column.
    pub(super) network_input: Option<(NetworkInput, usize)>,
}

impl MlpStage {
    pub(super) fn new(columns_computed: (usize, usize), relu: bool, (weights, bias): (Vec<Piece>, Piece)) -> Self {
        let columns = columns_computed.0 + columns_computed.1;
        Self { columns, columns_computed, relu, weights, biases: vec![bias], ..Self::default() }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NetworkInput {
    Encoded = 0,
    Direction = 1,
}

/// Rows of a parameter of the network, and their place in a matrix that is padded with zeros.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Index of the parameter, weights and biases of each layer alternating.
    pub(super) parameter: usize,
    first_row: usize,
    rows: usize,
    columns: usize,
    at: [usize; 2],
}

impl Piece {
    /// Iterates over (element of the parameter, row, column).
    pub(super) fn elements(self) -> impl Iterator<Item = (usize, usize, usize)> {
        let Self { first_row, rows, columns, at, .. } = self;
        (0..rows * columns).map(move |i| (first_row * columns + i, at[0] + i / columns, at[1] + i % columns))
    }
}

pub(super) fn padded(columns: usize) -> usize {
    columns.next_multiple_of(SIZE_MULTIPLE)
}

/// Returns the pieces of the weights of `dense`, and of its biases. `inputs` are the widths of the parts of its input,
/// `index` is its index among [`RadianceMlp::layers`](crate::mlp::RadianceMlp::layers), and `column` is its first output column.
pub(super) fn pieces(dense: &Dense, index: usize, inputs: &[usize], column: usize) -> (Vec<Piece>, Piece) {
    let [rows, columns] = dense.weight.dims();
    assert_eq!(rows, inputs.iter().sum::<usize>(), "layers fit on top of each other");
    let (mut row, mut first_row, mut weights) = (0, 0, Vec::new());
    for &rows in inputs {
        weights.push(Piece { parameter: 2 * index, first_row, rows, columns, at: [row, column] });
        first_row += rows;
        row += padded(rows);
    }
    (weights, Piece { parameter: 2 * index + 1, first_row: 0, rows: 1, columns, at: [0, column] })
}
