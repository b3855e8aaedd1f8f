//! Trilinear reading of voxel grids, differentiable in the voxels and in the places.

use burn::tensor::{Device, Int, Tensor};

use crate::dispatch::dispatch;
use crate::upload;

/// Grids of one size whose voxels are the rows of a table: grid by grid, and in each of them x runs fastest, z slowest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voxels {
    /// Number of grids.
    pub grids: usize,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// What is read beyond the outermost voxels' centres.
    pub beyond: Beyond,
}

/// What is read beyond the centres of a grid's outermost voxels, as in PyTorch's `grid_sample`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beyond {
    /// The nearest voxel of the border, with no gradient towards the place.
    Border,
    /// 0, which is reached one voxel beyond.
    Zero,
}

impl Voxels {
    /// Number of rows of the table.
    pub fn rows(&self) -> usize {
        self.grids * self.size.iter().product::<usize>()
    }
}

/// `table` read at `places`, `[P, C]`, differentiable in both (PyTorch: `grid_sample` with `align_corners=True`).
///
/// - `table`: a value of C channels for each voxel, `[rows, C]`.
/// - `places`: x, y, z in voxels, `[P, 3]`: (0, 0, 0) is the centre of the first voxel. Place `p` reads the grid `p mod
///   grids`.
///
/// # Panics
/// If `table` does not match `voxels`, or `places` has other than three columns.
///
/// # Examples
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::trilinear::{Beyond, Voxels, trilinear};
///
/// let device = Device::flex();
/// let voxels = Voxels { grids: 1, size: [2, 1, 1], beyond: Beyond::Border };
/// let table = Tensor::<2>::from_floats([[1.0], [3.0]], &device);
/// let read = trilinear(table, Tensor::from_floats([[0.25, 0.0, 0.0]], &device), voxels);
/// assert_eq!(read.into_scalar::<f32>(), 1.5);
/// # }
/// ```
pub fn trilinear(table: Tensor<2>, places: Tensor<2>, voxels: Voxels) -> Tensor<2> {
    assert_eq!(table.dims()[0], voxels.rows(), "table holds one row per voxel");
    assert_eq!(places.dims()[1], 3, "a place has three coordinates");
    dispatch! {
        &table.device();
        host => crate::kernel::apply(host::TrilinearKernel { voxels, channels: table.dims()[1] }, (table, places)),
        plain => plain(table, places, voxels),
    }
}

/// [`trilinear`] from plain tensor operations, on any backend.
pub fn plain(table: Tensor<2>, places: Tensor<2>, voxels: Voxels) -> Tensor<2> {
    let device = table.device();
    let [count, channels] = [places.dims()[0], table.dims()[1]];
    let axes = [0, 1, 2].map(|axis| plain_axis(places.clone().narrow(1, axis, 1), voxels.size[axis], voxels.beyond));
    let grid = grid_of_places(count, voxels, &device);
    let corner = |corner: usize| {
        let mut row = grid.clone();
        let mut weight = Tensor::<2>::ones([count, 1], &device);
        let mut stride = 1;
        for (axis, (rows, weights)) in axes.iter().enumerate() {
            let side = corner >> axis & 1;
            row = row + rows[side].clone() * stride;
            weight = weight * weights[side].clone();
            stride *= voxels.size[axis] as i32;
        }
        table.clone().select(0, row.reshape([count])) * weight
    };
    (0..8).map(corner).fold(Tensor::zeros([count, channels], &device), |sum, read| sum + read)
}

/// First row of the grid that each place reads, `[P, 1]`.
fn grid_of_places(count: usize, voxels: Voxels, device: &Device) -> Tensor<2, Int> {
    let size = voxels.rows() / voxels.grids;
    let first: Vec<i32> = (0..count).map(|place| (place % voxels.grids * size) as i32).collect();
    upload(first, [count, 1], device)
}

