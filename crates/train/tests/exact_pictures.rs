//! Error of pictures that is due to the samples that they skip.

use crate::common::steps;
use burn::tensor::Device;
use infonerf_render::{Renderer, render_image};
use infonerf_scene::{SceneRequest, TestProtocol};
use infonerf_train::{Config, Preset, Trainer};

/// Compares rays that stop early, and take longer steps through thin fog, with rays of all samples.
#[test]
#[allow(clippy::print_stdout, reason = "the figures of docs/numerics.md")]
fn pictures_are_within_60_db_of_exact_ones() {
    for name in ["crane", "castle", "knot", "orrery"] {
        let mut config = Config::of(Preset::Fast, ["train.iterations=300"]).unwrap();
        let request = SceneRequest { test: TestProtocol::First(2), ..SceneRequest::default() };
        let scene = infonerf_procedural::load(name, &request).unwrap();
        let mut trainer = Trainer::new(&config, scene, 0, None, &Device::flex()).unwrap();
        steps(&mut trainer, 300);
        let trained = [trainer.trained()];
        config.render.early_stop_transmittance = 0.0;
        let exact = Renderer::new(&config.render, trainer.scene());
        let (mut squares, mut samples, mut evaluated) = (Vec::new(), 0, [0; 2]);
        for view in &trainer.scene().test {
            let pictures = [&exact, trainer.renderer()].map(|by| render_image(by, &trained, &view.camera));
            let [exact, picture] = pictures.each_ref().map(|picture| picture.rgb.as_flattened());
            squares.push(exact.iter().zip(picture).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>());
            samples += exact.len();
            (0..2).for_each(|i| evaluated[i] += pictures[i].counts.evaluated);
        }
        let decibels = -10.0 * (squares.iter().sum::<f64>() / samples as f64).log10();
        println!("{name}: {decibels:.1} dB, {} in place of {} samples", evaluated[1], evaluated[0]);
        assert!(decibels >= 60.0 && 4 * evaluated[1] < 3 * evaluated[0], "{name}: {decibels} dB, {evaluated:?}");
    }
}
