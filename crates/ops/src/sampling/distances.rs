//! Distances of samples along a ray, as pure functions.

use super::{LastInterval, Placement};
use crate::random::Stream;

/// Places `count` distances in [near, far]: with jitter one at random in each stratum, else evenly spaced.
///
/// [`Placement::Left`]: NeRF's rule, `linspace(near, far, count)` with `count` ≥ 2, each jittered between the midpoints to its
/// neighbours.
/// [`Placement::Mid`]: `count` equal intervals, one sample in the middle of each, or anywhere in it if jittered.
/// [`Placement::Interval`]: the `count + 1` edges of `count` intervals, by NeRF's rule.
pub fn stratified(near: f32, far: f32, count: usize, rule: Placement, jitter: Option<Stream>) -> Vec<f32> {
    let at = |u: f32| near * (1.0 - u) + far * u;
    let draw = |i: usize| jitter.map(|stream| stream.uniform(i));
    match rule {
        Placement::Left | Placement::Interval => {
            let count = if rule == Placement::Interval { count + 1 } else { count };
            let even = |i: usize| at(i as f32 / (count - 1) as f32);
            let place = |i: usize| match draw(i) {
                None => even(i),
                Some(u) => {
                    let lower = if i == 0 { even(0) } else { 0.5 * (even(i - 1) + even(i)) };
                    let upper = if i + 1 == count { even(i) } else { 0.5 * (even(i) + even(i + 1)) };
                    lower + (upper - lower) * u
                }
            };
            (0..count).map(place).collect()
        }
        Placement::Mid => (0..count).map(|i| at((i as f32 + draw(i).unwrap_or(0.5)) / count as f32)).collect(),
    }
}

/// Returns `(distance, interval length)` of the samples of one ray with sorted distances `t`.
///
/// [`Placement::Left`]: from the sample to the next; the last one by `last`. [`Placement::Mid`]: between the midpoints
/// to both neighbours, the first from `near` and the last to `far`. [`Placement::Interval`]: distances are edges, one more
/// than samples.
pub fn intervals(t: &[f32], near: f32, far: f32, rule: Placement, last: LastInterval) -> Vec<(f32, f32)> {
    let n = t.len();
    match rule {
        Placement::Left => (0..n)
            .map(|i| match (t.get(i + 1), last.length()) {
                (Some(next), _) => (t[i], next - t[i]),
                (None, Some(length)) => (t[i], length),
                (None, None) if n > 1 => (t[i], t[n - 1] - t[n - 2]),
                (None, None) => (t[i], far - t[i]),
            })
            .collect(),
        Placement::Mid => {
            let edge = |i: usize| match i {
                0 => near,
                i if i == n => far,
                i => 0.5 * (t[i - 1] + t[i]),
            };
            (0..n).map(|i| (t[i], (edge(i + 1) - edge(i)).max(0.0))).collect()
        }
        Placement::Interval => t.windows(2).map(|edge| (0.5 * (edge[0] + edge[1]), edge[1] - edge[0])).collect(),
    }
}

/// Draws `count` distances from the piecewise-constant density of the coarse `weights` and merges them with the coarse `t`.
///
/// NeRF's inverse transform (Mildenhall et al., Sec. 5.2): bins between the midpoints of `t`, which holds 3 distances or more,
/// weights of the inner samples + 1e-5, `u` even in [0, 1] or jittered. Returns sorted distances, `[t.len() + count]`.
pub fn importance(t: &[f32], weights: &[f32], count: usize, jitter: Option<Stream>) -> Vec<f32> {
    let n = t.len();
    let mids: Vec<f32> = t.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    let inner = &weights[1..n - 1];
    // The sum is in `f64`: an encoding with high frequencies makes the last digit of a distance visible in the result.
    let total: f64 = inner.iter().map(|&w| f64::from(w) + 1e-5).sum();
    let mut cdf = Vec::with_capacity(n - 1);
    let mut sum = 0.0;
    cdf.push(0.0);
    for &w in inner {
        sum += (f64::from(w) + 1e-5) / total;
        cdf.push(sum);
    }
    // With this value u = 1 is at the end on every device, however the sum is rounded.
    cdf[n - 2] = 1.0;
    let mut merged = t.to_vec();
    merged.extend((0..count).map(|i| {
        let u = jitter.map_or(i as f64 / (count.max(2) - 1) as f64, |stream| f64::from(stream.uniform(i)));
        let above = cdf.partition_point(|&c| c <= u);
        let (below, above) = (above.saturating_sub(1), above.min(cdf.len() - 1));
        let width = cdf[above] - cdf[below];
        let fraction = (u - cdf[below]) / if width < 1e-5 { 1.0 } else { width };
        mids[below] + fraction as f32 * (mids[above] - mids[below])
    }));
    merged.sort_unstable_by(f32::total_cmp);
    merged
}

/// Blurs coarse weights before resampling (mip-NeRF, Eq. 18): the mean of the maxima over both pairs of neighbours,
/// plus 0.01, so that a surface that moves from one interval to the next is not missed.
pub fn blurred(weights: &[f32]) -> Vec<f32> {
    const PADDING: f32 = 0.01;
    let at = |i: usize| weights[i.min(weights.len() - 1)];
    (0..weights.len()).map(|i| 0.5 * (at(i.saturating_sub(1)).max(at(i)) + at(i).max(at(i + 1))) + PADDING).collect()
}

