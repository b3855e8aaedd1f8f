//! Training against PyTorch: 50 steps of the released algorithm with the same first weights, pixels, poses and jitter.
//!
//! `fixtures/parity.py` took the same steps; its head states the algorithm, and the rule that gives the first weights.

use std::ops::Range;
use std::sync::Arc;

use burn::tensor::{Device, f16};
use glam::{DMat3, DMat4, DVec3};
use infonerf_field::{FieldSpec, RadianceField};
use infonerf_render::RandomStream::{FineSamples, Neighbours, Samples, SeenRays, UnseenRays};
use infonerf_scene::{Camera, Image, PixelAt, Scene, View};
use infonerf_tests::{fixture, floats, hashed, parameters_of, space, whole, wholes, with_parameters};
use infonerf_train::{Config, Event, Pixels, Preset, StepBatch, Trainer};
use safetensors::SafeTensors;
use serde_json::Value;

use crate::setup;

/// Relative tolerance of each loss in each step.
const LOSS_TOLERANCE: f64 = 1e-3;
/// Tolerance of each network's final weights, relative to how far they have moved.
const WEIGHT_TOLERANCE: f64 = 1e-2;
/// Number of tensors: weight and bias of four layers of the trunk, then of density, feature, view and colour.
const TENSORS: usize = 16;
const SIGMA: usize = 4;

/// Transposes a layer's weight from PyTorch's `[outputs, inputs]` to Burn's `[inputs, outputs]`; a bias stays as it is.
fn in_order<T>(shape: &[usize], at: impl Fn(usize) -> T) -> Vec<T> {
    match shape {
        &[inputs, outputs] => (0..inputs * outputs).map(|n| at(n % outputs * inputs + n / outputs)).collect(),
        shape => (0..shape.iter().product()).map(at).collect(),
    }
}

/// Shape and elements of each parameter.
type Weights = Vec<(Vec<usize>, Vec<f32>)>;

/// Returns the L2 distance of `last − first` from `change` over the tensors `which`, relative to the norm of `change`.
fn error([first, last]: &[Weights; 2], which: Range<usize>, change: impl Fn(usize) -> Vec<f64>) -> f64 {
    let (mut apart, mut moved) = (0.0, 0.0);
    for tensor in which {
        let ((_, first), (shape, last)) = (&first[tensor], &last[tensor]);
        let change = change(tensor);
        assert_eq!(change.len(), last.len());
        let change = in_order(shape, |n| change[n]);
        for ((last, first), change) in last.iter().zip(first).zip(change) {
            apart += (f64::from(*last) - f64::from(*first) - change).powi(2);
            moved += change.powi(2);
        }
    }
    (apart / moved).sqrt()
}

/// Builds a network of the fixture with its initial weights; `net` is 0 for the coarse network and 1 for the fine one.
fn network(fixture: &Value, config: &Config, net: usize, device: &Device) -> RadianceField {
    let fact = |key: &str| fixture[key].as_f64().unwrap();
    let mut fan_in = 0;
    let rule = |l: usize, shape: &[usize]| {
        if let [inputs, _] = *shape {
            fan_in = inputs;
        }
        let (gain, shift) = match (l / 2, shape.len()) {
            (SIGMA, 2) => (fact("sigma_gain"), 0.0),
            (SIGMA, _) => (1.0, fact("sigma_bias")),
            _ => (1.0, 0.0),
        };
        let value = |n| (gain * (hashed(net * TENSORS + l, n) / (fan_in as f64).sqrt()) + shift) as f32;
        Some(in_order(shape, value))
    };
    let (field, parameters) = with_parameters(config.field.build(&setup(device)).unwrap(), rule);
    assert_eq!(parameters, TENSORS);
    field
}

/// Config of preset `released` at the fixture's size, with the weights of a run's losses.
fn configured(fixture: &Value, run: &Value) -> Config {
    // The fixture has each size under the last part of its key.
    let sizes = ["field.layers", "field.width", "render.samples", "render.fine_samples", "train.rays"];
    let steps = run["steps"].as_array().unwrap().len();
    let mut settings = vec![
        format!("train.iterations={steps}"),
        format!("loss.entropy.weight={}", run["entropy_weight"]),
        format!("loss.kl.weight={}", run["kl_weight"]),
        format!("loss.entropy.neighbours={}", run["kl_weight"].as_f64() > Some(0.0)),
        format!("train.unseen_rays={}", fixture["rays"]),
    ];
    settings.extend(sizes.map(|key| format!("{key}={}", fixture[key.rsplit('.').next().unwrap()])));
    Config::of(Preset::Released, settings).unwrap()
}

