//! A multi-resolution hash grid with a small MLP (Instant-NGP, Müller et al. 2022).

use std::fmt;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use burn::tensor::activation::softplus;
use infonerf_ops::mlp::{Activation, Precision};
use infonerf_ops::{to_host, unit_box, upload};
use infonerf_schedule::{Fault, Moment, Schedule};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_density, check_detail, check_range, check_width};
use crate::detail::part_weights;
use crate::field::{Field, FieldSetup, FieldSpec, Footprint};
use crate::init::{Init, parameter, uniform};
use crate::mlp::{Mlp, MlpSize};
use crate::points::{FieldOutput, Points};

const CORNERS: usize = 8;
/// Factors of the spatial hash (Müller et al. 2022, Eq. 4).
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// Sizes of [`HashGrid`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashConfig {
    /// Levels of resolution (paper: 16).
    pub levels: usize,
    /// Features of each entry (paper: 2).
    pub features: usize,
    /// Base-2 logarithm of the max number of entries per level (paper: 14 to 24).
    pub log2_table_size: u32,
    /// Cells along each axis of the coarsest level (paper: 16).
    pub coarsest: usize,
    /// Cells along each axis of the finest level (paper: 512 to 524288); between them resolutions grow geometrically.
    pub finest: usize,
    /// Hidden layers of the MLP before density.
    pub layers: usize,
    /// Width of the MLP; the view branch has half of it.
    pub width: usize,
    /// Frequencies of the direction's encoding.
    pub direction_frequencies: usize,
    /// s in σ = s·softplus(x + b), relative to the longest side of the scene's box.
    pub density_scale: f32,
    /// b in σ = s·softplus(x + b), which sets the initial density.
    pub density_bias: f32,
    /// Share of the finer levels in use, coarsest first; 1 for all.
    pub detail: Schedule,
}

impl fmt::Display for HashConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { levels, finest, layers, width, .. } = self;
        write!(f, "hash grid of {levels} levels up to {finest} with an MLP of {layers} layers of {width}")
    }
}

impl HashConfig {
    /// Lists the levels, coarsest first; their cells along each axis are a geometric series (Eq. 2 and 3).
    fn level_tables(&self) -> Vec<LevelTable> {
        let growth = (self.finest as f64 / self.coarsest as f64).powf(1.0 / (self.levels.max(2) - 1) as f64);
        let mut first = 0;
        let table = |level: usize| {
            let cells = (self.coarsest as f64 * growth.powi(level as i32)).round() as usize;
            let most = 1usize << self.log2_table_size;
            let vertices = (cells + 1).saturating_pow(3);
            let level = LevelTable { cells, first, entries: vertices.min(most), is_hashed: vertices > most };
            first += level.entries;
            level
        };
        (0..self.levels).map(table).collect()
    }
}

impl FieldSpec for HashConfig {
    type Field = HashGrid;

    fn validate(&self) -> Result<(), Fault> {
        check_range("levels", 1..=16, self.levels)?;
        check_range("features", 1..=8, self.features)?;
        check_range("log2_table_size", 4..=22, self.log2_table_size)?;
        check_range("coarsest", 2..=4096, self.coarsest)?;
        let finest = (self.coarsest..=1 << 16).contains(&self.finest);
        check("finest", "field.coarsest to 65536", self.finest, finest)?;
        check_range("layers", 1..=8, self.layers)?;
        check_width(self.width, 256)?;
        check_range("direction_frequencies", 0..=20, self.direction_frequencies)?;
        check_density(self.density_scale, self.density_bias)?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<HashGrid, Fault> {
        let mut rng = ChaCha8Rng::seed_from_u64(setup.seed);
        let levels = self.level_tables();
        let entries: usize = levels.iter().map(|level| level.entries).sum();
        let values = uniform(&mut rng, entries * self.features, 1e-4);
        let &Self { layers, width, direction_frequencies, .. } = self;
        let (inputs, precision) = (self.levels * self.features, Precision::F32);
        let size = MlpSize { inputs, layers, width, skip: layers, direction_frequencies, precision };
        let tables = parameter(values, [entries, self.features], setup.device);
        let mlp = Mlp::new(size, Init::FanIn, &mut rng, setup.device);
        let density_scale = self.density_scale / setup.longest_side();
        Ok(HashGrid { tables, mlp, levels, density_scale, config: self.clone(), bounds: setup.bounds })
    }

    fn footprint(&self) -> Footprint {
        let entries: usize = self.level_tables().iter().map(|level| level.entries).sum();
        // The features of eight corners per level with their indices and weights, and the MLP's activations.
        let corners = self.levels * CORNERS * (self.features + 2);
        let parameters = (entries * self.features + self.layers * self.width * self.width) as u64;
        Footprint { parameters, per_sample: (corners + self.layers * self.width) as u64 }
    }
}

/// Entries of one level within the table that holds all levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LevelTable {
    /// Cells along each axis.
    cells: usize,
    /// Index of the level's first entry.
    first: usize,
    entries: usize,
    /// Whether several vertices share an entry.
    is_hashed: bool,
}

