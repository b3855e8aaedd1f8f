//! Every body of compositing (also additive), ray entropy and ray divergence against the oracle in `f64`: values and gradients, random rays and
//! extreme ones. The oracle itself against finite differences and against values from arbitrary-precision arithmetic.

use crate::common::{Body, DISTRIBUTIONS, Draws, Rays, floats, matrix, vector, wide};
use burn::tensor::{Tensor, TensorData};
use infonerf_ops::{Intervals, RayDistribution, Segments, composite_over, reference};
use serde_json::Value;

/// Error of values that are at most about 1: a few roundings of `f32`.
const UNIT: f64 = 3e-6;
/// Relative error of Σα, which is a plain sum.
const SUM: f64 = 1e-6;
/// Error of an entropy in bits or a divergence in nats, relative to 1 + its size.
const INFORMATION: f64 = 1e-5;
/// Error of a gradient, relative to the largest of its ray and to its condition.
const GRADIENT: f64 = 2e-5;
/// Relative error of the oracle against arbitrary-precision arithmetic.
const EXACT: f64 = 1e-12;
/// Relative error of a central difference in `f64`.
const DIFFERENCE: f64 = 1e-5;

const CHANNELS: usize = 2;
/// The exact entropy and the released code's.
const EPSILONS: [f32; 2] = [0.0, 1e-10];
/// The released code's, a large one, and the smallest that a config may have.
const DIVERGENCE_EPSILONS: [f32; 3] = [1e-10, 1e-3, 1e-12];

fn close(got: f64, want: f64, tolerance: f64, what: &dyn Fn() -> String) {
    assert!((got - want).abs() <= tolerance, "{}: {got:e} against {want:e}, tolerance {tolerance:e}", what());
}

/// How strongly a rounding of ln p moves a gradient through p = α/S: (1 + max |ln(p + ε)|)/S.
fn condition(tau: &[f64], epsilon: f64) -> f64 {
    let Some(p) = reference::ray_density(tau) else { return 0.0 };
    let sum: f64 = tau.iter().map(|&tau| reference::alpha(tau)).sum();
    let floor = if epsilon > 0.0 { epsilon } else { f64::from(f32::MIN_POSITIVE) };
    let largest = p.iter().map(|p| -(p + floor).ln()).fold(0.0, f64::max);
    (1.0 + largest) / sum
}

/// The same for the entropy of a distribution: those with a background are normalised by a sum of at least 1.
fn entropy_condition(tau: &[f64], of: RayDistribution, epsilon: f64) -> f64 {
    match of {
        RayDistribution::Alpha => condition(tau, epsilon),
        _ => 1.0 - epsilon.max(f64::from(f32::MIN_POSITIVE)).ln(),
    }
}

fn check_gradient(got: &[f64], want: &[f64], condition: f64, skip: impl Fn(usize) -> bool, what: &dyn Fn() -> String) {
    let scale = want.iter().enumerate().filter(|(i, _)| !skip(*i)).map(|(_, g)| g.abs()).fold(condition, f64::max);
    for (i, (&got, &want)) in got.iter().zip(want).enumerate() {
        assert!(got.is_finite(), "{}: gradient {i} is {got}", what());
        if !skip(i) {
            close(got, want, GRADIENT * scale.max(1.0), &|| format!("{}, gradient {i}", what()));
        }
    }
}

struct Upstream {
    values: Vec<f32>,
    acc: Vec<f32>,
}

fn check_composite(body: Body, rays: &Rays, draws: &mut Draws) {
    let Rays { segments, tau } = rays;
    let values: Vec<f32> = (0..tau.len() * CHANNELS).map(|_| draws.signed()).collect();
    let mut weights = |count: usize| -> Vec<f32> { (0..count).map(|_| draws.signed()).collect() };
    let rays = segments.rays();
    let upstream = Upstream { values: weights(rays * CHANNELS), acc: weights(rays) };
    composite_values(body, segments, tau, &values);
    composite_gradients(body, segments, tau, &values, &upstream);
}

fn composite_values(body: Body, segments: &Segments, tau: &[f32], values: &[f32]) {
    let device = body.device();
    let out = body.composite(vector(tau, &device), matrix(values, CHANNELS, &device), segments);
    let (got, acc) = (floats(out.values), floats(out.acc));
    for (ray, range) in segments.ranges().enumerate() {
        let row = wide(&tau[range.clone()]);
        let what = |name: &str| format!("{body:?}, ray {row:?}, {name}");
        let w = reference::weights(&row);
        for c in 0..CHANNELS {
            let want: f64 = w.iter().zip(range.clone()).map(|(w, i)| w * f64::from(values[i * CHANNELS + c])).sum();
            close(got[ray * CHANNELS + c], want, UNIT, &|| what("value"));
        }
        close(acc[ray], w.iter().sum(), UNIT, &|| what("acc"));
    }
}

