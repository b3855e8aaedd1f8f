//! Neural Volumes against PyTorch: a learned code and one of images, decoded voxels and warp as points read them, the
//! additive march, its losses, gradients back to every bias and the latent code, and gain and bias of a view; and in training.
//!
//! `fixtures/neural_volumes.py` made the expected values; its head states the rule that gives every weight.

use burn::tensor::{Device, Tensor};
use infonerf_field::{
    CodeEncoderConfig, Extent, Field, FieldConfig, FieldSetup, FieldSpec, NeuralVolumesConfig, Penalty, Points,
    RadianceField, Sources,
};
use infonerf_ops::{Segments, additive_depth, composite, to_host, upload_rows};
use infonerf_procedural::load;
use infonerf_render::Exposure;
use infonerf_scene::{SceneRequest, TestProtocol};
use infonerf_schedule::Moment;
use infonerf_tests::{close, fixture, gradients_of_rank, numbers, overwritten, triple, whole, wholes};
use infonerf_train::{Config, Event, Outcome, Preset, Trainer};
use serde_json::Value;

use crate::{no_sources, setup, source_view};

/// Returns the config of the field without an encoder.
fn sizes(fixture: &Value) -> NeuralVolumesConfig {
    let sizes = ["latent", "resolution", "width", "maps", "warp_resolution"];
    serde_json::from_value(sizes.map(|key| (key, fixture[key].clone())).into_iter().collect()).unwrap()
}

fn encoder(fixture: &Value) -> CodeEncoderConfig {
    let encoder = &fixture["encoder"];
    let size = wholes(&encoder["size"]);
    CodeEncoderConfig { images: whole(&encoder["images"]), size: [size[0], size[1]], width: whole(&encoder["width"]) }
}

/// Returns an element of a parameter other than a code by the fixture's rule.
fn rule(shape: &[usize], u: f64) -> f64 {
    match *shape {
        [_] => 0.1 * u,
        [inputs, _] => (30.0 / inputs as f64).sqrt() * u,
        [_, inputs, _, _] => (3.0 / (16 * inputs) as f64).sqrt() * u,
        _ => (12.0 / (8 * shape[0]) as f64).sqrt() * u,
    }
}

fn built(fixture: &Value, config: NeuralVolumesConfig, device: &Device) -> RadianceField {
    let bounds = [0, 1].map(|index| triple(&fixture["box"][index]));
    let setup = FieldSetup { bounds, ..setup(device) };
    FieldConfig::NeuralVolumes(config).build(&setup).unwrap()
}

/// Number of the decoder's tensors: a dense layer, three transposed convolutions, and four branches of two dense layers.
const DECODER: usize = 2 + 2 * 3 + 2 * 8;

/// Builds the field whose code is its first two parameters.
fn learned(fixture: &Value, device: &Device) -> RadianceField {
    let (field, parameters) = overwritten(built(fixture, sizes(fixture), device), |l, shape, u| match l {
        0 => u,
        1 => -1.0 + 0.1 * u,
        _ => rule(shape, u),
    });
    assert_eq!(parameters, 2 + DECODER);
    field
}

/// Builds the field whose code comes from images.
fn encoded(fixture: &Value, device: &Device) -> RadianceField {
    let config = NeuralVolumesConfig { encoder: Some(encoder(fixture)), ..sizes(fixture) };
    let (field, parameters) = overwritten(built(fixture, config, device), |_, shape, u| rule(shape, u));
    // Each image has a tower of four convolutions; three dense layers follow.
    assert_eq!(parameters, encoder(fixture).images * 2 * 4 + 2 * 3 + DECODER);
    field
}

/// Returns the fixture's images, and one more.
fn photographs(fixture: &Value) -> Sources {
    let size = wholes(&fixture["encoder"]["picture"]);
    let view = |k| source_view(k, [size[1], size[0]], 1.0, [[0.0; 4]; 3]);
    Sources { views: (0..=encoder(fixture).images).map(view).collect(), middle: [0.0; 3] }
}

