//! Rays that own packed samples, on GPUs: offsets, functions that kernels along rays share, and rows and points of samples.

mod kernels;

use burn::backend::ops::IntTensorOps;
use burn::tensor::TensorData;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

pub(crate) use self::kernels::{RayMass, alpha_of, first_sample, ln_1p, mass_of};
use super::{Operation, Pass, empty, empty_like};
use crate::segments::Segments;
use crate::traffic::count_upload;

/// Kernel of [`points_on_rays`](crate::sampling::points_on_rays), whose distances have no gradient.
#[derive(Debug)]
pub(crate) struct PointsOnRays(pub(crate) Segments);

impl Operation<CubeBackend> for PointsOnRays {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [origins, directions, t] = inputs else { unreachable!("points have three inputs") };
        let out = empty(t, [self.0.samples(), 3]);
        let offsets = self.0.offsets_on_device_of(t);
        launch!(kernels::points_forward::launch, out.meta.num_elements(); origins, directions, t, &offsets, &out;);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [origins, directions, t] = pass.inputs else { unreachable!("points have three inputs") };
        let (dorigins, ddirections) = (empty_like(origins), empty_like(directions));
        let (offsets, count) = (self.0.offsets_on_device_of(t), dorigins.meta.num_elements());
        launch!(kernels::points_backward::launch, count; t, &offsets, pass.grad, &dorigins, &ddirections;);
        vec![Some(dorigins), Some(ddirections)]
    }
}

/// Kernel of [`Segments::spread`].
#[derive(Debug)]
pub(crate) struct Spread(pub(crate) Segments);

impl Operation<CubeBackend> for Spread {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let rows = &inputs[0];
        let out = empty(rows, [self.0.samples(), rows.meta.shape()[1]]);
        launch!(kernels::spread::launch, out.meta.num_elements(); rows, &self.0.offsets_on_device_of(rows), &out;);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let drows = empty_like(&pass.inputs[0]);
        let offsets = self.0.offsets_on_device_of(&drows);
        launch!(kernels::gather::launch, drows.meta.num_elements(); pass.grad, &offsets, &drows;);
        vec![Some(drows)]
    }
}

impl Segments {
    /// Returns the offsets, `[R + 1]`, on the device of `like`; cached on the first device that asks for them.
    pub(crate) fn offsets_on_device_of(&self, like: &CubeTensor) -> CubeTensor {
        let upload = || {
            count_upload(size_of_val(self.offsets()));
            CubeBackend::int_from_data(TensorData::new(self.offsets().to_vec(), [self.rays() + 1]), &like.device)
        };
        let cached = self.on_gpu.get_or_init(upload);
        if cached.device == like.device { cached.clone() } else { upload() }
    }
}
