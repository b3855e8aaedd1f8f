//! Trilinear reading of voxel grids, differentiable in the voxels and in the places.

#[cfg(feature = "flex")]
mod host;

use burn::tensor::{Int, Tensor};

use crate::dispatch::dispatch;
use crate::traffic::upload;

/// Grids of one size whose voxels are the rows of a table: grid by grid, and in each of them x runs fastest, z slowest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voxels {
    /// Number of grids.
    pub grids: usize,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Value beyond the outermost voxels' centres.
    pub padding: PaddingMode,
}

/// Value beyond the centres of a grid's outermost voxels, as in PyTorch's `grid_sample`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaddingMode {
    /// Value of the nearest voxel of the border, with no gradient with respect to the place.
    Border,
    /// Linear decrease to 0 within one voxel.
    Zero,
}

impl Voxels {
    /// Returns the number of rows of the table.
    pub fn rows(&self) -> usize {
        self.grids * self.size.iter().product::<usize>()
    }
}

/// Interpolates `table` at `places`, `[P, C]`: the sum of the eight voxels around a place, each times Π (1 − |distance|) over the three
/// axes. Differentiable in both (PyTorch: `grid_sample` with `align_corners=True`).
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
/// use infonerf_ops::trilinear::{PaddingMode, Voxels, trilinear};
///
/// let device = Device::flex();
/// let voxels = Voxels { grids: 1, size: [2, 1, 1], padding: PaddingMode::Border };
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
        host => {
            let (kernel, count) = (host::TrilinearKernel { voxels, channels: table.dims()[1] }, places.dims()[0]);
            crate::host::apply(kernel, [count, table.dims()[1]], [table, places].map(Tensor::into_dispatch))
        },
        plain => plain(table, places, voxels),
    }
}

/// Computes [`trilinear`] by plain tensor operations, on any backend.
pub fn plain(table: Tensor<2>, places: Tensor<2>, voxels: Voxels) -> Tensor<2> {
    let device = table.device();
    let [count, channels] = [places.dims()[0], table.dims()[1]];
    let axes = [0, 1, 2].map(|axis| plain_axis(places.clone().narrow(1, axis, 1), voxels.size[axis], voxels.padding));
    let size = voxels.rows() / voxels.grids;
    // First row of the grid that each place reads.
    let grid = upload((0..count).map(|place| (place % voxels.grids * size) as i32).collect(), [count, 1], &device);
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

/// Finds the voxels below and above each coordinate, and their weights, `[P, 1]` each.
fn plain_axis(at: Tensor<2>, size: usize, padding: PaddingMode) -> ([Tensor<2, Int>; 2], [Tensor<2>; 2]) {
    let last = (size - 1) as f32;
    let at = match padding {
        PaddingMode::Border => at.clamp(0.0, last),
        PaddingMode::Zero => at.clamp(-1.0, last + 1.0),
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

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::to_host;

    const CHANNELS: usize = 2;

    fn voxels(padding: PaddingMode) -> Voxels {
        Voxels { grids: 2, size: [3, 2, 4], padding }
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

    /// Returns the values read, and their gradients with respect to the table and the places.
    fn run(
        read: fn(Tensor<2>, Tensor<2>, Voxels) -> Tensor<2>,
        device: &Device,
        padding: PaddingMode,
    ) -> [Vec<f32>; 3] {
        let device = device.clone().autodiff();
        let rows = voxels(padding).rows();
        let values = (0..rows * CHANNELS).map(|i| (1.3 * i as f32).sin()).collect::<Vec<f32>>();
        let table = upload(values, [rows, CHANNELS], &device).require_grad();
        let places = Tensor::<2>::from_floats(PLACES, &device).require_grad();
        let out = read(table.clone(), places.clone(), voxels(padding));
        let grads = (out.clone() * out.clone().sin()).sum().backward();
        let gradient = |tensor: &Tensor<2>| to_host(tensor.grad(&grads).expect("both are read"));
        [to_host(out), gradient(&table), gradient(&places)]
    }

    #[test]
    fn bodies_agree_with_their_gradients() {
        for padding in [PaddingMode::Border, PaddingMode::Zero] {
            let host = run(trilinear, &Device::flex(), padding);
            for device in [Device::flex(), Device::ndarray()] {
                for (host, plain) in host.iter().zip(run(plain, &device, padding)) {
                    approx::assert_relative_eq!(host[..], plain[..], epsilon = 1e-5, max_relative = 1e-5);
                }
            }
        }
    }

    #[test]
    fn gradient_between_voxels_is_their_difference() {
        let device = Device::flex().autodiff();
        let voxels = Voxels { grids: 1, size: [2, 2, 2], padding: PaddingMode::Zero };
        let table =
            Tensor::<2>::from_floats([[0.0], [1.0], [10.0], [11.0], [100.0], [101.0], [110.0], [111.0]], &device);
        let places = Tensor::<2>::from_floats([[0.25, 0.5, 0.75], [-0.25, 0.0, 0.0], [1.5, 1.0, 1.0]], &device);
        let places = places.require_grad();
        let read = trilinear(table, places.clone(), voxels);
        assert_eq!(to_host(read.clone()), [80.25, 0.0, 55.5]);
        let gradient = to_host(places.grad(&read.sum().backward()).unwrap());
        assert_eq!(gradient[..3], [1.0, 10.0, 100.0]);
        // Along x, the value falls from 111 at the corner to 0 within one voxel.
        assert_eq!(gradient[6], -111.0);
    }
}
