//! mip-NeRF at full size against a JAX rendering of the same rays with the same weights.
//!
//! `fixtures/mip_forward.py` made the expected values; its head states the rule that gives every weight.

use burn::tensor::{Device, Tensor};
use glam::Vec3;
use infonerf_field::{FieldSetup, FieldSpec};
use infonerf_ops::{
    RayDistribution, RayGaussians, from_host, frustum_gaussians, integrated_encode, ray_entropy, to_host,
};
use infonerf_render::{Model, RenderOutput, RenderRequest, Renderer};
use infonerf_scene::{Aabb, Range, Ray, Scene, Space};
use infonerf_schedule::Moment;
use infonerf_tests::{fixture, with_parameters};
use infonerf_train::{Config, Preset};
use serde_json::Value;

const TOLERANCE: f64 = 1e-4;
/// Number of layers: trunk, density, feature, view, colour.
const LAYERS: usize = 12;

fn floats(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().map(|x| x.as_f64().unwrap()).collect(),
        single => vec![single.as_f64().unwrap()],
    }
}

fn float(value: &Value) -> f32 {
    value.as_f64().unwrap() as f32
}

fn vector(value: &Value) -> Vec3 {
    let [x, y, z] = floats(value)[..] else { panic!("three numbers") };
    Vec3::new(x as f32, y as f32, z as f32)
}

fn compare(got: &[f32], want: &Value, what: &str) {
    let want = floats(want);
    assert_eq!(got.len(), want.len(), "{what}");
    for (got, want) in got.iter().zip(want) {
        assert!((f64::from(*got) - want).abs() <= TOLERANCE, "{what}: {got} against {want}");
    }
}

/// Compares with relative errors, since variances span many orders of magnitude.
fn compare_relative(got: f32, want: f64, what: &str) {
    assert!((f64::from(got) - want).abs() <= TOLERANCE * want.abs(), "{what}: {got} against {want}");
}

/// Returns parameter `l` by the fixture's rule: the weight or bias of layer ⌊l/2⌋.
fn rule(fixture: &Value, l: usize, shape: &[usize]) -> Vec<f32> {
    let layer = l / 2;
    let [gain, bias] = ["gain", "bias0"].map(|key| fixture[key][layer].as_f64().unwrap());
    let phase = |n: usize, factor: f64| factor * (n + 1) as f64;
    match *shape {
        [inputs, outputs] => {
            let weight = |n: usize| {
                let (o, i) = (n % outputs, n / outputs);
                let cross = phase(o, 2.399_963_2) * phase(i, 1.0);
                let phase = 1.0 + phase(o, 12.9898) + phase(i, 78.233) + phase(layer, 37.719) + cross;
                (gain * (3.0 / inputs as f64).sqrt() * phase.sin()) as f32
            };
            (0..inputs * outputs).map(weight).collect()
        }
        [outputs] => {
            let value = |o| (bias + 0.1 * (0.5 + phase(o, 4.1414) + phase(layer, 3.7)).sin()) as f32;
            (0..outputs).map(value).collect()
        }
        ref other => panic!("a parameter of shape {other:?}"),
    }
}

/// Config of mip-NeRF as in its paper, without jitter.
fn config() -> Config {
    let field =
        "field={kind=\"mip\",layers=8,width=256,skip=5,position_frequencies=16,direction_frequencies=4,detail=1.0}";
    let settings = [field, "render.samples=128", "render.fine_samples=128", "render.placement=interval"];
    Config::of(Preset::Paper, settings).unwrap()
}

const HALF_EDGE: f32 = 6.0;

fn renderer(fixture: &Value) -> Renderer {
    let (near, far) = (float(&fixture["near"]), float(&fixture["far"]));
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
    let render = config().render;
    assert_eq!(fixture["coarse"].as_f64(), Some(render.samples.largest()));
    assert_eq!(fixture["fine"], render.fine_samples);
    Renderer::new(&render, &scene)
}