fn composite_gradients(body: Body, segments: &Segments, tau: &[f32], values: &[f32], upstream: &Upstream) {
    let device = body.device().autodiff();
    let t = vector(tau, &device).require_grad();
    let v = matrix(values, CHANNELS, &device).require_grad();
    let out = body.composite(t.clone(), v.clone(), segments);
    let integrals = (out.values * matrix(&upstream.values, CHANNELS, &device)).sum()
        + (out.acc * vector(&upstream.acc, &device)).sum();
    let grads = integrals.backward();
    let (dtau, dvalues) = (floats(t.grad(&grads).unwrap()), floats(v.grad(&grads).unwrap()));
    for (ray, range) in segments.ranges().enumerate() {
        let row = wide(&tau[range.clone()]);
        let g = |c: usize| f64::from(upstream.values[ray * CHANNELS + c]);
        let u: Vec<f64> = range
            .clone()
            .map(|i| (0..CHANNELS).map(|c| g(c) * f64::from(values[i * CHANNELS + c])).sum::<f64>())
            .map(|u| u + f64::from(upstream.acc[ray]))
            .collect();
        let want = reference::weights_vjp(&row, &u);
        check_gradient(&dtau[range.clone()], &want, 0.0, |_| false, &|| format!("{body:?}, ray {row:?}, integrals"));
        for (i, w) in range.zip(&reference::weights(&row)) {
            for c in 0..CHANNELS {
                close(dvalues[i * CHANNELS + c], w * g(c), UNIT, &|| format!("{body:?}, ray {row:?}, values"));
            }
        }
    }
}

/// Colours over a background are the same integrals: what a sample is worth is how much it differs from what is behind it.
fn check_composite_over(rays: &Rays, draws: &mut Draws) {
    const BACKGROUND: [f32; 3] = [0.25, 0.5, 1.0];
    let Rays { segments, tau } = rays;
    let mut signed = |count: usize| -> Vec<f32> { (0..count).map(|_| draws.signed()).collect() };
    let (colors, distances) = (signed(3 * tau.len()), signed(tau.len()));
    let (dcolor, ddepth, dacc) = (signed(3 * segments.rays()), signed(segments.rays()), signed(segments.rays()));
    for device in [Body::Kernel, Body::PlainNdarray].map(|body| body.device().autodiff()) {
        let (t, c) = (vector(tau, &device).require_grad(), matrix(&colors, 3, &device).require_grad());
        let out = composite_over(t.clone(), Some(c.clone()), vector(&distances, &device), BACKGROUND, segments);
        let color = out.color.unwrap();
        let pulled = (color.clone() * matrix(&dcolor, 3, &device)).sum()
            + (out.depth.clone() * vector(&ddepth, &device)).sum()
            + (out.acc * vector(&dacc, &device)).sum();
        let grads = pulled.backward();
        let (dtau, dcolors) = (floats(t.grad(&grads).unwrap()), floats(c.grad(&grads).unwrap()));
        let (color, depth) = (floats(color.detach()), floats(out.depth.detach()));
        for (ray, range) in segments.ranges().enumerate() {
            let row = wide(&tau[range.clone()]);
            let (w, what) = (reference::weights(&row), || format!("over a background, ray {row:?}"));
            let integral = |of: &dyn Fn(usize) -> f32| -> f64 {
                w.iter().zip(range.clone()).map(|(w, i)| w * f64::from(of(i))).sum()
            };
            let behind = 1.0 - w.iter().sum::<f64>();
            for (k, background) in BACKGROUND.into_iter().enumerate() {
                let want = integral(&|i| colors[3 * i + k]) + behind * f64::from(background);
                close(color[3 * ray + k], want, UNIT, &what);
            }
            close(depth[ray], integral(&|i| distances[i]), UNIT, &what);
            let worth = |i: usize| {
                let color = (0..3).map(|k| dcolor[3 * ray + k] * (colors[3 * i + k] - BACKGROUND[k])).sum::<f32>();
                f64::from(color + ddepth[ray] * distances[i] + dacc[ray])
            };
            let want = reference::weights_vjp(&row, &range.clone().map(worth).collect::<Vec<_>>());
            check_gradient(&dtau[range.clone()], &want, 0.0, |_| false, &what);
            for (i, w) in range.zip(&w) {
                (0..3).for_each(|k| close(dcolors[3 * i + k], w * f64::from(dcolor[3 * ray + k]), UNIT, &what));
            }
        }
    }
}

