//! Neural Body against PyTorch: masked dense convolutions, the look-up of four levels, the MLP, and gradients of parameters.
//!
//! `fixtures/neural_body.py` made the expected values; its head states the rule that gives every weight.

use burn::tensor::{Device, Tensor};
use infonerf_field::{
    BodyVertices, Extent, Field, FieldConfig, FieldSetup, FieldSpec, NeuralBodyConfig, Points, RadianceField,
};
use infonerf_ops::{to_host, upload_rows};
use infonerf_schedule::Moment;
use infonerf_tests::{close, fixture, hashed, numbers, overwritten, parameters_of, triple};
use serde_json::Value;

use crate::{no_sources, setup};

/// Minimum scale of the tolerance of gradients, since their terms cancel; the largest gradient is 0.15.
const MIN_SCALE: f64 = 1e-3;

fn triples(value: &Value) -> Vec<[f32; 3]> {
    value.as_array().unwrap().iter().map(triple).collect()
}

fn config(fixture: &Value) -> NeuralBodyConfig {
    let sizes = ["voxel", "code", "channels", "width", "appearance", "position_frequencies", "direction_frequencies"];
    let values = sizes.map(|key| (key, fixture[key].clone())).into_iter().chain([("vertices", "".into())]);
    serde_json::from_value(values.collect()).unwrap()
}

fn rule(l: usize, shape: &[usize], u: f64) -> f64 {
    match (shape, l) {
        ([_], _) => 0.4 + 0.1 * u,
        (_, 0 | 1) => u,
        _ => (6.0 / shape[0] as f64).sqrt() * u,
    }
}

/// Summarises the gradient of parameter `l` as the fixture does.
fn summed(l: usize, (shape, gradient): (Vec<usize>, Vec<f32>)) -> Vec<f32> {
    if shape.len() != 2 || l < 2 {
        return gradient;
    }
    let terms = gradient.iter().enumerate().map(|(n, g)| f64::from(*g) * hashed(l + 1000, n));
    vec![terms.sum::<f64>() as f32]
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    let fixture = &fixture("neural_body");
    for device in infonerf_tests::devices() {
        let device = &device.autodiff();
        let (vertices, axes) = (triples(&fixture["vertices"]), triples(&fixture["axes"]));
        let origin = triple(&fixture["origin"]);
        let body = Some(BodyVertices { vertices: &vertices, axes: axes.try_into().unwrap(), origin });
        let setup = FieldSetup { body, ..setup(device) };
        let field = FieldConfig::NeuralBody(config(fixture)).build(&setup).unwrap();
        let (original, parameters) = overwritten(field, rule);
        // Codes and appearance, 17 convolutions of three tensors, and eight dense layers.
        assert_eq!(parameters, 2 + 17 * 3 + 8 * 2);
        let field = original.conditioned(&no_sources(), None);
        let (positions, directions) = (numbers(&fixture["points"]), numbers(&fixture["directions"]));
        let [positions, directions] = [positions, directions].map(|rows| upload_rows(&rows, 3, device));
        let points = Points::scattered(positions, Extent::Ball { variance: 0.0 }).seen_along(directions);
        let (sigma, rgb) = (numbers(&fixture["sigma"]), numbers(&fixture["rgb"]));
        close(&to_host(field.evaluate(&points, false, Moment::END).sigma), &sigma, 0.0, "density alone");
        let sampled = field.evaluate(&points, true, Moment::END);
        let color = sampled.color.unwrap();
        close(&to_host(sampled.sigma.clone()), &sigma, 0.0, "density");
        close(&to_host(color.clone()), &rgb, 0.0, "colour");

        let loss = (color - 0.3).square().mean() + sampled.sigma.square().mean() * 0.01;
        let found = parameters_of(&original, Some(&loss.backward()));
        let expected: Vec<Vec<f32>> = fixture["gradients"].as_array().unwrap().iter().map(numbers).collect();
        assert_eq!(found.len(), expected.len());
        for (index, (got, want)) in found.into_iter().zip(&expected).enumerate() {
            close(&summed(index, got), want, MIN_SCALE, &format!("gradient of parameter {index}"));
        }
    }
}

#[test]
fn without_a_body_it_says_which_file_it_wants() {
    let config = FieldConfig::NeuralBody(config(&fixture("neural_body")));
    let message = RadianceField::new(&config, &setup(&Device::flex())).unwrap_err().to_string();
    assert!(message.contains("new_vertices/0.npy"), "{message}");
}

/// Checks SMPL's 6,890 vertices at the published voxel.
#[test]
fn a_body_of_full_size_fits() {
    let device = &Device::flex();
    let vertices: Vec<[f32; 3]> =
        (0..6890).map(|n| [0, 1, 2].map(|axis| hashed(axis, n) as f32 * [0.4, 0.2, 0.9][axis])).collect();
    let body = Some(BodyVertices { vertices: &vertices, ..BodyVertices::default() });
    let setup = FieldSetup { body, ..setup(device) };
    let sizes = NeuralBodyConfig { voxel: 0.005, ..config(&fixture("neural_body")) };
    let field = RadianceField::new(&FieldConfig::NeuralBody(sizes.clone()), &setup).unwrap();
    let positions = Tensor::from_floats([vertices[0], [5.0, 0.0, 0.0]], device);
    let points = Points::scattered(positions, Extent::Ball { variance: 0.0 });
    let sampled = field.conditioned(&no_sources(), None).evaluate(&points, true, Moment::END);
    assert!(to_host(sampled.color.unwrap()).iter().all(|c| c.is_finite()));
    let tiny = NeuralBodyConfig { voxel: 0.001, ..sizes };
    let message = RadianceField::new(&FieldConfig::NeuralBody(tiny), &setup).unwrap_err().to_string();
    assert!(message.contains("at most 1023 along each axis"), "{message}");
    let stray = [vertices.as_slice(), &[[4.9; 3]]].concat();
    let setup = FieldSetup { body: Some(BodyVertices { vertices: &stray, ..BodyVertices::default() }), ..setup };
    let sizes = NeuralBodyConfig { voxel: 0.006, ..config(&fixture("neural_body")) };
    let message = RadianceField::new(&FieldConfig::NeuralBody(sizes), &setup).unwrap_err().to_string();
    assert!(message.contains("is a vertex far from the others?"), "{message}");
}
