//! Neural Body (Peng et al. 2021): codes on the vertices of a body, spread by sparse convolutions.

mod encoder;
mod sites;
mod vertices;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::Tensor;
use burn::tensor::activation::{relu, sigmoid};
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use infonerf_ops::trilinear::{PaddingMode, Voxels, trilinear};
use infonerf_ops::upload;
use infonerf_schedule::{Fault, Moment};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_range, check_width};
use crate::field::{BodyVertices, Field, FieldFile, FieldSetup, FieldSpec, FieldTraits, Footprint, Sources};
use crate::init::{Init, normal, parameter};
use crate::points::{FieldOutput, Points, along_axes};
use encoder::{EncoderSites, SparseEncoder, channels};

/// Space around the vertices that the voxels hold, scene units (metres).
const MARGIN: f32 = 0.05;
/// Max number of voxels along an axis, and in all: at the published voxel size, a box of 3 m × 1.5 m × 1.5 m.
const MAX_SIDE: usize = 1024;
const MAX_CELLS: usize = 1 << 26;
/// Hidden layers from a point's features to its density.
const TRUNK: usize = 3;

/// Sizes of [`NeuralBody`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeuralBodyConfig {
    /// A PLY file of the body's vertices in the scene's world; empty for the scene's own, as in ZJU-MoCap.
    pub vertices: PathBuf,
    /// Edge of a voxel, scene units (paper: 5 mm).
    pub voxel: f32,
    /// Elements of each vertex's code (paper: 16).
    pub code: usize,
    /// Channels of the first level; the others have two and four times as many (paper: 32).
    pub channels: usize,
    /// Width of the MLP, whose last layer has half of it (paper: 256).
    pub width: usize,
    /// Elements of the frame's appearance code (paper: 128).
    pub appearance: usize,
    /// Frequencies of the position's encoding (paper: 10).
    pub position_frequencies: usize,
    /// Frequencies of the direction's encoding (paper: 4).
    pub direction_frequencies: usize,
}

impl fmt::Display for NeuralBodyConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { voxel, code, channels, width, .. } = self;
        write!(f, "codes of {code} on vertices, voxels of {voxel}, {channels} channels, an MLP of width {width}")
    }
}

impl FieldSpec for NeuralBodyConfig {
    type Field = NeuralBody;

    fn validate(&self) -> Result<(), Fault> {
        check("voxel", "above 0, at most 1", self.voxel, self.voxel > 0.0 && self.voxel <= 1.0)?;
        check_range("code", 1..=256, self.code)?;
        check_range("channels", 1..=256, self.channels)?;
        check_width(self.width, 4096)?;
        check_range("appearance", 1..=4096, self.appearance)?;
        check_range("position_frequencies", 0..=20, self.position_frequencies)?;
        check_range("direction_frequencies", 0..=20, self.direction_frequencies)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<NeuralBody, Fault> {
        let expected = "a PLY file, or a scene that comes with a body's, as ZJU-MoCap's `new_vertices/0.npy`";
        let read;
        let body = if self.vertices.as_os_str().is_empty() {
            setup.body.ok_or_else(|| Fault::new("field.vertices", expected, "neither"))?
        } else {
            read = vertices::read(&self.vertices)?;
            BodyVertices { vertices: &read, ..BodyVertices::default() }
        };
        let grid = BodyVoxels::around(&body, self.voxel)?;
        let cells: Vec<[usize; 3]> = body.vertices.iter().map(|&vertex| grid.cell(vertex)).collect();
        let rng = &mut ChaCha8Rng::seed_from_u64(setup.seed);
        let device = setup.device;
        let features = channels(self.channels).iter().sum();
        let trunk = |layer: usize| if layer == 0 { features } else { self.width };
        let seen =
            self.width + encoded_width(3, self.direction_frequencies) + encoded_width(3, self.position_frequencies);
        Ok(NeuralBody {
            codes: parameter(normal(rng, cells.len() * self.code), [cells.len(), self.code], device),
            appearance: parameter(normal(rng, self.appearance), [1, self.appearance], device),
            encoder: SparseEncoder::new(self.code, self.channels, rng, device),
            trunk: (0..TRUNK).map(|layer| Init::FanIn.linear(rng, trunk(layer), self.width, device)).collect(),
            sigma: Init::FanIn.linear(rng, self.width, 1, device),
            feature: Init::FanIn.linear(rng, self.width, self.width, device),
            framed: Init::FanIn.linear(rng, self.width + self.appearance, self.width, device),
            view: Init::FanIn.linear(rng, seen, self.width / 2, device),
            rgb: Init::FanIn.linear(rng, self.width / 2, 3, device),
            volumes: None,
            plan: Arc::new(EncoderSites::new(grid.size, &cells)),
            grid,
            frequencies: [self.position_frequencies, self.direction_frequencies],
        })
    }

    fn footprint(&self) -> Footprint {
        let features: usize = channels(self.channels).iter().sum();
        let convolutions = encoder::parameters(self.code, self.channels);
        let mlp = (features + 5 * self.width + self.appearance) * self.width;
        let per_sample = 2 * features + 6 * self.width + self.appearance;
        Footprint { parameters: (convolutions + mlp) as u64, per_sample: per_sample as u64 }
    }

    fn traits(&self) -> FieldTraits {
        FieldTraits { body: true, ..FieldTraits::default() }
    }

    fn files(&mut self) -> Vec<FieldFile<'_>> {
        vec![FieldFile { key: "vertices", path: &mut self.vertices, holds_weights: false }]
    }
}