fn check_entropy(body: Body, rays: &Rays, draws: &mut Draws) {
    let Rays { segments, tau } = rays;
    let device = body.device().autodiff();
    let weights: Vec<f32> = (0..segments.rays()).map(|_| draws.signed()).collect();
    for (of, epsilon) in DISTRIBUTIONS.into_iter().flat_map(|of| EPSILONS.map(|epsilon| (of, epsilon))) {
        let t = vector(tau, &device).require_grad();
        let out = body.entropy(t.clone(), segments, of, epsilon);
        let (bits, sum) = (floats(out.bits.clone().detach()), floats(out.alpha_sum.clone().detach()));
        let grads = (out.bits * vector(&weights, &device)).sum().backward();
        let dbits = floats(t.grad(&grads).unwrap());
        // One graph per backward pass: Burn consumes it.
        let again = body.entropy(t.clone(), segments, of, epsilon);
        let grads = (again.alpha_sum * vector(&weights, &device)).sum().backward();
        let dsum = floats(t.grad(&grads).unwrap());
        let epsilon = f64::from(epsilon);
        for (ray, range) in segments.ranges().enumerate() {
            let row = wide(&tau[range.clone()]);
            let what = |name: &str| format!("{body:?}, {of:?} with ε = {epsilon:e}, ray {row:?}, {name}");
            let want: f64 = row.iter().map(|&tau| reference::alpha(tau)).sum();
            close(sum[ray], want, SUM * want + 1e-45, &|| what("alpha sum"));
            let want = reference::entropy(&row, of, epsilon);
            close(bits[ray], want, INFORMATION * (1.0 + want), &|| what("value"));
            let scale = f64::from(weights[ray]);
            let want: Vec<f64> = row.iter().map(|tau| scale * (-tau).exp()).collect();
            check_gradient(&dsum[range.clone()], &want, 0.0, |_| false, &|| what("alpha sum"));
            let want: Vec<f64> = reference::entropy_gradient(&row, of, epsilon).iter().map(|g| g * scale).collect();
            // The exact entropy of an empty sample has an infinite slope: what is asked for is a finite number.
            let weights = reference::weights(&row);
            let least = |i: usize| if of == RayDistribution::Termination { weights[i].min(row[i]) } else { row[i] };
            let infinite = |i: usize| epsilon == 0.0 && least(i) < f64::from(f32::MIN_POSITIVE);
            check_gradient(&dbits[range], &want, entropy_condition(&row, of, epsilon), infinite, &|| what("gradient"));
        }
    }
}

fn check_divergence(body: Body, segments: &Segments, tau: &[f32], near: &[f32], draws: &mut Draws) {
    let device = body.device().autodiff();
    let weights: Vec<f32> = (0..segments.rays()).map(|_| draws.signed()).collect();
    for epsilon in DIVERGENCE_EPSILONS {
        let (p, q) = (vector(tau, &device).require_grad(), vector(near, &device).require_grad());
        let divergence = body.divergence(p.clone(), q.clone(), segments, epsilon);
        let got = floats(divergence.clone().detach());
        let grads = (divergence * vector(&weights, &device)).sum().backward();
        let (dp, dq) = (floats(p.grad(&grads).unwrap()), floats(q.grad(&grads).unwrap()));
        let epsilon = f64::from(epsilon);
        for (ray, range) in segments.ranges().enumerate() {
            let (p, q) = (wide(&tau[range.clone()]), wide(&near[range.clone()]));
            let what = || format!("{body:?}, rays {p:?} and {q:?}, ε = {epsilon:e}");
            let want = reference::divergence(&p, &q, epsilon);
            close(got[ray], want, INFORMATION * (1.0 + want.abs()), &|| format!("{}, value", what()));
            let (want_p, want_q) = reference::divergence_gradient(&p, &q, epsilon);
            let scaled = |g: Vec<f64>| g.into_iter().map(|g| g * f64::from(weights[ray])).collect::<Vec<f64>>();
            let gap = condition(&p, epsilon).max(condition(&q, epsilon));
            check_gradient(&dp[range.clone()], &scaled(want_p), gap, |_| false, &|| format!("{}, P", what()));
            check_gradient(&dq[range], &scaled(want_q), gap, |_| false, &|| format!("{}, Q", what()));
        }
    }
}

