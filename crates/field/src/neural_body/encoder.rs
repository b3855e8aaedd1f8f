use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor};
use infonerf_ops::upload;
use rand::Rng;

use super::sites::{NEIGHBOURS, Sites};
use crate::init::{parameter, uniform};

/// ε of the batch normalisation.
const EPSILON: f32 = 1e-3;
/// Number of submanifold convolutions on the vertices' own sites, and after each halving.
const LAYERS: [usize; 5] = [2, 2, 3, 3, 3];

/// Features at sites → features at sites: 3³ kernels over the occupied sites, batch normalisation over the sites,
/// ReLU.
///
/// The result equals a dense convolution of a volume that is 0 elsewhere, read at the output's sites. It is *submanifold* if
/// these are the input's sites (Graham et al. 2018). As there is one body, renders also use the statistics of the batch.
#[derive(Module, Debug)]
struct SparseConvolution {
    /// `[27·inputs, outputs]`, the kernel's x fastest, z slowest.
    weight: Param<Tensor<2>>,
    scale: Param<Tensor<1>>,
    shift: Param<Tensor<1>>,
}

impl SparseConvolution {
    fn new([inputs, outputs]: [usize; 2], rng: &mut impl Rng, device: &Device) -> Self {
        let fan_in = NEIGHBOURS * inputs;
        let weight = uniform(rng, fan_in * outputs, (1.0 / fan_in as f32).sqrt());
        let vector = |value: f32| parameter(vec![value; outputs], [outputs], device);
        Self { weight: parameter(weight, [fan_in, outputs], device), scale: vector(1.0), shift: vector(0.0) }
    }

    /// Maps `[sites, inputs]` to `[neighbours/27, outputs]`.
    fn forward(&self, features: Tensor<2>, neighbours: Tensor<1, Int>) -> Tensor<2> {
        let weight = self.weight.val();
        let by_site = [neighbours.dims()[0] / NEIGHBOURS, weight.dims()[0]];
        let out = or_zero(features).select(0, neighbours).reshape(by_site).matmul(weight);
        let centred = out.clone() - out.mean_dim(0);
        let deviation = (centred.clone().square().mean_dim(0) + EPSILON).sqrt();
        relu(centred / deviation * self.scale.val().unsqueeze() + self.shift.val().unsqueeze())
    }
}

/// Appends a row of zeros, the features of an empty cell.
fn or_zero(features: Tensor<2>) -> Tensor<2> {
    let zero = Tensor::zeros([1, features.dims()[1]], &features.device());
    Tensor::cat(vec![features, zero], 0)
}

/// Sites of the encoder's layers, from those of the vertices to those of the coarsest level.
#[derive(Clone, Debug)]
pub(super) struct EncoderSites {
    /// Site of each vertex.
    vertices: Vec<i32>,
    /// One over the number of vertices that share a vertex's site.
    shares: Vec<f32>,
    stages: Vec<Stage>,
}

#[derive(Clone, Debug)]
struct Stage {
    sites: Sites,
    /// Neighbours among the sites of the stage before; empty for the first.
    down: Vec<i32>,
    /// Neighbours among the stage's own sites.
    same: Vec<i32>,
}

impl EncoderSites {
    /// Plans the layers for vertices in `cells` of a grid.
    pub(super) fn new(size: [usize; 3], cells: &[[usize; 3]]) -> Self {
        let first = Sites::new(size, cells.iter().copied());
        let vertices: Vec<i32> = cells.iter().map(|&cell| first.row(cell)).collect();
        let mut counts = vec![0f32; first.len()];
        vertices.iter().for_each(|&row| counts[row as usize] += 1.0);
        let shares = vertices.iter().map(|&row| 1.0 / counts[row as usize]).collect();
        let mut stages = vec![Stage { same: first.neighbours(&first, 1), sites: first, down: Vec::new() }];
        for _ in 1..LAYERS.len() {
            let before = &stages[stages.len() - 1].sites;
            let sites = before.halved();
            let (down, same) = (before.neighbours(&sites, 2), sites.neighbours(&sites, 1));
            stages.push(Stage { sites, down, same });
        }
        Self { vertices, shares, stages }
    }

    /// Lists the size of each level in cells, coarsest last.
    pub(super) fn sizes(&self) -> impl Iterator<Item = [usize; 3]> {
        self.stages[1..].iter().map(|stage| stage.sites.size)
    }
}

/// Codes of vertices → volumes of features at strides 2, 4, 8 and 16 (Neural Body, Table 5).
#[derive(Module, Debug)]
pub(super) struct SparseEncoder {
    down: Vec<SparseConvolution>,
    same: Vec<Vec<SparseConvolution>>,
}

/// Returns the channels of the four levels: w, 2w, 4w and 4w.
pub(super) fn channels(width: usize) -> [usize; 4] {
    [width, 2 * width, 4 * width, 4 * width]
}

/// Returns the widths of the five stages: of the codes, and of the levels.
fn widths(code: usize, width: usize) -> Vec<usize> {
    std::iter::once(code).chain(channels(width)).collect()
}

/// Returns the number of weights of the kernels.
pub(super) fn parameters(code: usize, width: usize) -> usize {
    let widths = widths(code, width);
    let into = |stage: usize| LAYERS[stage] * widths[stage] + if stage > 0 { widths[stage - 1] } else { 0 };
    (0..LAYERS.len()).map(|stage| NEIGHBOURS * widths[stage] * into(stage)).sum()
}

impl SparseEncoder {
    /// Builds an encoder of codes of `code` elements, whose first level has `width` channels.
    pub(super) fn new(code: usize, width: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let widths = widths(code, width);
        let mut layers = |stage: usize| {
            let down = (stage > 0).then(|| SparseConvolution::new([widths[stage - 1], widths[stage]], rng, device));
            let same = (0..LAYERS[stage]).map(|_| SparseConvolution::new([widths[stage]; 2], rng, device)).collect();
            (down, same)
        };
        let (down, same): (Vec<_>, Vec<_>) = (0..LAYERS.len()).map(&mut layers).unzip();
        Self { down: down.into_iter().flatten().collect(), same }
    }

    /// Computes the volumes of `codes`, `[vertices, code]`: for each level `[cells, channels]`, x fastest, 0 where there is no site.
    pub(super) fn volumes(&self, codes: Tensor<2>, plan: &EncoderSites) -> Vec<Tensor<2>> {
        let device = codes.device();
        let int = |values: &[i32]| upload(values.to_vec(), [values.len()], &device);
        let shares = upload(plan.shares.clone(), [plan.shares.len(), 1], &device);
        // The mean of the codes of the vertices at each site.
        let nothing = Tensor::zeros([plan.stages[0].sites.len(), codes.dims()[1]], &device);
        let mut features = nothing.select_assign(0, int(&plan.vertices), codes * shares, IndexingUpdateOp::Add);
        let mut volumes = Vec::new();
        for (index, stage) in plan.stages.iter().enumerate() {
            if index > 0 {
                features = self.down[index - 1].forward(features, int(&stage.down));
            }
            let same = int(&stage.same);
            features = self.same[index].iter().fold(features, |x, layer| layer.forward(x, same.clone()));
            if index > 0 {
                volumes.push(or_zero(features.clone()).select(0, int(&stage.sites.rows)));
            }
        }
        volumes
    }
}
