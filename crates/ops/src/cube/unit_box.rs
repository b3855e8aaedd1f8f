//! Positions as shares of a box.

use burn::cubecl::{self, prelude::*};
use burn::tensor;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply, empty_like};

/// [`unit_box`](crate::unit_box()) of the box at `low`, `scale` being 1 over its sides.
pub(crate) fn unit_box(positions: tensor::Tensor<2>, low: [f32; 3], scale: [f32; 3]) -> tensor::Tensor<2> {
    apply(UnitBox { low, scale }, positions)
}

#[derive(Debug)]
struct UnitBox {
    low: [f32; 3],
    scale: [f32; 3],
}

impl CubeKernel for UnitBox {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let (positions, [x, y, z], [a, b, c]) = (&inputs[0], self.low, self.scale);
        let out = empty_like(positions);
        launch!(shares::launch, positions.meta.num_elements(); positions, &out; x, y, z, a, b, c);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (positions, [x, y, z], [a, b, c]) = (&pass.inputs[0], self.low, self.scale);
        let out = empty_like(positions);
        launch!(slopes::launch, positions.meta.num_elements(); positions, pass.grad, &out; x, y, z, a, b, c);
        vec![Some(out)]
    }
}

/// The number of an axis.
#[cube]
fn of_axis(axis: usize, x: f32, y: f32, z: f32) -> f32 {
    select(axis == 0, x, select(axis == 1, y, z))
}

#[cube(launch)]
fn shares(positions: &Tensor<f32>, out: &mut Tensor<f32>, x: f32, y: f32, z: f32, a: f32, b: f32, c: f32) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let axis = ABSOLUTE_POS % 3;
    let share = (positions[ABSOLUTE_POS] - of_axis(axis, x, y, z)) * of_axis(axis, a, b, c);
    out[ABSOLUTE_POS] = f32::min(f32::max(share, 0.0f32), 1.0f32);
}

#[cube(launch)]
fn slopes(
    positions: &Tensor<f32>,
    grad: &Tensor<f32>,
    out: &mut Tensor<f32>,
    x: f32,
    y: f32,
    z: f32,
    a: f32,
    b: f32,
    c: f32,
) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let axis = ABSOLUTE_POS % 3;
    let scale = of_axis(axis, a, b, c);
    let share = (positions[ABSOLUTE_POS] - of_axis(axis, x, y, z)) * scale;
    let mut slope = 0.0f32;
    if share >= 0.0f32 && share <= 1.0f32 {
        slope = scale * grad[ABSOLUTE_POS];
    }
    out[ABSOLUTE_POS] = slope;
}