/// Middles and lengths of intervals of random length, one behind the other along each ray.
fn intervals(segments: &Segments, draws: &mut Draws) -> [Vec<f32>; 2] {
    let [mut middle, mut lengths] = [Vec::new(), Vec::new()];
    for range in segments.ranges() {
        let mut edge = 0.0;
        for _ in range {
            let length = 0.1 * draws.unit() as f32;
            middle.push(edge + 0.5 * length);
            lengths.push(length);
            edge += length;
        }
    }
    [middle, lengths]
}

fn check_distortion(body: Body, rays: &Rays, draws: &mut Draws) {
    let Rays { segments, tau } = rays;
    let device = body.device().autodiff();
    let weights: Vec<f32> = (0..segments.rays()).map(|_| draws.signed()).collect();
    let intervals = intervals(segments, draws);
    let [t, middle, length] = [tau, &intervals[0], &intervals[1]].map(|input| vector(input, &device).require_grad());
    let inputs = Intervals { middle: middle.clone(), length: length.clone() };
    let distortion = body.distortion(t.clone(), inputs, segments);
    let got = floats(distortion.clone().detach());
    let grads = (distortion * vector(&weights, &device)).sum().backward();
    let gradients = [t, middle, length].map(|input| floats(input.grad(&grads).unwrap()));
    for (ray, range) in segments.ranges().enumerate() {
        let [row, middle, length] = [tau, &intervals[0], &intervals[1]].map(|input| wide(&input[range.clone()]));
        let what = || format!("{body:?}, ray {row:?}, distortion");
        close(got[ray], reference::distortion(&row, &middle, &length), UNIT, &what);
        for (got, want) in gradients.iter().zip(reference::distortion_gradient(&row, &middle, &length)) {
            let want: Vec<f64> = want.iter().map(|g| g * f64::from(weights[ray])).collect();
            check_gradient(&got[range.clone()], &want, 0.0, |_| false, &what);
        }
    }
}

/// Compositing of additive depths against the additive march itself.
fn check_additive(body: Body, rays: &Rays, draws: &mut Draws) {
    let Rays { segments, tau } = rays;
    let device = body.device().autodiff();
    let mut weights = |count: usize| -> Vec<f32> { (0..count).map(|_| draws.signed()).collect() };
    let (values, upstream) = (weights(tau.len()), weights(segments.rays()));
    let t = vector(tau, &device).require_grad();
    let out = body.composite(body.additive_depth(t.clone(), segments), matrix(&values, 1, &device), segments);
    let (got, acc) = (floats(out.values.clone().detach()), floats(out.acc.detach()));
    let grads = (out.values.squeeze_dim::<1>(1) * vector(&upstream, &device)).sum().backward();
    let dtau = floats(t.grad(&grads).unwrap());
    for (ray, range) in segments.ranges().enumerate() {
        let row = wide(&tau[range.clone()]);
        let what = |name: &str| format!("{body:?}, ray {row:?}, additive {name}");
        let (w, u) = (reference::additive_weights(&row), wide(&values[range.clone()]));
        close(got[ray], w.iter().zip(&u).map(|(w, u)| w * u).sum(), UNIT, &|| what("value"));
        close(acc[ray], w.iter().sum(), UNIT, &|| what("acc"));
        let scaled: Vec<f64> = u.iter().map(|u| u * f64::from(upstream[ray])).collect();
        let want = reference::additive_weights_vjp(&row, &scaled);
        check_gradient(&dtau[range], &want, 0.0, |_| false, &|| what("gradient"));
    }
}

#[test]
fn random_rays() {
    for body in Body::ALL {
        let mut draws = Draws(1);
        for _ in 0..3 {
            let rays = Rays::random(&mut draws, 61);
            check_composite(body, &rays, &mut draws);
            check_additive(body, &rays, &mut draws);
            check_entropy(body, &rays, &mut draws);
            check_distortion(body, &rays, &mut draws);
        }
    }
}

#[test]
fn colours_over_a_background() {
    let mut draws = Draws(4);
    check_composite_over(&Rays::random(&mut draws, 61), &mut draws);
    check_composite_over(&Rays::extreme(), &mut draws);
}

#[test]
fn extreme_rays() {
    for body in Body::ALL {
        check_composite(body, &Rays::extreme(), &mut Draws(2));
        check_additive(body, &Rays::extreme(), &mut Draws(2));
        check_entropy(body, &Rays::extreme(), &mut Draws(2));
        check_distortion(body, &Rays::extreme(), &mut Draws(2));
    }
}

