//! Bodies under test, and rays to test them on.

use burn::tensor::{Device, Tensor};
use infonerf_ops::random::mix;
use infonerf_ops::{Composite, RayEntropy, Segments, additive, composite, divergence, entropy, to_host, upload};

/// Implementation of the operations along rays on one backend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RayImplementation {
    Kernel,
    PlainFlex,
    PlainNdarray,
}

impl RayImplementation {
    pub const ALL: [Self; 3] = [Self::Kernel, Self::PlainFlex, Self::PlainNdarray];

    pub fn device(self) -> Device {
        if self == Self::PlainNdarray { Device::ndarray() } else { Device::flex() }
    }

    pub fn composite(self, tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Composite {
        if self == Self::Kernel { composite(tau, values, segments) } else { composite::plain(tau, values, segments) }
    }

    pub fn additive_depth(self, tau: Tensor<1>, segments: &Segments) -> Tensor<1> {
        if self == Self::Kernel { additive::additive_depth(tau, segments) } else { additive::plain(tau, segments) }
    }

    pub fn entropy(self, tau: Tensor<1>, segments: &Segments, epsilon: f32) -> RayEntropy {
        (if self == Self::Kernel { entropy::ray_entropy } else { entropy::plain })(tau, segments, epsilon)
    }

    pub fn divergence(self, tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
        let body = if self == Self::Kernel { divergence::ray_divergence } else { divergence::plain };
        body(tau, near, segments, epsilon)
    }
}

pub fn vector(values: &[f32], device: &Device) -> Tensor<1> {
    upload(values.to_vec(), [values.len()], device)
}

/// Joins density and colour to rows, `[M, 4]`, or `[M, 1]` without colour.
pub fn joined((density, color): (Tensor<1>, Option<Tensor<2>>)) -> Tensor<2> {
    Tensor::cat(std::iter::once(density.unsqueeze_dim(1)).chain(color).collect(), 1)
}

pub fn floats<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    to_host(tensor).into_iter().map(f64::from).collect()
}

pub fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

/// Asserts that results of two bodies in single precision agree to 2e-5 of the largest value.
pub fn assert_close(a: &[f32], b: &[f32], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    let scale = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= 2e-5 * scale, "{what}: {worst} of {scale}");
}

/// Reproducible random values by splitmix64.
pub struct Draws(pub u64);

impl Draws {
    pub fn unit(&mut self) -> f64 {
        let bits = mix(self.0);
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Draws uniformly from [−1, 1).
    pub fn signed(&mut self) -> f32 {
        (self.unit() * 2.0 - 1.0) as f32
    }

    /// Draws `count` values from [−1, 1).
    pub fn row(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.signed()).collect()
    }

    /// Draws an optical depth, log-uniform from 1e-6 to 100, or 0 one time in ten.
    pub fn tau(&mut self) -> f32 {
        let exponent = self.unit() * 8.0 - 6.0;
        if self.unit() < 0.1 { 0.0 } else { 10f64.powf(exponent) as f32 }
    }
}

/// Rays of different lengths, packed.
#[derive(Clone, Debug)]
pub struct Rays {
    pub segments: Segments,
    pub tau: Vec<f32>,
}

impl Rays {
    pub fn from_rows(rows: &[Vec<f32>]) -> Self {
        Self { segments: Segments::from_counts(rows.iter().map(Vec::len)), tau: rows.concat() }
    }

    /// Draws rays of 0 to 40 samples; every seventh is empty.
    pub fn random(draws: &mut Draws, count: usize) -> Self {
        let row = |ray: usize| -> Vec<f32> {
            let length = if ray.is_multiple_of(7) { 0 } else { (draws.unit() * 40.0) as usize + 1 };
            (0..length).map(|_| draws.tau()).collect()
        };
        Self::from_rows(&(0..count).map(row).collect::<Vec<_>>())
    }

    /// Returns every ray of one, two and three samples out of extreme depths, and rays of all of them.
    pub fn extreme() -> Self {
        /// Optical depths from 0 through subnormals to infinity.
        const EXTREMES: [f32; 9] = [0.0, 1e-38, 1e-12, 1e-4, 1.0, 30.0, 1e3, 1e30, f32::INFINITY];
        let mut rows: Vec<Vec<f32>> = vec![vec![], EXTREMES.to_vec(), EXTREMES.iter().rev().copied().collect()];
        for a in EXTREMES {
            rows.push(vec![a]);
            for b in EXTREMES {
                rows.push(vec![a, b]);
                rows.extend(EXTREMES.map(|c| vec![a, b, c]));
            }
        }
        Self::from_rows(&rows)
    }
}
