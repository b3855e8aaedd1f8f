//! Comparison of every body of compositing (also additive), ray entropy and divergence with the oracle in `f64`: values
//! and gradients of random and extreme rays. The oracle is compared with arbitrary precision.

use std::collections::BTreeMap;
use std::fmt::Display;

use burn::tensor::Tensor;
use infonerf_ops::{Segments, composite, composite_over, has_host_kernels, upload_rows};
use infonerf_oracle as oracle;
use serde_json::Value;

use crate::common::{Draws, RayImplementation, Rays, floats, vector, wide};

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

const BACKGROUND: [f32; 3] = [0.25, 0.5, 1.0];
/// ε of the exact entropy and of the released code.
const EPSILONS: [f32; 2] = [0.0, 1e-10];
/// ε of the released code, a large one, and the smallest that a config may have.
const DIVERGENCE_EPSILONS: [f32; 3] = [1e-10, 1e-3, 1e-12];

fn close(got: f64, want: f64, tolerance: f64, what: impl Display) {
    assert!((got - want).abs() <= tolerance, "{what}: {got:e} against {want:e}, tolerance {tolerance:e}");
}

/// Effect of a rounding of ln p on a gradient through p = α/S: (1 + max |ln(p + ε)|)/S.
fn condition(tau: &[f64], epsilon: f64) -> f64 {
    let Some(p) = oracle::ray_density(tau) else { return 0.0 };
    let floor = if epsilon > 0.0 { epsilon } else { f64::from(f32::MIN_POSITIVE) };
    let largest = p.iter().map(|p| -(p + floor).ln()).fold(0.0, f64::max);
    (1.0 + largest) / oracle::alpha_sum(tau)
}

/// Results of the oracle for one ray, given a weight for each output.
struct Expected {
    /// Outputs, with the tolerance of each.
    values: Vec<(f64, f64)>,
    /// Gradients of the weighted sum of outputs with respect to every sample of each input. Where one is infinite, any
    /// finite value is accepted.
    gradients: Vec<Vec<f64>>,
    /// Min scale of the gradients' tolerance.
    condition: f64,
}

impl Expected {
    fn new(values: Vec<(f64, f64)>, gradients: Vec<Vec<f64>>) -> Self {
        Self { values, gradients, condition: 0.0 }
    }
}

