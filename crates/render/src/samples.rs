use std::sync::{Arc, OnceLock};

use burn::tensor::{Device, Tensor};
use infonerf_ops::sampling::PackedSamples;
use infonerf_ops::{Segments, to_host};

/// Packed samples of a batch of rays.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Samples of each ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`, scene units.
    pub distance: Tensor<1>,
    on_host: Arc<OnceLock<Vec<f32>>>,
    /// Length of each sample's interval, `[M]`, in units of [`Warp::coordinate`](crate::Warp::coordinate).
    pub delta: Tensor<1>,
    /// Number of candidates before skipping.
    pub candidates: usize,
}

impl Samples {
    /// Returns samples at `distance`, `[M]`, with intervals of length `delta`, `[M]`, of `candidates` before skipping.
    pub fn new(segments: Segments, distance: Tensor<1>, delta: Tensor<1>, candidates: usize) -> Self {
        Self { segments, distance, on_host: Arc::default(), delta, candidates }
    }

    pub(crate) fn none(rays: usize, device: &Device) -> Self {
        let nothing = Tensor::empty([0], device);
        Self::new(Segments::uniform(rays, 0), nothing.clone(), nothing, 0)
    }

    /// Returns `packed` samples for a field on `device`, which differs from theirs in tracking gradients at most, and their
    /// positions, `[M, 3]`.
    pub(crate) fn packed(packed: PackedSamples, candidates: usize, device: &Device) -> (Self, Tensor<2>) {
        let PackedSamples { segments, distance, delta, positions, on_host } = packed;
        let [distance, delta] = [distance, delta].map(|values| on(&values, device));
        let on_host = Arc::new(on_host.map_or_else(OnceLock::new, OnceLock::from));
        (Self { segments, distance, on_host, delta, candidates }, positions)
    }

    /// Returns the distance of each sample on the host, `[M]`, scene units; read once from a device that placed them.
    pub fn t(&self) -> &[f32] {
        self.on_host.get_or_init(|| to_host(self.distance.clone()))
    }
}

/// Returns `tensor` as one of `device`, which differs from its own in tracking gradients at most.
pub(crate) fn on<const D: usize>(tensor: &Tensor<D>, device: &Device) -> Tensor<D> {
    match (tensor.device().is_autodiff(), device.is_autodiff()) {
        (false, true) => tensor.clone().autodiff(),
        (true, false) => tensor.clone().inner(),
        _ => tensor.clone(),
    }
}
