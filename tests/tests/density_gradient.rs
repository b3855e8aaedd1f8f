//! Gradients of every kind of field against finite differences: of density in positions, and of density and colour in parameters.

use burn::tensor::{Device, Tensor};
use infonerf_field::{
    BodyVertices, Extent, Field, FieldConfig, FieldSetup, FieldSpec, Penalty, Points, RadianceField, Sources,
    density_gradient,
};
use infonerf_ops::{Segments, to_host, upload, upload_rows};
use infonerf_schedule::Moment;
use infonerf_tests::{devices, fixture, hashed, parameters_of, with_parameters};

use crate::{setup, source_view};

/// Returns configs of a small field of each kind, with part of the detail of those that anneal it.
fn fields() -> Vec<FieldConfig> {
    serde_json::from_value(fixture("fields")).unwrap()
}

fn sources() -> Sources {
    let to_camera = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -5.0]];
    Sources { views: [source_view(0, [16, 16], 10.0, to_camera)].into(), middle: [0.0; 3] }
}

/// Builds a field with parameters that make it vary; element `n` of parameter `l` is shifted by `moved(l, n)`.
fn built(config: &FieldConfig, device: &Device, moved: impl Fn(usize, usize) -> f64) -> RadianceField {
    let vertices = [[-0.4, -0.5, -0.3], [0.1, 0.1, 0.2], [0.4, 0.3, 0.4]];
    let body = Some(BodyVertices { vertices: &vertices, ..BodyVertices::default() });
    let setup = FieldSetup { bounds: [[-1.0; 3], [1.0, 1.5, 2.0]], body, ..setup(device) };
    let gain = |shape: &[usize]| if shape.len() == 2 && shape[0] < 64 { (6.0 / shape[0] as f64).sqrt() } else { 1.0 };
    let values = |l: usize, shape: &[usize]| {
        Some((0..shape.iter().product()).map(|n| (gain(shape) * hashed(l, n) + moved(l, n)) as f32).collect())
    };
    with_parameters(RadianceField::new(config, &setup).unwrap(), values).0
}

/// Positions of five points.
const AT: [f32; 15] = [0.11, 0.23, 0.05, -0.31, -0.42, -0.17, 0.33, 0.38, 0.21, -0.13, 0.29, 0.37, 0.43, -0.07, -0.27];

/// Checks that a gradient lies between the differences on both sides, which a ReLU or the end of a texel makes unequal.
fn check_between(found: f64, sides: [f64; 2], tolerance: f64, what: &str) {
    let [low, high] = [sides[0].min(sides[1]), sides[0].max(sides[1])];
    assert!((low - tolerance..=high + tolerance).contains(&found), "{what}: {found}, {sides:?}");
}

/// Makes points that are samples of two rays.
fn points(positions: &[f32], device: &Device) -> Points {
    let count = positions.len() / 3;
    let each = |value: f32| upload(vec![value; count], [count], device);
    Points {
        positions: upload_rows(positions, 3, device),
        directions: Tensor::from_floats([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], device),
        segments: Segments::from_counts([2, count - 2]),
        extent: Extent::Cones { t: each(3.0), delta: each(0.2), radii: Tensor::from_floats([0.01, 0.02], device) },
    }
}

#[test]
fn gradients_in_positions_are_those_of_differences() {
    const STEP: f32 = 1e-3;
    for device in devices() {
        for config in fields() {
            let field = built(&config, &device, |_, _| 0.0).conditioned(&sources(), None);
            let sigma = |positions: &[f32]| {
                let densities = field.evaluate(&points(positions, &device), false, Moment::END).sigma;
                to_host(densities).into_iter().map(f64::from).collect::<Vec<_>>()
            };
            let found = density_gradient(&field, &points(&AT, &device), Moment::END);
            assert_eq!(found.is_some(), config.traits().tracks_positions, "{config}");
            let Some((density, gradient)) = found else { continue };
            let (density, gradient) = (to_host(density), to_host(gradient));
            let here = sigma(&AT);
            assert!(density.iter().zip(&here).all(|(a, b)| (f64::from(*a) - b).abs() <= 1e-6 * b), "{config}");
            let steepest = f64::from(gradient.iter().fold(0f32, |most, g| most.max(g.abs())));
            assert!(steepest > 0.1, "{config}: {gradient:?}");
            for (index, &found) in gradient.iter().enumerate() {
                let difference = |step: f32| {
                    let mut moved = AT;
                    moved[index] += step;
                    (sigma(&moved)[index / 3] - here[index / 3]) / f64::from(moved[index] - AT[index])
                };
                let sides = [difference(-STEP), difference(STEP)];
                check_between(f64::from(found), sides, 5e-3 * steepest, &format!("{config} on {device:?}, {index}"));
            }
        }
    }
}

/// Compares derivatives along a random direction of each parameter tensor.
#[test]
fn gradients_in_parameters_are_those_of_differences() {
    const STEP: f64 = 1e-3;
    let direction = |l: usize, n: usize| hashed(100 + l, n);
    for device in devices() {
        for config in fields() {
            // Σ u σ + Σ v c and the field's penalties, in a training step.
            let value = |field: &RadianceField, device: &Device| {
                let field = field.conditioned(&sources(), Some(5));
                let out = field.evaluate(&points(&AT, device), true, Moment::END);
                let weights = |l: usize, n: usize| (0..n).map(|n| hashed(l, n) as f32).collect::<Vec<_>>();
                let color = out.color.unwrap() * upload_rows(&weights(8, 15), 3, device);
                let penalties = [Penalty::TOTAL_VARIATION, Penalty::LATENT_DIVERGENCE].map(|name| field.penalty(name));
                let shown = (out.sigma * upload(weights(7, 5), [5], device)).sum() + color.sum();
                penalties.into_iter().flatten().fold(shown, |sum, penalty| sum + penalty)
            };
            let tracked = built(&config, &device.clone().autodiff(), |_, _| 0.0);
            let gradients = parameters_of(&tracked, Some(&value(&tracked, &tracked.device()).backward()));
            let along = |(l, (_, gradient)): (usize, &(Vec<usize>, Vec<f32>))| -> f64 {
                gradient.iter().enumerate().map(|(n, g)| f64::from(*g) * direction(l, n)).sum()
            };
            let found: Vec<f64> = gradients.iter().enumerate().map(along).collect();
            let steepest = found.iter().fold(0f64, |most, g| most.max(g.abs()));
            for (l, &found) in found.iter().enumerate() {
                let at = |step: f64| {
                    let moved = |m: usize, n: usize| if m == l { step * direction(l, n) } else { 0.0 };
                    f64::from(value(&built(&config, &device, moved), &device).into_scalar::<f32>())
                };
                let (below, here, above) = (at(-STEP), at(0.0), at(STEP));
                let sides = [(here - below) / STEP, (above - here) / STEP];
                check_between(found, sides, 1e-2 * steepest, &format!("{config} on {device:?}, parameter {l}"));
                let is_used = above != here || below != here;
                assert!(!is_used || found != 0.0, "{config}, parameter {l} has no gradient");
            }
        }
    }
}
