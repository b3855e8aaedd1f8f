//! NeRF and mip-NeRF at full size against renderings of the same rays with the same weights, by PyTorch and by JAX.
//!
//! `fixtures/nerf_forward.py` and `fixtures/mip_forward.py` made the expected values; their heads state the rules of the weights.

use burn::tensor::{Device, Tensor};
use infonerf_field::{FieldSetup, FieldSpec, RadianceField};
use infonerf_ops::{
    RayGaussians, frustum_gaussians, integrated_encode, ray_divergence, ray_entropy, to_host, upload_rows,
};
use infonerf_render::{Model, RenderOutput, RenderRequest, Renderer};
use infonerf_scene::{Ray, Scene};
use infonerf_schedule::Moment;
use infonerf_tests::{TOLERANCE, compare_within, fixture, floats, numbers, space, triple, with_parameters};
use infonerf_train::{Config, Preset};
use serde_json::{Value, json};

/// Tolerance of the coarse network's raw density, which reaches 8 here.
const SIGMA_TOLERANCE: f64 = 5e-4;
/// Tolerance of weights: the rule's sine in `f64` may differ in the last place between libraries.
const WEIGHT_TOLERANCE: f64 = 1e-7;

/// Layers in the module's order: trunk, density, feature, view, colour.
const LAYERS: usize = 12;
const FREQUENCIES: usize = 10;
const HALF_EDGE: f32 = 6.0;
const REQUEST: RenderRequest = RenderRequest { color: true, hidden: true };

/// Returns the config of the published network and sampling, without jitter.
fn config(settings: &[&str]) -> Config {
    Config::of(Preset::Paper, settings).unwrap()
}

/// Builds the config's field with the parameters that `rule` gives by position and shape.
fn network(config: &Config, device: &Device, rule: impl Fn(usize, &[usize]) -> Vec<f32>) -> RadianceField {
    let setup = FieldSetup { bounds: [[-HALF_EDGE; 3], [HALF_EDGE; 3]], seed: 0, device, body: None };
    let field = config.field.build(&setup).unwrap();
    let (field, parameters) = with_parameters(field, |l, shape| Some(rule(l, shape)));
    assert_eq!(parameters, 2 * LAYERS);
    field
}

/// Makes a renderer whose numbers of samples are those that the fixture has under `keys`.
fn renderer(fixture: &Value, config: &Config, keys: [&str; 2]) -> Renderer {
    let render = &config.render;
    assert_eq!(fixture[keys[0]].as_f64(), Some(render.samples.largest()));
    assert_eq!(fixture[keys[1]], render.fine_samples);
    let scene = Scene { name: "fixture".into(), space: space(fixture, HALF_EDGE), ..Scene::default() };
    Renderer::new(render, &scene)
}

fn rows(fixture: &Value) -> &[Value] {
    fixture["rays"].as_array().unwrap()
}

fn compare<A: Copy + Into<f64>>(got: &[A], want: &Value, what: &str) {
    compare_within(got, &floats(want), |_| TOLERANCE, what);
}

/// Compares colour, depth, opacity and entropy of a ray with those of `want` that it has.
fn compare_output(output: &RenderOutput, epsilon: f32, ray: usize, want: &Value, what: &str) {
    compare(&to_host(output.color.clone().unwrap().narrow(0, ray, 1)), &want["color"], &format!("{what}, colour"));
    let entropy = ray_entropy(output.tau.clone(), output.segments(), epsilon).bits;
    for (name, tensor) in [("depth", &output.depth), ("acc", &output.acc), ("entropy", &entropy)] {
        if let Some(want) = want.get(name) {
            compare(&to_host(tensor.clone().narrow(0, ray, 1)), want, &format!("{what}, {name}"));
        }
    }
}

/// Returns weight or bias of a layer by a fixture's rule: sines of the phases of output and input, which count from 1.
fn by_rule(
    fixture: &Value,
    layer: usize,
    shape: &[usize],
    weight_phase: impl Fn(f64, f64) -> f64,
    bias_phase: impl Fn(f64) -> f64,
) -> Vec<f32> {
    let [gain, bias] = ["gain", "bias0"].map(|key| fixture[key][layer].as_f64().unwrap());
    match *shape {
        // Burn keeps weights as [inputs, outputs], PyTorch the other way round.
        [inputs, outputs] => {
            let phase = |n: usize| weight_phase((n % outputs + 1) as f64, (n / outputs + 1) as f64);
            let weight = |n| (gain * (3.0 / inputs as f64).sqrt() * phase(n).sin()) as f32;
            (0..inputs * outputs).map(weight).collect()
        }
        [outputs] => (1..=outputs).map(|o| (bias + 0.1 * bias_phase(o as f64).sin()) as f32).collect(),
        ref other => panic!("a parameter of shape {other:?}"),
    }
}

