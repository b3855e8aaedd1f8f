use std::time::Instant;

use burn::module::Module;
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_field::{Extent, Points, RadianceField};
use infonerf_loss::{Norm, entropy_loss, gain_loss, photometric_loss};
use infonerf_ops::{Segments, to_host};
use infonerf_render::{Counts, Learned, Level, Model, Noise, OccupancyGrid, Renderer, Want};
use infonerf_scene::{Ray, Scene, ViewRegion};

use crate::average::Average;
use crate::batch::{self, Pyramid, Seen};
use crate::convergence::Convergence;
use crate::explained::Explained;
use crate::memory::{self, MemoryPlan};
use crate::model::{build, optimiser};
use crate::photographs::Photographs;
use crate::semantic::Semantic;
use crate::{Checkpoint, Config, Event, Phase, Profile, Progress, TrainError};

/// One run in memory: what is learned, and how far it is.
pub struct Trainer {
    config: Config,
    scene: Scene,
    seed: u64,
    /// Seconds after which to stop, if the clock and not the number of steps decides.
    budget: Option<f64>,
    device: Device,
    renderer: Renderer,
    region: ViewRegion,
    pyramid: Pyramid,
    photographs: Photographs,
    semantic: Option<Semantic>,
    model: Model,
    average: Average,
    optimiser: ModuleOptimizer,
    occupancy: Option<OccupancyGrid>,
    explained: Explained,
    progress: Progress,
    profile: Profile,
}

/// Why a run stopped, or that it has not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// There is more to do.
    Running,
    /// All steps are taken, or the budget is spent.
    Finished,
    /// The field went empty and no fresh start is left.
    Collapsed,
}

/// What a random stream is for; part of its address.
mod purpose {
    pub const SEEN: u64 = 1;
    pub const UNSEEN: u64 = 2;
    pub const NEAR: u64 = 3;
    pub const SAMPLES: u64 = 4;
    pub const OCCUPANCY: u64 = 5;
    pub const PICTURES: u64 = 6;
    pub const SOURCES: u64 = 7;
    pub const SEMANTIC: u64 = 8;
}

/// A pixel that differs by less than this from the background in every channel shows the background: half an 8-bit step.
const KEY_TOLERANCE: f32 = 0.5 / 255.0;

/// A field is empty whose seen rays have less opacity than this share of the pixels that show something ...
const EMPTY: f32 = 0.01;
/// ... if it stays so for this many steps while any more than as large a share of the pixels does.
const EMPTY_STEPS: usize = 50;

impl Trainer {
    /// Sets up a run: the same `config`, `scene` and `seed` give the same numbers on one device.
    ///
    /// # Errors
    /// If a number in `config` is out of range, a file of weights that it names cannot be used, or the run would not fit
    /// into memory.
    pub fn new(
        config: &Config,
        scene: Scene,
        seed: u64,
        budget: Option<f64>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        if let Some(available) = memory::available() {
            MemoryPlan::new(config, &scene).check(available)?;
        }
        let device = device.clone().autodiff();
        let renderer = Renderer::new(&config.render, &scene);
        let region = ViewRegion::new(&scene.train.iter().map(|view| view.camera.clone()).collect::<Vec<_>>());
        let model = build(config, scene.bounds, seed, &device)?;
        let pyramid = Pyramid::new(&scene, &config.train);
        let photographs = Photographs::new(&scene);
        let semantic = Semantic::new(&config.loss.semantic, &scene, &device)?;
        if (config.loss.alpha > 0.0 || config.render.occupancy.carve)
            && scene.train.iter().any(|view| view.image.alpha.is_none())
        {
            let key = if config.loss.alpha > 0.0 { "loss.alpha" } else { "render.occupancy.carve" };
            return Err(TrainError::config(key, "expected training images with an alpha channel: they have none"));
        }
        let occupancy = occupancy_grid(config, &scene);
        Ok(Self {
            optimiser: optimiser(config),
            config: config.clone(),
            scene,
            seed,
            budget,
            device,
            renderer,
            region,
            pyramid,
            photographs,
            semantic,
            model,
            average: Average::default(),
            occupancy,
            explained: Explained::default(),
            progress: Progress::default(),
            profile: Profile::default(),
        })
    }