fn compare<const D: usize>(got: Tensor<D>, want: &Value, what: &str) {
    close(&to_host(got), &numbers(want), 0.0, what);
}

/// Compares `original`, conditioned on `sources`, with the `expected` values.
fn check(fixture: &Value, expected: &Value, original: &RadianceField, sources: &Sources) {
    let device = &original.device();
    let field = original.conditioned(sources, None);
    let segments = Segments::from_counts(wholes(&fixture["counts"]));
    let (positions, deltas) = (numbers(&fixture["positions"]), numbers(&fixture["deltas"]));
    let points = Points::scattered(upload_rows(&positions, 3, device), Extent::Ball { variance: 0.0 });
    let sampled = field.evaluate(&points, true, Moment::END);
    let alone = field.evaluate(&points, false, Moment::END);
    assert!(alone.color.is_none());
    compare(alone.sigma, &expected["sigma"], "density alone");

    let color = sampled.color.unwrap();
    compare(sampled.sigma.clone(), &expected["sigma"], "density");
    compare(color.clone(), &expected["rgb"], "colour");
    let tau = sampled.sigma * Tensor::from_floats(deltas.as_slice(), device);
    let rays = composite(additive_depth(tau, &segments), color, &segments);
    compare(rays.values.clone(), &expected["rays"], "rays");
    compare(rays.acc.clone(), &expected["opacities"], "opacities");
    let variation = field.penalty(Penalty::TOTAL_VARIATION).unwrap();
    compare(variation.clone(), &expected["variation"], "total variation");
    let divergence = field.penalty(Penalty::LATENT_DIVERGENCE).unwrap();
    compare(divergence.clone(), &expected["divergence"], "divergence");
    let prior = ((rays.acc.clone() + 0.1).log() + (rays.acc.neg() + 1.1).log() - 0.11f32.ln()).mean();
    compare(prior.clone(), &expected["prior"], "opacity prior");

    let loss = (rays.values - 0.3).square().mean() + variation * 0.01 + divergence * 0.001 + prior * 0.01;
    let vectors = gradients_of_rank(1, original, &loss.backward());
    let expected = expected["gradients"].as_array().unwrap();
    assert_eq!(vectors.len(), expected.len());
    for (index, (got, want)) in vectors.iter().zip(expected).enumerate() {
        close(got, &numbers(want), 0.0, &format!("gradient of vector {index}"));
    }
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    let fixture = &fixture("neural_volumes");
    for device in infonerf_tests::devices() {
        let device = &device.autodiff();
        check(fixture, &fixture["learned"], &learned(fixture, device), &no_sources());
        check(fixture, &fixture["encoded"], &encoded(fixture, device), &photographs(fixture));
    }
}

/// Checks gain and bias of views, their gradients, and those of the colours that they change.
#[test]
fn gain_and_bias_agree_with_pytorch_on_every_device() {
    let fixture = &fixture("neural_volumes")["exposed"];
    let views = wholes(&fixture["views"]);
    let behind = triple(&fixture["background"]);
    for device in infonerf_tests::devices() {
        let device = &device.autodiff();
        let rule = |l: usize, _: &[usize], u: f64| if l == 0 { 1.0 + 0.3 * u } else { 0.1 * u };
        let (exposure, parameters) = overwritten(Exposure::new(2, device), rule);
        assert_eq!(parameters, 2);
        let opacity = Tensor::<1>::from_floats(&numbers(&fixture["opacities"])[..], device).require_grad();
        let color = Tensor::<1>::from_floats(&numbers(&fixture["color"])[..], device).reshape([views.len(), 3]);
        let color = color.detach().require_grad();
        let shown = exposure.apply(color.clone(), opacity.clone(), behind, &views);
        compare(shown.clone(), &fixture["shown"], "colours of views");
        let gradients = (shown - 0.3).square().mean().backward();
        let of_rays = [to_host(color.grad(&gradients).unwrap()), to_host(opacity.grad(&gradients).unwrap())];
        let names = ["gains", "biases", "colours", "opacities"];
        for (index, got) in gradients_of_rank(2, &exposure, &gradients).into_iter().chain(of_rays).enumerate() {
            close(&got, &numbers(&fixture["gradients"][index]), 0.0, names[index]);
        }
    }
}

