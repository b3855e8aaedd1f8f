//! A product of two factors, and its launch.

use burn::cubecl::calculate_cube_count_elemwise;
use burn::cubecl::prelude::*;
use burn_cubecl::tensor::CubeTensor;

use super::kernel::{self, End, Options, PlaceLaunch};
use super::tile::Tile;
use super::{Rows, dims};
use crate::cube::arg;
use crate::mlp::Activation;

/// A matrix as a factor: of each outer index and each term of the sums a number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factor<'a> {
    pub(super) matrix: Rows<'a>,
    /// Its first number; 0 of two matrices.
    pub(super) start: usize,
    /// Numbers of a row in memory; of two matrices, of the first one's.
    pub(super) width: usize,
    pub(super) outers: usize,
    /// Whether a row in memory holds the terms of an outer index, rather than a term of all of them.
    pub(super) along_terms: bool,
}

impl<'a> Factor<'a> {
    pub(super) fn of_rows(matrix: Rows<'a>, outers: usize, along_terms: bool) -> Self {
        Self { matrix, start: 0, width: dims(matrix.first)[1], outers, along_terms }
    }

    fn second(&self) -> &'a CubeTensor {
        self.matrix.second.unwrap_or(self.matrix.first)
    }

    fn place(&self) -> PlaceLaunch {
        PlaceLaunch::new(self.start, self.width, dims_or_row(self.second()), self.outers)
    }
}

/// Numbers of a matrix's rows, or of a vector.
fn dims_or_row(tensor: &CubeTensor) -> usize {
    let shape = tensor.meta.shape();
    shape[shape.num_dims() - 1]
}

/// Left · right, and what becomes of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Product<'a> {
    pub(super) left: Factor<'a>,
    pub(super) right: Factor<'a>,
    /// Of each sum.
    pub(super) terms: usize,
    pub(super) end: End,
    pub(super) function: Activation,
    /// What the end needs of each row, column or number.
    pub(super) row_input: Option<&'a CubeTensor>,
    pub(super) column_input: Option<&'a CubeTensor>,
    pub(super) kept: Option<&'a CubeTensor>,
    /// Where biases or sums of columns begin.
    pub(super) column_start: usize,
    pub(super) out_start: usize,
    /// In how many parts the sums are taken, and how many numbers each has of the output.
    pub(super) parts: usize,
    pub(super) part_numbers: usize,
}

impl<'a> Product<'a> {
    pub(super) fn new(left: Factor<'a>, right: Factor<'a>, terms: usize, end: End) -> Self {
        let (row_input, column_input, kept) = (None, None, None);
        let (column_start, out_start, parts, part_numbers) = (0, 0, 1, 0);
        let function = Activation::None;
        Self {
            left,
            right,
            terms,
            end,
            function,
            row_input,
            column_input,
            kept,
            column_start,
            out_start,
            parts,
            part_numbers,
        }
    }

    pub(super) fn launch(&self, out: &CubeTensor) {
        let Self { left, right, .. } = self;
        let tile = Tile::of_columns(right.outers);
        let options = Options {
            tile,
            left: tile.left(left.along_terms, left.matrix.second.is_some()),
            right: tile.right(right.along_terms),
            end: self.end,
            function: self.function,
        };
        let groups = tile.count([left.outers, right.outers]) * self.parts;
        let dim = CubeDim::new_1d(tile.threads() as u32);
        let count = calculate_cube_count_elemwise(&out.client, groups * tile.threads(), dim);
        let unused = left.matrix.first;
        kernel::multiply::launch(
            &out.client,
            count,
            dim,
            arg(left.matrix.first),
            arg(left.second()),
            arg(right.matrix.first),
            arg(self.row_input.unwrap_or(unused)),
            arg(self.column_input.unwrap_or(unused)),
            arg(self.kept.unwrap_or(unused)),
            arg(out),
            left.place(),
            right.place(),
            self.terms,
            self.terms.div_ceil(self.parts),
            self.part_numbers,
            self.out_start,
            self.column_start,
            options,
        );
    }
}