/// The voxels below and above each coordinate, and their weights, `[P, 1]` each.
fn plain_axis(at: Tensor<2>, size: usize, beyond: Beyond) -> ([Tensor<2, Int>; 2], [Tensor<2>; 2]) {
    let last = (size - 1) as f32;
    let at = match beyond {
        Beyond::Border => at.clamp(0.0, last),
        Beyond::Zero => at.clamp(-1.0, last + 1.0),
    };
    let below = at.clone().detach().floor();
    let fraction = at - below.clone();
    let side = |index: Tensor<2>, weight: Tensor<2>| {
        let there = index.clone().greater_equal_elem(0.0).bool_and(index.clone().lower_equal_elem(last));
        (index.clamp(0.0, last).int(), weight.mask_fill(there.bool_not(), 0.0))
    };
    let (low, low_weight) = side(below.clone(), fraction.clone().neg() + 1.0);
    let (high, high_weight) = side(below + 1.0, fraction);
    ([low, high], [low_weight, high_weight])
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use super::{Beyond, Voxels};
    use crate::kernel::{Kernel, Pass};

    /// Places that a thread takes at a time.
    const CHUNK: usize = 1024;

    #[derive(Debug)]
    pub(super) struct TrilinearKernel {
        pub(super) voxels: Voxels,
        pub(super) channels: usize,
    }

    /// A coordinate: the voxel below it, the fraction beyond that, and whether the reading changes with it.
    #[derive(Clone, Copy)]
    struct Axis {
        below: isize,
        fraction: f32,
        moves: bool,
    }

    impl Axis {
        fn new(at: f32, size: usize, beyond: Beyond) -> Self {
            let last = (size - 1) as f32;
            let (least, largest) = match beyond {
                Beyond::Border => (0.0, last),
                Beyond::Zero => (-1.0, last + 1.0),
            };
            let within = at.clamp(least, largest);
            let below = within.floor();
            Self { below: below as isize, fraction: within - below, moves: at > least && at < largest }
        }
    }

    /// One of the eight voxels around a place: its row, its weight, and how that changes along each axis.
    struct Corner {
        row: usize,
        weight: f32,
        slope: [f32; 3],
    }

    impl TrilinearKernel {
        /// The voxels around a place that are there.
        fn corners(&self, index: usize, place: &[f32]) -> impl Iterator<Item = Corner> {
            let Voxels { grids, size, beyond } = self.voxels;
            let axes = [0, 1, 2].map(|axis| Axis::new(place[axis], size[axis], beyond));
            let grid = index % grids * (size[0] * size[1] * size[2]);
            (0..8).filter_map(move |corner: usize| {
                let sides = [corner & 1, corner >> 1 & 1, corner >> 2];
                let [x, y, z] = [0, 1, 2].map(|axis| {
                    let voxel = axes[axis].below + sides[axis] as isize;
                    usize::try_from(voxel).ok().filter(|voxel| *voxel < size[axis])
                });
                let row = grid + (z? * size[1] + y?) * size[0] + x?;
                let weights = [0, 1, 2].map(|axis| {
                    let Axis { fraction, .. } = axes[axis];
                    if sides[axis] == 1 { fraction } else { 1.0 - fraction }
                });
                let slope = [0, 1, 2].map(|axis| {
                    let sign = if sides[axis] == 1 { 1.0 } else { -1.0 };
                    if axes[axis].moves { sign * weights[(axis + 1) % 3] * weights[(axis + 2) % 3] } else { 0.0 }
                });
                Some(Corner { row, weight: weights[0] * weights[1] * weights[2], slope })
            })
        }

        fn voxel<'a>(&self, table: &'a [f32], row: usize) -> &'a [f32] {
            &table[row * self.channels..(row + 1) * self.channels]
        }

        /// The gradient of the table, place by place: which of them meet in a voxel is known to none before.
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
            let chunks = places.par_chunks(3 * CHUNK).zip(grad.par_chunks(self.channels * CHUNK));
            out.par_chunks_mut(3 * CHUNK).zip(chunks).enumerate().for_each(|(chunk, (out, (places, grad)))| {
                let rows = out.chunks_exact_mut(3).zip(places.chunks_exact(3)).zip(grad.chunks_exact(self.channels));
                for (index, ((out, place), grad)) in rows.enumerate() {
                    for corner in self.corners(chunk * CHUNK + index, place) {
                        let voxel = self.voxel(table, corner.row);
                        let worth: f32 = voxel.iter().zip(grad).map(|(value, g)| value * g).sum();
                        for (out, slope) in out.iter_mut().zip(corner.slope) {
                            *out += slope * worth;
                        }
                    }
                }
            });
            out
        }
    }

    impl Kernel for TrilinearKernel {
        fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![inputs[1][0], self.channels]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let &[table, places] = inputs else { unreachable!("trilinear reading has two inputs") };
            let mut out = vec![0.0; places.len() / 3 * self.channels];
            let chunks = out.par_chunks_mut(CHUNK * self.channels).zip(places.par_chunks(3 * CHUNK));
            chunks.enumerate().for_each(|(chunk, (out, places))| {
                for (index, (out, place)) in out.chunks_exact_mut(self.channels).zip(places.chunks_exact(3)).enumerate()
                {
                    for corner in self.corners(chunk * CHUNK + index, place) {
                        for (sum, value) in out.iter_mut().zip(self.voxel(table, corner.row)) {
                            *sum += corner.weight * value;
                        }
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::to_host;

    const CHANNELS: usize = 2;

    fn voxels(beyond: Beyond) -> Voxels {
        Voxels { grids: 2, size: [3, 2, 4], beyond }
    }

    /// Places within both grids, beyond each face, and far away.
    const PLACES: [[f32; 3]; 8] = [
        [0.25, 0.5, 1.75],
        [1.5, 0.25, 2.9],
        [-0.4, 0.6, 0.3],
        [2.3, 0.1, 3.6],
        [1.2, 1.7, -0.8],
        [0.7, -0.3, 1.1],
        [-9.0, 0.5, 1.0],
        [1.1, 0.4, 40.0],
    ];

    /// What is read, and its gradients with respect to the table and the places.
    fn run(read: fn(Tensor<2>, Tensor<2>, Voxels) -> Tensor<2>, device: &Device, beyond: Beyond) -> [Vec<f32>; 3] {
        let device = device.clone().autodiff();
        let rows = voxels(beyond).rows();
        let values = (0..rows * CHANNELS).map(|i| (1.3 * i as f32).sin()).collect::<Vec<f32>>();
        let table = upload(values, [rows, CHANNELS], &device).require_grad();
        let places = Tensor::<2>::from_floats(PLACES, &device).require_grad();
        let out = read(table.clone(), places.clone(), voxels(beyond));
        let grads = (out.clone() * out.clone().sin()).sum().backward();
        let gradient = |tensor: &Tensor<2>| to_host(tensor.grad(&grads).expect("both are read"));
        [to_host(out), gradient(&table), gradient(&places)]
    }

    #[test]
    #[allow(deprecated, reason = "the older backend stays selectable, so it stays tested")]
    fn bodies_agree_with_their_gradients() {
        for beyond in [Beyond::Border, Beyond::Zero] {
            let host = run(trilinear, &Device::flex(), beyond);
            for device in [Device::flex(), Device::ndarray()] {
                for (host, plain) in host.iter().zip(run(plain, &device, beyond)) {
                    assert_eq!(host.len(), plain.len());
                    for (a, b) in host.iter().zip(plain) {
                        assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{beyond:?}: {a} against {b}");
                    }
                }
            }
        }
    }

    /// The value is linear along each axis between voxels: differences are slopes.
    #[test]
    fn the_slope_is_the_difference_between_voxels() {
        let device = Device::flex().autodiff();
        let voxels = Voxels { grids: 1, size: [2, 2, 2], beyond: Beyond::Zero };
        let table =
            Tensor::<2>::from_floats([[0.0], [1.0], [10.0], [11.0], [100.0], [101.0], [110.0], [111.0]], &device);
        let places = Tensor::<2>::from_floats([[0.25, 0.5, 0.75], [-0.25, 0.0, 0.0], [1.5, 1.0, 1.0]], &device);
        let places = places.require_grad();
        let read = trilinear(table, places.clone(), voxels);
        assert_eq!(to_host(read.clone()), [80.25, 0.0, 55.5]);
        let slopes = to_host(places.grad(&read.sum().backward()).unwrap());
        assert_eq!(slopes[..3], [1.0, 10.0, 100.0]);
        // Half a voxel beyond the corner 111 it has fallen to half along x.
        assert_eq!(slopes[6], -111.0);
    }
}
