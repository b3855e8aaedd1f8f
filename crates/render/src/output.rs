use std::sync::{Arc, OnceLock};

use burn::tensor::{Device, Tensor};
use infonerf_ops::sampling::PackedSamples;
use infonerf_ops::{Segments, to_host, upload};

/// Packed samples of a batch of rays.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Samples of each ray.
    pub segments: Segments,
    /// Distance of each sample along its ray, `[M]`, scene units.
    pub distance: Tensor<1>,
    /// Distances on the host, once they are read.
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

    /// Returns `packed` samples and their positions, `[M, 3]`, for a field on `device`, theirs with or without autodiff.
    pub(crate) fn packed(packed: PackedSamples, candidates: usize, device: &Device) -> (Self, Tensor<2>) {
        let PackedSamples { segments, distance, delta, positions, on_host } = packed;
        let [distance, delta] = [distance, delta].map(|values| with_autodiff_of(&values, device));
        let on_host = Arc::new(on_host.map_or_else(OnceLock::new, OnceLock::from));
        (Self { segments, distance, on_host, delta, candidates }, positions)
    }

    /// Returns the distance of each sample on the host, `[M]`, scene units; read once from a device that placed them.
    pub fn t(&self) -> &[f32] {
        self.on_host.get_or_init(|| to_host(self.distance.clone()))
    }
}

/// Converts `tensor` to `device`, which is its own device with or without autodiff.
pub(crate) fn with_autodiff_of<const D: usize>(tensor: &Tensor<D>, device: &Device) -> Tensor<D> {
    match (tensor.device().is_autodiff(), device.is_autodiff()) {
        (false, true) => tensor.clone().autodiff(),
        (true, false) => tensor.clone().inner(),
        _ => tensor.clone(),
    }
}

/// Outputs to evaluate in addition to opacity and distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderRequest {
    /// Whether to evaluate colour. Without it a coarse pass, which then only places fine samples, has no gradient.
    pub color: bool,
    /// Whether to evaluate samples behind the optical depth `render.hidden_depth`: false in training, true for pictures.
    pub hidden: bool,
}

/// Output of one pass of a field over a batch of rays.
#[derive(Clone, Debug)]
pub struct RenderOutput {
    /// Samples at which the field was evaluated, `M` in all.
    pub samples: Samples,
    /// Optical depth τ per sample, `[M]`: σδ, under additive compositing converted by [`additive_depth`].
    ///
    /// [`additive_depth`]: infonerf_ops::additive_depth()
    pub tau: Tensor<1>,
    /// Colour on the background, `[R, 3]`, if requested.
    pub color: Option<Tensor<2>>,
    /// Distance Σ w t along the ray, `[R]`, scene units.
    pub depth: Tensor<1>,
    /// Opacity Σ w, `[R]`.
    pub acc: Tensor<1>,
    /// The background colour.
    pub background: [f32; 3],
}

impl RenderOutput {
    /// Returns the samples of each ray.
    pub fn segments(&self) -> &Segments {
        &self.samples.segments
    }

    pub(crate) fn empty(samples: Samples, request: RenderRequest, background: [f32; 3]) -> Self {
        let (rays, device) = (samples.segments.rays(), samples.distance.device());
        let zeros = Tensor::<1>::zeros([rays], &device);
        let behind = upload(background.to_vec(), [1, 3], &device);
        let color = request.color.then(|| behind.repeat_dim(0, rays));
        Self { samples, tau: Tensor::empty([0], &device), color, depth: zeros.clone(), acc: zeros, background }
    }
}

/// Outputs of all passes over a batch of rays.
#[derive(Clone, Debug)]
pub struct Passes {
    /// The coarse pass, which places the samples of the fine one; `None` for a single pass.
    pub coarse: Option<RenderOutput>,
    /// The fine pass, or the single one: the result.
    pub fine: RenderOutput,
}

impl Passes {
    /// Returns the samples of both passes before and after skipping.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        for Samples { candidates, segments, .. } in self.coarse.iter().chain([&self.fine]).map(|pass| &pass.samples) {
            counts += Counts { total: *candidates as u64, evaluated: segments.samples() as u64 };
        }
        counts
    }
}

/// Numbers of samples before and after skipping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Candidate samples, before skipping.
    pub total: u64,
    /// Samples that a field evaluated.
    pub evaluated: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.total += other.total;
        self.evaluated += other.evaluated;
    }
}
