//! Properties of operations along rays that hold for all samples.

use crate::common::{DISTRIBUTIONS, RayImplementation, floats, vector, wide};
use infonerf_ops::{RayDistribution, Segments, composite, from_host};
use proptest::prelude::*;

/// Roundings of `f32` sums over a ray.
const TOLERANCE: f64 = 1e-5;

/// Generates optical depths from thin to opaque, and zeros.
fn tau() -> impl Strategy<Value = f32> {
    prop_oneof![1 => Just(0.0), 8 => (-8f32..2.5).prop_map(|e| 10f32.powf(e)), 1 => Just(1e10)]
}

fn ray() -> impl Strategy<Value = Vec<f32>> {
    prop::collection::vec(tau(), 1..40)
}

fn body() -> impl Strategy<Value = RayImplementation> {
    prop::sample::select(RayImplementation::ALL.to_vec())
}

/// Returns an arbitrary value for each sample index.
fn value(index: usize) -> f32 {
    (index as f32 * 0.7).sin()
}

fn values(count: usize) -> Vec<f32> {
    (0..count).map(value).collect()
}

/// Computes Σ w v and Σ w.
fn composited(body: RayImplementation, ray: &[f32], values: &[f32]) -> [f64; 2] {
    let device = body.device();
    let out = body.composite(vector(ray, &device), from_host(values, 1, &device), &Segments::uniform(1, ray.len()));
    [floats(out.values)[0], floats(out.acc)[0]]
}

fn bits(body: RayImplementation, ray: &[f32], of: RayDistribution) -> f64 {
    let tau = vector(ray, &body.device());
    floats(body.entropy(tau, &Segments::uniform(1, ray.len()), of, 0.0).bits)[0]
}

fn divergence(body: RayImplementation, p: &[f32], q: &[f32]) -> f64 {
    let device = body.device();
    let segments = Segments::uniform(1, p.len());
    floats(body.divergence(vector(p, &device), vector(q, &device), &segments, 1e-10))[0]
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= TOLERANCE * (1.0 + a.abs())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Tests w ∈ [0, 1] and Σ w + e^{−Σ τ} = 1.
    #[test]
    fn weights_and_transmittance_add_up_to_one(body in body(), tau in ray()) {
        let w = composite::weights(&tau, &Segments::uniform(1, tau.len()));
        prop_assert!(w.iter().all(|w| (0.0..=1.0).contains(w)), "{w:?}");
        let leaves = (-tau.iter().map(|&tau| f64::from(tau)).sum::<f64>()).exp();
        let sum: f64 = w.iter().map(|&w| f64::from(w)).sum();
        prop_assert!(close(sum + leaves, 1.0));
        // The operation integrates with the weights of the host.
        for (i, &w) in w.iter().enumerate() {
            let mut one = vec![0.0; tau.len()];
            one[i] = 1.0;
            prop_assert!(close(composited(body, &tau, &one)[0], f64::from(w)));
        }
        prop_assert!(close(composited(body, &tau, &values(tau.len()))[1], sum));
    }

    /// Tests 0 ≤ H ≤ log₂ N, and H = log₂ N if all samples are equally opaque. A background adds one outcome.
    #[test]
    fn entropy_is_bounded(body in body(), tau in ray(), even in tau(), count in 1usize..40) {
        for of in DISTRIBUTIONS {
            let outcomes = tau.len() + usize::from(of != RayDistribution::Alpha);
            let bits = bits(body, &tau, of);
            prop_assert!(bits >= -TOLERANCE && bits <= (outcomes as f64).log2() + TOLERANCE, "{of:?}: {bits}");
        }
        let bits = bits(body, &vec![even; count], RayDistribution::Alpha);
        let most = if even > 0.0 { (count as f64).log2() } else { 0.0 };
        prop_assert!(close(most, bits), "{bits}");
    }

    #[test]
    fn empty_rays_and_walls_have_no_entropy_of_termination(body in body(), rest in ray(), count in 1usize..40) {
        prop_assert!(bits(body, &vec![0.0; count], RayDistribution::Termination).abs() <= TOLERANCE);
        prop_assert!(bits(body, &vec![0.0; count], RayDistribution::AlphaBackground).abs() <= TOLERANCE);
        let wall: Vec<f32> = std::iter::once(1e10).chain(rest).collect();
        prop_assert!(bits(body, &wall, RayDistribution::Termination).abs() <= TOLERANCE);
    }

    /// Tests Pinsker's inequality, KL ≥ ½ (Σ |p − q|)², the largest value, and equality for equal rays. With ε inside the
    /// logarithms it holds up to N ε.
    #[test]
    fn divergence_is_between_the_distance_of_distributions_and_its_bound(body in body(), pairs in prop::collection::vec((tau(), tau()), 1..40)) {
        let (p, q): (Vec<f32>, Vec<f32>) = pairs.into_iter().unzip();
        let distance = match [&p, &q].map(|tau| infonerf_oracle::ray_density(&wide(tau))) {
            [Some(a), Some(b)] => a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum(),
            _ => 0f64,
        };
        let least = 0.5 * distance * distance - TOLERANCE;
        let divergence = divergence(body, &p, &q);
        prop_assert!(divergence >= least && divergence <= -1e-10f64.ln() + TOLERANCE, "{divergence}, distance {distance}");
        prop_assert!(self::divergence(body, &p, &p).abs() <= TOLERANCE);
    }

    #[test]
    fn splitting_an_interval_does_not_change_the_result(body in body(), tau in ray(), at in any::<prop::sample::Index>(), share in 0f32..1.0) {
        let at = at.index(tau.len());
        let (mut cut, mut cut_values) = (tau.clone(), values(tau.len()));
        cut.splice(at..=at, [tau[at] * share, tau[at] * (1.0 - share)]);
        cut_values.insert(at, value(at));
        let (whole, cut) = (composited(body, &tau, &values(tau.len())), composited(body, &cut, &cut_values));
        prop_assert!(close(whole[0], cut[0]) && close(whole[1], cut[1]), "{whole:?} {cut:?}");
    }
}