/// Placement of voxels about a body.
#[derive(Clone, Debug)]
struct BodyVoxels {
    /// Axes of the body's frame in the world, and its origin.
    axes: [[f32; 3]; 3],
    origin: [f32; 3],
    /// The grid's first corner in the body's frame.
    low: [f32; 3],
    voxel: f32,
    /// Voxels along each axis, a multiple of 32.
    size: [usize; 3],
}

impl BodyVoxels {
    /// Builds a grid that holds the vertices with a margin.
    fn around(body: &BodyVertices<'_>, voxel: f32) -> Result<Self, Fault> {
        let &BodyVertices { vertices, axes, origin } = body;
        let mut grid = Self { axes, origin, low: [0.0; 3], voxel, size: [0; 3] };
        let framed: Vec<[f32; 3]> = vertices.iter().map(|&vertex| grid.framed(vertex)).collect();
        for axis in 0..3 {
            let along = framed.iter().map(|p| p[axis]);
            grid.low[axis] = along.clone().fold(f32::INFINITY, f32::min) - MARGIN;
            let high = along.fold(f32::NEG_INFINITY, f32::max) + MARGIN;
            let cells = ((high - grid.low[axis]) / voxel).ceil();
            let good = cells >= 1.0 && cells <= MAX_SIDE as f32 - 1.0;
            check("voxel", "voxels of which a body's box has at most 1023 along each axis", voxel, good)?;
            grid.size[axis] = (cells as usize | 31) + 1;
        }
        let good = grid.size.iter().product::<usize>() <= MAX_CELLS;
        let expected = "voxels of which a body's box has at most 2^26 (is a vertex far from the others?)";
        check("voxel", expected, voxel, good)?;
        Ok(grid)
    }

    /// Maps a point of the world to the body's frame: Rᵀ(x − origin).
    fn framed(&self, point: [f32; 3]) -> [f32; 3] {
        self.axes.map(|axis| (0..3).map(|i| axis[i] * (point[i] - self.origin[i])).sum())
    }

    /// Maps points of the world, `[M, 3]`, to voxels from the grid's first corner.
    fn places(&self, points: Tensor<2>) -> Tensor<2> {
        let row = |numbers: [f32; 3]| upload(numbers.to_vec(), [1, 3], &points.device());
        (along_axes(points.clone() - row(self.origin), self.axes) - row(self.low)) / self.voxel
    }