    /// Goes on from `checkpoint`.
    ///
    /// # Errors
    /// If it is of another config.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        self.model = checkpoint.restore_model(self.model.clone())?;
        self.average = checkpoint.restore_average(&self.model.valid())?;
        self.optimiser = checkpoint.restore_optimiser(optimiser(&self.config))?;
        if let Some(grid) = &mut self.occupancy {
            checkpoint.restore_occupancy(grid)?;
        }
        self.explained = checkpoint.restore_explained()?;
        self.progress = checkpoint.progress().clone();
        Ok(())
    }

    /// Everything needed to go on later.
    ///
    /// # Errors
    /// If the weights cannot be encoded.
    pub fn checkpoint(&self) -> Result<Checkpoint, TrainError> {
        let explained = self.config.train.explained.is_on().then_some(&self.explained);
        let occupancy = self.occupancy.as_ref();
        Checkpoint::take(&self.progress, &self.model, &self.average, &self.optimiser, occupancy, explained)
    }

    /// How far the run is.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Where the time went.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// The scene it learns.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The model without gradients, to render with: the mean over the end of the run, once there is one.
    pub fn model(&self) -> Model {
        let model = self.average.mean().cloned().unwrap_or_else(|| self.model.valid());
        model.conditioned(self.photographs.all())
    }

    /// The renderer of the scene.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The occupancy grid once it may be used.
    pub fn occupancy(&self) -> Option<&OccupancyGrid> {
        let o = &self.config.render.occupancy;
        self.occupancy.as_ref().filter(|_| o.carve || self.progress.step > o.warmup)
    }

    /// What pictures are rendered from. Asks the field where it is empty if `render.occupancy.refine` says so: worth keeping.
    pub fn learned(&self) -> Learned {
        let model = self.model();
        let factor = self.config.render.occupancy.refine;
        let occupancy = self.occupancy().map(|grid| {
            if factor == 1 {
                return grid.clone();
            }
            let noise = Noise::new(self.seed, self.progress.step as u64, purpose::PICTURES);
            let extent = Extent::Ball { variance: grid.cell_variance() / (factor * factor) as f32 };
            let length = self.renderer.step_length(1.0);
            grid.refined(factor, noise, length, |points| densities(&model.fine, points, extent, 1.0))
        });
        Learned { model, occupancy }
    }

    /// Share of the run that is done: by the clock if there is a budget, else by steps.
    pub fn done(&self) -> f64 {
        let share = match self.budget {
            Some(budget) => self.progress.seconds / budget,
            None => self.progress.step as f64 / self.config.train.iterations as f64,
        };
        share.min(1.0)
    }

    /// Takes one step and tells what happened.
    ///
    /// # Errors
    /// If a loss is not finite. The model is then as it was before the step.
    pub fn step(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        if self.is_over() {
            return Ok(Outcome::Finished);
        }
        let start = Instant::now();
        let step = self.progress.step;
        self.update_occupancy(step);
        let terms = self.forward(step)?;
        let lr = self.config.train.lr_at(step, self.done());
        let Terms { total, numbers, counts, rays, samples_a_ray } = terms;
        let grads = self.profile.time(Phase::Backward, || GradientsParams::from_grads(total.backward(), &self.model));
        let (optimiser, model) = (&mut self.optimiser, self.model.clone());
        self.model = self.profile.time(Phase::Optimiser, || optimiser.step(lr, model, grads));
        self.progress.count(counts);
        let before = if self.progress.samples_a_ray > 0.0 { self.progress.samples_a_ray } else { samples_a_ray };
        self.progress.samples_a_ray = (0.9 * before + 0.1 * samples_a_ray).max(1.0);
        self.progress.step += 1;
        if Average::takes(self.config.train.average, self.progress.step, self.done()) {
            self.average.add(self.model.valid());
        }
        let spent = start.elapsed().as_secs_f64();
        self.progress.seconds += spent;
        let full_size = self.config.train.factor_at(self.done()) == 1;
        let converged =
            full_size && self.progress.convergence.add(&self.config.train.converged, f64::from(numbers.mse));
        report(Event::Step {
            step: self.progress.step,
            seconds: self.progress.seconds,
            loss: numbers.total,
            rgb: numbers.rgb,
            entropy: numbers.entropy,
            gain: numbers.gain,
            psnr: -10.0 * numbers.mse.max(1e-12).log10(),
            lr,
            rays_per_second: rays as f64 / spent,
            acc: numbers.acc,
            evaluated: counts.evaluated as f64 / counts.total.max(1) as f64,
        });
        if converged {
            report(Event::Converged { step: self.progress.step });
        }
        self.watch(&numbers, report)
    }

    /// Whether there is nothing left to do.
    fn is_over(&self) -> bool {
        self.done() >= 1.0 || self.progress.convergence.reached
    }

    /// Detects a field that went empty, and starts over with other weights while that is allowed.
    fn watch(&mut self, numbers: &Numbers, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let empty = numbers.acc < EMPTY * numbers.foreground && numbers.foreground > EMPTY;
        self.progress.empty_steps = if empty { self.progress.empty_steps + 1 } else { 0 };
        if self.progress.empty_steps >= EMPTY_STEPS {
            let restarted = self.progress.restarts < self.config.train.restarts;
            report(Event::Collapse { step: self.progress.step, restarted });
            if !restarted {
                return Ok(Outcome::Collapsed);
            }
            self.restart()?;
        }
        Ok(if self.is_over() { Outcome::Finished } else { Outcome::Running })
    }

    fn restart(&mut self) -> Result<(), TrainError> {
        let restarts = self.progress.restarts + 1;
        let seed = Noise::new(self.seed, restarts as u64, 0).bits();
        self.model = build(&self.config, self.scene.bounds, seed, &self.device)?;
        self.average = Average::default();
        self.optimiser = optimiser(&self.config);
        self.occupancy = occupancy_grid(&self.config, &self.scene);
        self.explained = Explained::default();
        let convergence = Convergence::default();
        self.progress = Progress { step: 0, restarts, empty_steps: 0, convergence, ..self.progress.clone() };
        Ok(())
    }

    fn update_occupancy(&mut self, step: usize) {
        let progress = self.done() as f32;
        let Some(grid) = self.occupancy.as_mut().filter(|grid| grid.is_due(step)) else { return };
        let noise = Noise::new(self.seed, step as u64, purpose::OCCUPANCY);
        let field = self.model.fine.valid().conditioned(self.photographs.all());
        let length = self.renderer.step_length(progress);
        let extent = Extent::Ball { variance: grid.cell_variance() };
        self.profile.time(Phase::Occupancy, || {
            grid.update(noise, length, |positions| densities(&field, positions, extent, progress))
        });
    }

    /// Rays of training images and of unseen poses for this step.
    fn ray_counts(&self) -> (usize, usize) {
        let train = &self.config.train;
        if train.samples == 0 || self.progress.samples_a_ray <= 0.0 {
            return (train.rays, train.unseen_rays);
        }
        let rays = (train.samples as f64 / self.progress.samples_a_ray)
            .clamp(train.rays as f64 / 4.0, train.rays as f64 * 16.0);
        (rays as usize, (rays * train.unseen_rays as f64 / train.rays as f64) as usize)
    }

    fn forward(&mut self, step: usize) -> Result<Terms, TrainError> {
        let noise = |purpose| Noise::new(self.seed, step as u64, purpose);
        let done = self.done();
        let progress = done as f32;
        let (loss, train) = (&self.config.loss, &self.config.train);
        let ramp = loss.ramp_at(done);
        let entropy_weight = loss.entropy.weight * ramp;
        let gain_weight = loss.gain.weight_at(step) * ramp;
        let opacity_weight = loss.opacity_at(done);
        let (ray_count, unseen_count) = self.ray_counts();
        let (factor, pixels) = self.pyramid.size(train, done);
        self.explained.look_at(factor, pixels);
        let Seen { pixels: seen, colors, places, passed } = self.profile.time(Phase::Rays, || {
            self.pyramid.seen(train, ray_count, step, done, noise(purpose::SEEN), &self.explained)
        });
        self.progress.pixels_skipped += passed;
        let o = &self.config.render.occupancy;
        let occupancy = self.occupancy.as_ref().filter(|_| o.carve || step >= o.warmup);
        let wants_entropy = |counts: bool| (entropy_weight > 0.0 && counts).then_some(loss.entropy.epsilon);

        let sources = self.photographs.draw(train, seen.view(), noise(purpose::SOURCES));
        let model = self.profile.time(Phase::Seen, || self.model.conditioned(&sources));

        // Rays of training images.
        let rays = seen.rays();
        let want = Want { color: true, entropy: wants_entropy(loss.entropy.rays.seen()) };
        let render =
            |rays: &[Ray], want, noise| self.renderer.render(&model, rays, want, Some(noise), occupancy, progress);
        let (coarse, fine) = self.profile.time(Phase::Seen, || render(&rays, want, noise(purpose::SAMPLES)));
        let mut counts = count(coarse.as_ref(), &fine);
        let samples_a_ray = counts.evaluated as f64 / rays.len() as f64;
        let mut ray_total = rays.len();
        let shown = |c: &[f32; 4]| c.iter().zip(self.scene.background).any(|(c, b)| (c - b).abs() > KEY_TOLERANCE);
        let foreground: Vec<bool> = colors.iter().map(shown).collect();
        let channels = colors.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
        let target = Tensor::<2>::from_data(TensorData::new(channels, [rays.len(), 3]), &self.device);
        let color = fine.color.clone().expect("colour was wanted");
        if train.explained.is_on() {
            let met = to_host(color.clone().detach());
            let apart = |(met, [red, green, blue, _]): (&[f32], &[f32; 4])| {
                met.iter().zip([red, green, blue]).fold(0.0, |most: f32, (met, shown)| most.max((met - shown).abs()))
            };
            self.explained.remember(&places, met.chunks_exact(3).zip(&colors).map(apart));
        }
        let mut rgb = photometric_loss(color, target.clone(), loss.rgb.norm);
        let mse = rgb.clone();
        if let Some(color) = coarse.and_then(|level| level.color) {
            rgb = rgb + photometric_loss(color, target, loss.rgb.norm) * loss.rgb.coarse;
        }

        // Rays of unseen poses: density only.
        let uses_unseen = unseen_count > 0
            && (entropy_weight > 0.0 && loss.entropy.rays.unseen() || gain_weight > 0.0 && loss.gain.rays.unseen());
        let unseen = uses_unseen.then(|| {
            let width = self.pyramid.pixel_width(train, done);
            let noise_of_pose = noise(purpose::UNSEEN);
            let pixels = batch::unseen(&self.scene, &self.region, train, unseen_count, width, noise_of_pose);
            let rays = pixels.rays();
            let want = Want { color: false, entropy: wants_entropy(loss.entropy.rays.unseen()) };
            let (coarse, level) =
                self.profile.time(Phase::Unseen, || render(&rays, want, noise(purpose::SAMPLES).next()));
            counts += count(coarse.as_ref(), &level);
            ray_total += rays.len();
            (pixels, level)
        });

        let mut total = rgb.clone();
        let entropy = (entropy_weight > 0.0).then(|| {
            let mut sum = Tensor::<1>::zeros([1], &self.device);
            let mut rays_counted = 0;
            let seen_level = loss.entropy.rays.seen().then_some(&fine);
            let unseen_level = unseen.as_ref().filter(|_| loss.entropy.rays.unseen()).map(|(_, level)| level);
            for level in seen_level.into_iter().chain(unseen_level) {
                sum = sum + entropy_loss(&level.composite, loss.entropy.mask);
                rays_counted += level.samples.segments.rays();
            }
            sum / rays_counted.max(1) as f32
        });
        if let Some(entropy) = &entropy {
            total = total + entropy.clone() * entropy_weight;
        }

        // Neighbouring rays.
        let gain = (gain_weight > 0.0).then(|| {
            let noise = noise(purpose::NEAR);
            let mut sum = Tensor::<1>::zeros([1], &self.device);
            let mut bundles = 0;
            let seen_pair = loss.gain.rays.seen().then_some((&seen, &fine));
            let unseen_pair =
                unseen.as_ref().filter(|_| loss.gain.rays.unseen()).map(|(pixels, level)| (pixels, level));
            for (pixels, level) in seen_pair.into_iter().chain(unseen_pair) {
                if level.samples.segments.samples() == 0 {
                    continue;
                }
                let near = pixels.near(noise, loss.gain.max_angle_deg);
                let tau = self
                    .profile
                    .time(Phase::Near, || self.renderer.optical_depth_along(&model.fine, level, &near, progress));
                counts += Counts::from(&level.samples);
                ray_total += near.len();
                sum = sum + gain_loss(level.tau.clone(), tau, &level.samples.segments, &loss.gain);
                bundles += 1;
            }
            sum / bundles.max(1) as f32
        });
        if let Some(gain) = &gain {
            total = total + gain.clone() * gain_weight;
        }

        // A small picture from an unseen pose.
        let semantic_weight = loss.semantic.weight_at(step);
        if let Some(semantic) = self.semantic.as_ref().filter(|_| semantic_weight > 0.0) {
            let noise = noise(purpose::SEMANTIC);
            let (rays, size) = batch::unseen_picture(&self.scene, &self.region, train, loss.semantic.size, noise);
            let want = Want { color: true, entropy: None };
            let (coarse, level) = self.profile.time(Phase::Unseen, || render(&rays, want, noise.next()));
            counts += count(coarse.as_ref(), &level);
            ray_total += rays.len();
            let picture = level.color.expect("colour was wanted");
            let views = noise.next().next();
            total = total + semantic.loss(picture, size, |count| views.below(0, 0, count)) * semantic_weight;
        }

        // Priors on opacity, and smoothness of the tables.
        let pulls = foreground
            .iter()
            .map(|&shown| opacity_weight + if shown { -loss.key.foreground } else { loss.key.background });
        let pulls: Vec<f32> = pulls.collect();
        if pulls.iter().any(|pull| *pull != 0.0) {
            let pulls = Tensor::<1>::from_data(TensorData::new(pulls, [rays.len()]), &self.device);
            total = total + (fine.composite.acc.clone() * pulls).mean();
        }
        if loss.alpha > 0.0 {
            let alphas: Vec<f32> = colors.iter().map(|color| color[3]).collect();
            let alphas = Tensor::<1>::from_data(TensorData::new(alphas, [rays.len()]), &self.device);
            total = total + (fine.composite.acc.clone() - alphas).square().mean() * loss.alpha;
        }
        if let Some((_, level)) = unseen.as_ref().filter(|_| opacity_weight > 0.0) {
            total = total + level.composite.acc.clone().mean() * opacity_weight;
        }
        if let Some(variation) = self.model.fine.variation().filter(|_| loss.variation.weight > 0.0) {
            total = total + variation * loss.variation.weight * loss.variation.last.powf(progress);
        }

        let acc = fine.composite.acc.clone().mean();
        let terms = [&rgb, &mse, &total, &acc].into_iter().chain([&entropy, &gain].into_iter().flatten());
        let values = read_back(terms);
        let mut optional = values[4..].iter().copied();
        let numbers = Numbers {
            rgb: values[0],
            mse: values[1] / if loss.rgb.norm == Norm::Squared { 3.0 } else { 1.0 },
            total: values[2],
            acc: values[3],
            entropy: entropy.and_then(|_| optional.next()),
            gain: gain.and_then(|_| optional.next()),
            foreground: foreground.iter().filter(|shown| **shown).count() as f32 / rays.len() as f32,
        };
        numbers.check(step)?;
        Ok(Terms { total, numbers, counts, rays: ray_total, samples_a_ray })
    }
}

