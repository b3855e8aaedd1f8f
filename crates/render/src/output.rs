use burn::tensor::Tensor;
use infonerf_ops::{Segments, upload};

use crate::Samples;

/// Request: outputs to evaluate in addition to opacity and distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderRequest {
    /// Colour. Without it only density is evaluated, and a coarse pass, which then only places fine samples, has no gradient.
    pub color: bool,
    /// Samples behind the optical depth `render.hidden_depth`: skipped in training, evaluated for pictures.
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
        Self {
            samples,
            tau: Tensor::empty([0], &device),
            color: request.color.then(|| behind.repeat_dim(0, rays)),
            depth: zeros.clone(),
            acc: zeros,
            background,
        }
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
