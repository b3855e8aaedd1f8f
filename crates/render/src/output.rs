use burn::tensor::{Device, Tensor};
use infonerf_ops::Segments;

use crate::{Exposure, Samples};

/// What a render has to return beside opacity and distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderRequest {
    /// Colour; without it only density is evaluated, and a coarse pass, which only says where to look, has no gradient.
    pub color: bool,
}

/// One pass of a field over a bundle of rays.
#[derive(Clone, Debug)]
pub struct RenderOutput {
    /// Where it was evaluated.
    pub samples: Samples,
    /// Optical depth τ of each sample, `[M]`: σδ, or under additive compositing what [`additive_depth`] makes of it.
    ///
    /// [`additive_depth`]: infonerf_ops::additive_depth()
    pub tau: Tensor<1>,
    /// Colour on the background, `[R, 3]`; none if it was not asked for.
    pub color: Option<Tensor<2>>,
    /// Distance Σ w t along the ray, `[R]`, scene units.
    pub depth: Tensor<1>,
    /// Opacity Σ w, `[R]`.
    pub acc: Tensor<1>,
    /// The colour behind everything.
    pub background: [f32; 3],
}

impl RenderOutput {
    /// Which samples belong to which ray.
    pub fn segments(&self) -> &Segments {
        &self.samples.segments
    }

    /// The same as the training views show it that `views` names, one for each ray.
    fn exposed(self, exposure: &Exposure, views: &[usize]) -> Self {
        let color = self.color.map(|color| exposure.apply(color, self.acc.clone(), self.background, views));
        Self { color, ..self }
    }

    /// A bundle of which every sample was skipped.
    pub(crate) fn empty(samples: Samples, request: RenderRequest, background: [f32; 3], device: &Device) -> Self {
        let rays = samples.segments.rays();
        let zeros = Tensor::<1>::zeros([rays], device);
        let behind = Tensor::<1>::from_floats(background, device).unsqueeze::<2>();
        Self {
            samples,
            tau: Tensor::empty([0], device),
            color: request.color.then(|| behind.repeat_dim(0, rays)),
            depth: zeros.clone(),
            acc: zeros,
            background,
        }
    }
}

/// The passes over a bundle of rays.
#[derive(Clone, Debug)]
pub struct Passes {
    /// The pass that says where to look; none where there is a single pass.
    pub coarse: Option<RenderOutput>,
    /// The pass that is the result.
    pub fine: RenderOutput,
}

impl Passes {
    /// Both passes as the training views show them that `views` names, one for each ray.
    pub fn exposed(self, exposure: &Exposure, views: &[usize]) -> Self {
        Self {
            coarse: self.coarse.map(|coarse| coarse.exposed(exposure, views)),
            fine: self.fine.exposed(exposure, views),
        }
    }

    /// Samples before and after skipping, of both passes.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::from(&self.fine.samples);
        if let Some(coarse) = &self.coarse {
            counts += Counts::from(&coarse.samples);
        }
        counts
    }
}

/// Points along rays before and after skipping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Candidates.
    pub total: u64,
    /// Evaluated by a field.
    pub evaluated: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.total += other.total;
        self.evaluated += other.evaluated;
    }
}

impl From<&Samples> for Counts {
    fn from(samples: &Samples) -> Self {
        Self { total: samples.candidates as u64, evaluated: samples.segments.samples() as u64 }
    }
}
