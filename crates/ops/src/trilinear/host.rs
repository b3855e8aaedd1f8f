//! Host kernel of [`trilinear`](super::trilinear()).

use rayon::prelude::*;

use super::{PaddingMode, Voxels};
use crate::host::{Kernel, Pass};

const CHUNK: usize = 1024;

#[derive(Debug)]
pub(super) struct TrilinearKernel {
    pub(super) voxels: Voxels,
    pub(super) channels: usize,
}

/// Place of a coordinate between two voxels.
struct GridAxis {
    /// Voxel below the coordinate.
    below: isize,
    /// Weights of the voxels below and above.
    weights: [f32; 2],
    /// Derivatives of the weights with respect to the coordinate.
    derivatives: [f32; 2],
}

impl GridAxis {
    fn new(at: f32, size: usize, padding: PaddingMode) -> Self {
        let last = (size - 1) as f32;
        let (least, largest) = match padding {
            PaddingMode::Border => (0.0, last),
            PaddingMode::Zero => (-1.0, last + 1.0),
        };
        let within = at.clamp(least, largest);
        let below = within.floor();
        let fraction = within - below;
        let derivatives = if at > least && at < largest { [-1.0, 1.0] } else { [0.0; 2] };
        Self { below: below as isize, weights: [1.0 - fraction, fraction], derivatives }
    }
}

/// One of the eight voxels around a place: its row, its weight, and the derivative of the weight along each axis.
struct VoxelCorner {
    row: usize,
    weight: f32,
    derivative: [f32; 3],
}

impl TrilinearKernel {
    /// Iterates over those of the eight voxels around a place that lie within the grid.
    fn corners(&self, index: usize, place: &[f32]) -> impl Iterator<Item = VoxelCorner> {
        let Voxels { grids, size, padding } = self.voxels;
        let axes = [0, 1, 2].map(|axis| GridAxis::new(place[axis], size[axis], padding));
        let grid = index % grids * (size[0] * size[1] * size[2]);
        (0..8).filter_map(move |corner: usize| {
            let sides = [corner & 1, corner >> 1 & 1, corner >> 2];
            let [x, y, z] = [0, 1, 2].map(|axis| {
                let voxel = axes[axis].below + sides[axis] as isize;
                usize::try_from(voxel).ok().filter(|voxel| *voxel < size[axis])
            });
            let row = grid + (z? * size[1] + y?) * size[0] + x?;
            let weights = [0, 1, 2].map(|axis| axes[axis].weights[sides[axis]]);
            let derivative = [0, 1, 2]
                .map(|axis| axes[axis].derivatives[sides[axis]] * weights[(axis + 1) % 3] * weights[(axis + 2) % 3]);
            Some(VoxelCorner { row, weight: weights[0] * weights[1] * weights[2], derivative })
        })
    }

    fn voxel<'a>(&self, table: &'a [f32], row: usize) -> &'a [f32] {
        &table[row * self.channels..(row + 1) * self.channels]
    }

    /// Computes the gradient of the table in one thread, as it is not known in advance which places share a voxel.
    fn table_gradient(&self, places: &[f32], grad: &[f32]) -> Vec<f32> {
        let mut table = vec![0.0; self.voxels.rows() * self.channels];
        for (index, (place, grad)) in places.chunks_exact(3).zip(grad.chunks_exact(self.channels)).enumerate() {
            for corner in self.corners(index, place) {
                let start = corner.row * self.channels;
                for (sum, g) in table[start..start + self.channels].iter_mut().zip(grad) {
                    *sum += corner.weight * g;
                }
            }
        }
        table
    }

    fn place_gradient(&self, table: &[f32], places: &[f32], grad: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; places.len()];
        let rows = places.par_chunks_exact(3).zip(grad.par_chunks_exact(self.channels)).with_min_len(CHUNK);
        rows.zip(out.par_chunks_exact_mut(3)).enumerate().for_each(|(index, ((place, grad), out))| {
            for corner in self.corners(index, place) {
                let voxel = self.voxel(table, corner.row);
                let d: f32 = voxel.iter().zip(grad).map(|(value, g)| value * g).sum();
                for (out, derivative) in out.iter_mut().zip(corner.derivative) {
                    *out += derivative * d;
                }
            }
        });
        out
    }
}

impl Kernel for TrilinearKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let &[table, places] = inputs else { unreachable!("trilinear reading has two inputs") };
        let mut out = vec![0.0; places.len() / 3 * self.channels];
        let rows = out.par_chunks_exact_mut(self.channels).zip(places.par_chunks_exact(3)).with_min_len(CHUNK);
        rows.enumerate().for_each(|(index, (out, place))| {
            for corner in self.corners(index, place) {
                for (sum, value) in out.iter_mut().zip(self.voxel(table, corner.row)) {
                    *sum += corner.weight * value;
                }
            }
        });
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let &[table, places] = pass.inputs else { unreachable!("trilinear reading has two inputs") };
        let (dtable, dplaces) = rayon::join(
            || pass.wanted[0].then(|| self.table_gradient(places, pass.grad)),
            || pass.wanted[1].then(|| self.place_gradient(table, places, pass.grad)),
        );
        vec![dtable, dplaces]
    }
}
