//! A field of your own, trained with InfoNeRF's losses on a built-in scene from four views.
//!
//! ```text
//! cargo run --release --example own_field
//! ```

#![allow(clippy::print_stdout, reason = "an example shows what it computes")]

use std::path::Path;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::Device;
use burn::tensor::activation::{relu, sigmoid, softplus};
use infonerf_field::{Field, FieldOutput, Points};
use infonerf_metrics::to_rgb8;
use infonerf_ops::frequency_encode;
use infonerf_procedural::load;
use infonerf_report::save_png;
use infonerf_scene::SceneRequest;
use infonerf_schedule::Moment;
use infonerf_train::{Config, Outcome, Preset, Trainer, evaluate_view};

const FREQUENCIES: usize = 6;
const WIDTH: usize = 48;

/// A small MLP whose colour does not depend on the view direction.
#[derive(Module, Debug)]
struct DiffuseMlp {
    first: Linear,
    second: Linear,
    last: Linear,
}

impl DiffuseMlp {
    fn new(device: &Device) -> Self {
        let linear = |from, to| LinearConfig::new(from, to).init(device);
        Self { first: linear(3 + 6 * FREQUENCIES, WIDTH), second: linear(WIDTH, WIDTH), last: linear(WIDTH, 4) }
    }
}

impl Field for DiffuseMlp {
    fn evaluate(&self, points: &Points, color: bool, _at: Moment) -> FieldOutput {
        let position = frequency_encode(points.positions.clone(), FREQUENCIES, &[]);
        let hidden = relu(self.second.forward(relu(self.first.forward(position))));
        let out = self.last.forward(hidden);
        FieldOutput {
            sigma: softplus(out.clone().narrow(1, 0, 1).squeeze_dim::<1>(1) * 10.0, 1.0),
            color: color.then(|| sigmoid(out.narrow(1, 1, 3))),
        }
    }

    fn device(&self) -> Device {
        self.last.weight.val().device()
    }
}

fn main() -> anyhow::Result<()> {
    // The fast preset's sampler and skipping, with L_RGB and the paper's entropy alone.
    let settings = ["loss.silhouette.weight=0", "loss.tv.weight=0", "train.iterations=400"];
    let config = Config::of(Preset::Fast, settings)?;
    let request = SceneRequest { image_size: Some(100), ..SceneRequest::default() };
    let scene = load("castle", &request)?;
    let device = Device::flex();
    let mut trainer = Trainer::with_field(&config, scene, 0, None, &device, |seed, device| {
        device.seed(seed);
        DiffuseMlp::new(device)
    })?;
    while trainer.step(&mut |_event| ())? == Outcome::Running {}

    let seen = evaluate_view(trainer.renderer(), &[trainer.trained()], &trainer.scene().test[0])?;
    println!("{:.2} dB on a view that it was not trained on", seen.value("psnr").unwrap_or_default());
    let picture = to_rgb8(&seen.image.rgb, seen.image.width, seen.image.height)?;
    Ok(save_png(&picture, Path::new("own_field.png"))?)
}
