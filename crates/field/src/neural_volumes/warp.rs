use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};
use infonerf_ops::trilinear::{PaddingMode, Voxels, trilinear};
use infonerf_ops::upload;
use rand::Rng;

use super::{LEAKY_GAIN, LEAKY_SLOPE, in_voxels};
use crate::init::glorot_linear;

/// Width of the branches that make the affine maps, and of the one that makes the mixture's weights.
const WIDTHS: (usize, usize) = (128, 64);
const TRANSLATION: f32 = 0.1;
/// Value added to a quaternion's squared length, so that a quaternion of length 0 stays finite.
const SQUARE_EPSILON: f32 = 1e-5;
/// Min sum of the mixture's weights as a divisor.
const MIN_WEIGHT: f32 = 1e-3;

/// A mixture of affine maps (Neural Volumes, Lombardi et al. 2019, Sec. 4.2), from a point to the place where the template is
/// read:
///
/// `Aᵢ(p) = sᵢ ⊙ Rᵢ (p − tᵢ)` and `warp(p) = Σ wᵢ(Aᵢ p) Aᵢ p / max(Σ wᵢ(Aᵢ p), 0.001)`,
///
/// where wᵢ is a grid of voxels, read trilinearly. As in the released code it is computed at the voxels of a grid and is
/// linear between.
#[derive(Module, Debug)]
pub(super) struct VolumeWarp {
    scales: Branch,
    rotations: Branch,
    translations: Branch,
    weights: Branch,
    #[module(skip)]
    maps: usize,
    #[module(skip)]
    resolution: usize,
}

#[derive(Module, Debug)]
struct Branch {
    hidden: Linear,
    output: Linear,
}

impl Branch {
    fn new(rng: &mut impl Rng, [inputs, hidden, outputs]: [usize; 3], device: &Device) -> Self {
        Self {
            hidden: glorot_linear(rng, inputs, hidden, LEAKY_GAIN, device),
            output: glorot_linear(rng, hidden, outputs, 1.0, device),
        }
    }

    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.output.forward(leaky_relu(self.hidden.forward(x), LEAKY_SLOPE))
    }
}

impl VolumeWarp {
    /// Builds a mixture of `maps` affine maps on a grid of `resolution`³, for codes of `latent` elements.
    pub(super) fn new(latent: usize, maps: usize, resolution: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let mut branch = |hidden: usize, outputs: usize| Branch::new(rng, [latent, hidden, outputs], device);
        let [scales, rotations, translations] = [3, 4, 3].map(|numbers| branch(WIDTHS.0, numbers * maps));
        let weights = branch(WIDTHS.1, maps * resolution.pow(3));
        Self { scales, rotations, translations, weights, maps, resolution }
    }

    pub(super) fn grid(&self) -> Voxels {
        Voxels { grids: 1, size: [self.resolution; 3], padding: PaddingMode::Border }
    }

    /// Computes where the template is read for each voxel, by a code `[1, latent]`: `[resolution³, 3]` in [−1, 1]³, x fastest.
    pub(super) fn field(&self, code: Tensor<2>) -> Tensor<2> {
        let (maps, voxels) = (self.maps, self.resolution.pow(3));
        let (linear, offset) = self.affine(code.clone());
        let points = upload(self.points(), [voxels, 3], &code.device());
        // Row v·maps + i is Aᵢ of voxel v.
        let mapped = (points.matmul(linear) + offset).reshape([voxels * maps, 3]);
        let weights = self.weights.forward(code).exp().reshape([maps * voxels, 1]);
        let places = in_voxels(mapped.clone(), self.grid());
        let weights = trilinear(weights, places, Voxels { grids: maps, ..self.grid() }).reshape([voxels, maps, 1]);
        let mixed = (mapped.reshape([voxels, maps, 3]) * weights.clone()).sum_dim(1);
        (mixed / weights.sum_dim(1).clamp_min(MIN_WEIGHT)).squeeze_dim(1)
    }

    /// Returns all maps, `[3, 3·maps]` and `[1, 3·maps]`: `Aᵢ(p)` is columns 3i to 3i + 2 of `p · linear + offset`.
    fn affine(&self, code: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
        let maps = self.maps;
        let scales = self.scales.forward(code.clone()).reshape([maps, 3, 1]);
        let rotations = rotations(self.rotations.forward(code.clone()).reshape([maps, 4]));
        let translations = self.translations.forward(code).reshape([maps, 1, 3]) * TRANSLATION;
        let linear = rotations * scales;
        let offset = (linear.clone() * translations).sum_dim(2).neg().reshape([1, 3 * maps]);
        (linear.reshape([3 * maps, 3]).swap_dims(0, 1), offset)
    }

    /// Returns the voxels' centres in [−1, 1]³, row-major.
    fn points(&self) -> Vec<f32> {
        let size = self.resolution;
        let at = |voxel: usize| 2.0 * voxel as f32 / (size - 1) as f32 - 1.0;
        (0..size.pow(3)).flat_map(|v| [at(v % size), at(v / size % size), at(v / size.pow(2))]).collect()
    }
}

/// Returns the rotations `[N, 3, 3]` of quaternions (w, x, y, z), `[N, 4]`, of any length.
fn rotations(quaternions: Tensor<2>) -> Tensor<3> {
    let count = quaternions.dims()[0];
    let length = (quaternions.clone().square().sum_dim(1) + SQUARE_EPSILON).sqrt();
    let unit = quaternions / length;
    let part = |index: usize| unit.clone().narrow(1, index, 1);
    let [w, x, y, z] = [0, 1, 2, 3].map(part);
    let product = |a: &Tensor<2>, b: &Tensor<2>| a.clone() * b.clone() * 2.0;
    let diagonal = |a: &Tensor<2>, b: &Tensor<2>| (product(a, a) + product(b, b)).neg() + 1.0;
    let entries = vec![
        diagonal(&y, &z),
        product(&x, &y) - product(&w, &z),
        product(&x, &z) + product(&w, &y),
        product(&x, &y) + product(&w, &z),
        diagonal(&x, &z),
        product(&y, &z) - product(&w, &x),
        product(&x, &z) - product(&w, &y),
        product(&y, &z) + product(&w, &x),
        diagonal(&x, &y),
    ];
    Tensor::cat(entries, 1).reshape([count, 3, 3])
}