/// Returns parameter `l` (weight and bias of each layer in turn) of NeRF's coarse (0) or fine (1) network, a few elements checked.
fn nerf_rule(fixture: &Value, net: usize, l: usize, shape: &[usize]) -> Vec<f32> {
    let layer = l / 2;
    let cross = fixture["cross"].as_f64().unwrap();
    let [at_layer, at_net] = [(layer + 1) as f64, net as f64];
    let weight = |o, i| 1.0 + 12.9898 * o + 78.233 * i + 37.719 * at_layer + 93.989 * at_net + cross * (o * i);
    let bias = |o| 0.5 + 4.1414 * o + 3.7 * at_layer + 1.9 * at_net;
    let mut values = by_rule(fixture, layer, shape, weight, bias);
    let (probes, last) = (&fixture["weight_probes"][net * LAYERS + layer], values.len() - 1);
    let probed = if let [inputs, outputs] = *shape {
        assert_eq!((l % 2, &probes["shape"]), (0, &json!([outputs, inputs])), "layer {layer}");
        // Weights are multiplied by 2^(−k/2) where layers 0 and 5 read frequency k of the encoded position.
        let read = if layer == 0 || layer == 5 { FREQUENCIES } else { 0 };
        for (n, value) in values.iter_mut().enumerate() {
            if let Some(k) = (n / outputs).checked_sub(3).map(|i| i / 6).filter(|k| *k < read) {
                *value = (f64::from(*value) * 2f64.powf(-0.5 * k as f64)) as f32;
            }
        }
        vec![("w_first", 0), ("w_0_last", (inputs - 1) * outputs), ("w_last_0", outputs - 1), ("w_last", last)]
    } else {
        assert_eq!(l % 2, 1, "a weight, then its bias");
        vec![("b_first", 0), ("b_last", last)]
    };
    for (key, n) in probed {
        compare_within(&[values[n]], &floats(&probes[key]), |_| WEIGHT_TOLERANCE, &format!("layer {layer}, {key}"));
    }
    values
}

fn check_nerf(device: &Device) {
    let fixture = &fixture("nerf_forward");
    let network = |net| network(&config(&[]), device, |l, shape| nerf_rule(fixture, net, l, shape));
    let model = Model { coarse: Some(network(0)), ..Model::of(network(1)) };
    let epsilon = fixture["eps"].as_f64().unwrap() as f32;
    for last_interval in ["finite", "infinite"] {
        let config = config(&[&format!("render.last_interval={last_interval}")]);
        let renderer = renderer(fixture, &config, ["n_coarse", "n_fine"]);
        let render = |origin: &str, direction: &str| {
            let ray = |row: &Value| Ray::new(triple(&row[origin]).into(), triple(&row[direction]).into());
            let rays = renderer.rays(rows(fixture).iter().map(ray).collect(), device);
            let passes = renderer.render(&model, &rays, REQUEST, None, Moment::END);
            (passes.coarse.unwrap(), passes.fine)
        };
        let ray = render("origin", "dir");
        let near = render("near_origin", "near_dir");
        let divergence = |p: &RenderOutput, q: &RenderOutput| {
            to_host(ray_divergence(p.tau.clone(), q.tau.clone(), &ray.1.samples.segments, epsilon))
        };
        let (forward, backward) = (divergence(&ray.1, &near.1), divergence(&near.1, &ray.1));
        for (index, row) in rows(fixture).iter().enumerate() {
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
                let want = if defined { &expected[key] } else { &json!(0.0) };
                compare(&got[index..=index], want, &format!("{last_interval}, {key} {index}"));
            }
        }
        // The last interval is left out, since an infinite length cannot be divided by.
        let (tau, delta) = (to_host(ray.0.tau.clone()), to_host(ray.0.samples.delta.clone()));
        let mut want = floats(&fixture["ray0_coarse_sigma"]["f64"]);
        want.pop();
        let sigma: Vec<f64> = (0..want.len()).map(|i| f64::from(tau[i]) / f64::from(delta[i])).collect();
        assert_eq!(fixture["n_coarse"], want.len() + 1);
        compare_within(&sigma, &want, |_| SIGMA_TOLERANCE, "coarse density");
    }
}

