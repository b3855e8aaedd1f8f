//! Neural Volumes against PyTorch: decoded voxels and warp as points read them, the additive march, its losses, and gradients
//! back to every bias and the latent code; and in training.
//!
//! `fixtures/neural_volumes.py` made the expected values; its head states the rule that gives every weight.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor};
use infonerf_field::{
    Extent, Field, FieldConfig, FieldSetup, FieldSpec, NeuralVolumesConfig, Points, RadianceField, Sources,
};
use infonerf_ops::{Segments, additive_depth, composite, to_host};
use infonerf_scene::{SceneRequest, SceneSource, TestProtocol, load};
use infonerf_schedule::Moment;
use infonerf_tests::{compare, largest, numbers, overwritten};
use infonerf_train::{Config, Event, Outcome, Preset, Trainer, config};
use serde_json::Value;

const TOLERANCE: f64 = 1e-4;

fn fixture() -> Value {
    serde_json::from_str(include_str!("../fixtures/neural_volumes.json")).unwrap()
}

fn sizes(fixture: &Value) -> NeuralVolumesConfig {
    let number = |key: &str| fixture[key].as_u64().unwrap() as usize;
    NeuralVolumesConfig {
        latent: number("latent"),
        resolution: number("resolution"),
        width: number("width"),
        maps: number("maps"),
        warp_resolution: number("warp_resolution"),
    }
}

/// The fixture's rule.
fn rule(l: usize, shape: &[usize], u: f64) -> f64 {
    match (shape, l) {
        (_, 0) => u,
        (_, 1) => -1.0 + 0.1 * u,
        ([_], _) => 0.1 * u,
        ([_, _], _) => (30.0 / shape[0] as f64).sqrt() * u,
        _ => (12.0 / (8 * shape[0]) as f64).sqrt() * u,
    }
}

fn field(fixture: &Value, device: &Device) -> RadianceField {
    let corner = |index: usize| {
        let corner = numbers(&fixture["box"][index]);
        [corner[0], corner[1], corner[2]]
    };
    let setup = FieldSetup { bounds: [corner(0), corner(1)], seed: 0, device, body: None };
    let field = FieldConfig::NeuralVolumes(sizes(fixture)).build(&setup).unwrap();
    let (field, parameters) = overwritten(field, rule);
    // The code, a dense layer, three transposed convolutions, and four branches of two dense layers.
    assert_eq!(parameters, 2 + 2 + 2 * 3 + 2 * 8);
    field
}

fn no_photographs() -> Sources {
    Sources { views: [].into(), middle: [0.0; 3] }
}

/// Compares with errors beside the largest of the expected values.
fn close(got: &[f32], want: &[f32], what: &str) {
    compare(got, want, TOLERANCE * largest(want), what);
}

/// Gradients of the rank-1 parameters, in the order of the module.
struct VectorGradients<'a> {
    gradients: &'a Gradients,
    found: Vec<Vec<f32>>,
}

impl ModuleVisitor for VectorGradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if D == 1 {
            self.found.push(to_host(param.val().grad(self.gradients).expect("every parameter has a gradient")));
        }
    }
}