    /// Returns the voxel nearest to a vertex.
    fn cell(&self, vertex: [f32; 3]) -> [usize; 3] {
        let framed = self.framed(vertex);
        [0, 1, 2].map(|axis| ((framed[axis] - self.low[axis]) / self.voxel).round() as usize)
    }

    /// Returns the cells of a level of `size` per voxel of the grid: the released code stretches every level over the grid so that the
    /// middles of its outermost cells coincide with the grid's faces.
    fn stretch(&self, size: [usize; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| (size[axis] - 1) as f32 / self.size[axis] as f32)
    }
}

/// Codes of a body's vertices → sparse convolutions → features of a point from four levels → MLP → density and colour.
///
/// A scene is one frame: the parameters that the released code shares between frames (codes, convolutions) and those that
/// it learns per frame (an appearance code) are learned from that frame. Codes of vertices that share a voxel are
/// averaged; the released code keeps one of them.
#[derive(Module, Debug)]
pub struct NeuralBody {
    codes: Param<Tensor<2>>,
    appearance: Param<Tensor<2>>,
    encoder: SparseEncoder,
    trunk: Vec<Linear>,
    sigma: Linear,
    feature: Linear,
    framed: Linear,
    view: Linear,
    rgb: Linear,
    /// Features of each level, `[cells, channels]`; `None` before the field is [conditioned](Field::conditioned).
    volumes: Option<Vec<Tensor<2>>>,
    #[module(skip)]
    plan: Arc<EncoderSites>,
    #[module(skip)]
    grid: BodyVoxels,
    /// Frequencies of position and direction.
    #[module(skip)]
    frequencies: [usize; 2],
}

impl NeuralBody {
    /// Reads the features of points `[M, 3]` from all levels side by side, `[M, channels]`. Far from the body they are 0.
    fn features(&self, positions: Tensor<2>) -> Tensor<2> {
        let volumes = self.volumes.as_ref().expect("Neural Body is conditioned before it is evaluated");
        let device = self.device();
        let places = self.grid.places(positions);
        let read = |(volume, size): (&Tensor<2>, [usize; 3])| {
            let stretch = upload(self.grid.stretch(size).to_vec(), [1, 3], &device);
            let voxels = Voxels { grids: 1, size, padding: PaddingMode::Zero };
            trilinear(volume.clone(), places.clone() * stretch, voxels)
        };
        Tensor::cat(volumes.iter().zip(self.plan.sizes()).map(read).collect(), 1)
    }

    fn color(&self, trunk: Tensor<2>, points: &Points) -> Tensor<2> {
        let [samples, _] = trunk.dims();
        let appearance = self.appearance.val();
        let appearance = appearance.clone().expand([samples, appearance.dims()[1]]);
        let framed = self.framed.forward(Tensor::cat(vec![self.feature.forward(trunk), appearance], 1));
        let [of_position, of_direction] = self.frequencies;
        let direction = frequency_encode(points.sample_directions(), of_direction, &[]);
        let position = frequency_encode(points.positions.clone(), of_position, &[]);
        let view = self.view.forward(Tensor::cat(vec![framed, direction, position], 1));
        sigmoid(self.rgb.forward(relu(view)))
    }
}

impl Field for NeuralBody {
    fn evaluate(&self, points: &Points, color: bool, _at: Moment) -> FieldOutput {
        let features = self.features(points.positions.clone());
        let trunk = self.trunk.iter().fold(features, |x, layer| relu(layer.forward(x)));
        let sigma = relu(self.sigma.forward(trunk.clone())).squeeze_dim(1);
        FieldOutput { sigma, color: color.then(|| self.color(trunk, points)) }
    }

    fn conditioned(&self, _sources: &Sources, _seed: Option<u64>) -> Self {
        let volumes = self.encoder.volumes(self.codes.val(), &self.plan);
        Self { volumes: Some(volumes), ..self.clone() }
    }
}
