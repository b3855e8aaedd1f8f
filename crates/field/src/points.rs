use burn::tensor::{Device, Tensor};
use infonerf_ops::{Segments, from_host};

/// Where a field is evaluated, on the host; the positions as a tensor too where a gradient is to reach them.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Sample positions in scene units, `[M, 3]` row-major.
    pub positions: &'a [f32],
    /// Unit view direction of each ray, `[R, 3]` row-major.
    pub directions: &'a [f32],
    /// Which samples belong to which ray.
    pub segments: &'a Segments,
    /// The space around its position that each sample represents.
    pub extent: Extent<'a>,
    /// The positions as a tensor `[M, 3]` in an autodiff graph, if a gradient with respect to them is wanted: see
    /// [`FieldSpec::tracks_positions`](crate::FieldSpec::tracks_positions).
    pub tracked: Option<&'a Tensor<2>>,
}

impl Points<'_> {
    /// Number of samples `M`.
    pub fn len(&self) -> usize {
        self.positions.len() / 3
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The positions as a tensor, `[M, 3]`: the tracked ones, if there are any.
    pub fn positions_on(&self, device: &Device) -> Tensor<2> {
        self.tracked.cloned().unwrap_or_else(|| from_host(self.positions, 3, device))
    }

    /// The unit view direction of each sample as a tensor, `[M, 3]`.
    pub fn directions_on(&self, device: &Device) -> Tensor<2> {
        from_host(&self.sample_directions(), 3, device)
    }

    /// The view direction of each sample, `[M, 3]` row-major.
    pub fn sample_directions(&self) -> Vec<f32> {
        let mut directions = Vec::with_capacity(self.positions.len());
        for (ray, range) in self.directions.chunks_exact(3).zip(self.segments.ranges()) {
            for _ in range {
                directions.extend_from_slice(ray);
            }
        }
        directions
    }
}

/// The space that a sample represents. Fields of points ignore it; mip-NeRF averages over it.
#[derive(Clone, Copy, Debug)]
pub enum Extent<'a> {
    /// Conical frusta around the rays: sample `i`, at distance `t[i]`, is the middle of an interval of length `delta[i]`.
    Cones {
        /// Distance of each sample along its ray, `[M]`, scene units.
        t: &'a [f32],
        /// Length of each sample's interval, `[M]`, scene units.
        delta: &'a [f32],
        /// Radius of each ray's cone at distance 1, `[R]`.
        radii: &'a [f32],
    },
    /// The same ball around each position, for points not on rays.
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
    /// Colour in [0, 1]³ (mip-NeRF: up to 0.001 beyond; Neural Volumes: not bounded above), `[M, 3]`, if
    /// requested.
    pub color: Option<Tensor<2>>,
}