/// A moderate sample behind one that nothing passes, and before it: the sum of depths must not swallow either.
#[test]
fn a_huge_last_interval_leaves_the_samples_before_it_alone() {
    let rays = Rays::from_rows(&[vec![0.5, 0.25, 1e10], vec![0.5, 1e10, 0.25], vec![3.0, 5e9]]);
    for body in Body::ALL {
        check_composite(body, &rays, &mut Draws(3));
        check_additive(body, &rays, &mut Draws(3));
        check_entropy(body, &rays, &mut Draws(3));
        check_distortion(body, &rays, &mut Draws(3));
    }
}

/// So that a run stops at the step whose loss it is, before the optimiser sees it.
#[test]
fn a_depth_that_is_not_a_number_reaches_its_ray_alone() {
    let tau = [0.5, f32::NAN, 0.25, 1.0, 2.0];
    let segments = Segments::from_counts([3, 2]);
    for body in Body::ALL {
        let device = body.device();
        let t = || vector(&tau, &device);
        let sane = || vector(&[1.0, 2.0, 0.5, 0.1, 0.2], &device);
        let intervals = Intervals { middle: vector(&[0.0, 1.0, 2.0, 0.0, 1.0], &device), length: sane() };
        let composited = body.composite(t(), matrix(&[0.5; 5], 1, &device), &segments);
        let entropies = DISTRIBUTIONS.map(|of| EPSILONS.map(|epsilon| body.entropy(t(), &segments, of, epsilon).bits));
        let divergences = [(t(), sane()), (sane(), t())].map(|(p, q)| body.divergence(p, q, &segments, 1e-10));
        let others = [composited.values.squeeze_dim(1), composited.acc, body.distortion(t(), intervals, &segments)];
        let columns = entropies.into_iter().flatten().chain(divergences).chain(others);
        for (place, column) in columns.map(floats).enumerate() {
            assert!(column[0].is_nan() && column[1].is_finite(), "{body:?}, {place}: {column:?}");
        }
    }
}

#[test]
fn no_rays_and_rays_without_samples() {
    for body in Body::ALL {
        let device = body.device();
        for rays in [0, 3] {
            let segments = Segments::uniform(rays, 0);
            let empty = || Tensor::<1>::from_data(TensorData::new(Vec::<f32>::new(), [0]), &device);
            let values = Tensor::<2>::from_data(TensorData::new(Vec::<f32>::new(), [0, CHANNELS]), &device);
            let out = body.composite(empty(), values, &segments);
            assert_eq!(out.values.dims(), [rays, CHANNELS], "{body:?}");
            let entropies = DISTRIBUTIONS.map(|of| body.entropy(empty(), &segments, of, 0.0).bits);
            let divergence = body.divergence(empty(), empty(), &segments, 1e-10);
            let distortion = body.distortion(empty(), Intervals { middle: empty(), length: empty() }, &segments);
            assert_eq!(body.additive_depth(empty(), &segments).dims(), [0], "{body:?}");
            for column in entropies.into_iter().chain([out.acc, divergence, distortion]) {
                assert_eq!(floats(column), vec![0.0; rays], "{body:?}");
            }
        }
    }
}

#[test]
fn divergence_of_random_rays() {
    for body in Body::ALL {
        let mut draws = Draws(4);
        for _ in 0..3 {
            let Rays { segments, tau } = Rays::random(&mut draws, 61);
            let near: Vec<f32> =
                tau.iter().map(|tau| if draws.unit() < 0.2 { draws.tau() } else { tau * 1.3 }).collect();
            check_divergence(body, &segments, &tau, &near, &mut draws);
            check_divergence(body, &segments, &near, &tau, &mut draws);
        }
    }
}

#[test]
fn divergence_of_extreme_rays() {
    let Rays { segments, tau } = Rays::extreme();
    for body in Body::ALL {
        for shift in [0, 1, 4] {
            let near: Vec<f32> = segments
                .ranges()
                .flat_map(|range| (0..range.len()).map(move |i| range.start + (i + shift) % range.len()))
                .map(|i| tau[i])
                .collect();
            check_divergence(body, &segments, &tau, &near, &mut Draws(5));
        }
    }
}

/// Density along every ray of `rows` replaced, one sample at a time, by `f`'s central difference.
fn differences(tau: &[f64], f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    (0..tau.len())
        .map(|i| {
            let h = 1e-6 * tau[i];
            let at = |step: f64| {
                let mut moved = tau.to_vec();
                moved[i] += step;
                f(&moved)
            };
            (at(h) - at(-h)) / (2.0 * h)
        })
        .collect()
}

