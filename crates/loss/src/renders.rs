//! Renders of a training step, and the requests of terms for them.

use std::collections::BTreeMap;

use burn::tensor::Tensor;
use infonerf_field::Penalty;
use infonerf_ops::means::mean_squared_difference;
use infonerf_render::{Passes, RenderOutput};
use infonerf_scene::PixelAt;
use serde::{Deserialize, Serialize};

/// A term's need in addition to density along the seen rays, which is always rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Colour along the rays of training images.
    SeenColor,
    /// Density along rays of an unseen pose.
    Unseen,
    /// Density along the neighbours of rays of training images.
    SeenNeighbours,
    /// Density along the neighbours of rays of the unseen pose.
    UnseenNeighbours,
    /// A whole image from an unseen pose.
    Picture {
        /// Longest side of the image in pixels.
        size: u32,
    },
    /// A penalty on the field's own parameters.
    Penalty(Penalty),
}

impl Need {
    /// Returns the need for unseen rays, if `rays` includes them.
    pub fn of(rays: RaySet) -> Vec<Self> {
        if rays.unseen() { vec![Self::Unseen] } else { Vec::new() }
    }

    /// Returns the needs for `rays` and the neighbours of each.
    pub fn neighbours_of(rays: RaySet) -> Vec<Self> {
        let mut needs = Self::of(rays);
        needs.extend(rays.seen().then_some(Self::SeenNeighbours));
        needs.extend(rays.unseen().then_some(Self::UnseenNeighbours));
        needs
    }

    /// Whether the need is rendered from an unseen pose.
    pub fn is_unseen(&self) -> bool {
        matches!(self, Self::Unseen | Self::UnseenNeighbours | Self::Picture { .. })
    }

    /// Whether the need is rendered along neighbouring rays.
    pub fn is_of_neighbours(&self) -> bool {
        matches!(self, Self::SeenNeighbours | Self::UnseenNeighbours)
    }
}

/// Lists each of `needs` once, in order of appearance.
pub(crate) fn union(needs: impl Iterator<Item = Need>) -> Vec<Need> {
    let mut union = Vec::new();
    for need in needs {
        if !union.contains(&need) {
            union.push(need);
        }
    }
    union
}

/// The rays over which a term is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RaySet {
    /// Rays of training images.
    Seen,
    /// Rays of unseen poses.
    Unseen,
    /// Rays of training images and of unseen poses.
    All,
}

impl RaySet {
    /// Whether seen rays are included.
    pub fn seen(self) -> bool {
        self != Self::Unseen
    }

    /// Whether unseen rays are included.
    pub fn unseen(self) -> bool {
        self != Self::Seen
    }
}

/// Pixels of the training images along a bundle of rays.
#[derive(Clone, Debug)]
pub struct Target {
    /// Colours on the background, `[R, 3]`.
    pub rgb: Tensor<2>,
    /// Colours on the host with alpha, which is 1 for images without it.
    pub rgba: Vec<[f32; 4]>,
    /// Share of the 3 × 3 pixels about each pixel that do not show the background: 1 within an object, less at its edge.
    pub coverage: Vec<f32>,
    /// [Class](pixel_class) of each pixel, `[R]`, if a GPU drew them.
    pub classes: Option<Tensor<1>>,
    /// View and position of each pixel.
    pub pixels: Vec<PixelAt>,
    /// The scene's background.
    pub background: [f32; 3],
}

impl Target {
    /// Whether a pixel shows something other than the scene's background.
    pub fn is_foreground(&self, pixel: [f32; 4]) -> bool {
        is_foreground(pixel, self.background)
    }
}

/// Whether a pixel shows something other than `background`: it differs from it by half an 8-bit step or more.
pub fn is_foreground(pixel: [f32; 4], background: [f32; 3]) -> bool {
    const TOLERANCE: f32 = 0.5 / 255.0;
    (0..3).any(|channel| (pixel[channel] - background[channel]).abs() >= TOLERANCE)
}

/// Class of a pixel: 0 if it shows the background, 1 at the edge of an object, 2 within one, where the `coverage` around it
/// is 1.
pub fn pixel_class(pixel: [f32; 4], coverage: f32, background: [f32; 3]) -> f32 {
    match (is_foreground(pixel, background), coverage) {
        (false, _) => 0.0,
        (true, 1.0) => 2.0,
        (true, _) => 1.0,
    }
}

