//! PixelNeRF at full size against PyTorch: torchvision's ResNet-34 read from a file, the MLP on pixel-aligned features, and
//! gradients back into the encoder.
//!
//! `fixtures/pixelnerf.py` made the expected values; its head states the rule that gives every weight.

use std::path::Path;

use burn::tensor::Device;
use infonerf_field::{
    DensityActivation, EncoderConfig, Extent, Field, FieldConfig, FieldSpec, PixelNerfConfig, Points, RadianceField,
    Sources,
};
use infonerf_ops::{Segments, to_host, upload_rows};
use infonerf_schedule::Moment;
use infonerf_tests::{
    TOLERANCE, compare_within, fixture, gradients_of_rank, hashed, numbers, triple, whole, wholes, with_parameters,
    write_weights,
};
use serde_json::Value;

use crate::{setup, source_view};

const STAGES: [usize; 3] = [3, 4, 6];
const BLOCKS: usize = 5;
const POOL_AFTER: usize = 3;

/// Returns names and shapes that torchvision gives the tensors up to layer3, in order.
fn tensors() -> Vec<(String, Vec<usize>)> {
    let mut all = Vec::new();
    let mut layer = |convolution: String, normalisation: String, shape: [usize; 4]| {
        all.push((format!("{convolution}.weight"), shape.to_vec()));
        for name in ["weight", "bias", "running_mean", "running_var"] {
            all.push((format!("{normalisation}.{name}"), vec![shape[0]]));
        }
    };
    layer("conv1".into(), "bn1".into(), [64, 3, 7, 7]);
    for (stage, count) in STAGES.into_iter().enumerate() {
        let outputs = 64 << stage;
        for block in 0..count {
            let at = format!("layer{}.{block}", stage + 1);
            let shrinks = stage > 0 && block == 0;
            let inputs = if shrinks { outputs / 2 } else { outputs };
            layer(format!("{at}.conv1"), format!("{at}.bn1"), [outputs, inputs, 3, 3]);
            layer(format!("{at}.conv2"), format!("{at}.bn2"), [outputs, outputs, 3, 3]);
            if shrinks {
                layer(format!("{at}.downsample.0"), format!("{at}.downsample.1"), [outputs, inputs, 1, 1]);
            }
        }
    }
    all
}

/// Writes the encoder's weights under torchvision's names.
fn write_resnet34(path: &Path) {
    write_weights(path, &tensors(), |name, shape, u| match shape {
        [_, inputs, height, width] => (6.0 / (inputs * height * width) as f64).sqrt() * u,
        _ if name.ends_with("running_mean") || name.ends_with("bias") => 0.1 * u,
        _ if name.ends_with("running_var") => 1.0 + 0.5 * u,
        _ => (if name.contains(".bn2.") { 0.5 } else { 1.0 }) * (1.0 + 0.2 * u),
    });
}

/// Returns parameter `visited` of the MLP by the fixture's rule, which counts from `tensors` on.
fn mlp_rule(tensors: usize, visited: usize, shape: &[usize]) -> Vec<f32> {
    // The layers are the input layer, the feature layers side by side, the blocks, and the output layer.
    let layer = visited / 2;
    let last = 2 + 2 * BLOCKS;
    let parts = if layer == 1 { POOL_AFTER } else { 1 };
    let gain = match layer {
        layer if layer == last => -0.25,
        layer if layer >= 2 && layer % 2 == 1 => 0.5,
        _ => 2f64.sqrt(),
    };
    // The rule counts the feature layers separately, while they are one layer here.
    let first = tensors + 2 * layer + if layer > 1 { 2 * (POOL_AFTER - 1) } else { 0 };
    let width = shape[shape.len() - 1];
    let outputs = width / parts;
    let value = |n: usize| {
        let (input, part, output) = (n / width, n % width / outputs, n % outputs);
        match *shape {
            [inputs, _] => gain * (3.0 / inputs as f64).sqrt() * hashed(first + 2 * part, output * inputs + input),
            _ => 0.1 * hashed(first + 2 * part + 1, output),
        }
    };
    (0..shape.iter().product()).map(|n| value(n) as f32).collect()
}

fn config(encoder: EncoderConfig) -> PixelNerfConfig {
    let (blocks, pool_after, density) = (BLOCKS, POOL_AFTER, DensityActivation::Relu);
    PixelNerfConfig { encoder, blocks, pool_after, width: 512, frequencies: 6, lowest_frequency: 1.5, density }
}