#[test]
fn the_oracle_against_finite_differences() {
    let mut draws = Draws(6);
    let mut ray = |n: usize| -> Vec<f64> { (0..n).map(|_| 10f64.powf(draws.unit() * 3.0 - 2.0)).collect() };
    let agree = |got: &[f64], want: &[f64], what: &str| {
        let scale = want.iter().map(|g| g.abs()).fold(1e-2, f64::max);
        for (got, want) in got.iter().zip(want) {
            close(*got, *want, DIFFERENCE * scale, &|| what.to_owned());
        }
    };
    for n in [1, 2, 3, 8, 24] {
        let (tau, near, u) = (ray(n), ray(n), ray(n));
        let integral = |tau: &[f64]| reference::weights(tau).iter().zip(&u).map(|(w, u)| w * u).sum();
        agree(&reference::weights_vjp(&tau, &u), &differences(&tau, integral), "weights");
        let additive = |tau: &[f64]| reference::additive_weights(tau).iter().zip(&u).map(|(w, u)| w * u).sum();
        agree(&reference::additive_weights_vjp(&tau, &u), &differences(&tau, additive), "additive weights");
        let (middle, length): (Vec<f64>, Vec<f64>) = (1..=n).map(|i| (i as f64 * 0.1, 0.1 + u[i - 1])).unzip();
        let [dtau, dmiddle, dlength] = reference::distortion_gradient(&tau, &middle, &length);
        agree(&dtau, &differences(&tau, |tau| reference::distortion(tau, &middle, &length)), "distortion");
        agree(&dmiddle, &differences(&middle, |m| reference::distortion(&tau, m, &length)), "distortion, middles");
        agree(&dlength, &differences(&length, |d| reference::distortion(&tau, &middle, d)), "distortion, lengths");
        for (of, epsilon) in DISTRIBUTIONS.into_iter().flat_map(|of| [0.0, 1e-10, 1e-3].map(|epsilon| (of, epsilon))) {
            let want = differences(&tau, |tau| reference::entropy(tau, of, epsilon));
            agree(&reference::entropy_gradient(&tau, of, epsilon), &want, "entropy");
        }
        for epsilon in [1e-10, 1e-3] {
            let (dp, dq) = reference::divergence_gradient(&tau, &near, epsilon);
            agree(&dp, &differences(&tau, |tau| reference::divergence(tau, &near, epsilon)), "divergence, P");
            agree(&dq, &differences(&near, |near| reference::divergence(&tau, near, epsilon)), "divergence, Q");
        }
    }
}

