//! The kernel: a group of threads per tile of the product. A step takes some terms of both factors to shared memory, in fours of
//! outer indices, and adds their products to the sums that threads have in registers, while the next terms are on their way.

use burn::cubecl::{self, prelude::*};

use super::tile::{STEP, Staging, Tile};
use crate::cube::activation::{activated, before_activation};
use crate::mlp::Activation;

type Four = Vector<f32, Const<4>>;

/// What is built into a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Options {
    pub(super) tile: Tile,
    pub(super) left: Staging,
    pub(super) right: Staging,
    pub(super) end: End,
    pub(super) function: Activation,
}

/// What becomes of a sum s.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum End {
    /// Itself.
    Nothing,
    /// f(s + b) of its column's bias.
    Activation,
    /// s f′, given the value of f.
    Slope,
    /// (s + u v) f′ of its row's u and its column's v.
    SlopeOfMore,
    /// It is added to what is there.
    Onto,
    /// Itself, in parts, and beside it the sums of the right factor's columns.
    Gradient,
    /// The same, transposed.
    TransposedGradient,
}

impl End {
    const fn is_gradient(self) -> bool {
        matches!(self, Self::Gradient | Self::TransposedGradient)
    }
}

/// Where a factor lies in memory.
#[derive(CubeType, CubeLaunch)]
pub(super) struct Place {
    /// Its first number.
    start: usize,
    /// Numbers of a row; of two matrices, of the first one's.
    width: usize,
    /// Of the second one's rows.
    second_width: usize,
    /// Outer indices.
    outers: usize,
}

/// A factor's share of a step, in registers: of the outer indices from `outer` on and the terms from `term` on, zeros where there
/// is none.
#[cube]
fn fetch(
    x: &Tensor<f32>,
    second: &Tensor<f32>,
    place: &Place,
    share: &mut Array<Four>,
    outer: usize,
    term: usize,
    end: usize,
    #[comptime] staging: Staging,
) {
    #[unroll]
    for i in 0..comptime!(staging.shares()) {
        let index = UNIT_POS as usize + i * comptime!(staging.threads);
        let first = outer + four_of(index, staging) * 4;
        let k = term + term_of(index, staging);
        let mut four = Four::empty();
        #[unroll]
        for lane in 0..4usize {
            let o = first + lane;
            let mut value = 0.0f32;
            if o < place.outers && k < end {
                let mut row = k;
                let mut column = o;
                if comptime!(staging.along_terms) {
                    row = o;
                    column = k;
                }
                if comptime!(staging.is_split) {
                    if column < place.width {
                        value = x[row * place.width + column];
                    } else {
                        value = second[row * place.second_width + column - place.width];
                    }
                } else {
                    value = x[place.start + row * place.width + column];
                }
            }
            four.insert(lane, value);
        }
        share[i] = four;
    }
}

/// Which four of outer indices is a thread's, such that neighbouring threads read neighbouring numbers.
#[cube]
fn four_of(index: usize, #[comptime] staging: Staging) -> usize {
    let mut four = index % comptime!(staging.fours);
    if comptime!(staging.along_terms) {
        four = index / comptime!(STEP);
    }
    four
}

/// Of which term.
#[cube]
fn term_of(index: usize, #[comptime] staging: Staging) -> usize {
    let mut term = index / comptime!(staging.fours);
    if comptime!(staging.along_terms) {
        term = index % comptime!(STEP);
    }
    term
}

/// What was fetched, to shared memory: all fours of a term, then of the next.
#[cube]
fn stage(share: &Array<Four>, shared: &mut Shared<[Four]>, #[comptime] staging: Staging) {
    #[unroll]
    for i in 0..comptime!(staging.shares()) {
        let index = UNIT_POS as usize + i * comptime!(staging.threads);
        let at = term_of(index, staging) * comptime!(staging.pitch()) + four_of(index, staging);
        if comptime!(staging.is_even()) {
            shared[at] = share[i];
        } else {
            if index < comptime!(staging.fours * STEP) {
                shared[at] = share[i];
            }
        }
    }
}