impl LevelTable {
    fn entry(self, vertex: [usize; 3]) -> usize {
        let side = self.cells + 1;
        let index = if self.is_hashed {
            let mixed = vertex.into_iter().zip(PRIMES).map(|(v, prime)| (v as u32).wrapping_mul(prime));
            mixed.fold(0, |hash, part| hash ^ part) as usize % self.entries
        } else {
            (vertex[2] * side + vertex[1]) * side + vertex[0]
        };
        self.first + index
    }

    /// Returns the entries at the corners of the cell around `u` ∈ [0, 1]³, with their trilinear weights, which sum to 1, and
    /// the derivatives of these along each axis of `u`.
    #[inline]
    fn corners(self, u: [f32; 3]) -> [(usize, f32, [f32; 3]); CORNERS] {
        let cells = self.cells as f32;
        // The lowest corner of the cell around `u`, and the offset of `u` from it, in cells.
        let scaled = u.map(|u| u * cells);
        let low = scaled.map(|x| (x as usize).min(self.cells - 1));
        let above = [0, 1, 2].map(|axis| scaled[axis] - low[axis] as f32);
        std::array::from_fn(|corner| {
            let upper = [0, 1, 2].map(|axis| corner >> axis & 1);
            let [x, y, z] =
                [0, 1, 2].map(|axis| if upper[axis] == 1 { (above[axis], cells) } else { (1.0 - above[axis], -cells) });
            let entry = self.entry([0, 1, 2].map(|axis| low[axis] + upper[axis]));
            (entry, x.0 * y.0 * z.0, [x.1 * y.0 * z.0, x.0 * y.1 * z.0, x.0 * y.0 * z.1])
        })
    }
}

/// Features of a pyramid of grids, whose finer levels share entries by a hash → small MLP → density and colour.
#[derive(Module, Debug)]
pub struct HashGrid {
    tables: Param<Tensor<2>>,
    mlp: Mlp,
    #[module(skip)]
    levels: Vec<LevelTable>,
    /// Factor on density, 1/scene unit.
    #[module(skip)]
    density_scale: f32,
    #[module(skip)]
    config: HashConfig,
    #[module(skip)]
    bounds: [[f32; 3]; 2],
}

