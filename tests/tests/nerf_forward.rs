//! The full-size network, coarse and fine, against a PyTorch rendering of the same rays with the same weights.
//!
//! `fixtures/nerf_forward.py` made the expected values; its head states the rule that gives every weight.

use burn::tensor::{Device, Tensor};
use glam::Vec3;
use infonerf_field::{FieldSetup, FieldSpec, RadianceField};
use infonerf_ops::{RayDistribution, ray_divergence, ray_entropy, to_host};
use infonerf_render::{Model, RenderOutput, RenderRequest, Renderer};
use infonerf_scene::{Aabb, Range, Ray, Scene, Space};
use infonerf_schedule::Moment;
use infonerf_tests::{fixture, with_parameters};
use infonerf_train::{Config, Preset};
use serde_json::{Value, json};

/// Tolerance of colour, opacity, depth, entropy and divergence.
const TOLERANCE: f64 = 1e-4;
/// Tolerance of the coarse network's raw density, which reaches 8 here.
const SIGMA_TOLERANCE: f64 = 5e-4;
/// Tolerance of weights: the rule's sine in `f64` may differ in the last place between libraries.
const WEIGHT_TOLERANCE: f64 = 1e-7;

/// Layers in the module's order: trunk, density, feature, view, colour.
const LAYERS: usize = 12;
const FREQUENCIES: usize = 10;

fn floats(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().map(|x| x.as_f64().unwrap()).collect(),
        single => vec![single.as_f64().unwrap()],
    }
}

/// Returns a parameter by the fixture's rule; a few of its elements are checked against the fixture.
struct NerfRule<'a> {
    fixture: &'a Value,
    net: usize,
    /// Number of the parameter: weight and bias of each layer in turn.
    visited: usize,
}

impl NerfRule<'_> {
    fn probe(&self, layer: usize) -> &Value {
        &self.fixture["weight_probes"][self.net * LAYERS + layer]
    }

    /// Column scale c[i]: 2^(−k/2) where layers 0 and 5 read frequency k of the encoded position.
    fn column(layer: usize, input: usize) -> f64 {
        match input.checked_sub(3).map(|i| i / 6) {
            Some(frequency) if (layer == 0 || layer == 5) && frequency < FREQUENCIES => {
                2f64.powf(-0.5 * frequency as f64)
            }
            _ => 1.0,
        }
    }

    fn weight(&self, layer: usize, fan_in: usize, output: usize, input: usize) -> f32 {
        let [o, i, l] = [output + 1, input + 1, layer + 1].map(|n| n as f64);
        let cross = self.fixture["cross"].as_f64().unwrap();
        let phase = 1.0 + 12.9898 * o + 78.233 * i + 37.719 * l + 93.989 * self.net as f64 + cross * (o * i);
        let gain = self.fixture["gain"][layer].as_f64().unwrap();
        let value = (gain * (3.0 / fan_in as f64).sqrt() * phase.sin()) as f32;
        (f64::from(value) * Self::column(layer, input)) as f32
    }

    fn bias(&self, layer: usize, output: usize) -> f32 {
        let phase = 0.5 + 4.1414 * (output + 1) as f64 + 3.7 * (layer + 1) as f64 + 1.9 * self.net as f64;
        (self.fixture["bias0"][layer].as_f64().unwrap() + 0.1 * phase.sin()) as f32
    }

    fn values(&self, shape: &[usize]) -> Vec<f32> {
        let layer = self.visited / 2;
        let probe = |key: &str, got: f32| {
            let want = self.probe(layer)[key].as_f64().unwrap();
            assert!((f64::from(got) - want).abs() < WEIGHT_TOLERANCE, "layer {layer}, {key}: {got} against {want}");
        };
        match shape {
            // Burn keeps weights as [inputs, outputs], PyTorch the other way round.
            &[inputs, outputs] => {
                assert_eq!(self.visited % 2, 0, "a weight, then its bias");
                assert_eq!(self.probe(layer)["shape"], json!([outputs, inputs]), "layer {layer}");
                let weight = |o, i| self.weight(layer, inputs, o, i);
                probe("w_first", weight(0, 0));
                probe("w_0_last", weight(0, inputs - 1));
                probe("w_last_0", weight(outputs - 1, 0));
                probe("w_last", weight(outputs - 1, inputs - 1));
                (0..inputs).flat_map(|i| (0..outputs).map(move |o| weight(o, i))).collect()
            }
            &[outputs] => {
                assert_eq!(self.visited % 2, 1, "a weight, then its bias");
                probe("b_first", self.bias(layer, 0));
                probe("b_last", self.bias(layer, outputs - 1));
                (0..outputs).map(|o| self.bias(layer, o)).collect()
            }
            other => panic!("a parameter of shape {other:?}"),
        }
    }
}

/// Config of the paper's network and sampling, without jitter.
fn config(last_interval: &str) -> Config {
    let last_interval = format!("render.last_interval={last_interval}");
    Config::of(Preset::Paper, [&last_interval]).unwrap()
}

const HALF_EDGE: f32 = 6.0;

fn network(fixture: &Value, net: usize, device: &Device) -> RadianceField {
    let setup = FieldSetup { bounds: [[-HALF_EDGE; 3], [HALF_EDGE; 3]], seed: 0, device, body: None };
    let field = config("finite").field.build(&setup).unwrap();
    let values = |visited, shape: &[usize]| Some(NerfRule { fixture, net, visited }.values(shape));
    let (field, parameters) = with_parameters(field, values);
    assert_eq!(parameters, 2 * LAYERS);
    field
}