/// Adds the products of a step's terms to a thread's sums: fours along a row, row after row.
#[cube]
fn accumulate(left: &Shared<[Four]>, right: &Shared<[Four]>, sums: &mut Array<Four>, #[comptime] options: Options) {
    let tile = comptime!(options.tile);
    let own_row = UNIT_POS as usize / comptime!(tile.column_threads);
    let own_column = UNIT_POS as usize % comptime!(tile.column_threads);
    let mut columns = Array::<Four>::new(comptime!(tile.column_fours));
    #[unroll]
    for k in 0..comptime!(STEP) {
        let left_at = k * comptime!(options.left.pitch()) + own_row;
        let right_at = k * comptime!(options.right.pitch()) + own_column;
        #[unroll]
        for j in 0..comptime!(tile.column_fours) {
            columns[j] = right[right_at + j * comptime!(tile.column_threads)];
        }
        #[unroll]
        for i in 0..comptime!(tile.row_fours) {
            let rows = left[left_at + i * comptime!(tile.row_threads)];
            #[unroll]
            for lane in 0..4usize {
                let x = Four::new(rows.extract(lane));
                #[unroll]
                for j in 0..comptime!(tile.column_fours) {
                    let at = comptime!((i * 4 + lane) * tile.column_fours + j);
                    sums[at] = fma(x, columns[j], sums[at]);
                }
            }
        }
    }
}

/// Adds a step's terms of the right factor to the sums of a thread's columns.
#[cube]
fn add_columns(right: &Shared<[Four]>, sums: &mut Array<Four>, #[comptime] options: Options) {
    let tile = comptime!(options.tile);
    let own = UNIT_POS as usize % comptime!(tile.column_threads);
    for k in 0..comptime!(STEP) {
        #[unroll]
        for j in 0..comptime!(tile.column_fours) {
            sums[j] += right[k * comptime!(options.right.pitch()) + own + j * comptime!(tile.column_threads)];
        }
    }
}

/// `[rows, terms]·[terms, columns]`, in parts of `part_terms` terms, each of which has `part_numbers` numbers of `out`.
///
/// `row_input`, `column_input` and `kept` are what the end is given of each row, column and number; `column_start` is where the
/// biases begin in `column_input`, or the sums of columns in `out`.
#[cube(launch)]
pub(super) fn multiply(
    left: &Tensor<f32>,
    left_second: &Tensor<f32>,
    right: &Tensor<f32>,
    row_input: &Tensor<f32>,
    column_input: &Tensor<f32>,
    kept: &Tensor<f32>,
    out: &mut Tensor<f32>,
    left_place: Place,
    right_place: Place,
    terms: usize,
    part_terms: usize,
    part_numbers: usize,
    out_start: usize,
    column_start: usize,
    #[comptime] options: Options,
) {
    let tile = comptime!(options.tile);
    let (rows, columns) = (left_place.outers, right_place.outers);
    let column_tiles = (columns + comptime!(tile.columns() - 1)) / comptime!(tile.columns());
    let row_tiles = (rows + comptime!(tile.rows() - 1)) / comptime!(tile.rows());
    let first_column = CUBE_POS % column_tiles * comptime!(tile.columns());
    let first_row = CUBE_POS / column_tiles % row_tiles * comptime!(tile.rows());
    let part = CUBE_POS / column_tiles / row_tiles;

    let mut left_tile = Shared::<[Four]>::new_slice(comptime!(options.left.shared()));
    let mut right_tile = Shared::<[Four]>::new_slice(comptime!(options.right.shared()));
    let mut left_share = Array::<Four>::new(comptime!(options.left.shares()));
    let mut right_share = Array::<Four>::new(comptime!(options.right.shares()));
    let mut sums = Array::<Four>::new(comptime!(tile.fours()));
    #[unroll]
    for i in 0..comptime!(tile.fours()) {
        sums[i] = Four::new(0.0f32);
    }
    let mut column_sums = Array::<Four>::new(comptime!(tile.column_fours));
    #[unroll]
    for j in 0..comptime!(tile.column_fours) {
        column_sums[j] = Four::new(0.0f32);
    }

    // A group beyond the last part has no terms.
    let mut term = part * part_terms;
    let end = usize::min(term + part_terms, terms);
    fetch(left, left_second, &left_place, &mut left_share, first_row, term, end, options.left);
    fetch(right, right, &right_place, &mut right_share, first_column, term, end, options.right);
    while term < end {
        stage(&left_share, &mut left_tile, options.left);
        stage(&right_share, &mut right_tile, options.right);
        sync_cube();
        term += comptime!(STEP);
        if term < end {
            fetch(left, left_second, &left_place, &mut left_share, first_row, term, end, options.left);
            fetch(right, right, &right_place, &mut right_share, first_column, term, end, options.right);
        }
        accumulate(&left_tile, &right_tile, &mut sums, options);
        if comptime!(options.end.is_gradient()) {
            if first_row == 0 {
                add_columns(&right_tile, &mut column_sums, options);
            }
        }
        sync_cube();
    }

    if part * part_terms < terms {
        let ends =
            Ends { first_row, first_column, rows, columns, out_start: out_start + part * part_numbers, column_start };
        write(&sums, row_input, column_input, kept, out, &ends, options);
        if comptime!(options.end.is_gradient()) {
            if first_row == 0 {
                write_columns(&column_sums, out, &ends, part * part_numbers, options);
            }
        }
    }
}