struct Terms {
    total: Tensor<1>,
    numbers: Numbers,
    counts: Counts,
    rays: usize,
    samples_a_ray: f64,
}

struct Numbers {
    total: f32,
    rgb: f32,
    mse: f32,
    entropy: Option<f32>,
    gain: Option<f32>,
    acc: f32,
    foreground: f32,
}

impl Numbers {
    fn check(&self, step: usize) -> Result<(), TrainError> {
        let terms = [
            ("RGB loss", Some(self.rgb)),
            ("entropy loss", self.entropy),
            ("information gain loss", self.gain),
            ("total loss", Some(self.total)),
        ];
        match terms.into_iter().find_map(|(term, value)| value.filter(|v| !v.is_finite()).map(|value| (term, value))) {
            Some((term, value)) => Err(TrainError::NonFinite { term, value, step }),
            None => Ok(()),
        }
    }
}

/// Numbers of a step, in one transfer: a GPU has to be waited for each time.
pub(crate) fn read_back<'a>(terms: impl IntoIterator<Item = &'a Tensor<1>>) -> Vec<f32> {
    to_host(Tensor::cat(terms.into_iter().map(|term| term.clone().detach()).collect(), 0))
}

fn count(coarse: Option<&Level>, fine: &Level) -> Counts {
    let mut counts = Counts::from(&fine.samples);
    if let Some(coarse) = coarse {
        counts += Counts::from(&coarse.samples);
    }
    counts
}

fn occupancy_grid(config: &Config, scene: &Scene) -> Option<OccupancyGrid> {
    let o = &config.render.occupancy;
    o.enabled.then(|| {
        let mut grid = OccupancyGrid::new(o, scene.bounds);
        if o.carve {
            grid.carve(&scene.train);
        }
        grid
    })
}

/// Densities of points on no ray, for the occupancy grid.
fn densities(field: &RadianceField, positions: &[f32], extent: Extent<'_>, progress: f32) -> Vec<f32> {
    let segments = Segments::uniform(1, positions.len() / 3);
    let points = Points { positions, directions: &[0.0, 0.0, 1.0], segments: &segments, extent };
    to_host(field.evaluate(points, false, progress).sigma)
}
