//! Operations along rays, one thread per ray.

mod kernels;

use burn::backend::ops::IntTensorOps;
use burn::tensor::{Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::kernels::ln_1p;
use super::{CubeKernel, Pass, apply, empty, empty_like};
use crate::Segments;
use crate::composite::MIN_ALPHA_SUM;
use crate::traffic::count_upload;

/// [`composite`](crate::composite())'s results, packed: values and Σw, `[R, C + 1]`.
pub(crate) fn composite(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Tensor<2> {
    apply(Composite { rays: Rays::new(segments) }, (tau, values))
}

/// [`ray_entropy`](crate::ray_entropy)'s results for α/Σα, packed: bits and Σα, `[R, 2]`.
pub(crate) fn entropy(tau: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<2> {
    apply(Entropy { rays: Rays::new(segments), epsilon }, tau)
}

/// [`ray_divergence`](crate::ray_divergence), `[R]`.
pub(crate) fn divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    apply(Divergence { rays: Rays::new(segments), epsilon }, (tau, near))
}

/// Which samples each ray owns.
#[derive(Debug)]
struct Rays(Segments);

impl Rays {
    fn new(segments: &Segments) -> Self {
        Self(segments.clone())
    }

    fn count(&self) -> usize {
        self.0.rays()
    }

    /// The offsets, `[R + 1]`, which stay on the device that is the first to be asked for them.
    fn offsets(&self, like: &CubeTensor) -> CubeTensor {
        let moved = || {
            let offsets: Vec<i32> = self.0.offsets.iter().map(|offset| *offset as i32).collect();
            let count = offsets.len();
            count_upload(size_of_val(offsets.as_slice()));
            CubeBackend::int_from_data(TensorData::new(offsets, [count]), &like.device)
        };
        let kept = self.0.on_gpu.get_or_init(moved);
        if kept.device == like.device { kept.clone() } else { moved() }
    }
}

#[derive(Debug)]
struct Composite {
    rays: Rays,
}

impl CubeKernel for Composite {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [tau, values] = inputs else { unreachable!("composite has two inputs") };
        let channels = values.meta.shape()[1];
        let out = empty(tau, [self.rays.count(), channels + 1]);
        launch!(
            kernels::composite_forward::launch, self.rays.count();
            tau, values, &self.rays.offsets(tau), &out;
            channels
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [tau, values] = pass.inputs else { unreachable!("composite has two inputs") };
        let (dtau, dvalues) = (empty_like(tau), empty_like(values));
        launch!(
            kernels::composite_backward::launch, self.rays.count();
            tau, values, &self.rays.offsets(tau), pass.grad, &dtau, &dvalues;
            values.meta.shape()[1]
        );
        vec![Some(dtau), Some(dvalues)]
    }
}

#[derive(Debug)]
struct Entropy {
    rays: Rays,
    epsilon: f32,
}

impl CubeKernel for Entropy {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let tau = &inputs[0];
        let out = empty(tau, [self.rays.count(), 2]);
        launch!(
            kernels::entropy_forward::launch, self.rays.count();
            tau, &self.rays.offsets(tau), &out;
            self.epsilon, MIN_ALPHA_SUM
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let tau = &pass.inputs[0];
        let dtau = empty_like(tau);
        launch!(
            kernels::entropy_backward::launch, self.rays.count();
            tau, &self.rays.offsets(tau), pass.grad, &dtau;
            self.epsilon, MIN_ALPHA_SUM
        );
        vec![Some(dtau)]
    }
}

#[derive(Debug)]
struct Divergence {
    rays: Rays,
    epsilon: f32,
}

impl CubeKernel for Divergence {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [tau, near] = inputs else { unreachable!("a divergence has two inputs") };
        let out = empty(tau, [self.rays.count()]);
        launch!(
            kernels::divergence_forward::launch, self.rays.count();
            tau, near, &self.rays.offsets(tau), &out;
            self.epsilon, MIN_ALPHA_SUM
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [tau, near] = pass.inputs else { unreachable!("a divergence has two inputs") };
        let (dtau, dnear) = (empty_like(tau), empty_like(near));
        launch!(
            kernels::divergence_backward::launch, self.rays.count();
            tau, near, &self.rays.offsets(tau), pass.grad, &dtau, &dnear;
            self.epsilon, MIN_ALPHA_SUM
        );
        vec![Some(dtau), Some(dnear)]
    }
}
