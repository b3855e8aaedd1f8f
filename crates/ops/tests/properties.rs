//! Properties of operations along rays that hold for all samples.

use crate::common::{DISTRIBUTIONS, RayImplementation, floats, matrix, vector};
use burn::tensor::Tensor;
use infonerf_ops::{Composite, RayDistribution, RayEntropy, Segments, composite};
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

fn rays() -> impl Strategy<Value = Vec<Vec<f32>>> {
    prop::collection::vec(prop::collection::vec(tau(), 0..12), 1..12)
}

fn body() -> impl Strategy<Value = RayImplementation> {
    prop::sample::select(RayImplementation::ALL.to_vec())
}

/// Returns an arbitrary value for each sample index.
fn value(index: usize) -> f32 {
    (index as f32 * 0.7).sin()
}

fn packed(rows: &[Vec<f32>]) -> (Segments, Vec<f32>) {
    (Segments::from_counts(rows.iter().map(Vec::len)), rows.concat())
}

fn run(body: RayImplementation, rows: &[Vec<f32>], values: &[f32]) -> Composite {
    let (segments, tau) = packed(rows);
    let device = body.device();
    body.composite(vector(&tau, &device), matrix(values, 1, &device), &segments)
}

fn entropies(body: RayImplementation, rows: &[Vec<f32>], of: RayDistribution, epsilon: f32) -> RayEntropy {
    let (segments, tau) = packed(rows);
    body.entropy(vector(&tau, &body.device()), &segments, of, epsilon)
}

fn bits(body: RayImplementation, ray: &[f32], of: RayDistribution) -> f64 {
    floats(entropies(body, &[ray.to_vec()], of, 0.0).bits)[0]
}

fn values(count: usize) -> Vec<f32> {
    (0..count).map(value).collect()
}

/// Computes Σ w v, Σ w, Σ α and the entropy of α/Σα.
fn single(body: RayImplementation, ray: &[f32], values: &[f32]) -> [f64; 4] {
    let out = run(body, &[ray.to_vec()], values);
    let entropy = entropies(body, &[ray.to_vec()], RayDistribution::Alpha, 0.0);
    let first = |tensor: Tensor<1>| floats(tensor)[0];
    [floats(out.values)[0], first(out.acc), first(entropy.alpha_sum), first(entropy.bits)]
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
            prop_assert!(close(single(body, &tau, &one)[0], f64::from(w)));
        }
        prop_assert!(close(single(body, &tau, &values(tau.len()))[1], sum));
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

    #[test]
    fn entropy_and_opacity_do_not_depend_on_the_order_of_samples(body in body(), (tau, other) in ray().prop_flat_map(|r| (Just(r.clone()), Just(r).prop_shuffle()))) {
        let [a, b] = [&tau, &other].map(|tau| single(body, tau, &values(tau.len())));
        for i in 1..4 {
            prop_assert!(close(a[i], b[i]), "{a:?} {b:?}");
        }
    }

    /// Tests Gibbs' inequality, and equality for equal rays. With ε inside the logarithms it holds up to N ε.
    #[test]
    fn divergence_is_not_negative(body in body(), pairs in prop::collection::vec((tau(), tau()), 1..40)) {
        let (p, q): (Vec<f32>, Vec<f32>) = pairs.into_iter().unzip();
        let divergence = divergence(body, &p, &q);
        prop_assert!(divergence >= -TOLERANCE && divergence <= -1e-10f64.ln() + TOLERANCE, "{divergence}");
        prop_assert!(self::divergence(body, &p, &p).abs() <= TOLERANCE);
    }

    /// Tests Pinsker's inequality, KL ≥ ½ (Σ |p − q|)².
    #[test]
    fn divergence_bounds_the_distance_of_distributions(body in body(), pairs in prop::collection::vec((tau(), tau()), 2..40)) {
        let (p, q): (Vec<f32>, Vec<f32>) = pairs.into_iter().unzip();
        let densities = [&p, &q].map(|tau| infonerf_oracle::ray_density(&tau.iter().copied().map(f64::from).collect::<Vec<_>>()));
        if let [Some(a), Some(b)] = densities {
            let distance: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
            let divergence = divergence(body, &p, &q);
            prop_assert!(divergence >= 0.5 * distance * distance - TOLERANCE, "{divergence}, distance {distance}");
        }
    }

    #[test]
    fn entropy_of_a_uniform_ray_does_not_depend_on_its_opacity(body in body(), even in 1e-9f32..10.0, factor in 1e-3f32..1e3, count in 1usize..40) {
        let bits = |tau: f32| bits(body, &vec![tau; count], RayDistribution::Alpha);
        prop_assert!(close(bits(even), bits(even * factor)));
    }

    #[test]
    fn splitting_an_interval_does_not_change_the_result(body in body(), tau in ray(), at in any::<prop::sample::Index>(), share in 0f32..1.0) {
        let at = at.index(tau.len());
        let (mut cut, mut cut_values) = (tau.clone(), values(tau.len()));
        cut.splice(at..=at, [tau[at] * share, tau[at] * (1.0 - share)]);
        cut_values.insert(at, value(at));
        let (whole, cut) = (single(body, &tau, &values(tau.len())), single(body, &cut, &cut_values));
        prop_assert!(close(whole[0], cut[0]) && close(whole[1], cut[1]), "{whole:?} {cut:?}");
    }

    #[test]
    fn rays_do_not_affect_each_other(body in body(), rows in rays(), turn in any::<prop::sample::Index>()) {
        let by_ray = |rows: &[Vec<f32>]| {
            let own: Vec<f32> = rows.iter().flat_map(|row| values(row.len())).collect();
            let out = run(body, rows, &own);
            let entropies = DISTRIBUTIONS.map(|of| floats(entropies(body, rows, of, 1e-10).bits));
            let (segments, tau) = packed(rows);
            let device = body.device();
            let near: Vec<f32> = tau.iter().map(|tau| tau * 0.5 + 0.1).collect();
            let divergence = body.divergence(vector(&tau, &device), vector(&near, &device), &segments, 1e-10);
            let [a, b, c] = entropies;
            let columns = [floats(out.values), floats(out.acc), a, b, c, floats(divergence)];
            (0..rows.len()).map(|ray| columns.each_ref().map(|column| column[ray])).collect::<Vec<_>>()
        };
        let turn = turn.index(rows.len());
        let mut together = by_ray(&rows);
        together.rotate_left(turn);
        let mut turned = rows.clone();
        turned.rotate_left(turn);
        let alone: Vec<[f64; 6]> = turned.iter().flat_map(|row| by_ray(std::slice::from_ref(row))).collect();
        for (other, what) in [(by_ray(&turned), "turned"), (alone, "alone")] {
            for (a, b) in together.iter().flatten().zip(other.iter().flatten()) {
                prop_assert!(close(*a, *b), "{}: {} {}", what, a, b);
            }
        }
    }
}