/// Builds the fixture's data set: four images with their cameras, and further cameras.
fn scene(fixture: &Value) -> Scene {
    let size = whole(&fixture["size"]) as u32;
    let camera = |rows: &Value| {
        let mut pose: Vec<f64> = rows.as_array().unwrap().iter().flat_map(floats).collect();
        pose.extend([0.0, 0.0, 0.0, 1.0]);
        let pose = DMat4::from_cols_slice(&pose).transpose();
        Camera::from_fov(size, size, fixture["fov"].as_f64().unwrap(), pose)
    };
    let cameras: Vec<Camera> = fixture["poses"].as_array().unwrap().iter().map(camera).collect();
    let view = |(id, (pixels, camera)): (usize, (&Value, &Camera))| {
        let color = |pixel: &Value| [0, 1, 2].map(|channel| pixel[channel].as_f64().unwrap() as f32 / 255.0);
        let rgb = pixels.as_array().unwrap().iter().map(color).collect();
        let image = Image { width: size, height: size, rgb, alpha: None };
        View::new(id, format!("train/{id}"), camera.clone(), image)
    };
    Scene {
        name: "fixture".into(),
        train: fixture["images"].as_array().unwrap().iter().zip(&cameras).enumerate().map(view).collect(),
        space: space(fixture, 1.0),
        all_train_cameras: cameras,
        ..Scene::default()
    }
}

/// Returns the pixels and poses of a step of the fixture.
fn step_batch(scene: &Scene, step: &Value) -> StepBatch {
    let size = scene.train[0].image.width as usize;
    let pixels = |view: usize, numbers: &Value| {
        let numbers = wholes(numbers);
        let at = numbers.iter().map(|&n| PixelAt { view, x: (n % size) as f32, y: (n / size) as f32 }).collect();
        (Pixels { cameras: scene.all_train_cameras.as_slice().into(), at, width: 1.0 }, numbers)
    };
    let view = whole(&step["view"]);
    let (seen, numbers) = pixels(view, &step["seen"]);
    let [x, y, z] = floats(&step["turn"])[..] else { panic!("three angles") };
    let turn = [(DVec3::X, x), (DVec3::Y, y), (DVec3::Z, z)]
        .map(|(axis, degrees)| DMat3::from_axis_angle(axis, degrees.to_radians()));
    StepBatch {
        scene: 0,
        seen,
        colors: numbers.iter().map(|&n| scene.train[view].image.rgb[n]).collect(),
        unseen: Some(pixels(whole(&step["pose"]), &step["unseen"]).0),
        rotation: DMat4::from_mat3(turn[0] * turn[1] * turn[2]),
    }
}

/// Takes the steps of a run and compares each step's losses, and the first and last weights, with the fixture.
fn train(fixture: &Value, mode: &str, device: &Device) -> [Weights; 2] {
    let run = &fixture["runs"][mode];
    let config = configured(fixture, run);
    let scene = Arc::new(scene(fixture));
    let seed = run["seed"].as_u64().unwrap();
    let build = {
        let (fixture, config) = (fixture.clone(), config.clone());
        // The trainer builds the fine network with the run's own seed, and the coarse one with another seed.
        move |of: u64, device: &Device| network(&fixture, &config, usize::from(of == seed), device)
    };
    let mut trainer = Trainer::with_field(&config, scene.clone(), seed, None, device, build).unwrap();
    let first = parameters_of(&trainer.model(), None);
    for (index, step) in run["steps"].as_array().unwrap().iter().enumerate() {
        let mut events = Vec::new();
        trainer.step_on(step_batch(&scene, step), &mut |event| events.push(event)).unwrap();
        let [Event::Step { loss, losses, .. }] = &events[..] else { panic!("{mode}, step {index}: {events:?}") };
        let expected = run["losses"].as_object().unwrap();
        assert_eq!(losses.len() + 1, expected.len(), "{mode}: {losses:?}");
        for (name, want) in expected {
            let got = f64::from(if name == "total" { *loss } else { losses[name] });
            let want = want[index].as_f64().unwrap();
            let what = format!("{device:?}, {mode}, step {index}, {name}: {got} against {want}");
            assert!((got - want).abs() <= LOSS_TOLERANCE * want.abs(), "{what}");
        }
    }
    [first, parameters_of(&trainer.model(), None)]
}

/// Checks all runs of the fixture, but on the older CPU backend, which is slow, only the one with all losses.
#[test]
#[allow(deprecated, reason = "the name of the older backend")]
fn trains_as_pytorch_does_on_every_device() {
    let fixture = &fixture("parity");
    let changes = SafeTensors::deserialize(include_bytes!("../fixtures/parity.safetensors")).unwrap();
    for (name, stream) in fixture["streams"].as_object().unwrap() {
        let streams = [SeenRays, UnseenRays, Neighbours, Samples, FineSamples];
        let known = streams.iter().find(|known| format!("{known:?}") == *name).unwrap();
        assert_eq!(*known as u64, stream.as_u64().unwrap(), "{name}: put its new number into parity.py and run that");
    }
    for device in &infonerf_tests::devices() {
        let is_slow = *device == Device::ndarray();
        for mode in fixture["runs"].as_object().unwrap().keys().filter(|mode| !is_slow || *mode == "kl") {
            let weights = train(fixture, mode, device);
            let change = |tensor: usize| {
                let tensor = changes.tensor(&format!("{mode}.{tensor}")).unwrap();
                let halves = tensor.data().chunks_exact(2).map(|bytes| f16::from_le_bytes([bytes[0], bytes[1]]));
                halves.map(f64::from).collect()
            };
            for (net, tensors) in [("coarse", 0..TENSORS), ("fine", TENSORS..2 * TENSORS)] {
                let error = error(&weights, tensors, change);
                assert!(
                    error <= WEIGHT_TOLERANCE,
                    "{device:?}, {mode}: {net} weights are {error} of their change apart"
                );
            }
        }
    }
}