#[test]
fn nerf_agrees_with_pytorch_on_every_device() {
    infonerf_tests::devices().iter().for_each(check_nerf);
}

/// Compares with relative errors, since variances span many orders of magnitude.
fn compare_relative(got: &[f32], want: &[f64], what: &str) {
    compare_within(got, want, |want| TOLERANCE * want.abs(), what);
}

#[test]
fn frusta_and_their_encoding_agree_with_jax() {
    let fixture = fixture("mip_forward");
    for (index, row) in fixture["frusta"].as_array().unwrap().iter().enumerate() {
        let [t0, t1, radius] = ["t0", "t1", "radius"].map(|key| row[key].as_f64().unwrap());
        let [t, delta, radii] =
            [0.5 * (t0 + t1), t1 - t0, radius].map(|number| Tensor::from_floats([number as f32], &Device::flex()));
        let RayGaussians { mean, along, across } = frustum_gaussians(t, delta, radii);
        let [mean, along, across] = [mean, along, across].map(|tensor| to_host(tensor)[0]);
        compare_relative(&[mean, along, across], &floats(&row["moments"]), &format!("frustum {index}"));
        // Features are those of the stored Gaussian. Far slices have none, as f32 does not resolve the highest frequency's phase.
        let found = triple(&fixture["direction"]).map(|d| along * d * d + across * (1.0 - d * d));
        compare_relative(&found, &floats(&row["variance"]), &format!("frustum {index}, variance"));
        if t0 < 10.0 {
            let [mean, variance] = ["mean", "variance"].map(|key| upload_rows(&numbers(&row[key]), 3, &Device::flex()));
            let features = to_host(integrated_encode(mean, variance, 16, &[]));
            compare(&features, &row["features"], &format!("frustum {index}, features"));
        }
    }
}

/// Returns parameter `l` of mip-NeRF by the fixture's rule: the weight or bias of layer ⌊l/2⌋.
fn mip_rule(fixture: &Value, l: usize, shape: &[usize]) -> Vec<f32> {
    let at_layer = (l / 2 + 1) as f64;
    let weight = |o, i| 1.0 + 12.9898 * o + 78.233 * i + 37.719 * at_layer + 2.399_963_2 * o * i;
    by_rule(fixture, l / 2, shape, weight, |o| 0.5 + 4.1414 * o + 3.7 * at_layer)
}

/// Compares everything that the fixture holds, with one network for both passes.
#[test]
fn mip_nerf_agrees_with_jax_on_every_device() {
    let fixture = &fixture("mip_forward");
    let field =
        "field={kind=\"mip\",layers=8,width=256,skip=5,position_frequencies=16,direction_frequencies=4,detail=1.0}";
    let config = config(&[field, "render.samples=128", "render.fine_samples=128", "render.placement=interval"]);
    let renderer = renderer(fixture, &config, ["coarse", "fine"]);
    let ray = |row: &Value| {
        let [origin, direction] = ["origin", "direction"].map(|key| triple(&row[key]).into());
        Ray { origin, direction, radius: numbers(&row["radius"])[0], cosine: 1.0 }
    };
    for device in &infonerf_tests::devices() {
        let model = Model::of(network(&config, device, |l, shape| mip_rule(fixture, l, shape)));
        let rays = renderer.rays(rows(fixture).iter().map(ray).collect(), device);
        let passes = renderer.render(&model, &rays, REQUEST, None, Moment::END);
        let (coarse, fine) = (passes.coarse.unwrap(), passes.fine);
        let (t, delta) = (fine.samples.t(), to_host(fine.samples.delta.clone()));
        for (index, row) in rows(fixture).iter().enumerate() {
            let range = fine.samples.segments.range(index);
            let last = range.end - 1;
            let edges = range.map(|i| t[i] - 0.5 * delta[i]).chain([t[last] + 0.5 * delta[last]]);
            compare(&edges.collect::<Vec<f32>>(), &row["edges"], &format!("ray {index}, edges"));
            compare_output(&fine, 0.0, index, &row["fine"], &format!("ray {index}, fine"));
            compare_output(&coarse, 0.0, index, &row["coarse"], &format!("ray {index}, coarse"));
        }
    }
}
