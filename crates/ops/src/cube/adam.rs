//! A step of Adam as one launch per parameter.

use burn::cubecl::{self, prelude::*};
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;

use super::empty_like;
use crate::adam::{AdamOps, Step};

/// One thread per number. The moments are replaced where they are.
#[cube(launch)]
fn update(
    x: &Tensor<f32>,
    g: &Tensor<f32>,
    m: &mut Tensor<f32>,
    v: &mut Tensor<f32>,
    next: &mut Tensor<f32>,
    beta1: f32,
    beta2: f32,
    rate: f32,
    epsilon: f32,
) {
    if ABSOLUTE_POS >= x.len() {
        terminate!();
    }
    let g = g[ABSOLUTE_POS];
    let mean = m[ABSOLUTE_POS] * beta1 + g * (1.0f32 - beta1);
    let square = v[ABSOLUTE_POS] * beta2 + g * g * (1.0f32 - beta2);
    m[ABSOLUTE_POS] = mean;
    v[ABSOLUTE_POS] = square;
    next[ABSOLUTE_POS] = x[ABSOLUTE_POS] - mean * rate / (f32::sqrt(square) + epsilon);
}

impl AdamOps for CubeBackend {
    fn adam(
        x: CubeTensor,
        g: CubeTensor,
        m: CubeTensor,
        v: CubeTensor,
        step: Step,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let [x, g] = [x, g].map(into_contiguous);
        // The model has its parameters too while it is stepped; moments are the optimiser's own, unless it was cloned.
        let own = |moment: CubeTensor| if moment.can_mut() { moment } else { moment.copy() };
        let [m, v] = [m, v].map(own).map(into_contiguous);
        let next = empty_like(&x);
        launch!(
            update::launch, x.meta.num_elements();
            &x, &g, &m, &v, &next;
            step.beta1, step.beta2, step.rate, step.epsilon
        );
        (next, m, v)
    }
}