/// Where a tile's sums go.
#[derive(CubeType)]
struct Ends {
    first_row: usize,
    first_column: usize,
    rows: usize,
    columns: usize,
    out_start: usize,
    column_start: usize,
}

/// Writes what becomes of a thread's sums.
#[cube]
fn write(
    sums: &Array<Four>,
    row_input: &Tensor<f32>,
    column_input: &Tensor<f32>,
    kept: &Tensor<f32>,
    out: &mut Tensor<f32>,
    ends: &Ends,
    #[comptime] options: Options,
) {
    let tile = comptime!(options.tile);
    let own_row = UNIT_POS as usize / comptime!(tile.column_threads);
    #[unroll]
    for i in 0..comptime!(4 * tile.row_fours) {
        let row = ends.first_row + (own_row + comptime!(i / 4 * tile.row_threads)) * 4 + comptime!(i % 4);
        if row < ends.rows {
            #[unroll]
            for j in 0..comptime!(4 * tile.column_fours) {
                let column = column_of(j, ends, tile);
                if column < ends.columns {
                    let sum = sums[comptime!(i * tile.column_fours + j / 4)].extract(comptime!(j % 4));
                    let at = row * ends.columns + column;
                    match comptime!(options.end) {
                        End::Nothing | End::Gradient => out[ends.out_start + at] = sum,
                        End::TransposedGradient => out[ends.out_start + column * ends.rows + row] = sum,
                        End::Onto => out[at] += sum,
                        End::Activation => {
                            out[at] = activated(sum + column_input[ends.column_start + column], options.function);
                        }
                        End::Slope => out[at] = before_activation(kept[at], sum, options.function),
                        End::SlopeOfMore => {
                            let more = sum + row_input[row] * column_input[column];
                            out[at] = before_activation(kept[at], more, options.function);
                        }
                    }
                }
            }
        }
    }
}

/// Writes the sums of a thread's columns, which those below it have too.
#[cube]
fn write_columns(
    sums: &Array<Four>,
    out: &mut Tensor<f32>,
    ends: &Ends,
    part_start: usize,
    #[comptime] options: Options,
) {
    let tile = comptime!(options.tile);
    if (UNIT_POS as usize) < comptime!(tile.column_threads) {
        #[unroll]
        for j in 0..comptime!(4 * tile.column_fours) {
            let column = column_of(j, ends, tile);
            if column < ends.columns {
                out[part_start + ends.column_start + column] = sums[comptime!(j / 4)].extract(comptime!(j % 4));
            }
        }
    }
}

/// The column of the `j`-th number of a thread's rows.
#[cube]
fn column_of(#[comptime] j: usize, ends: &Ends, #[comptime] tile: Tile) -> usize {
    let own = UNIT_POS as usize % comptime!(tile.column_threads);
    ends.first_column + (own + comptime!(j / 4 * tile.column_threads)) * 4 + comptime!(j % 4)
}
