//! Operations along rays, one thread per ray.

mod kernels;

use std::sync::Arc;

use burn::backend::ops::IntTensorOps;
use burn::tensor::{Shape, Tensor, TensorData};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::kernels::{alpha_of, ln_1p};
use super::outputs::Outputs;
use super::{CubeKernel, Pass, apply, empty, empty_like};
use crate::Segments;
use crate::composite::MIN_ALPHA_SUM;
use crate::traffic::count_upload;

/// What [`composite`](crate::composite()) or, of three values on `background` and with `distances`,
/// [`composite_over`](crate::composite_over()) gives: values, distances and Σw.
pub(crate) fn composite(
    tau: Tensor<1>,
    values: Option<Tensor<2>>,
    distances: Option<Tensor<1>>,
    background: Option<[f32; 3]>,
    segments: &Segments,
) -> (Option<Tensor<2>>, Tensor<1>, Tensor<1>) {
    let (rays, channels) = (segments.rays(), values.as_ref().map_or(0, |values| values.dims()[1]));
    // Not even of no values is a buffer empty.
    let outputs = Outputs::new([Shape::new([rays, channels.max(1)]), Shape::new([rays]), Shape::new([rays])]);
    let has_distances = distances.is_some();
    let distances = distances.unwrap_or_else(|| tau.clone()).detach();
    let is_colored = values.is_some();
    let values = values.unwrap_or_else(|| tau.clone().detach().unsqueeze_dim(1));
    let kernel = Composite { rays: Rays::new(segments), outputs: outputs.clone(), channels, has_distances, background };
    let buffer = apply(kernel, (tau, values, distances));
    let values = is_colored.then(|| outputs.output(&buffer, 0));
    (values, outputs.output(&buffer, 1), outputs.output(&buffer, 2))
}

/// [`ray_entropy`](crate::ray_entropy)'s results for α/Σα: bits and Σα, `[R]` each.
pub(crate) fn entropy(tau: Tensor<1>, segments: &Segments, epsilon: f32) -> [Tensor<1>; 2] {
    let outputs = Outputs::new([0, 1].map(|_| Shape::new([segments.rays()])));
    let buffer = apply(Entropy { rays: Rays::new(segments), outputs: outputs.clone(), epsilon }, tau);
    [0, 1].map(|index| outputs.output(&buffer, index))
}

/// [`ray_divergence`](crate::ray_divergence), `[R]`.
pub(crate) fn divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    apply(Divergence { rays: Rays::new(segments), epsilon }, (tau, near))
}

/// [`Segments::spread`].
pub(crate) fn spread(rows: Tensor<2>, segments: &Segments) -> Tensor<2> {
    apply(Spread(Rays::new(segments)), rows)
}

/// [`points_on_rays`](crate::sampling::points_on_rays).
pub(crate) fn points(origins: Tensor<2>, directions: Tensor<2>, t: Tensor<1>, segments: &Segments) -> Tensor<2> {
    apply(Points(Rays::new(segments)), (origins, directions, t.detach()))
}

#[derive(Debug)]
struct Points(Rays);

impl CubeKernel for Points {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [origins, directions, t] = inputs else { unreachable!("points have three inputs") };
        let out = empty(t, [self.0.0.samples(), 3]);
        let offsets = self.0.offsets(t);
        launch!(kernels::points_forward::launch, out.meta.num_elements(); origins, directions, t, &offsets, &out;);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [origins, directions, t] = pass.inputs else { unreachable!("points have three inputs") };
        let (dorigins, ddirections) = (empty_like(origins), empty_like(directions));
        let offsets = self.0.offsets(t);
        launch!(
            kernels::points_backward::launch, dorigins.meta.num_elements();
            t, &offsets, pass.grad, &dorigins, &ddirections;
        );
        vec![Some(dorigins), Some(ddirections), None]
    }
}

#[derive(Debug)]
struct Spread(Rays);

impl CubeKernel for Spread {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let rows = &inputs[0];
        let out = empty(rows, [self.0.0.samples(), rows.meta.shape()[1]]);
        launch!(kernels::spread::launch, out.meta.num_elements(); rows, &self.0.offsets(rows), &out;);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let drows = empty_like(&pass.inputs[0]);
        launch!(kernels::gather::launch, drows.meta.num_elements(); pass.grad, &self.0.offsets(&drows), &drows;);
        vec![Some(drows)]
    }
}

/// Offsets of each ray's samples, for kernels.
#[derive(Debug)]
pub(super) struct Rays(Segments);

impl Rays {
    pub(super) fn new(segments: &Segments) -> Self {
        Self(segments.clone())
    }

    fn count(&self) -> usize {
        self.0.rays()
    }

    /// The offsets, `[R + 1]`, which stay on the device that is the first to be asked for them.
    pub(super) fn offsets(&self, like: &CubeTensor) -> CubeTensor {
        let moved = || {
            let offsets: Vec<i32> = self.0.offsets().iter().map(|offset| *offset as i32).collect();
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
    outputs: Arc<Outputs<3>>,
    /// Columns of the values; 0 for none.
    channels: usize,
    has_distances: bool,
    background: Option<[f32; 3]>,
}

impl CubeKernel for Composite {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [tau, values, distances] = inputs else { unreachable!("composite has three inputs") };
        let buffer = self.outputs.buffer(tau);
        let [out, depth, acc] = self.outputs.parts(&buffer);
        let [red, green, blue] = self.background.unwrap_or_default();
        launch!(
            kernels::composite_forward::launch, self.rays.count();
            tau, values, distances, &self.rays.offsets(tau), &out, &depth, &acc;
            red, green, blue, self.channels, self.background.is_some(), self.has_distances
        );
        buffer
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [tau, values, distances] = pass.inputs else { unreachable!("composite has three inputs") };
        let (dtau, dvalues) = (empty_like(tau), empty_like(values));
        let [dout, ddepth, dacc] = self.outputs.gradients();
        let [red, green, blue] = self.background.unwrap_or_default();
        let of = |grad: &Option<CubeTensor>| grad.clone().unwrap_or_else(|| tau.clone());
        launch!(
            kernels::composite_backward::launch, self.rays.count();
            tau, values, distances, &self.rays.offsets(tau), &of(&dout), &of(&ddepth), &of(&dacc), &dtau, &dvalues;
            red, green, blue, self.channels, self.background.is_some(), dout.is_some(), ddepth.is_some(), dacc.is_some()
        );
        vec![Some(dtau), Some(dvalues).filter(|_| self.channels > 0), None]
    }
}

#[derive(Debug)]
struct Entropy {
    rays: Rays,
    outputs: Arc<Outputs<2>>,
    epsilon: f32,
}

impl CubeKernel for Entropy {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let tau = &inputs[0];
        let buffer = self.outputs.buffer(tau);
        let [bits, alpha_sum] = self.outputs.parts(&buffer);
        launch!(
            kernels::entropy_forward::launch, self.rays.count();
            tau, &self.rays.offsets(tau), &bits, &alpha_sum;
            self.epsilon, MIN_ALPHA_SUM
        );
        buffer
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let tau = &pass.inputs[0];
        let dtau = empty_like(tau);
        let [dbits, dsum] = self.outputs.gradients();
        let of = |grad: &Option<CubeTensor>| grad.clone().unwrap_or_else(|| tau.clone());
        launch!(
            kernels::entropy_backward::launch, self.rays.count();
            tau, &self.rays.offsets(tau), &of(&dbits), &of(&dsum), &dtau;
            self.epsilon, MIN_ALPHA_SUM, dbits.is_some(), dsum.is_some()
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