fn renderer(fixture: &Value, last_interval: &str) -> Renderer {
    let (near, far) = (fixture["near"].as_f64().unwrap() as f32, fixture["far"].as_f64().unwrap() as f32);
    let scene = Scene {
        name: "fixture".into(),
        space: Space {
            near,
            far,
            range: Range::Distance { near, far },
            bounds: Aabb::cube(Vec3::ZERO, HALF_EDGE),
            ..Default::default()
        },
        ..Scene::default()
    };
    let render = config(last_interval).render;
    assert_eq!(fixture["n_coarse"].as_f64(), Some(render.samples.largest()));
    assert_eq!(fixture["n_fine"], render.fine_samples);
    Renderer::new(&render, &scene)
}

fn rays(fixture: &Value, origin: &str, direction: &str) -> Vec<Ray> {
    let vector = |value: &Value| {
        let [x, y, z] = floats(value)[..] else { panic!("three numbers") };
        Vec3::new(x as f32, y as f32, z as f32)
    };
    let rows = fixture["rays"].as_array().unwrap();
    let ray = |row: &Value| Ray::new(vector(&row[origin]), vector(&row[direction]));
    rows.iter().map(ray).collect()
}

fn compare(got: &[f64], want: &[f64], tolerance: f64, what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    for (got, want) in got.iter().zip(want) {
        assert!((got - want).abs() <= tolerance, "{what}: {got} against {want}");
    }
}

fn column(tensor: Tensor<1>) -> Vec<f64> {
    to_host(tensor).into_iter().map(f64::from).collect()
}

fn compare_output(output: &RenderOutput, epsilon: f32, ray: usize, want: &Value, what: &str) {
    let color: Vec<f64> = to_host(output.color.clone().unwrap()).into_iter().map(f64::from).collect();
    compare(&color[ray * 3..ray * 3 + 3], &floats(&want["color"]), TOLERANCE, &format!("{what}, colour"));
    let entropy = ray_entropy(output.tau.clone(), output.segments(), RayDistribution::Alpha, epsilon).bits;
    for (name, tensor) in [("depth", &output.depth), ("acc", &output.acc), ("entropy", &entropy)] {
        if let Some(want) = want.get(name) {
            compare(&column(tensor.clone())[ray..=ray], &floats(want), TOLERANCE, &format!("{what}, {name}"));
        }
    }
}

/// Compares everything that the fixture holds on one device.
fn check(device: &Device) {
    let fixture = &fixture("nerf_forward");
    let model = Model { coarse: Some(network(fixture, 0, device)), ..Model::of(network(fixture, 1, device)) };
    let epsilon = fixture["eps"].as_f64().unwrap() as f32;
    let request = RenderRequest { color: true, hidden: true };
    for last_interval in ["finite", "infinite"] {
        let renderer = renderer(fixture, last_interval);
        let render = |origin, direction| {
            let rays = renderer.rays(rays(fixture, origin, direction), device);
            let passes = renderer.render(&model, &rays, request, None, Moment::END);
            (passes.coarse.unwrap(), passes.fine)
        };
        let ray = render("origin", "dir");
        let near = render("near_origin", "near_dir");
        let segments = &ray.1.samples.segments;
        let divergence = |p: &RenderOutput, q: &RenderOutput| {
            column(ray_divergence(p.tau.clone(), q.tau.clone(), segments, epsilon))
        };
        let (forward, backward) = (divergence(&ray.1, &near.1), divergence(&near.1, &ray.1));
        for (index, row) in fixture["rays"].as_array().unwrap().iter().enumerate() {
            let expected = &row[last_interval]["f64"];
            for (name, passes) in [("ray", &ray), ("near_ray", &near)] {
                for (stage, output) in [("coarse", &passes.0), ("fine", &passes.1)] {
                    let what = format!("{last_interval}, {name} {index}, {stage}");
                    compare_output(output, epsilon, index, &expected[name][stage], &what);
                }
            }
            // PyTorch's formula has no threshold: it compares a ray with the empty density of one that hits nothing.
            // Here such a pair has no divergence.
            let hits = |name: &str| expected[name]["fine"]["acc"].as_f64().unwrap() > 0.0;
            let defined = hits("ray") && hits("near_ray");
            for (key, got) in [("kl_ray_near", &forward), ("kl_near_ray", &backward)] {
                let want = if defined { floats(&expected[key]) } else { vec![0.0] };
                compare(&got[index..=index], &want, TOLERANCE, &format!("{last_interval}, {key} {index}"));
            }
        }
        let tau = column(ray.0.tau.clone());
        let count = fixture["n_coarse"].as_u64().unwrap() as usize;
        // The last interval is left out: infinite, it is no factor to divide by.
        let delta = to_host(ray.0.samples.delta.clone());
        let sigma: Vec<f64> = (0..count - 1).map(|i| tau[i] / f64::from(delta[i])).collect();
        let want = floats(&fixture["ray0_coarse_sigma"]["f64"]);
        compare(&sigma, &want[..count - 1], SIGMA_TOLERANCE, "coarse density");
    }
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    for device in infonerf_tests::devices() {
        check(&device);
    }
}