fn fixture() -> Value {
    serde_json::from_str(include_str!("fixtures/losses.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Compares where the fixture has a number: null stands for an infinite or undefined slope.
fn agree_where_finite(got: &[f64], want: &[f64], tolerance: f64, what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    let scale = want.iter().filter(|x| x.is_finite()).map(|x| x.abs()).fold(0.0, f64::max);
    for (got, want) in got.iter().zip(want).filter(|(_, want)| want.is_finite()) {
        close(*got, *want, tolerance * scale + 1e-300, &|| what.to_owned());
    }
}

/// A ray whose opacities sum to less than this hits nothing by definition; the fixture knows no such threshold.
fn hits(tau: &[f64]) -> bool {
    reference::ray_density(tau).is_some()
}

#[test]
fn the_oracle_against_arbitrary_precision() {
    let fixture = fixture();
    let mut rays = std::collections::BTreeMap::new();
    for ray in fixture["rays"].as_array().unwrap() {
        let (name, tau) = (ray["name"].as_str().unwrap(), numbers(&ray["tau"]));
        let alpha: Vec<f64> = tau.iter().map(|&tau| reference::alpha(tau)).collect();
        agree_where_finite(&alpha, &numbers(&ray["alpha"]), EXACT, name);
        agree_where_finite(&reference::transmittance(&tau)[..tau.len()], &numbers(&ray["trans"]), EXACT, name);
        let w = reference::weights(&tau);
        agree_where_finite(&w, &numbers(&ray["w"]), EXACT, name);
        agree_where_finite(&[w.iter().sum()], &[ray["acc"].as_f64().unwrap()], EXACT, name);
        if hits(&tau) {
            close(
                reference::entropy(&tau, RayDistribution::Alpha, 0.0),
                ray["entropy"].as_f64().unwrap(),
                EXACT,
                &|| name.to_owned(),
            );
            let want = numbers(&ray["dentropy_dtau"]);
            // Slopes that cancel to nothing are compared with what they cancelled from.
            let got = reference::entropy_gradient(&tau, RayDistribution::Alpha, 0.0);
            let scale = condition(&tau, 0.0);
            for (got, want) in got.iter().zip(&want).filter(|(_, want)| want.is_finite()) {
                close(*got, *want, EXACT * scale, &|| name.to_owned());
            }
        } else {
            assert_eq!(reference::entropy(&tau, RayDistribution::Alpha, 0.0), 0.0, "{name}");
        }
        rays.insert(name.to_owned(), tau);
    }
    for pair in fixture["pairs"].as_array().unwrap() {
        let (p, q) = (pair["p"].as_str().unwrap(), pair["q"].as_str().unwrap());
        let what = || format!("{p} and {q}");
        let (tau, near) = (&rays[p], &rays[q]);
        let got = reference::divergence(tau, near, 0.0);
        if !(hits(tau) && hits(near)) {
            assert_eq!(got, 0.0, "{}", what());
            continue;
        }
        let want = pair["kl"].as_f64().unwrap();
        close(got, want, EXACT * (1.0 + want), &what);
        let (dp, dq) = reference::divergence_gradient(tau, near, 0.0);
        let scale = condition(tau, 0.0).max(condition(near, 0.0));
        for (got, want) in [(dp, numbers(&pair["dkl_dtau_p"])), (dq, numbers(&pair["dkl_dtau_q"]))] {
            for (got, want) in got.iter().zip(&want).filter(|(_, want)| want.is_finite()) {
                close(*got, *want, EXACT * scale.max(want.abs()), &what);
            }
        }
    }
}

/// The bodies themselves against arbitrary precision, without the oracle in between.
#[test]
fn every_body_against_arbitrary_precision() {
    let fixture = fixture();
    let mut rays = std::collections::BTreeMap::new();
    for ray in fixture["rays"].as_array().unwrap() {
        let tau: Vec<f32> = numbers(&ray["tau"]).iter().map(|&tau| tau as f32).collect();
        if hits(&wide(&tau)) {
            for body in Body::ALL {
                let device = body.device();
                let w = vec![1.0; tau.len()];
                let segments = Segments::uniform(1, tau.len());
                let out = body.composite(vector(&tau, &device), matrix(&w, 1, &device), &segments);
                let entropy = body.entropy(vector(&tau, &device), &segments, RayDistribution::Alpha, 0.0);
                let what = || format!("{body:?}, {}", ray["name"]);
                close(floats(out.acc)[0], ray["acc"].as_f64().unwrap(), UNIT, &what);
                close(floats(entropy.bits)[0], ray["entropy"].as_f64().unwrap(), INFORMATION, &what);
            }
        }
        rays.insert(ray["name"].as_str().unwrap().to_owned(), tau);
    }
    for pair in fixture["pairs"].as_array().unwrap() {
        let (tau, near) = (&rays[pair["p"].as_str().unwrap()], &rays[pair["q"].as_str().unwrap()]);
        if !(hits(&wide(tau)) && hits(&wide(near))) {
            continue;
        }
        let want = pair["kl"].as_f64().unwrap();
        for body in Body::ALL {
            let device = body.device();
            let segments = Segments::uniform(1, tau.len());
            let got = body.divergence(vector(tau, &device), vector(near, &device), &segments, 1e-30);
            let what = || format!("{body:?}, {} and {}", pair["p"], pair["q"]);
            close(floats(got)[0], want, INFORMATION * (1.0 + want), &what);
        }
    }
}

/// Constant density, a step, and density that falls exponentially, with the integrals that can be done by hand.
#[test]
fn the_oracle_against_closed_forms() {
    let near = |got: f64, want: f64, what: &str| close(got, want, 1e-14 * want.abs() + 1e-300, &|| what.to_owned());
    for (sigma, length, n) in [(0.3, 4.0, 16), (1e-9, 1.0, 7), (25.0, 2.0, 64)] {
        // σ everywhere: what is left after i intervals is exp(−σ δ i).
        let delta = length / n as f64;
        let tau = vec![sigma * delta; n];
        let left = |i: usize| (-sigma * delta * i as f64).exp();
        for (i, (&trans, w)) in reference::transmittance(&tau).iter().zip(reference::weights(&tau)).enumerate() {
            close(trans, left(i), 1e-12 * trans, &|| format!("transmittance {i}"));
            close(w, left(i) * -(-sigma * delta).exp_m1(), 1e-12 * w, &|| format!("weight {i}"));
        }
        close(reference::opacity(&tau), -(-sigma * length).exp_m1(), 1e-13, &|| "opacity".into());
        close(reference::entropy(&tau, RayDistribution::Alpha, 0.0), (n as f64).log2(), 1e-13 * n as f64, &|| {
            "entropy".into()
        });
        // ∂ Σ w / ∂τ = what leaves the ray, for every sample; and an even ray's entropy is at its maximum.
        for slope in reference::weights_vjp(&tau, &vec![1.0; n]) {
            close(slope, left(n), 1e-12 * left(n), &|| "slope of the opacity".into());
        }
        assert!(reference::entropy_gradient(&tau, RayDistribution::Alpha, 0.0).iter().all(|slope| *slope == 0.0));

        // Nothing, then a wall: all that arrives stops at the first interval of it.
        let mut step = vec![0.0; n];
        step[n / 2..].fill(sigma);
        near(reference::weights(&step)[n / 2], -(-sigma).exp_m1(), "the wall");
        assert!(reference::weights(&step)[..n / 2].iter().all(|w| *w == 0.0));
        let behind = (n - n / 2 - 1) as f64;
        let mut u = vec![0.0; n];
        u[n / 2] = 1.0;
        // Only the wall's own interval and what is before it move its weight: T = 1 before it.
        let slopes = reference::weights_vjp(&step, &u);
        near(slopes[n / 2], (-sigma).exp(), "slope within the wall");
        near(slopes[0], (-sigma).exp_m1(), "slope before the wall");
        assert!(behind == 0.0 || slopes[n - 1] == 0.0);

        // σ e^(−k t), integrated over each interval.
        let k = 0.7;
        let depth = |t: f64| sigma / k * -(-k * t).exp_m1();
        let falling: Vec<f64> = (0..n).map(|i| depth((i + 1) as f64 * delta) - depth(i as f64 * delta)).collect();
        let want = -(-depth(length)).exp_m1();
        close(reference::opacity(&falling), want, 1e-12 * want, &|| "falling density".into());
    }
}

#[test]
fn the_oracle_where_rays_cancel() {
    let fixture: Value = serde_json::from_str(include_str!("fixtures/extremes.json")).unwrap();
    let epsilon = fixture["epsilon"].as_f64().unwrap();
    let value = |got: f64, want: &Value, what: &dyn Fn() -> String| {
        let want = want.as_f64().unwrap();
        close(got, want, 1e-9 * want.abs() + 1e-30, what);
    };
    let slopes = |got: &[f64], want: &Value, what: &dyn Fn() -> String| {
        let want = numbers(want);
        let largest = want.iter().map(|g| g.abs()).fold(0.0, f64::max);
        got.iter().zip(&want).for_each(|(got, want)| close(*got, *want, 1e-8 * largest + 1e-200, what));
    };
    let mut rays = std::collections::BTreeMap::new();
    for ray in fixture["rays"].as_array().unwrap() {
        let (name, tau) = (ray["name"].as_str().unwrap(), numbers(&ray["tau"]));
        let what = |part: &'static str| move || format!("{name}, {part}");
        let u: Vec<f64> = (0..tau.len()).map(|i| (i as f64).cos()).collect();
        value(reference::weights(&tau).iter().zip(&u).map(|(w, u)| w * u).sum(), &ray["weighted"], &what("weighted"));
        slopes(&reference::weights_vjp(&tau, &u), &ray["weighted_gradient"], &what("its slopes"));
        value(reference::opacity(&tau), &ray["opacity"], &what("opacity"));
        let ones = vec![1.0; tau.len()];
        slopes(&reference::weights_vjp(&tau, &ones), &ray["opacity_gradient"], &what("its slopes"));
        if hits(&tau) {
            value(reference::entropy(&tau, RayDistribution::Alpha, epsilon), &ray["entropy"], &what("entropy"));
            slopes(
                &reference::entropy_gradient(&tau, RayDistribution::Alpha, epsilon),
                &ray["entropy_gradient"],
                &what("its slopes"),
            );
            value(reference::entropy(&tau, RayDistribution::Alpha, 0.0), &ray["entropy_exact"], &what("exact entropy"));
        }
        rays.insert(name.to_owned(), tau);
    }
    for pair in fixture["pairs"].as_array().unwrap() {
        let (p, q) = (pair["p"].as_str().unwrap(), pair["q"].as_str().unwrap());
        let what = || format!("{p} and {q}");
        value(reference::divergence(&rays[p], &rays[q], epsilon), &pair["gain"], &what);
        let (dp, dq) = reference::divergence_gradient(&rays[p], &rays[q], epsilon);
        slopes(&dp, &pair["gradient_p"], &what);
        slopes(&dq, &pair["gradient_q"], &what);
    }
}
