//! Error of pictures that is due to the samples that they skip.

use crate::common::steps;
use burn::tensor::Device;
use infonerf_render::{Renderer, TrainedModel, render_image};
use infonerf_scene::{SceneRequest, TestProtocol};
use infonerf_train::{Config, Preset, Trainer};

/// Compares rays that stop early, and take longer steps through thin fog, with rays of all samples: in pictures of one
/// field, and of two that share the samples of the first.
#[test]
#[allow(clippy::print_stdout, reason = "the figures of docs/numerics.md")]
fn pictures_are_close_to_exact_ones() {
    let cases = [("crane", 1, 60.0), ("castle", 1, 60.0), ("knot", 1, 60.0), ("orrery", 1, 60.0), ("room", 2, 45.0)];
    for (name, fields, decibels) in cases {
        let mut config = Config::of(Preset::Fast, ["train.iterations=300"]).unwrap();
        let request = SceneRequest { test: TestProtocol::First(3 - fields), ..SceneRequest::default() };
        let scene = infonerf_procedural::load(name, &request).unwrap();
        let trained = |seed| {
            let mut trainer = Trainer::new(&config, scene.clone(), seed, None, &Device::flex()).unwrap();
            steps(&mut trainer, 300);
            trainer.trained()
        };
        let members: Vec<TrainedModel> = (0..fields as u64).map(trained).collect();
        let renderer = Renderer::new(&config.render, &scene);
        config.render.early_stop_transmittance = 0.0;
        let exact = Renderer::new(&config.render, &scene);
        let (mut squares, mut samples, mut evaluated) = (0.0, 0, [0; 2]);
        for view in &scene.test {
            let pictures = [&exact, &renderer].map(|by| render_image(by, &members, &view.camera));
            let [exact, picture] = pictures.each_ref().map(|picture| picture.rgb.as_flattened());
            squares += exact.iter().zip(picture).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            samples += exact.len();
            (0..2).for_each(|i| evaluated[i] += pictures[i].counts.evaluated);
        }
        let found = -10.0 * (squares / samples as f64).log10();
        println!("{name}, fields: {fields}: {found:.1} dB, {} in place of {} samples", evaluated[1], evaluated[0]);
        assert!(found >= decibels && 4 * evaluated[1] < 3 * evaluated[0], "{name}: {found} dB, {evaluated:?}");
    }
}