impl HashGrid {
    /// Interpolates the features of all levels trilinearly, `[M, levels · features]`.
    fn encode(&self, positions: Tensor<2>, detail: f64) -> Tensor<2> {
        let (levels, features) = (self.levels.len(), self.config.features);
        let device = self.device();
        let present = part_weights(levels, 1.0, detail);
        // Cells are looked up on the host.
        let shares = unit_box(positions, self.bounds);
        let positions = to_host(shares.clone());
        let samples = positions.len() / 3;
        let mut indices = vec![0i32; samples * levels * CORNERS];
        let mut weights = vec![0f32; indices.len()];
        let rows = indices.par_chunks_mut(levels * CORNERS).zip(weights.par_chunks_mut(levels * CORNERS));
        rows.zip(positions.as_chunks::<3>().0).for_each(|((indices, weights), &u)| {
            for ((index, weight), corner) in indices.iter_mut().zip(weights).zip(self.corners(u, &present)) {
                (*index, *weight, _) = corner;
            }
        });
        let count = indices.len();
        let indices = upload(indices, [count], &device);
        let mut weights = upload(weights, [count, 1], &device);
        if shares.is_tracked() {
            // `moved` has the value 0, and passes the gradient of the weights on to the positions.
            let moved = shares.clone() - shares.detach();
            let of_point = |&u: &[f32; 3]| self.corners(u, &present).flat_map(|(_, _, gradient)| gradient);
            let gradients = positions.as_chunks::<3>().0.par_iter().flat_map_iter(of_point).collect();
            let gradients = upload(gradients, [samples, levels * CORNERS, 3], &device);
            weights = weights + (gradients * moved.unsqueeze_dim(1)).sum_dim(2).reshape([count, 1]);
        }
        let weighted = self.tables.val().select(0, indices) * weights;
        weighted.reshape([samples * levels, CORNERS, features]).sum_dim(1).reshape([samples, levels * features])
    }

    /// Lists the entry, weight and the weight's gradient of the corners around `u` ∈ [0, 1]³ on every level, times the level's
    /// share in `present`.
    fn corners(&self, u: [f32; 3], present: &[f32]) -> impl Iterator<Item = (i32, f32, [f32; 3])> {
        self.levels.iter().zip(present).flat_map(move |(level, present)| {
            let shared = |(entry, weight, gradient): (usize, f32, [f32; 3])| {
                (entry as i32, weight * present, gradient.map(|g| g * present))
            };
            level.corners(u).map(shared)
        })
    }
}

impl Field for HashGrid {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let encoded = self.encode(points.positions.clone(), self.config.detail.at(at));
        let out = self.mlp.forward(encoded, points, color, Activation::None);
        FieldOutput { sigma: softplus(out.sigma + self.config.density_bias, 1.0) * self.density_scale, ..out }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    fn config() -> HashConfig {
        HashConfig {
            levels: 3,
            features: 2,
            log2_table_size: 9,
            coarsest: 4,
            finest: 16,
            layers: 1,
            width: 8,
            direction_frequencies: 1,
            density_scale: 10.0,
            density_bias: -1.0,
            detail: 1.0.into(),
        }
    }

    #[test]
    fn coarse_levels_are_dense_and_fine_ones_hashed() {
        let levels = config().level_tables();
        let sizes: Vec<_> = levels.iter().map(|level| (level.cells, level.entries, level.is_hashed)).collect();
        assert_eq!(sizes, [(4, 125, false), (8, 512, true), (16, 512, true)]);
        assert_eq!(levels[2].first, 125 + 512);
    }

    #[test]
    fn weights_are_trilinear() {
        for level in config().level_tables() {
            for u in [[0.0; 3], [1.0; 3], [0.3, 0.71, 0.5], [0.25, 0.25, 0.999]] {
                let corners = level.corners(u);
                assert!((corners.iter().map(|(_, weight, _)| weight).sum::<f32>() - 1.0).abs() < 1e-6);
                assert!(corners.iter().all(|(entry, ..)| (level.first..level.first + level.entries).contains(entry)));
            }
        }
        // At a vertex only its own entry has a weight.
        let dense = config().level_tables()[0];
        let at_vertex = dense.corners([0.5, 0.25, 1.0]).map(|(entry, weight, _)| (entry, weight));
        let entries: Vec<_> = at_vertex.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
        assert_eq!(entries, [((4 * 5 + 1) * 5 + 2, 1.0)]);
    }

    #[test]
    fn finer_levels_fade_in() {
        let device = Device::flex();
        let setup = FieldSetup { bounds: [[-1.0; 3], [1.0; 3]], seed: 0, device: &device, body: None };
        let field = config().build(&setup).unwrap();
        let encoded = |detail: f64| to_host(field.encode(Tensor::from_floats([[0.1, -0.4, 0.7]], &device), detail));
        let (coarse, all) = (encoded(0.0), encoded(1.0));
        assert!(coarse[..2] == all[..2] && coarse[2..] == [0.0; 4] && !all.contains(&0.0), "{coarse:?}, {all:?}");
    }
}
