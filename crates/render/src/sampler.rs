//! Where along a ray to look: pure functions of distances.

use crate::{LastInterval, Noise, Placement};

/// `count` distances that divide [near, far]: with jitter one at random in each stratum, else evenly spaced.
///
/// [`Placement::Left`]: NeRF's rule, `linspace(near, far, count)`, each jittered between the midpoints beside it.
/// [`Placement::Mid`]: `count` equal intervals, one sample in the middle of each, or anywhere in it if jittered.
pub(crate) fn stratified(
    near: f32,
    far: f32,
    count: usize,
    placement: Placement,
    jitter: Option<(Noise, usize)>,
) -> Vec<f32> {
    let at = |u: f32| near * (1.0 - u) + far * u;
    let draw = |i: usize| jitter.map(|(noise, ray)| noise.uniform(ray, i));
    match placement {
        Placement::Left => {
            let even = |i: usize| at(i as f32 / (count - 1) as f32);
            (0..count)
                .map(|i| match draw(i) {
                    None => even(i),
                    Some(u) => {
                        let lower = if i == 0 { even(0) } else { 0.5 * (even(i - 1) + even(i)) };
                        let upper = if i + 1 == count { even(i) } else { 0.5 * (even(i) + even(i + 1)) };
                        lower + (upper - lower) * u
                    }
                })
                .collect()
        }
        Placement::Mid => (0..count).map(|i| at((i as f32 + draw(i).unwrap_or(0.5)) / count as f32)).collect(),
    }
}

/// Interval lengths of sorted distances.
///
/// [`Placement::Left`]: the gap to the next sample; the last one by `last`. [`Placement::Mid`]: from half-way to the
/// neighbour before to half-way to the one behind, ends reaching to `near` and `far`.
pub(crate) fn intervals(t: &[f32], near: f32, far: f32, placement: Placement, last: LastInterval) -> Vec<f32> {
    let n = t.len();
    match placement {
        Placement::Left => (0..n)
            .map(|i| match (t.get(i + 1), last) {
                (Some(next), _) => next - t[i],
                (None, LastInterval::Infinite) => 1e10,
                (None, LastInterval::Finite) if n > 1 => t[n - 1] - t[n - 2],
                (None, LastInterval::Finite) => far - t[i],
            })
            .collect(),
        Placement::Mid => {
            let edge = |i: usize| match i {
                0 => near,
                i if i == n => far,
                i => 0.5 * (t[i - 1] + t[i]),
            };
            (0..n).map(|i| (edge(i + 1) - edge(i)).max(0.0)).collect()
        }
    }
}

/// `count` distances drawn from the piecewise-constant density of the coarse `weights`, merged with the coarse `t`.
///
/// NeRF's inverse transform (Mildenhall et al., Sec. 5.2): bins between the midpoints of `t`, weights of the inner
/// samples + 1e-5, `u` even in [0, 1] or jittered. Returns sorted distances, `[t.len() + count]`.
pub(crate) fn importance(t: &[f32], weights: &[f32], count: usize, jitter: Option<(Noise, usize)>) -> Vec<f32> {
    let n = t.len();
    let mids: Vec<f32> = t.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    let inner = &weights[1..n - 1];
    let total: f32 = inner.iter().map(|w| w + 1e-5).sum();
    let mut cdf = Vec::with_capacity(n - 1);
    let mut sum = 0.0;
    cdf.push(0.0);
    for w in inner {
        sum += (w + 1e-5) / total;
        cdf.push(sum);
    }
    let mut merged = t.to_vec();
    merged.extend((0..count).map(|i| {
        let u = match jitter {
            Some((noise, ray)) => noise.uniform(ray, i),
            None => i as f32 / (count.max(2) - 1) as f32,
        };
        let above = cdf.partition_point(|&c| c <= u);
        let (below, above) = (above.saturating_sub(1), above.min(cdf.len() - 1));
        let width = cdf[above] - cdf[below];
        let fraction = (u - cdf[below]) / if width < 1e-5 { 1.0 } else { width };
        mids[below] + fraction * (mids[above] - mids[below])
    }));
    merged.sort_unstable_by(f32::total_cmp);
    merged
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn even_samples_of_both_placements() {
        assert_eq!(stratified(2.0, 6.0, 5, Placement::Left, None), [2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(stratified(2.0, 6.0, 4, Placement::Mid, None), [2.5, 3.5, 4.5, 5.5]);
        let t = [2.0, 3.0, 5.0];
        assert_eq!(intervals(&t, 2.0, 6.0, Placement::Left, LastInterval::Finite), [1.0, 2.0, 2.0]);
        assert_eq!(intervals(&t, 2.0, 6.0, Placement::Left, LastInterval::Infinite), [1.0, 2.0, 1e10]);
        assert_eq!(intervals(&t, 1.0, 6.0, Placement::Mid, LastInterval::Finite), [1.5, 1.5, 2.0]);
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
            let noise = Noise::new(seed, 0, 0);
            for placement in [Placement::Left, Placement::Mid] {
                let t = stratified(near, far, count, placement, Some((noise, 3)));
                let merged = importance(&t, &weights[..count], fine, Some((noise, 3)));
                for t in [&t, &merged] {
                    prop_assert!(t.windows(2).all(|pair| pair[0] <= pair[1]));
                    prop_assert!(t.iter().all(|t| *t >= near - 1e-4 && *t <= far + 1e-4));
                }
                let delta = intervals(&merged, near, far, placement, LastInterval::Finite);
                prop_assert!(delta.iter().all(|d| *d >= 0.0));
            }
        }
    }
}