fn check(device: &Device) {
    let fixture = &fixture();
    let device = &device.clone().autodiff();
    let original = field(fixture, device);
    let field = original.conditioned(&no_photographs(), None);
    let counts: Vec<usize> = numbers(&fixture["counts"]).iter().map(|count| *count as usize).collect();
    let segments = Segments::from_counts(counts.iter().copied());
    let (positions, deltas) = (numbers(&fixture["positions"]), numbers(&fixture["deltas"]));
    let points = Points {
        positions: &positions,
        directions: &[0.0, 0.0, 1.0].repeat(counts.len()),
        segments: &segments,
        extent: Extent::Ball { variance: 0.0 },
    };
    let sampled = field.evaluate(points, true, Moment::END);
    let alone = field.evaluate(points, false, Moment::END);
    assert!(alone.color.is_none());
    close(&to_host(alone.sigma), &numbers(&fixture["sigma"]), "density alone");

    let color = sampled.color.unwrap();
    close(&to_host(sampled.sigma.clone()), &numbers(&fixture["sigma"]), "density");
    close(&to_host(color.clone()), &numbers(&fixture["rgb"]), "colour");
    let tau = sampled.sigma * Tensor::from_floats(deltas.as_slice(), device);
    let rays = composite(additive_depth(tau, &segments), color, &segments);
    close(&to_host(rays.values.clone()), &numbers(&fixture["rays"]), "rays");
    close(&to_host(rays.acc.clone()), &numbers(&fixture["opacities"]), "opacities");
    let variation = field.total_variation().unwrap();
    close(&to_host(variation.clone()), &numbers(&fixture["variation"]), "total variation");
    let divergence = field.latent_divergence().unwrap();
    close(&to_host(divergence.clone()), &numbers(&fixture["divergence"]), "divergence");
    let prior = ((rays.acc.clone() + 0.1).log() + (rays.acc.neg() + 1.1).log() - 0.11f32.ln()).mean();
    close(&to_host(prior.clone()), &numbers(&fixture["prior"]), "opacity prior");

    let loss = (rays.values - 0.3).square().mean() + variation * 0.01 + divergence * 0.001 + prior * 0.01;
    let gradients = loss.backward();
    let mut vectors = VectorGradients { gradients: &gradients, found: Vec::new() };
    original.visit(&mut vectors);
    let expected = fixture["gradients"].as_array().unwrap();
    assert_eq!(vectors.found.len(), expected.len());
    for (index, (got, want)) in vectors.found.iter().zip(expected).enumerate() {
        close(got, &numbers(want), &format!("gradient of vector {index}"));
    }
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    for device in infonerf_tests::devices() {
        check(&device);
    }
}

/// A seed draws a code about the mean: the same one each time, another for another seed.
#[test]
fn a_seed_draws_the_code() {
    let fixture = &fixture();
    let field = field(fixture, &Device::flex().autodiff());
    let positions = numbers(&fixture["positions"]);
    let segments = Segments::uniform(1, positions.len() / 3);
    let extent = Extent::Ball { variance: 0.0 };
    let points = Points { positions: &positions, directions: &[0.0, 0.0, 1.0], segments: &segments, extent };
    let density = |seed| {
        let conditioned = field.conditioned(&no_photographs(), seed);
        to_host(conditioned.evaluate(points, false, Moment::END).sigma)
    };
    assert_eq!(density(Some(1)), density(Some(1)));
    assert_ne!(density(Some(1)), density(Some(2)));
    assert_ne!(density(Some(1)), density(None));
    assert_eq!(density(None), density(None));
}

/// With the released loss weights, four views of a built-in scene are learned to 20 dB.
#[test]
fn learns_its_training_views() {
    let mut table = Preset::Fast.table();
    for setting in [
        "field={kind='neuralvolumes',latent=32,resolution=16,width=32,maps=4,warp_resolution=8}",
        "render.samples=48",
        "render.compositing=additive",
        "loss.rgb.weight=104.04",
        "loss.entropy.weight=0.0",
        "loss.opacity.weight=0.0",
        "loss.silhouette.weight=0.0",
        "loss.opacity_prior.weight=0.01",
        "loss.tv.weight=0.01",
        "loss.latent.weight=0.001",
        "train.iterations=400",
        "train.rays=256",
        "train.target_samples=0",
        "train.downscale=1.0",
        "train.lr=4e-3",
    ] {
        config::assign(&mut table, setting).unwrap();
    }
    let config = Config::from_table(table).unwrap();
    let request = SceneRequest { image_size: Some(32), test: TestProtocol::First(1), ..SceneRequest::default() };
    let scene = load(&SceneSource::Procedural("crane".into()), &request).unwrap();
    let mut trainer = Trainer::new(&config, scene, 0, None, &Device::flex()).unwrap();
    let mut steps = Vec::new();
    let mut report = |event| {
        if let Event::Step { psnr, losses, .. } = event {
            steps.push((psnr, losses));
        }
    };
    while trainer.step(&mut report).unwrap() == Outcome::Running {}
    let terms: Vec<&str> = steps[0].1.keys().map(String::as_str).collect();
    assert_eq!(terms, ["latent", "opacity_prior", "rgb", "tv"]);
    let last = &steps[steps.len() - 10..];
    let mean = last.iter().map(|(psnr, _)| psnr).sum::<f32>() / last.len() as f32;
    assert!(mean >= 20.0, "{mean} dB");
}