fn compare_output(output: &RenderOutput, ray: usize, want: &Value, what: &str) {
    let row = |tensor: Tensor<1>| to_host(tensor.narrow(0, ray, 1));
    let color = to_host(output.color.clone().unwrap().narrow(0, ray, 1));
    compare(&color, &want["color"], &format!("{what}, colour"));
    compare(&row(output.depth.clone()), &want["depth"], &format!("{what}, depth"));
    compare(&row(output.acc.clone()), &want["acc"], &format!("{what}, acc"));
    let entropy = ray_entropy(output.tau.clone(), output.segments(), RayDistribution::Alpha, 0.0);
    compare(&row(entropy.bits), &want["entropy"], &format!("{what}, entropy"));
}

#[test]
fn frusta_and_their_encoding_agree_with_jax() {
    let fixture = fixture("mip_forward");
    let direction = vector(&fixture["direction"]);
    for (index, row) in fixture["frusta"].as_array().unwrap().iter().enumerate() {
        let [t0, t1, radius] = ["t0", "t1", "radius"].map(|key| row[key].as_f64().unwrap());
        let [t, delta, radii] =
            [0.5 * (t0 + t1), t1 - t0, radius].map(|number| Tensor::from_floats([number as f32], &Device::flex()));
        let RayGaussians { mean, along, across } = frustum_gaussians(t, delta, radii);
        let [mean, along, across] = [mean, along, across].map(|tensor| to_host(tensor)[0]);
        for (got, want) in [mean, along, across].into_iter().zip(floats(&row["moments"])) {
            compare_relative(got, want, &format!("frustum {index}"));
        }
        // From the stored Gaussian: at 900 units f32 cannot even hold the phase of the highest frequency.
        let single = |key: &str| floats(&row[key]).into_iter().map(|x| x as f32).collect::<Vec<_>>();
        let (mean, variance) = (single("mean"), single("variance"));
        for (axis, d) in direction.to_array().into_iter().enumerate() {
            let want = along * d * d + across * (1.0 - d * d);
            compare_relative(want, variance[axis].into(), &format!("frustum {index}, variance"));
        }
        if t0 < 10.0 {
            let [mean, variance] = [&mean, &variance].map(|rows| from_host(rows, 3, &Device::flex()));
            let features = to_host(integrated_encode(mean, variance, 16, &[]));
            compare(&features, &row["features"], &format!("frustum {index}, features"));
        }
    }
}

fn check(device: &Device) {
    let fixture = &fixture("mip_forward");
    let setup = FieldSetup { bounds: [[-HALF_EDGE; 3], [HALF_EDGE; 3]], seed: 0, device, body: None };
    let field = config().field.build(&setup).unwrap();
    let (field, parameters) = with_parameters(field, |l, shape| Some(rule(fixture, l, shape)));
    assert_eq!(parameters, 2 * LAYERS);
    // One network for both passes.
    let model = Model::of(field);
    let rows = fixture["rays"].as_array().unwrap();
    let ray = |row: &Value| Ray {
        origin: vector(&row["origin"]),
        direction: vector(&row["direction"]),
        radius: float(&row["radius"]),
        cosine: 1.0,
    };
    let rays: Vec<Ray> = rows.iter().map(ray).collect();
    let request = RenderRequest { color: true, hidden: true };
    let renderer = renderer(fixture);
    let rays = renderer.rays(rays, device);
    let passes = renderer.render(&model, &rays, request, None, Moment::END);
    let (coarse, fine) = (passes.coarse.unwrap(), passes.fine);
    let delta = to_host(fine.samples.delta.clone());
    for (index, row) in rows.iter().enumerate() {
        let range = fine.samples.segments.range(index);
        let mut edges: Vec<f32> = range.clone().map(|i| fine.samples.t()[i] - 0.5 * delta[i]).collect();
        edges.push(fine.samples.t()[range.end - 1] + 0.5 * delta[range.end - 1]);
        compare(&edges, &row["edges"], &format!("ray {index}, edges"));
        compare_output(&fine, index, &row["fine"], &format!("ray {index}, fine"));
        compare_output(&coarse, index, &row["coarse"], &format!("ray {index}, coarse"));
    }
}

#[test]
fn agrees_with_jax_on_every_device() {
    for device in infonerf_tests::devices() {
        check(&device);
    }
}
