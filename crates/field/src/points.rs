use burn::tensor::Tensor;
use infonerf_ops::{Segments, upload};

/// Points that a field is evaluated at: packed samples of rays, or points on no ray.
#[derive(Clone, Debug)]
pub struct Points {
    /// Positions of the samples, `[M, 3]`, scene units. A gradient reaches them if they are in an autodiff graph and the field
    /// [tracks positions](crate::FieldTraits::tracks_positions).
    pub positions: Tensor<2>,
    /// Unit view direction of each ray, `[R, 3]`, held fixed.
    pub directions: Tensor<2>,
    /// The samples of each ray.
    pub segments: Segments,
    /// The space around its position that each sample represents.
    pub extent: Extent,
}

impl Points {
    /// Returns points on no ray, `[M, 3]`, seen along +z.
    pub fn scattered(positions: Tensor<2>, extent: Extent) -> Self {
        let directions = Tensor::from_floats([[0.0, 0.0, 1.0]], &positions.device());
        let segments = Segments::uniform(1, positions.dims()[0]);
        Self { positions, directions, segments, extent }
    }

    /// Returns the points with a view direction for each of them, `[M, 3]`.
    pub fn seen_along(self, directions: Tensor<2>) -> Self {
        Self { segments: Segments::uniform(self.len(), 1), directions, ..self }
    }

    /// Returns the number of samples `M`.
    pub fn len(&self) -> usize {
        self.segments.samples()
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the unit view direction of each sample, `[M, 3]`.
    pub(crate) fn sample_directions(&self) -> Tensor<2> {
        self.segments.spread(self.directions.clone())
    }
}

/// Computes the components of vectors `[M, 3]` along three `axes`.
pub(crate) fn along_axes(vectors: Tensor<2>, axes: [[f32; 3]; 3]) -> Tensor<2> {
    let axes: Tensor<3> = upload(axes.concat(), [1, 3, 3], &vectors.device());
    (vectors.unsqueeze_dim(1) * axes).sum_dim(2).squeeze_dim(2)
}

/// The space that a sample represents. Fields of points ignore it; mip-NeRF averages over it.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one per batch of samples")]
pub enum Extent {
    /// Conical frusta around the rays: sample `i`, at distance `t[i]`, is the middle of an interval of length `delta[i]`.
    Cones {
        /// Distance of each sample along its ray, `[M]`, scene units.
        t: Tensor<1>,
        /// Length of each sample's interval, `[M]`, scene units.
        delta: Tensor<1>,
        /// Radius of each ray's cone at distance 1, `[R]`.
        radii: Tensor<1>,
    },
    /// A ball of one size around each position, for points not on rays.
    Ball {
        /// Variance along each axis, scene units².
        variance: f32,
    },
}

/// The output of a field.
#[derive(Clone, Debug)]
pub struct FieldOutput {
    /// Volume density σ ≥ 0 in 1/scene unit, `[M]`.
    pub sigma: Tensor<1>,
    /// Colour in [0, 1]³ (mip-NeRF: up to 0.001 beyond; Neural Volumes: not bounded), `[M, 3]`, if requested.
    pub color: Option<Tensor<2>>,
}
