//! Host kernel of [`trilinear`](super::trilinear()).

use rayon::prelude::*;

use super::{PaddingMode, Voxels};
use crate::kernel::{Kernel, Pass};

const CHUNK: usize = 1024;

#[derive(Debug)]
pub(super) struct TrilinearKernel {
    pub(super) voxels: Voxels,
    pub(super) channels: usize,
}

/// Returns the voxels below and above a coordinate, each with its weight and the weight's derivative; `None` beyond the grid.
fn neighbours(at: f32, size: usize, padding: PaddingMode) -> [Option<(usize, f32, f32)>; 2] {
    let last = (size - 1) as f32;
    let (least, largest) = match padding {
        PaddingMode::Border => (0.0, last),
        PaddingMode::Zero => (-1.0, last + 1.0),
    };
    let within = at.clamp(least, largest);
    let below = within.floor();
    let (fraction, derivative) = (within - below, if at > least && at < largest { 1.0 } else { 0.0 });
    [(0, 1.0 - fraction, -derivative), (1, fraction, derivative)].map(|(side, weight, derivative)| {
        let voxel = usize::try_from(below as isize + side).ok().filter(|voxel| *voxel < size)?;
        Some((voxel, weight, derivative))
    })
}

impl TrilinearKernel {
    /// Iterates over those of the eight voxels around a place that lie within the grid: the row of each, its weight, and the
    /// derivative of the weight along each axis.
    fn corners(&self, index: usize, place: &[f32]) -> impl Iterator<Item = (usize, f32, [f32; 3])> {
        let Voxels { grids, size, padding } = self.voxels;
        let axes = [0, 1, 2].map(|axis| neighbours(place[axis], size[axis], padding));
        let grid = index % grids * (size[0] * size[1] * size[2]);
        (0..8).filter_map(move |corner: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| axes[axis][corner >> axis & 1]);
            let ((x, wx, dx), (y, wy, dy), (z, wz, dz)) = (x?, y?, z?);
            let row = grid + (z * size[1] + y) * size[0] + x;
            Some((row, wx * wy * wz, [dx * wy * wz, wx * dy * wz, wx * wy * dz]))
        })
    }

    /// Computes the gradient of the table in one thread, as it is not known in advance which places share a voxel.
    fn table_gradient(&self, places: &[f32], grad: &[f32]) -> Vec<f32> {
        let mut table = vec![0.0; self.voxels.rows() * self.channels];
        for (index, (place, grad)) in places.chunks_exact(3).zip(grad.chunks_exact(self.channels)).enumerate() {
            for (row, weight, _) in self.corners(index, place) {
                for (sum, g) in table[row * self.channels..].iter_mut().zip(grad) {
                    *sum += weight * g;
                }
            }
        }
        table
    }

    fn place_gradient(&self, table: &[f32], places: &[f32], grad: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; places.len()];
        let rows = places.par_chunks_exact(3).zip(grad.par_chunks_exact(self.channels)).with_min_len(CHUNK);
        rows.zip(out.par_chunks_exact_mut(3)).enumerate().for_each(|(index, ((place, grad), out))| {
            for (row, _, derivatives) in self.corners(index, place) {
                let d: f32 = table[row * self.channels..].iter().zip(grad).map(|(value, g)| value * g).sum();
                for (out, derivative) in out.iter_mut().zip(derivatives) {
                    *out += derivative * d;
                }
            }
        });
        out
    }
}

impl Kernel for TrilinearKernel {
    fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
        let &[table, places] = inputs else { unreachable!("trilinear reading has two inputs") };
        let mut out = vec![0.0; places.len() / 3 * self.channels];
        let rows = out.par_chunks_exact_mut(self.channels).zip(places.par_chunks_exact(3)).with_min_len(CHUNK);
        rows.enumerate().for_each(|(index, (out, place))| {
            for (row, weight, _) in self.corners(index, place) {
                for (sum, value) in out.iter_mut().zip(&table[row * self.channels..]) {
                    *sum += weight * value;
                }
            }
        });
        out
    }

    fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
        let &[table, places] = pass.inputs else { unreachable!("trilinear reading has two inputs") };
        let (dtable, dplaces) = rayon::join(
            || wanted[0].then(|| self.table_gradient(places, pass.grad)),
            || wanted[1].then(|| self.place_gradient(table, places, pass.grad)),
        );
        vec![dtable, dplaces]
    }
}
