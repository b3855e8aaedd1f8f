//! The gradient of density with respect to positions, of every field that configs can name.

use burn::tensor::{Device, Tensor};
use infonerf_field::{
    Body, Extent, Field, FieldConfig, FieldSetup, FieldSpec, Points, RadianceField, SourceView, Sources,
    density_gradient,
};
use infonerf_ops::{Segments, from_host, to_host, upload};
use infonerf_schedule::Moment;
use infonerf_tests::{devices, overwritten};
use serde_json::{Value, json};

/// A small field of each kind, with part of its detail where that is annealed.
fn fields() -> [Value; 7] {
    [
        json!({"kind": "nerf", "layers": 2, "width": 16, "skip": 1, "position_frequencies": 3, "direction_frequencies": 1,
               "density": "softplus", "detail": 0.7}),
        json!({"kind": "mip", "layers": 2, "width": 16, "skip": 1, "position_frequencies": 3, "direction_frequencies": 1,
               "detail": 0.7}),
        json!({"kind": "factored", "resolutions": [4, 9], "channels": 4, "frequencies": 2, "layers": 1, "width": 16,
               "view_dependence": 0.5, "density_scale": 10.0, "density_bias": -1.0, "detail": 0.7}),
        json!({"kind": "hash", "levels": 3, "features": 2, "log2_table_size": 9, "coarsest": 3, "finest": 7, "layers": 1,
               "width": 16, "direction_frequencies": 1, "density_scale": 10.0, "density_bias": -1.0, "detail": 0.7}),
        json!({"kind": "neuralvolumes", "latent": 4, "resolution": 4, "width": 16, "maps": 2, "warp_resolution": 3}),
        json!({"kind": "neuralbody", "vertices": "", "voxel": 0.1, "code": 4, "channels": 4, "width": 16, "appearance": 4,
               "position_frequencies": 2, "direction_frequencies": 1}),
        json!({"kind": "pixelnerf", "encoder": {"width": 4, "blocks": [1], "weights": ""}, "blocks": 1, "pool_after": 1,
               "width": 16, "frequencies": 2, "lowest_frequency": 1.5, "density": "softplus"}),
    ]
}

/// The field, with parameters that make it vary, as it is for one photograph.
fn built(config: &FieldConfig, device: &Device) -> RadianceField {
    let vertices = [[-0.4, -0.5, -0.3], [0.1, 0.1, 0.2], [0.4, 0.3, 0.4]];
    let body = Some(Body { vertices: &vertices, ..Body::default() });
    let setup = FieldSetup { bounds: [[-1.0; 3], [1.0, 1.5, 2.0]], seed: 0, device, body };
    let view = SourceView {
        width: 16,
        height: 16,
        rgb: vec![[0.5; 3]; 256].into(),
        focal: [10.0; 2],
        centre: [8.0; 2],
        to_camera: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -5.0]],
    };
    let gain = |shape: &[usize]| if shape.len() == 2 && shape[0] < 64 { (6.0 / shape[0] as f64).sqrt() } else { 1.0 };
    let (field, _) = overwritten(RadianceField::new(config, &setup).unwrap(), |_, shape, number| gain(shape) * number);
    field.conditioned(&Sources { views: vec![view].into(), middle: [0.0; 3] }, None)
}

/// Samples of two rays.
fn points(positions: &[f32], device: &Device) -> Points {
    let count = positions.len() / 3;
    let each = |value: f32| upload(vec![value; count], [count], device);
    Points {
        positions: from_host(positions, 3, device),
        directions: Tensor::from_floats([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], device),
        segments: Segments::from_counts([2, count - 2]),
        extent: Extent::Cones { t: each(3.0), delta: each(0.2), radii: Tensor::from_floats([0.01, 0.02], device) },
    }
}

#[test]
fn slopes_of_every_field_are_those_of_differences() {
    const STEP: f32 = 1e-3;
    let at: [f32; 15] =
        [0.11, 0.23, 0.05, -0.31, -0.42, -0.17, 0.33, 0.38, 0.21, -0.13, 0.29, 0.37, 0.43, -0.07, -0.27];
    for device in devices() {
        for config in fields().map(|field| serde_json::from_value::<FieldConfig>(field).unwrap()) {
            let field = built(&config, &device);
            let sigma = |positions: &[f32]| {
                let densities = field.evaluate(&points(positions, &device), false, Moment::END).sigma;
                to_host(densities).into_iter().map(f64::from).collect::<Vec<_>>()
            };
            let found = density_gradient(&field, &points(&at, &device), Moment::END);
            assert_eq!(found.is_some(), config.tracks_positions(), "{config}");
            let Some((density, gradient)) = found else { continue };
            let (density, gradient) = (to_host(density), to_host(gradient));
            let here = sigma(&at);
            assert!(density.iter().zip(&here).all(|(a, b)| (f64::from(*a) - b).abs() <= 1e-6 * b), "{config}");
            let steepest = f64::from(gradient.iter().fold(0f32, |most, slope| most.max(slope.abs())));
            assert!(steepest > 0.1, "{config}: {gradient:?}");
            for (index, &slope) in gradient.iter().enumerate() {
                let difference = |step: f32| {
                    let mut moved = at;
                    moved[index] += step;
                    (sigma(&moved)[index / 3] - here[index / 3]) / f64::from(moved[index] - at[index])
                };
                // On both sides: they differ where a ReLU turns on or a texel ends in between.
                let sides = [difference(-STEP), difference(STEP)];
                let (low, high) = (sides[0].min(sides[1]), sides[0].max(sides[1]));
                let within = low - 5e-3 * steepest..=high + 5e-3 * steepest;
                assert!(within.contains(&f64::from(slope)), "{config} on {device:?}, {index}: {slope}, {sides:?}");
            }
        }
    }
}
