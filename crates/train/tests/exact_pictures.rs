//! Error of pictures that is due to the samples that they skip.

use crate::common::steps;
use burn::tensor::Device;
use infonerf_render::{Renderer, TrainedModel, render_image};
use infonerf_scene::{SceneRequest, TestProtocol};
use infonerf_train::{Config, Preset, Trainer};

/// Compares rays that stop early, and take longer steps through thin fog, with rays of all samples: in pictures of one
/// field, and of three that share the samples of the first.
#[test]
#[allow(clippy::print_stdout, reason = "the figures of docs/numerics.md")]
fn pictures_are_close_to_exact_ones() {
    for name in ["crane", "castle", "knot", "orrery"] {
        let mut config = Config::of(Preset::Fast, ["train.iterations=300"]).unwrap();
        let request = SceneRequest { test: TestProtocol::First(2), ..SceneRequest::default() };
        let scene = infonerf_procedural::load(name, &request).unwrap();
        let trainers = [0, 1, 2].map(|seed| {
            let mut trainer = Trainer::new(&config, scene.clone(), seed, None, &Device::flex()).unwrap();
            steps(&mut trainer, 300);
            trainer
        });
        let members: [TrainedModel; 3] = trainers.each_ref().map(Trainer::trained);
        config.render.early_stop_transmittance = 0.0;
        let exact = Renderer::new(&config.render, &scene);
        for (members, decibels, share) in [(&members[..1], 60.0, 0.75), (&members, 45.0, 0.6)] {
            let (mut squares, mut samples, mut evaluated) = (0.0, 0, [0; 2]);
            for view in &scene.test {
                let pictures = [&exact, trainers[0].renderer()].map(|by| render_image(by, members, &view.camera));
                let [exact, picture] = pictures.each_ref().map(|picture| picture.rgb.as_flattened());
                squares += exact.iter().zip(picture).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
                samples += exact.len();
                (0..2).for_each(|i| evaluated[i] += pictures[i].counts.evaluated);
            }
            let found = -10.0 * (squares / samples as f64).log10();
            let [all, some] = evaluated;
            println!("{name}, fields: {}: {found:.1} dB, {some} in place of {all} samples", members.len());
            assert!(found >= decibels && (some as f64) < share * all as f64, "{name}: {found} dB, {evaluated:?}");
        }
    }
}