/// Compares an operation with the oracle, ray by ray.
///
/// - `inputs`: one value per packed sample each.
/// - `evaluate`: from the inputs on a device to columns of one value per ray each.
/// - `expected`: from the inputs of a ray and the weight of each column.
fn compare<const N: usize>(
    body: RayImplementation,
    segments: &Segments,
    inputs: [&[f32]; N],
    draws: &mut Draws,
    evaluate: impl Fn([Tensor<1>; N]) -> Vec<Tensor<1>>,
    expected: impl Fn([Vec<f64>; N], &[f64]) -> Expected,
) {
    let device = body.device().autodiff();
    let tensors = inputs.map(|input| vector(input, &device).require_grad());
    let columns = evaluate(tensors.clone());
    let weights: Vec<Vec<f32>> = columns.iter().map(|_| draws.row(segments.rays())).collect();
    let values: Vec<Vec<f64>> = columns.iter().map(|column| floats(column.clone().detach())).collect();
    let weighted = columns.into_iter().zip(&weights).map(|(column, weights)| (column * vector(weights, &device)).sum());
    let grads = weighted.reduce(|sum, term| sum + term).unwrap().backward();
    let gradients = tensors.map(|tensor| tensor.grad(&grads).map(floats));
    for (ray, range) in segments.ranges().enumerate() {
        let rows = inputs.map(|input| wide(&input[range.clone()]));
        let upstream: Vec<f64> = weights.iter().map(|weights| f64::from(weights[ray])).collect();
        let want = expected(rows.clone(), &upstream);
        for (column, (want, tolerance)) in want.values.into_iter().enumerate() {
            close(values[column][ray], want, tolerance, format_args!("{body:?}, {rows:?}, column {column}"));
        }
        for (input, (got, want_gradient)) in gradients.iter().zip(&want.gradients).enumerate() {
            let got = got.as_ref().expect("an input of the graph has a gradient");
            let scale = largest(want_gradient, want.condition.max(1.0));
            for (i, (got, want_one)) in got[range.clone()].iter().zip(want_gradient).enumerate() {
                let what = format_args!("{body:?}, {rows:?}, gradient {i} of input {input}");
                assert!(got.is_finite(), "{what}: {got}");
                if *want_one != f64::INFINITY {
                    close(*got, *want_one, GRADIENT * scale, what);
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn scaled(values: &[f64], factor: f64) -> Vec<f64> {
    values.iter().map(|x| x * factor).collect()
}

/// Sums rows of values, each times its factor.
fn combined<'a>(terms: impl IntoIterator<Item = (&'a Vec<f64>, f64)>, length: usize) -> Vec<f64> {
    terms
        .into_iter()
        .fold(vec![0.0; length], |sum, (row, factor)| sum.iter().zip(row).map(|(sum, x)| sum + factor * x).collect())
}

fn stacked<const N: usize>(columns: [Tensor<1>; N]) -> Tensor<2> {
    Tensor::stack(columns.to_vec(), 1)
}

fn column(table: &Tensor<2>, index: usize) -> Tensor<1> {
    table.clone().narrow(1, index, 1).squeeze_dim(1)
}

fn check_composite(body: RayImplementation, Rays { segments, tau }: &Rays, draws: &mut Draws) {
    let (a, b) = (draws.row(tau.len()), draws.row(tau.len()));
    let on_host = composite::weights(tau, segments);
    for range in segments.ranges() {
        for (got, want) in on_host[range.clone()].iter().zip(oracle::weights(&wide(&tau[range]))) {
            close(f64::from(*got), want, UNIT, "a weight on the host");
        }
    }
    let evaluate = |[tau, a, b]: [Tensor<1>; 3]| {
        let out = body.composite(tau, stacked([a, b]), segments);
        vec![column(&out.values, 0), column(&out.values, 1), out.acc]
    };
    compare(body, segments, [tau, &a, &b], draws, evaluate, |[tau, a, b], u| {
        let w = oracle::weights(&tau);
        let values = vec![(dot(&w, &a), UNIT), (dot(&w, &b), UNIT), (w.iter().sum(), UNIT)];
        let dw = combined([(&a, u[0]), (&b, u[1]), (&vec![1.0; w.len()], u[2])], w.len());
        Expected::new(values, vec![oracle::weights_vjp(&tau, &dw), scaled(&w, u[0]), scaled(&w, u[1])])
    });
}

/// Checks colours over a background, depth and Σw.
fn check_composite_over(body: RayImplementation, Rays { segments, tau }: &Rays, draws: &mut Draws) {
    let [red, green, blue, distance] = [0; 4].map(|_| draws.row(tau.len()));
    let evaluate = |[tau, red, green, blue, distance]: [Tensor<1>; 5]| {
        let out = composite_over(tau, Some(stacked([red, green, blue])), distance, BACKGROUND, segments);
        let color = out.color.unwrap();
        vec![column(&color, 0), column(&color, 1), column(&color, 2), out.depth, out.acc]
    };
    compare(body, segments, [tau, &red, &green, &blue, &distance], draws, evaluate, |[tau, red, green, blue, t], u| {
        let (w, colors) = (oracle::weights(&tau), [red, green, blue]);
        let over = |c: usize| dot(&w, &colors[c]) + (1.0 - w.iter().sum::<f64>()) * f64::from(BACKGROUND[c]);
        let values = [over(0), over(1), over(2), dot(&w, &t), w.iter().sum()].map(|value| (value, UNIT)).to_vec();
        let behind: f64 = (0..3).map(|c| u[c] * f64::from(BACKGROUND[c])).sum();
        let shared = vec![u[4] - behind; w.len()];
        let terms = [(&colors[0], u[0]), (&colors[1], u[1]), (&colors[2], u[2]), (&t, u[3]), (&shared, 1.0)];
        let dtau = oracle::weights_vjp(&tau, &combined(terms, w.len()));
        Expected::new(values, vec![dtau, scaled(&w, u[0]), scaled(&w, u[1]), scaled(&w, u[2])])
    });
}

fn check_entropy(body: RayImplementation, Rays { segments, tau }: &Rays, draws: &mut Draws) {
    let alpha_sum = |[tau]: [Tensor<1>; 1]| vec![body.entropy(tau, segments, 0.0).alpha_sum];
    compare(body, segments, [tau], draws, alpha_sum, |[tau], u| {
        let sum = oracle::alpha_sum(&tau);
        Expected::new(vec![(sum, SUM * sum + 1e-45)], vec![tau.iter().map(|tau| u[0] * (-tau).exp()).collect()])
    });
    for epsilon in EPSILONS {
        let bits = |[tau]: [Tensor<1>; 1]| vec![body.entropy(tau, segments, epsilon).bits];
        let epsilon = f64::from(epsilon);
        compare(body, segments, [tau], draws, bits, |[tau], u| {
            let want = oracle::entropy(&tau, epsilon);
            let mut gradient = scaled(&oracle::entropy_gradient(&tau, epsilon), u[0]);
            for (g, tau) in gradient.iter_mut().zip(&tau) {
                if epsilon == 0.0 && *tau < f64::from(f32::MIN_POSITIVE) {
                    *g = f64::INFINITY;
                }
            }
            let condition = condition(&tau, epsilon);
            Expected { condition, ..Expected::new(vec![(want, INFORMATION * (1.0 + want))], vec![gradient]) }
        });
    }
}

fn check_divergence(body: RayImplementation, segments: &Segments, tau: &[f32], near: &[f32], draws: &mut Draws) {
    for epsilon in DIVERGENCE_EPSILONS {
        let evaluate = |[p, q]: [Tensor<1>; 2]| vec![body.divergence(p, q, segments, epsilon)];
        let epsilon = f64::from(epsilon);
        compare(body, segments, [tau, near], draws, evaluate, |[p, q], u| {
            let want = oracle::divergence(&p, &q, epsilon);
            let (dp, dq) = oracle::divergence_gradient(&p, &q, epsilon);
            let gradients = vec![scaled(&dp, u[0]), scaled(&dq, u[0])];
            let condition = condition(&p, epsilon).max(condition(&q, epsilon));
            Expected { condition, ..Expected::new(vec![(want, INFORMATION * (1.0 + want.abs()))], gradients) }
        });
    }
}

/// Compares compositing of additive depths with the additive march itself.
fn check_additive(body: RayImplementation, Rays { segments, tau }: &Rays, draws: &mut Draws) {
    let values = draws.row(tau.len());
    let evaluate = |[tau, values]: [Tensor<1>; 2]| {
        let out = body.composite(body.additive_depth(tau, segments), values.unsqueeze_dim(1), segments);
        vec![column(&out.values, 0), out.acc]
    };
    compare(body, segments, [tau, &values], draws, evaluate, |[tau, values], u| {
        let w = oracle::additive_weights(&tau);
        let dw = combined([(&values, u[0]), (&vec![1.0; w.len()], u[1])], w.len());
        let gradients = vec![oracle::additive_weights_vjp(&tau, &dw), scaled(&w, u[0])];
        Expected::new(vec![(dot(&w, &values), UNIT), (w.iter().sum(), UNIT)], gradients)
    });
}

fn check_all(body: RayImplementation, rays: &Rays, draws: &mut Draws) {
    check_composite(body, rays, draws);
    check_additive(body, rays, draws);
    check_entropy(body, rays, draws);
    if body != RayImplementation::PlainFlex {
        check_composite_over(body, rays, draws);
    }
}

/// Checks that `flex` uses host kernels, for speed, and that other devices do not, whose tensors these cannot read.
#[test]
fn flex_alone_has_host_kernels() {
    for body in RayImplementation::ALL {
        for device in [body.device(), body.device().autodiff()] {
            assert_eq!(has_host_kernels(&device), body != RayImplementation::PlainNdarray);
        }
    }
}

#[test]
fn bodies_agree_with_the_oracle() {
    // A moderate sample behind an opaque one, and in front of one: its digits must survive in the sum of depths.
    let huge = Rays::from_rows(&[vec![0.5, 0.25, 1e10], vec![0.5, 1e10, 0.25], vec![3.0, 5e9]]);
    for body in RayImplementation::ALL {
        let mut draws = Draws(1);
        for _ in 0..3 {
            let rays = Rays::random(&mut draws, 61);
            check_all(body, &rays, &mut draws);
        }
        check_all(body, &Rays::extreme(), &mut Draws(2));
        check_all(body, &huge, &mut Draws(3));
    }
}

/// Checks that NaN reaches the results of its ray alone. A run then stops before the optimizer uses its loss.
#[test]
fn a_depth_that_is_not_a_number_reaches_its_ray_alone() {
    let tau = [0.5, f32::NAN, 0.25, 1.0, 2.0];
    let segments = Segments::from_counts([3, 2]);
    for body in RayImplementation::ALL {
        let device = body.device();
        let t = || vector(&tau, &device);
        let sane = || vector(&[1.0, 2.0, 0.5, 0.1, 0.2], &device);
        let composited = body.composite(t(), upload_rows(&[0.5; 5], 1, &device), &segments);
        let entropies = EPSILONS.map(|epsilon| body.entropy(t(), &segments, epsilon).bits);
        let divergences = [(t(), sane()), (sane(), t())].map(|(p, q)| body.divergence(p, q, &segments, 1e-10));
        let others = [composited.values.squeeze_dim(1), composited.acc];
        let columns = entropies.into_iter().chain(divergences).chain(others);
        for (place, column) in columns.map(floats).enumerate() {
            assert!(column[0].is_nan() && column[1].is_finite(), "{body:?}, {place}: {column:?}");
        }
    }
}

#[test]
fn no_rays_and_rays_without_samples() {
    for body in RayImplementation::ALL {
        let device = body.device();
        for rays in [0, 3] {
            let segments = Segments::uniform(rays, 0);
            let empty = || vector(&[], &device);
            let values = upload_rows(&[], 2, &device);
            let out = body.composite(empty(), values, &segments);
            assert_eq!(out.values.dims(), [rays, 2], "{body:?}");
            let entropy = body.entropy(empty(), &segments, 0.0).bits;
            let divergence = body.divergence(empty(), empty(), &segments, 1e-10);
            assert_eq!(body.additive_depth(empty(), &segments).dims(), [0], "{body:?}");
            for column in [entropy, out.acc, divergence] {
                assert_eq!(floats(column), vec![0.0; rays], "{body:?}");
            }
        }
    }
}

#[test]
fn divergences_agree_with_the_oracle() {
    let extreme = Rays::extreme();
    for body in RayImplementation::ALL {
        let mut draws = Draws(4);
        for _ in 0..3 {
            let Rays { segments, tau } = Rays::random(&mut draws, 61);
            let near: Vec<f32> =
                tau.iter().map(|tau| if draws.unit() < 0.2 { draws.tau() } else { tau * 1.3 }).collect();
            check_divergence(body, &segments, &tau, &near, &mut draws);
            check_divergence(body, &segments, &near, &tau, &mut draws);
        }
        let Rays { segments, tau } = &extreme;
        for shift in [0, 1, 4] {
            let turned =
                |range: std::ops::Range<usize>| (0..range.len()).map(move |i| range.start + (i + shift) % range.len());
            let near: Vec<f32> = segments.ranges().flat_map(turned).map(|i| tau[i]).collect();
            check_divergence(body, segments, tau, &near, &mut Draws(5));
        }
    }
}

/// Computes central differences of `f` with respect to each sample of a ray.
fn differences(tau: &[f64], f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let difference = |i: usize| {
        let h = 1e-6 * tau[i];
        let at = |step: f64| {
            let mut moved = tau.to_vec();
            moved[i] += step;
            f(&moved)
        };
        (at(h) - at(-h)) / (2.0 * h)
    };
    (0..tau.len()).map(difference).collect()
}

#[test]
fn gradients_of_the_oracle_are_those_of_differences() {
    let mut draws = Draws(6);
    let mut ray = |n: usize| -> Vec<f64> { (0..n).map(|_| 10f64.powf(draws.unit() * 3.0 - 2.0)).collect() };
    let agree = |got: &[f64], want: &[f64], what: &str| agree(got, want, |_| 1e-5 * largest(want, 1e-2), what);
    for n in [1, 2, 3, 8, 24] {
        let (tau, near, u) = (ray(n), ray(n), ray(n));
        let integral = |tau: &[f64]| dot(&oracle::weights(tau), &u);
        agree(&oracle::weights_vjp(&tau, &u), &differences(&tau, integral), "weights");
        let additive = |tau: &[f64]| dot(&oracle::additive_weights(tau), &u);
        agree(&oracle::additive_weights_vjp(&tau, &u), &differences(&tau, additive), "additive weights");
        for epsilon in [0.0, 1e-10, 1e-3] {
            let want = differences(&tau, |tau| oracle::entropy(tau, epsilon));
            agree(&oracle::entropy_gradient(&tau, epsilon), &want, "entropy");
        }
        for epsilon in [1e-10, 1e-3] {
            let (dp, dq) = oracle::divergence_gradient(&tau, &near, epsilon);
            agree(&dp, &differences(&tau, |tau| oracle::divergence(tau, &near, epsilon)), "divergence, P");
            agree(&dq, &differences(&near, |near| oracle::divergence(&tau, near, epsilon)), "divergence, Q");
        }
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect()
}

fn largest(values: &[f64], least: f64) -> f64 {
    values.iter().filter(|x| x.is_finite()).map(|x| x.abs()).fold(least, f64::max)
}

/// Compares values where a fixture has a number: null stands for an infinite or undefined gradient. `tolerance` is a function of
/// the expected value.
fn agree(got: &[f64], want: &[f64], tolerance: impl Fn(f64) -> f64, what: impl Display + Copy) {
    assert_eq!(got.len(), want.len(), "{what}");
    for (got, want) in got.iter().zip(want).filter(|(_, want)| want.is_finite()) {
        close(*got, *want, tolerance(*want), what);
    }
}

fn entries(list: &Value) -> std::slice::Iter<'_, Value> {
    list.as_array().unwrap().iter()
}

fn name_in<'a>(entry: &'a Value, key: &str) -> &'a str {
    entry[key].as_str().unwrap()
}

/// Returns whether Σα reaches the threshold below which a ray hits nothing; the fixture has no such threshold.
fn hits(tau: &[f64]) -> bool {
    oracle::ray_density(tau).is_some()
}

/// Checks values and gradients of all rays and pairs of the fixture. Tolerances are a `part` of a value or of the largest
/// gradient of a ray, and relative to the terms that cancel in a gradient (`condition`).
#[test]
fn the_oracle_against_arbitrary_precision() {
    let fixture: Value = serde_json::from_str(include_str!("fixtures/losses.json")).unwrap();
    let value = |got: f64, of: &Value, key: &str, part: f64| {
        let want = of[key].as_f64().unwrap();
        close(got, want, (part * want.abs() + 1e-30).min(EXACT * (1.0 + want.abs())), format_args!("{key} of {of}"));
    };
    let row = |got: &[f64], of: &Value, key: &str, part: f64, condition: f64| {
        let want = numbers(&of[key]);
        let small = part * largest(&want, 0.0) + 1e-60;
        let tolerance = |want: f64| small.min(EXACT * condition.max(want.abs()));
        agree(got, &want, tolerance, format_args!("{key} of {of}"));
    };
    let rays: BTreeMap<&str, (Vec<f64>, &Value)> =
        entries(&fixture["rays"]).map(|ray| (name_in(ray, "name"), (numbers(&ray["tau"]), ray))).collect();
    for (tau, ray) in rays.values() {
        let u: Vec<f64> = (0..tau.len()).map(|i| (i as f64).cos()).collect();
        let w = oracle::weights(tau);
        let alpha: Vec<f64> = tau.iter().map(|&tau| oracle::alpha(tau)).collect();
        let trans = oracle::transmittance(tau);
        for (got, key) in [(&alpha[..], "alpha"), (&trans[..tau.len()], "trans"), (&w, "w")] {
            row(got, ray, key, EXACT, 1.0);
        }
        value(w.iter().sum(), ray, "acc", EXACT);
        value(oracle::opacity(tau), ray, "acc", EXACT);
        row(&oracle::weights_vjp(tau, &vec![1.0; tau.len()]), ray, "acc_gradient", 1e-8, f64::INFINITY);
        value(dot(&w, &u), ray, "weighted", EXACT);
        row(&oracle::weights_vjp(tau, &u), ray, "weighted_gradient", 1e-8, f64::INFINITY);
        for entropy in entries(&ray["entropies"]) {
            let epsilon = entropy["epsilon"].as_f64().unwrap();
            let got = oracle::entropy(tau, epsilon);
            if hits(tau) {
                value(got, entropy, "value", 1e-9);
                let gradient = oracle::entropy_gradient(tau, epsilon);
                row(&gradient, entropy, "gradient", 1e-8, condition(tau, epsilon));
            } else {
                assert_eq!(got, 0.0, "{ray}");
            }
        }
    }
    for pair in entries(&fixture["pairs"]) {
        let (tau, near) = (&rays[name_in(pair, "p")].0, &rays[name_in(pair, "q")].0);
        for divergence in entries(&pair["divergences"]) {
            let epsilon = divergence["epsilon"].as_f64().unwrap();
            let got = oracle::divergence(tau, near, epsilon);
            if hits(tau) && hits(near) {
                value(got, divergence, "value", 1e-9);
                let (dp, dq) = oracle::divergence_gradient(tau, near, epsilon);
                let condition = condition(tau, epsilon).max(condition(near, epsilon));
                row(&dp, divergence, "gradient_p", 1e-8, condition);
                row(&dq, divergence, "gradient_q", 1e-8, condition);
            } else {
                assert_eq!(got, 0.0, "{pair}");
            }
        }
    }
}