/// Rays with the model's output along them.
#[derive(Clone, Debug)]
pub struct RenderedBundle {
    /// The passes.
    pub passes: Passes,
    /// The training pixels; `None` for rays of unseen poses.
    pub target: Option<Target>,
}

impl RenderedBundle {
    /// Returns the fine or only pass.
    pub fn output(&self) -> &RenderOutput {
        &self.passes.fine
    }

    /// Returns the number of rays.
    pub fn rays(&self) -> usize {
        self.output().segments().rays()
    }

    /// Computes the mean squared error of the colours over rays and channels; `None` without colours or pixels.
    pub fn squared_error(&self) -> Option<Tensor<1>> {
        let (color, target) = (self.output().color.clone()?, self.target.as_ref()?.rgb.clone());
        Some(mean_squared_difference(color, target))
    }
}

/// Density along neighbouring rays, paired with those of a bundle by index.
#[derive(Clone, Debug, Default)]
pub struct NeighbourBundles {
    /// Neighbours of rays of training images.
    pub seen: Option<RenderOutput>,
    /// Neighbours of rays of the unseen pose.
    pub unseen: Option<RenderOutput>,
}

/// A whole image from an unseen pose.
#[derive(Clone, Debug)]
pub struct UnseenImage {
    /// Colours, `[height·width, 3]` row-major.
    pub rgb: Tensor<2>,
    /// Height and width in pixels.
    pub size: (usize, usize),
    /// Index of a training view, drawn anew for each image.
    pub view: usize,
}

/// All renders of a step.
#[derive(Clone, Debug)]
pub struct Renders {
    /// Rays of training images.
    pub seen: RenderedBundle,
    /// [`RenderedBundle::squared_error`] of the rays of training images, which is both minimised and reported.
    pub squared_error: Option<Tensor<1>>,
    /// Rays of an unseen pose, if requested.
    pub unseen: Option<RenderedBundle>,
    /// Neighbours, if requested.
    pub neighbours: NeighbourBundles,
    /// An image from an unseen pose, if requested.
    pub picture: Option<UnseenImage>,
    /// Requested penalties on the field's own parameters that the field has, scalars.
    pub penalties: BTreeMap<Penalty, Tensor<1>>,
}

impl Renders {
    /// Lists the outputs of `rays` that were rendered.
    pub fn outputs(&self, rays: RaySet) -> impl Iterator<Item = &RenderOutput> {
        let unseen = self.unseen.as_ref().filter(|_| rays.unseen());
        rays.seen().then_some(&self.seen).into_iter().chain(unseen).map(RenderedBundle::output)
    }

    /// Lists the neighbours of `rays` that were rendered.
    pub fn neighbours(&self, rays: RaySet) -> impl Iterator<Item = &RenderOutput> {
        let NeighbourBundles { seen, unseen } = &self.neighbours;
        seen.as_ref().filter(|_| rays.seen()).into_iter().chain(unseen.as_ref().filter(|_| rays.unseen()))
    }

    /// Lists the outputs of `rays` with those of their neighbours, where both were rendered.
    pub fn pairs(&self, rays: RaySet) -> impl Iterator<Item = (&RenderOutput, &RenderOutput)> {
        let NeighbourBundles { seen, unseen } = &self.neighbours;
        let seen = seen.as_ref().filter(|_| rays.seen()).map(|near| (self.seen.output(), near));
        let unseen = self.unseen.as_ref().zip(unseen.as_ref()).filter(|_| rays.unseen());
        seen.into_iter().chain(unseen.map(|(bundle, near)| (bundle.output(), near)))
    }

    /// Computes the mean over all rays, given the sum over each bundle with its number of rays; 0 without rays.
    pub fn mean(&self, sums: impl Iterator<Item = (Tensor<1>, usize)>) -> Tensor<1> {
        match sums.reduce(|(sum, rays), (more, more_rays)| (sum + more, rays + more_rays)) {
            Some((sum, rays)) => sum / rays.max(1) as f32,
            None => self.zero(),
        }
    }

    /// Returns a penalty on the field's own parameters, a scalar; 0 for a field without it.
    pub fn penalty(&self, name: Penalty) -> Tensor<1> {
        self.penalties.get(&name).cloned().unwrap_or_else(|| self.zero())
    }

    /// Returns a scalar 0 on the device of the renders.
    pub fn zero(&self) -> Tensor<1> {
        Tensor::zeros([1], &self.seen.output().acc.device())
    }
}