/// Draws `count + 1` edges from the piecewise-constant density of `weights` in the intervals between `edges`.
///
/// mip-NeRF's inverse transform (Sec. 3.1, released code): `u` even in [0, 1), or one at random in each stratum, so that
/// edges are sorted; weights that sum to less than 1e-5 are padded evenly.
pub fn resample(edges: &[f32], weights: &[f32], count: usize, jitter: Option<Stream>) -> Vec<f32> {
    const MIN_SUM: f32 = 1e-5;
    const LAST: f32 = 1.0 - f32::EPSILON;
    let n = weights.len();
    let sum: f32 = weights.iter().sum();
    let padding = (MIN_SUM - sum).max(0.0) / n as f32;
    let total = sum + padding * n as f32;
    let mut cdf = Vec::with_capacity(n + 1);
    let mut below = 0.0;
    cdf.push(0.0);
    for weight in &weights[..n - 1] {
        below += (weight + padding) / total;
        cdf.push(f32::min(below, 1.0));
    }
    cdf.push(1.0);
    let edge = |i: usize| {
        let u = match jitter {
            Some(stream) => ((i as f32 + stream.uniform(i)) / (count + 1) as f32).min(LAST),
            None => i as f32 / count as f32 * LAST,
        };
        // u is in [0, 1), and so in one of the intervals.
        let interval = cdf.partition_point(|&c| c <= u) - 1;
        let fraction = (u - cdf[interval]) / (cdf[interval + 1] - cdf[interval]);
        edges[interval] + fraction.clamp(0.0, 1.0) * (edges[interval + 1] - edges[interval])
    };
    (0..=count).map(edge).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn even_samples_of_every_rule() {
        assert_eq!(stratified(2.0, 6.0, 5, Placement::Left, None), [2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(stratified(2.0, 6.0, 4, Placement::Mid, None), [2.5, 3.5, 4.5, 5.5]);
        assert_eq!(stratified(2.0, 6.0, 4, Placement::Interval, None), [2.0, 3.0, 4.0, 5.0, 6.0]);
        let t = [2.0, 3.0, 5.0];
        let left = |last| intervals(&t, 2.0, 6.0, Placement::Left, last);
        assert_eq!(left(LastInterval::Finite), [(2.0, 1.0), (3.0, 2.0), (5.0, 2.0)]);
        assert_eq!(left(LastInterval::Infinite), [(2.0, 1.0), (3.0, 2.0), (5.0, 1e10)]);
        let finite = |rule| intervals(&t, 1.0, 6.0, rule, LastInterval::Finite);
        assert_eq!(finite(Placement::Mid), [(2.0, 1.5), (3.0, 1.5), (5.0, 2.0)]);
        assert_eq!(finite(Placement::Interval), [(2.5, 1.0), (4.0, 2.0)]);
    }

    /// Compares with values computed by `tests/fixtures/mip_forward.py`.
    #[test]
    fn resampling_agrees_with_jax() {
        let cases: Vec<serde_json::Value> =
            serde_json::from_str(include_str!("../../tests/fixtures/resampling.json")).unwrap();
        for case in &cases {
            let floats = |key: &str| -> Vec<f32> {
                case[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
            };
            let (weights, edges) = (floats("weights"), floats("edges"));
            let blurred = blurred(&weights);
            let drawn = resample(&edges, &blurred, floats("resampled").len() - 1, None);
            for (got, want) in [(blurred, floats("blurred")), (drawn, floats("resampled"))] {
                approx::assert_abs_diff_eq!(got[..], want[..], epsilon = 1e-5);
            }
        }
    }

    #[test]
    fn resampling_zero_weights_is_even() {
        let drawn = resample(&[2.0, 3.0, 4.0, 5.0, 6.0], &[0.0; 4], 8, None);
        approx::assert_abs_diff_eq!(drawn[..], [2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0][..], epsilon = 1e-5);
    }

    #[test]
    fn importance_goes_where_the_weight_is() {
        let t = stratified(2.0, 6.0, 64, Placement::Left, None);
        let mut weights = vec![0.0; 64];
        weights[40] = 1.0;
        let drawn = importance(&t, &weights, 100, None);
        let near = drawn.iter().filter(|d| (**d - t[40]).abs() < 0.07).count();
        assert!(near > 90, "{near} of 164 near the spike");
    }

    proptest! {
        #[test]
        fn samples_are_sorted_and_inside(
            seed in any::<u64>(), count in 4usize..40, fine in 1usize..40,
            near in 0.1f32..3.0, length in 0.01f32..10.0,
            weights in prop::collection::vec(0f32..1.0, 40),
        ) {
            let far = near + length;
            let jitter = Some(Stream { key: seed, item: 3 });
            for rule in Placement::ALL {
                let t = stratified(near, far, count, rule, jitter);
                let drawn = match rule {
                    Placement::Interval => resample(&t, &weights[..count], fine, jitter),
                    _ => importance(&t, &weights[..count], fine, jitter),
                };
                for t in [&t, &drawn] {
                    prop_assert!(t.windows(2).all(|pair| pair[0] <= pair[1]));
                    prop_assert!(t.iter().all(|t| *t >= near - 1e-4 && *t <= far + 1e-4));
                }
                let samples = intervals(&drawn, near, far, rule, LastInterval::Finite);
                let expected = if rule == Placement::Interval { fine } else { count + fine };
                prop_assert_eq!(samples.len(), expected);
                prop_assert!(samples.iter().all(|(_, delta)| *delta >= 0.0));
            }
        }
    }
}
