use nalgebra::DMatrix;
use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::fid::INCEPTION_NETWORK;
use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::features::FeatureSet;

pub(super) const KID: Metric = Metric {
    descriptor: Descriptor { key: "kid", name: "KID", unit: "", decimals: 3, better: Better::Lower },
    definition: "unbiased squared MMD of Inception's features, kernel (x·y/d + 1)³ (Bińkowski et al. 2018)",
    measure: Measure::Set(INCEPTION_NETWORK, kernel_distance),
};

const MAX_SUBSET: usize = 1000;
const SUBSETS: u64 = 100;

/// Computes the kernel distance between two sets of vectors: the mean squared maximum mean discrepancy over 100 pairs
/// of random subsets of `min(n, m, 1000)` vectors, as in clean-fid. The subsets are the same in every run. If both sets have
/// that size, every draw has the same value and one is enough.
///
/// # Errors
/// If a set has fewer than two vectors, or dimensions differ.
pub fn kernel_distance(a: &FeatureSet, b: &FeatureSet) -> Result<f64, MetricError> {
    let [a, b] = FeatureSet::matrices(a, b)?;
    let size = a.nrows().min(b.nrows()).min(MAX_SUBSET);
    if a.nrows() == size && b.nrows() == size {
        return Ok(maximum_mean_discrepancy(&a, &b));
    }
    let draw = |draw| {
        let mut random = ChaCha8Rng::seed_from_u64(draw);
        let mut subset = |rows: &DMatrix<f64>| rows.select_rows(&sample(&mut random, rows.nrows(), size).into_vec());
        maximum_mean_discrepancy(&subset(&a), &subset(&b))
    };
    let draws: Vec<f64> = (0..SUBSETS).into_par_iter().map(draw).collect();
    Ok(draws.iter().sum::<f64>() / SUBSETS as f64)
}

/// Estimates, without bias, the squared maximum mean discrepancy with the kernel `k(x, y) = (x·y / d + 1)³`,
///
/// `Σ_{i≠j} k(x_i, x_j) / (n (n − 1)) + Σ_{i≠j} k(y_i, y_j) / (m (m − 1)) − 2 Σ_{ij} k(x_i, y_j) / (n m)`
///
/// (Bińkowski et al. 2018, Eq. 4); it may be negative.
fn maximum_mean_discrepancy(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let kernel =
        |x: &DMatrix<f64>, y: &DMatrix<f64>| (x * y.transpose()).map(|dot| (dot / x.ncols() as f64 + 1.0).powi(3));
    let within = |x: &DMatrix<f64>| {
        let (kernel, n) = (kernel(x, x), x.nrows() as f64);
        (kernel.sum() - kernel.trace()) / (n * (n - 1.0))
    };
    within(a) + within(b) - 2.0 * kernel(a, b).mean()
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use serde_json::Value;

    use super::*;
    use crate::metric::frechet_distance;

    fn set(rows: &[impl AsRef<[f32]>]) -> FeatureSet {
        let mut set = FeatureSet::default();
        rows.iter().for_each(|row| set.push(row.as_ref()).unwrap());
        set
    }

    fn discrepancy(a: &FeatureSet, b: &FeatureSet) -> f64 {
        let [a, b] = FeatureSet::matrices(a, b).unwrap();
        maximum_mean_discrepancy(&a, &b)
    }

    /// Generates vectors by the rule of `tests/distribution.py`.
    fn features(which: usize, n: usize, dimension: usize) -> FeatureSet {
        let value = |i: usize, j: usize| {
            let mixed = (i * 7919 + j * 104_729 + 31 * which) % 65_521;
            let noise = ((mixed * mixed + 17 * mixed) % 65_521) as f32 / 65_521.0;
            noise * (1 + which) as f32 + 0.25 * which as f32
        };
        set(&(0..n).map(|i| (0..dimension).map(|j| value(i, j)).collect()).collect::<Vec<Vec<f32>>>())
    }

    /// Compares with SciPy and NumPy (`distribution.json`, made by `distribution.py`).
    #[test]
    fn fid_and_kid_agree_with_the_reference_at_any_rank() {
        let cases: Vec<Value> = serde_json::from_str(include_str!("../../tests/distribution.json")).unwrap();
        assert_eq!(cases.len(), 5);
        for case in cases {
            let count = |key: &str| case[key].as_u64().unwrap() as usize;
            let expected = |key: &str| case[key].as_f64().unwrap();
            let (n, m, dimension) = (count("n"), count("m"), count("dimension"));
            let (a, b) = (features(0, n, dimension), features(1, m, dimension));
            // SciPy's root of a singular matrix has half the digits.
            assert_relative_eq!(frechet_distance(&a, &b).unwrap(), expected("frechet"), max_relative = 2e-7);
            assert_relative_eq!(discrepancy(&a, &b), expected("mmd"), max_relative = 1e-10);
            if n == m {
                assert_relative_eq!(kernel_distance(&a, &b).unwrap(), expected("mmd"), max_relative = 1e-10);
            }
        }
    }

    #[test]
    fn fid_and_kid_need_two_images() {
        let one = set(&[[1f32, 2.0]]);
        for distance in [frechet_distance, kernel_distance] {
            assert_eq!(distance(&one, &one).unwrap_err().to_string(), "needs at least 2 images, got 1");
            assert!(distance(&FeatureSet::default(), &one).is_err());
        }
    }

    #[test]
    fn subsets_are_the_same_in_every_run() {
        let row = |i: usize| [(i % 7) as f32 / 7.0, (i % 5) as f32 / 5.0];
        let near: Vec<[f32; 2]> = (0..40).map(row).collect();
        let far: Vec<[f32; 2]> = (0..30).map(row).map(|[x, y]| [x + 1.0, y + 1.0]).collect();
        let (near, far) = (set(&near), set(&far));
        let value = kernel_distance(&near, &far).unwrap();
        assert_eq!(kernel_distance(&near, &far), Ok(value));
        // A mean over subsets estimates what all vectors give.
        let expected = discrepancy(&near, &far);
        assert!(value != expected, "subsets were drawn");
        assert_relative_eq!(value, expected, max_relative = 0.02);
    }
}