/// Returns the densities of the fixture's points from the field conditioned on `sources`.
fn densities(fixture: &Value, field: &RadianceField, sources: &Sources, seed: Option<u64>) -> Vec<f32> {
    let positions = numbers(&fixture["positions"]);
    let points = Points::scattered(upload_rows(&positions, 3, &field.device()), Extent::Ball { variance: 0.0 });
    to_host(field.conditioned(sources, seed).evaluate(&points, false, Moment::END).sigma)
}

/// Checks that the encoder sees the first images, each through its own tower.
#[test]
fn the_first_photographs_make_the_code() {
    let fixture = &fixture("neural_volumes");
    let (field, all) = (encoded(fixture, &Device::flex().autodiff()), photographs(fixture));
    let seen = |order: [usize; 3]| {
        let views = order.iter().map(|&index| all.views[index].clone()).collect();
        densities(fixture, &field, &Sources { views, ..all }, None)
    };
    assert_eq!(seen([0, 1, 2]), seen([0, 1, 0]), "a third one is not looked at");
    assert_ne!(seen([0, 1, 2]), seen([1, 0, 2]));
    assert_ne!(seen([0, 1, 2]), seen([0, 2, 1]));
}

/// Checks that a seed draws the same code each time, and another seed another one.
#[test]
fn a_seed_draws_the_code() {
    let fixture = &fixture("neural_volumes");
    let (device, photographs) = (Device::flex().autodiff(), photographs(fixture));
    for field in [learned(fixture, &device), encoded(fixture, &device)] {
        let density = |seed| densities(fixture, &field, &photographs, seed);
        assert_eq!(density(Some(1)), density(Some(1)));
        assert_ne!(density(Some(1)), density(Some(2)));
        assert_ne!(density(Some(1)), density(None));
        assert_eq!(density(None), density(None));
    }
}

/// With the released loss weights, four views of a built-in scene are learned to 18.5 dB. A code from images, which is learned
/// more slowly as its deviation begins at 1, exceeds the 13.3 dB of empty renders. At rates above 2e-3 the result depends on
/// the seed and on the rounding of matrix products.
#[test]
fn learns_its_training_views_with_and_without_the_encoder() {
    for (settings, expected) in [("", 18.5), ("field.encoder={images=3,size=[32,32],width=4}", 15.5)] {
        let psnr = trained(settings);
        assert!(psnr >= expected, "{settings:?}: {psnr} dB");
    }
}

/// Returns the PSNR of the last steps of a small run.
fn trained(settings: &str) -> f32 {
    let small = "field={kind='neuralvolumes',latent=32,resolution=16,width=32,maps=4,warp_resolution=8} \
                 render.samples=48 render.compositing=additive loss.rgb.weight=104.04 loss.entropy.weight=0.0 \
                 loss.silhouette.weight=0.0 loss.opacity_prior.weight=0.01 loss.tv.weight=0.01 \
                 loss.latent.weight=0.001 train.iterations=400 train.rays=256 train.target_samples=0 \
                 train.downscale=1.0 train.lr=1e-3";
    let config = Config::of(Preset::Fast, small.split(' ').chain(settings.split_whitespace())).unwrap();
    let request = SceneRequest { image_size: Some(32), test: TestProtocol::First(1), ..SceneRequest::default() };
    let scene = load("crane", &request).unwrap();
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
    last.iter().map(|(psnr, _)| psnr).sum::<f32>() / last.len() as f32
}
