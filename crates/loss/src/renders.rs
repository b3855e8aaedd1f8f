//! Renders of a training step, and the requests of terms for them.

use std::collections::BTreeMap;

use burn::tensor::Tensor;
use infonerf_field::Penalty;
use infonerf_render::{Passes, RenderOutput};
use infonerf_scene::PixelAt;
use serde::{Deserialize, Serialize};

/// Render that a term needs in addition to density along the seen rays, which is always rendered.
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
        let neighbours = [rays.seen().then_some(Self::SeenNeighbours), rays.unseen().then_some(Self::UnseenNeighbours)];
        Self::of(rays).into_iter().chain(neighbours.into_iter().flatten()).collect()
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
    /// Colours on the host.
    pub on_host: Vec<[f32; 3]>,
    /// View and position of each pixel.
    pub pixels: Vec<PixelAt>,
    /// The scene's background.
    pub background: [f32; 3],
}

impl Target {
    /// Lists for each pixel whether it differs from the background by half an 8-bit step or more in any channel.
    pub fn foreground(&self) -> impl ExactSizeIterator<Item = bool> {
        const TOLERANCE: f32 = 0.5 / 255.0;
        let differs = |pixel: &[f32; 3]| (0..3).any(|c| (pixel[c] - self.background[c]).abs() >= TOLERANCE);
        self.on_host.iter().map(differs)
    }
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
    pub seen: Passes,
    /// Pixels along the rays of training images.
    pub target: Target,
    /// Mean squared error of colours along seen rays over rays and channels, if requested: it is both minimised and reported.
    pub squared_error: Option<Tensor<1>>,
    /// Rays of an unseen pose, if requested.
    pub unseen: Option<RenderOutput>,
    /// Neighbours of rays of training images, paired with them by index, if requested.
    pub seen_neighbours: Option<RenderOutput>,
    /// Neighbours of rays of the unseen pose, if requested.
    pub unseen_neighbours: Option<RenderOutput>,
    /// An image from an unseen pose, if requested.
    pub picture: Option<UnseenImage>,
    /// Requested penalties on the field's own parameters that the field has, scalars.
    pub penalties: BTreeMap<Penalty, Tensor<1>>,
}

impl Renders {
    /// Lists the outputs of `rays` that were rendered.
    pub fn outputs(&self, rays: RaySet) -> impl Iterator<Item = &RenderOutput> {
        rays.seen().then_some(&self.seen.fine).into_iter().chain(self.unseen.as_ref().filter(|_| rays.unseen()))
    }

    /// Lists the outputs of `rays` with those of their neighbours, where both were rendered.
    pub fn pairs(&self, rays: RaySet) -> impl Iterator<Item = (&RenderOutput, &RenderOutput)> {
        let seen = self.seen_neighbours.as_ref().filter(|_| rays.seen()).map(|near| (&self.seen.fine, near));
        let unseen = self.unseen.as_ref().zip(self.unseen_neighbours.as_ref()).filter(|_| rays.unseen());
        seen.into_iter().chain(unseen)
    }

    /// Computes the mean over all rays of `values`, `[R]` for each bundle of rays; 0 without rays.
    pub fn mean(&self, values: impl Iterator<Item = Tensor<1>>) -> Tensor<1> {
        let sums = values.map(|of_rays| (of_rays.dims()[0], of_rays.sum()));
        match sums.reduce(|(rays, sum), (more_rays, more)| (rays + more_rays, sum + more)) {
            Some((rays, sum)) => sum / rays.max(1) as f32,
            None => self.zero(),
        }
    }

    /// Returns a penalty on the field's own parameters, a scalar; 0 for a field without it.
    pub fn penalty(&self, name: Penalty) -> Tensor<1> {
        self.penalties.get(&name).cloned().unwrap_or_else(|| self.zero())
    }

    /// Returns a scalar 0 on the device of the renders.
    pub fn zero(&self) -> Tensor<1> {
        Tensor::zeros([1], &self.seen.fine.acc.device())
    }
}
