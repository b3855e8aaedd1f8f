//! CLIP's image encoder against Hugging Face's, with the same weights: embeddings, and the gradient that a render gets.
//!
//! `fixtures/clip.py` made the expected values; its head states the rule that gives every weight.

use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_loss::semantic_loss;
use infonerf_ops::to_host;
use infonerf_pretrained::{ClipConfig, ClipVision};
use infonerf_procedural::load;
use infonerf_scene::{SceneRequest, TestProtocol};
use infonerf_tests::{TOLERANCE, compare_within, fixture, floats, picture, whole, write_weights};
use infonerf_train::{Config, Event, Preset, Trainer};
use serde_json::Value;

fn small(fixture: &Value) -> ClipConfig {
    let number = |key: &str| whole(&fixture["small"][key]);
    let [image, patch, width, hidden] = ["image_size", "patch_size", "hidden_size", "intermediate_size"].map(number);
    let [layers, heads, embedding] = ["num_hidden_layers", "num_attention_heads", "projection_dim"].map(number);
    ClipConfig { image, patch, width, layers, heads, hidden, embedding }
}

/// Returns names and shapes of the published file's tensors, in the order of the rule.
fn tensors(config: ClipConfig) -> Vec<(String, Vec<usize>)> {
    let ClipConfig { image, patch, width, hidden, .. } = config;
    let mut all = vec![
        ("vision_model.embeddings.class_embedding".to_owned(), vec![width]),
        ("vision_model.embeddings.patch_embedding.weight".to_owned(), vec![width, 3, patch, patch]),
        ("vision_model.embeddings.position_embedding.weight".to_owned(), vec![1 + (image / patch).pow(2), width]),
    ];
    let mut pair = |name: String, shape: &[usize]| {
        all.push((format!("{name}.weight"), shape.to_vec()));
        all.push((format!("{name}.bias"), vec![shape[0]]));
    };
    pair("vision_model.pre_layrnorm".into(), &[width]);
    for index in 0..config.layers {
        let at = format!("vision_model.encoder.layers.{index}");
        for part in ["k", "v", "q", "out"] {
            pair(format!("{at}.self_attn.{part}_proj"), &[width, width]);
        }
        pair(format!("{at}.layer_norm1"), &[width]);
        pair(format!("{at}.mlp.fc1"), &[hidden, width]);
        pair(format!("{at}.mlp.fc2"), &[width, hidden]);
        pair(format!("{at}.layer_norm2"), &[width]);
    }
    pair("vision_model.post_layernorm".into(), &[width]);
    all.push(("visual_projection.weight".into(), vec![config.embedding, width]));
    all
}

fn rule(name: &str, shape: &[usize], u: f64) -> f64 {
    match shape {
        _ if name.ends_with("class_embedding") || name.contains("position_embedding") => 0.5 * u,
        _ if name.ends_with("bias") => 0.1 * u,
        [_] => 1.0 + 0.2 * u,
        _ => (3.0 / shape[1..].iter().product::<usize>() as f64).sqrt() * u,
    }
}

fn encoder(path: &Path, config: ClipConfig, device: &Device) -> ClipVision {
    write_weights(path, &tensors(config), rule);
    ClipVision::read(path, config, device).unwrap()
}

/// Returns image `k` of the fixture with its height and width.
fn pictured(fixture: &Value, k: usize, device: &Device) -> (Tensor<2>, (usize, usize)) {
    let side = |i: usize| whole(&fixture["pictures"][k][i]);
    let (height, width) = (side(0), side(1));
    let pixels = picture(k, height * width).into_flattened();
    (Tensor::from_data(TensorData::new(pixels, [height * width, 3]), device), (height, width))
}

/// Compares embeddings, of unit length, or gradients, which reach 0.1.
fn compare<const D: usize>(got: Tensor<D>, want: &Value, what: &str) {
    compare_within(&to_host(got), &floats(want), |_| TOLERANCE, what);
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    let fixture = &fixture("clip");
    let folder = tempfile::tempdir().unwrap();
    for device in infonerf_tests::devices() {
        let device = &device.autodiff();
        let clip = encoder(&folder.path().join("clip"), small(fixture), device);
        let (first, size) = pictured(fixture, 0, device);
        let first = first.require_grad();
        let embedding = clip.embed(first.clone(), size);
        compare(embedding.clone(), &fixture["embeddings"][0], "enlarged");
        let (second, size) = pictured(fixture, 1, device);
        let target = clip.embed(second, size);
        compare(target.clone(), &fixture["embeddings"][1], "shrunk");
        let gradients = semantic_loss(embedding, target.detach()).backward();
        compare(first.grad(&gradients).unwrap(), &fixture["gradient"], "gradient");
    }
}

#[test]
#[ignore = "writes and reads 350 MB of weights"]
fn the_published_size_agrees_with_pytorch() {
    let fixture = &fixture("clip");
    let folder = tempfile::tempdir().unwrap();
    let device = Device::flex();
    let clip = encoder(&folder.path().join("clip"), ClipConfig::VIT_B_32, &device);
    let (first, size) = pictured(fixture, 0, &device);
    compare(clip.embed(first, size), &fixture["full"], "ViT-B/32");
}

#[test]
#[ignore = "writes and reads 350 MB of weights"]
fn a_run_trains_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip");
    encoder(&path, ClipConfig::VIT_B_32, &Device::flex());
    let request = SceneRequest { image_size: Some(32), test: TestProtocol::First(1), ..SceneRequest::default() };
    let train = |weight: f32| {
        let weights = format!("loss.semantic.weights={path:?}");
        let weight = format!("loss.semantic.weight={weight}");
        let settings = ["train.rays=64", "train.target_samples=2000", "loss.semantic.every=2", "loss.semantic.size=12"];
        let config = Config::of(Preset::Fast, settings.into_iter().chain([weights.as_str(), &weight])).unwrap();
        let scene = load("knot", &request).unwrap();
        let mut trainer = Trainer::new(&config, scene, 0, None, &Device::flex()).unwrap();
        let mut losses = Vec::new();
        for _ in 0..3 {
            let mut report = |event| {
                let Event::Step { loss, losses: terms, .. } = event else { panic!("{event:?}") };
                losses.push((loss, terms["rgb"]));
            };
            trainer.step(&mut report).unwrap();
        }
        losses
    };
    let (without, with) = (train(0.0), train(0.5));
    assert_eq!(with[0].1, without[0].1, "the first pixels are the same");
    let added = |step: usize| with[step].0 - without[step].0;
    assert!(added(0) > 1e-4 && added(0) < 1.0, "a distance on the sphere, halved: {}", added(0));
    assert_ne!(with[1].1, without[1].1, "its gradient reached the field");
}

#[test]
fn a_file_without_the_encoder_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other");
    let fault = |path: &Path| ClipVision::read(path, ClipConfig::VIT_B_32, &Device::flex()).err().unwrap();
    assert!(fault(&path).contains("No such file"));
    write_weights(&path, &[("bias".to_owned(), vec![1])], |_, _, u| u);
    let missing = fault(&path);
    assert!(missing.contains(": no tensor `vision_model.") && missing.contains("`, expected F32 ["), "{missing}");
}
