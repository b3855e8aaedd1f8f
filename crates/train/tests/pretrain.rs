//! Learning from many scenes, starting from pre-trained weights, and learning from a single view.

use std::sync::Arc;

use crate::common::{config, configs, losses, pixel_config, scene_of, steps, trainer};
use burn::tensor::Device;
use infonerf_render::TrainedModel;
use infonerf_scene::Scene;
use infonerf_train::{Config, TestView, Trainer, evaluate_view};

fn scenes() -> Vec<Arc<Scene>> {
    ["random-1", "random-2", "random-3"].map(|name| scene_of(name, 4, 16)).into()
}

/// Returns a config for many scenes: L_RGB alone, and no occupancy grid, which belongs to one scene.
fn lesson_config(settings: &[&str]) -> Config {
    let off = ["render.occupancy.enabled=false", "loss.entropy.weight=0", "loss.kl.weight=0"];
    pixel_config(&[&off, settings].concat())
}

/// Renders a trainer's first test view, nothing skipped.
fn shown(trainer: &Trainer) -> TestView {
    let trained = TrainedModel { occupancy: None, ..trainer.trained() };
    evaluate_view(trainer.renderer(), &[trained], &trainer.scene().test[0]).unwrap()
}

fn picture(trainer: &Trainer) -> Vec<[f32; 3]> {
    shown(trainer).image.rgb
}

#[test]
fn pretrained_weights_help_on_a_new_scene() {
    let learning = lesson_config(&["train.iterations=150", "train.rays=64", "train.lr=3e-3"]);
    let mut pretrainer = Trainer::on_scenes(&learning, scenes(), 1, &Device::flex()).unwrap();
    let losses: Vec<f32> = losses(&mut pretrainer, 150).into_iter().map(|(_, loss)| loss).collect();
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    assert!(mean(&losses[130..]) < 0.6 * mean(&losses[..20]), "{losses:?}");

    let run = tempfile::tempdir().unwrap();
    pretrainer.checkpoint(&mut |_| ()).unwrap().save(run.path()).unwrap();
    let init = format!("train.init={:?}", run.path());
    let psnr = |config: &Config| {
        let trainer = Trainer::new(config, scene_of("random-9", 1, 16), 0, None, &Device::flex()).unwrap();
        shown(&trainer).value("psnr").unwrap()
    };
    let (fresh, taught) = (psnr(&pixel_config(&[])), psnr(&pixel_config(&[&init])));
    assert!(taught > fresh + 1.0, "{taught} dB from weights learned on other scenes, {fresh} dB from random ones");
}

#[test]
fn run_begins_with_the_weights_of_train_init() {
    let run = tempfile::tempdir().unwrap();
    let mut first = trainer(&pixel_config(&[]), 1, &Device::flex());
    steps(&mut first, 3);
    first.checkpoint(&mut |_| ()).unwrap().save(run.path()).unwrap();
    let init = format!("train.init={:?}", run.path());
    let second = trainer(&pixel_config(&[&init]), 2, &Device::flex());
    assert_eq!(picture(&second), picture(&first));
    assert_ne!(picture(&trainer(&pixel_config(&[]), 2, &Device::flex())), picture(&first));
}

#[test]
fn weights_of_another_shape_are_refused() {
    let run = tempfile::tempdir().unwrap();
    let fault = |config: &Config| {
        let trainer = Trainer::new(config, scene_of("knot", 1, 16), 0, None, &Device::flex());
        trainer.err().expect("a fault").to_string()
    };
    let init = format!("train.init={:?}", run.path());
    let message = fault(&pixel_config(&[&init]));
    assert!(message.starts_with("train.init: ") && message.contains("infonerf pretrain"), "{message}");
    trainer(&pixel_config(&[]), 1, &Device::flex()).checkpoint(&mut |_| ()).unwrap().save(run.path()).unwrap();
    for config in [pixel_config(&[&init, "field.width=12"]), config(&[&init])] {
        let message = fault(&config);
        assert!(message.starts_with("train.init: ") && message.lines().count() == 1, "{message}");
    }
}

#[test]
fn config_of_one_scene_cannot_learn_from_many() {
    let fault = |config: &Config, scenes| {
        Trainer::on_scenes(config, scenes, 0, &Device::flex()).err().expect("a fault").to_string()
    };
    for (config, key) in [
        (config(&[]), "field.kind: expected `pixelnerf`"),
        (pixel_config(&[]), "render.occupancy.enabled: "),
        (lesson_config(&["train.exposure_compensation=true"]), "train.exposure_compensation: "),
    ] {
        let message = fault(&config, scenes());
        assert!(message.starts_with(key), "{message}");
    }
    assert!(fault(&lesson_config(&[]), Vec::new()).starts_with("scenes: "));
}

#[test]
fn every_field_learns_from_one_view() {
    for config in configs() {
        let mut trainer = Trainer::new(&config, scene_of("knot", 1, 16), 0, None, &Device::flex()).unwrap();
        assert_eq!(steps(&mut trainer, 12).len(), 12);
        assert!(picture(&trainer).iter().flatten().all(|value| value.is_finite()));
    }
}
