//! Fréchet distance and KID against SciPy and NumPy (`distribution.json`, made by `distribution.py`).

use approx::assert_relative_eq;
use infonerf_metrics::{FeatureSet, frechet_distance, kernel_distance, maximum_mean_discrepancy};
use serde_json::Value;

/// Generates vectors by the rule of `distribution.py`.
fn features(which: usize, n: usize, dimension: usize) -> FeatureSet {
    let value = |i: usize, j: usize| {
        let mixed = (i * 7919 + j * 104_729 + 31 * which) % 65_521;
        let noise = ((mixed * mixed + 17 * mixed) % 65_521) as f32 / 65_521.0;
        noise * (1 + which) as f32 + 0.25 * which as f32
    };
    let rows: Vec<Vec<f32>> = (0..n).map(|i| (0..dimension).map(|j| value(i, j)).collect()).collect();
    FeatureSet::from_rows(rows.iter().map(Vec::as_slice)).unwrap()
}

#[test]
fn fid_and_kid_agree_with_the_reference_at_any_rank() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("distribution.json")).unwrap();
    assert_eq!(cases.len(), 5);
    for case in cases {
        let count = |key: &str| case[key].as_u64().unwrap() as usize;
        let expected = |key: &str| case[key].as_f64().unwrap();
        let (n, m, dimension) = (count("n"), count("m"), count("dimension"));
        let (a, b) = (features(0, n, dimension), features(1, m, dimension));
        // SciPy's root of a singular matrix has half the digits.
        assert_relative_eq!(frechet_distance(&a, &b).unwrap(), expected("frechet"), max_relative = 2e-7);
        assert_relative_eq!(maximum_mean_discrepancy(&a, &b).unwrap(), expected("mmd"), max_relative = 1e-10);
        if n == m {
            assert_relative_eq!(kernel_distance(&a, &b).unwrap(), expected("mmd"), max_relative = 1e-10);
        }
    }
}