fn field(weights: &Path, device: &Device) -> RadianceField {
    let config = config(EncoderConfig { width: 64, blocks: STAGES.to_vec(), weights: weights.to_owned() });
    let tensors = tensors().len();
    // Five tensors of the file (convolution and normalisation) become a weight and a bias.
    let encoder = tensors / 5 * 2;
    let field = FieldConfig::PixelNerf(config).build(&setup(device)).unwrap();
    let (field, parameters) =
        with_parameters(field, |l, shape| (l >= encoder).then(|| mlp_rule(tensors, l - encoder, shape)));
    assert_eq!(parameters, encoder + 2 * (3 + 2 * BLOCKS));
    field
}

fn sources(fixture: &Value) -> Sources {
    let size = ["width", "height"].map(|key| whole(&fixture[key]));
    let focal = fixture["focal"].as_f64().unwrap() as f32;
    let view = |(index, matrix): (usize, &[f32])| {
        let to_camera = [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| matrix[4 * row + column]));
        source_view(index, size, focal, to_camera)
    };
    let views = numbers(&fixture["to_camera"]).chunks(12).enumerate().map(view).collect();
    Sources { views, middle: triple(&fixture["middle"]) }
}

/// Compares relative to the larger of 1 and the value; density reaches 6, gradients 0.4.
fn compare(got: &[f32], want: &Value, what: &str) {
    compare_within(got, &numbers(want), |want| TOLERANCE * want.abs().max(1.0), what);
}

/// Checks every device but the older CPU backend, which takes a minute for convolutions of this size.
#[test]
#[allow(deprecated, reason = "the name of the older backend")]
fn agrees_with_pytorch() {
    let fixture = &fixture("pixelnerf");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("resnet34.safetensors");
    write_resnet34(&path);
    for device in infonerf_tests::devices().into_iter().filter(|device| *device != Device::ndarray()) {
        let field = field(&path, &device.autodiff());
        let sources = sources(fixture);
        let (positions, directions) = (numbers(&fixture["points"]), numbers(&fixture["directions"]));
        let counts = wholes(&fixture["counts"]);
        let firsts = counts.iter().scan(0, |sum, count| Some(std::mem::replace(sum, *sum + count)));
        let directions: Vec<f32> = firsts.flat_map(|first| directions[3 * first..3 * first + 3].to_vec()).collect();
        let [positions, directions] = [positions, directions].map(|rows| upload_rows(&rows, 3, &field.device()));
        let (segments, extent) = (Segments::from_counts(counts.clone()), Extent::Ball { variance: 0.0 });
        let points = Points { positions, directions, segments, extent };
        let sampled = field.conditioned(&sources, None).evaluate(&points, true, Moment::END);
        let color = sampled.color.unwrap();
        let gradients = (color.clone().sum() + sampled.sigma.clone().sum()).backward();
        compare(&to_host(color), &fixture["rgb"], "colour");
        compare(&to_host(sampled.sigma), &fixture["sigma"], "density");

        let biases = gradients_of_rank(1, &field, &gradients);
        compare(&biases[0], &fixture["grad_stem_bias"], "gradient of the stem's bias");
        let last = &biases[tensors().len() / 5 - 1];
        compare(last, &fixture["grad_last_bias"], "gradient of the last convolution's bias");
    }
}

#[test]
fn a_file_without_the_weights_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let fault = |name: &str, width: usize| {
        let encoder = EncoderConfig { width, blocks: vec![1], weights: folder.path().join(name) };
        FieldConfig::PixelNerf(config(encoder)).build(&setup(&Device::flex())).unwrap_err().to_string()
    };
    std::fs::write(folder.path().join("text"), "no weights").unwrap();
    write_weights(&folder.path().join("other"), &[("bias".to_owned(), vec![1])], |_, _, u| u);
    write_resnet34(&folder.path().join("good"));
    for (name, width, part) in [
        ("absent", 64, "No such file"),
        ("text", 64, "no safetensors file"),
        ("other", 64, "no tensor `conv1.weight`"),
        ("good", 8, "`conv1.weight` is F32 [64, 3, 7, 7], not F32 [8, 3, 7, 7]"),
    ] {
        let message = fault(name, width);
        assert!(message.starts_with("field.encoder.weights: expected a file of the tensors"), "{message}");
        assert!(message.contains(part) && message.contains(name), "{message}");
        assert_eq!(message.lines().count(), 1);
    }
}
