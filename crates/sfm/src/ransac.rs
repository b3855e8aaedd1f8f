//! Random sample consensus (Fischler and Bolles 1981), scored as MSAC (Torr and Zisserman 2000).

use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

/// Probability that at least one sample without outliers is drawn.
const CONFIDENCE: f64 = 0.9999;

pub(crate) struct Ransac {
    /// Squared errors below this are inliers.
    pub(crate) threshold: f64,
    pub(crate) max_samples: usize,
    pub(crate) seed: u64,
}

impl Ransac {
    /// Returns the model, solved from `N` data, with the min `Σ min(error, threshold)` over data `0..count`, and its inliers.
    pub(crate) fn run<M, const N: usize>(
        &self,
        count: usize,
        solve: impl Fn([usize; N]) -> Vec<M>,
        error: impl Fn(&M, usize) -> f64,
    ) -> Option<(M, Vec<usize>)> {
        if count < N {
            return None;
        }
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let (mut best, mut least, mut needed) = (None, f64::INFINITY, self.max_samples as f64);
        let mut drawn = 0.0;
        while drawn < needed {
            drawn += 1.0;
            let chosen = sample(&mut random, count, N);
            for model in solve(std::array::from_fn(|i| chosen.index(i))) {
                let cost: f64 = (0..count).map(|i| error(&model, i).min(self.threshold)).sum();
                if cost < least {
                    let inliers: Vec<usize> = (0..count).filter(|&i| error(&model, i) < self.threshold).collect();
                    let clean = (inliers.len() as f64 / count as f64).powi(N as i32);
                    if clean > 0.0 {
                        needed = needed.min((1.0 - CONFIDENCE).ln() / (-clean.min(1.0 - 1e-9)).ln_1p());
                    }
                    (best, least) = (Some((model, inliers)), cost);
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_noise() {
        let data: Vec<f64> =
            (0..60).map(|i| if i % 3 == 0 { f64::from(i * i % 17) - 90.0 } else { 2.0 * f64::from(i) }).collect();
        let line = |[a, b]: [usize; 2]| vec![(data[a] - data[b]) / (a as f64 - b as f64)];
        let ransac = Ransac { threshold: 0.01, max_samples: 500, seed: 1 };
        let error = |m: &f64, i: usize| (m * i as f64 - data[i]).powi(2);
        let (m, inliers) = ransac.run(60, line, error).unwrap();
        assert!((m - 2.0).abs() < 1e-9 && inliers.len() == 40);
        assert!(ransac.run(1, line, error).is_none());
    }
}
