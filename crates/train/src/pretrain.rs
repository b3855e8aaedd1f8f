//! Training of one model on many scenes, for fields that look at photographs.

use std::time::Instant;

use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_field::FieldConfig;
use infonerf_loss::{Norm, photometric_loss};
use infonerf_render::{Counts, Level, Model, Noise, Renderer, Want};
use infonerf_scene::Scene;

use crate::average::Average;
use crate::batch::{Pyramid, Seen};
use crate::explained::Explained;
use crate::model::{build, optimiser};
use crate::photographs::Photographs;
use crate::trainer::read_back;
use crate::{Checkpoint, Config, Event, Outcome, Progress, TrainError};

/// A run over many scenes: each step shows the field some photographs of one scene, and asks for pixels of another view.
///
/// The objective is L_RGB alone, with no skipping of empty space: there is no one space. Its checkpoint is what `train.init`
/// takes.
pub struct Pretrainer {
    config: Config,
    scenes: Vec<Lesson>,
    seed: u64,
    device: Device,
    model: Model,
    optimiser: ModuleOptimizer,
    progress: Progress,
}

/// One of the scenes.
struct Lesson {
    renderer: Renderer,
    pyramid: Pyramid,
    photographs: Photographs,
}

/// What a random stream is for; part of its address.
mod purpose {
    pub const SCENE: u64 = 11;
    pub const SEEN: u64 = 12;
    pub const SOURCES: u64 = 13;
    pub const SAMPLES: u64 = 14;
}

impl Pretrainer {
    /// Sets up a run over `scenes`: the same arguments give the same numbers on one device.
    ///
    /// # Errors
    /// If there is no scene, the field is one of a single scene, a number in `config` is out of range, or a file of weights
    /// that it names cannot be used.
    pub fn new(config: &Config, scenes: &[Scene], seed: u64, device: &Device) -> Result<Self, TrainError> {
        config.validate()?;
        if !matches!(config.field, FieldConfig::PixelNerf(_)) {
            let cause = "expected `pixelnerf`: only a field that looks at photographs can learn from many scenes";
            return Err(TrainError::config("field.kind", cause));
        }
        let first = scenes.first().ok_or_else(|| TrainError::config("scenes", "expected at least one"))?;
        let device = device.clone().autodiff();
        let lesson = |scene: &Scene| Lesson {
            renderer: Renderer::new(&config.render, scene),
            pyramid: Pyramid::new(scene, &config.train),
            photographs: Photographs::new(scene),
        };
        Ok(Self {
            model: build(config, first.bounds, seed, &device)?,
            optimiser: optimiser(config),
            config: config.clone(),
            scenes: scenes.iter().map(lesson).collect(),
            seed,
            device,
            progress: Progress::default(),
        })
    }

    /// Goes on from `checkpoint`.
    ///
    /// # Errors
    /// If it is of another config.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        self.model = checkpoint.restore_model(self.model.clone())?;
        self.optimiser = checkpoint.restore_optimiser(optimiser(&self.config))?;
        self.progress = checkpoint.progress().clone();
        Ok(())
    }

    /// Everything needed to go on later, or to begin another run with.
    ///
    /// # Errors
    /// If the weights cannot be encoded.
    pub fn checkpoint(&self) -> Result<Checkpoint, TrainError> {
        Checkpoint::take(&self.progress, &self.model, &Average::default(), &self.optimiser, None, None)
    }

    /// How far the run is.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Share of the run that is done.
    pub fn done(&self) -> f64 {
        (self.progress.step as f64 / self.config.train.iterations as f64).min(1.0)
    }

    /// Takes one step and tells what happened.
    ///
    /// # Errors
    /// If the loss is not finite. The model is then as it was before the step.
    pub fn step(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let (done, step) = (self.done(), self.progress.step);
        if done >= 1.0 {
            return Ok(Outcome::Finished);
        }
        let start = Instant::now();
        let noise = |purpose| Noise::new(self.seed, step as u64, purpose);
        let (train, loss) = (&self.config.train, &self.config.loss);
        let lesson = &self.scenes[noise(purpose::SCENE).below(0, 0, self.scenes.len())];
        let none = Explained::default();
        let Seen { pixels, colors, .. } =
            lesson.pyramid.seen(train, train.rays, step, done, noise(purpose::SEEN), &none);
        let sources = lesson.photographs.draw(train, pixels.view(), noise(purpose::SOURCES));
        let model = self.model.conditioned(&sources);
        let rays = pixels.rays();
        let want = Want { color: true, entropy: None };
        let samples = Some(noise(purpose::SAMPLES));
        let (coarse, fine) = lesson.renderer.render(&model, &rays, want, samples, None, done as f32);
        let channels = colors.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
        let target = Tensor::<2>::from_data(TensorData::new(channels, [rays.len(), 3]), &self.device);
        let rgb_of = |level: &Level| {
            let color = level.color.clone().expect("colour was wanted");
            photometric_loss(color, target.clone(), loss.rgb.norm)
        };
        let rgb = rgb_of(&fine);
        let total = coarse.as_ref().map_or_else(|| rgb.clone(), |level| rgb.clone() + rgb_of(level) * loss.rgb.coarse);
        let values = read_back([&rgb, &total, &fine.composite.acc.clone().mean()]);
        let &[rgb, value, acc] = values.as_slice() else { unreachable!("three were asked for") };
        let mse = rgb / if loss.rgb.norm == Norm::Squared { 3.0 } else { 1.0 };
        if !value.is_finite() {
            return Err(TrainError::NonFinite { term: "RGB loss", value, step });
        }
        let mut counts = Counts::from(&fine.samples);
        if let Some(coarse) = &coarse {
            counts += Counts::from(&coarse.samples);
        }
        let lr = train.lr_at(step, done);
        let grads = GradientsParams::from_grads(total.backward(), &self.model);
        self.model = self.optimiser.step(lr, self.model.clone(), grads);
        self.progress.count(counts);
        self.progress.step += 1;
        let spent = start.elapsed().as_secs_f64();
        self.progress.seconds += spent;
        report(Event::Step {
            step: self.progress.step,
            seconds: self.progress.seconds,
            loss: value,
            rgb,
            entropy: None,
            gain: None,
            psnr: -10.0 * mse.max(1e-12).log10(),
            lr,
            rays_per_second: rays.len() as f64 / spent,
            acc,
            evaluated: counts.evaluated as f64 / counts.total.max(1) as f64,
        });
        Ok(if self.done() >= 1.0 { Outcome::Finished } else { Outcome::Running })
    }
}
