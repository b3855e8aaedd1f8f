//! A step: forward, backward, optimiser, and what is watched over steps.

use std::time::Instant;

use burn::module::{Module, ModuleMapper, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use infonerf_field::{Extent, Field};
use infonerf_ops::adam::{finite_after, step_if};
use infonerf_ops::{Traffic, is_gpu};
use infonerf_render::{Exposure, Model, Noise, RandomStream};
use infonerf_schedule::Moment;

use super::forward::Forward;
use super::numbers::Numbers;
use super::{Outcome, Trainer, densities, occupancy_grid};
use crate::error_sampling::PixelErrors;
use crate::model::{learning_rates, optimiser};
use crate::step_pixels::StepPixels;
use crate::weight_averaging::WeightAverage;
use crate::{Event, Phase, TrainError};

/// Steps after which a GPU is asked for their losses.
const READ_EVERY: usize = 16;

/// A step that was taken, and is not reported yet.
pub(super) struct Taken {
    at: Moment,
    numbers: Numbers,
    lr: f64,
    rays: usize,
    /// Share of the candidate samples that a field evaluated.
    evaluated: f64,
    /// 1 if the objective was finite in this step and in those before that are not reported either, else 0: then the model
    /// stays as it was. On the device.
    finite: Tensor<1>,
    /// Seconds that it took, and of training so far, once they are counted.
    seconds: [f64; 2],
}

/// In how many steps the losses on `device` are read once.
pub(super) fn read_every(device: &Device) -> usize {
    if is_gpu(device) { READ_EVERY } else { 1 }
}

/// The model, which leaves one without numbers behind: weights that nobody else holds are changed where they are.
fn taken<F: Field>(model: &mut Model<F>) -> Model<F> {
    struct Emptied;
    impl ModuleMapper for Emptied {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|weights| Tensor::empty([0; D], &weights.device()))
        }
    }
    let emptied = model.clone().map(&mut Emptied);
    std::mem::replace(model, emptied)
}

impl<F: Field> Trainer<F> {
    /// Takes one step and reports what happened.
    ///
    /// A GPU is not waited for in each step: what happened in 16 is reported after the last of them ([`Self::read_every`]).
    ///
    /// # Errors
    /// If a loss of a step is not finite. The weights are then as they were before that step.
    pub fn step(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        self.step_with(Self::draw, report)
    }

    /// The same, of pixels that are given and not drawn. Samples along their rays are jittered by the run's seed and step.
    ///
    /// # Errors
    /// As [`Self::step`].
    ///
    /// # Panics
    /// If there is no such scene or camera, or no seen pixel.
    pub fn step_on(&mut self, pixels: StepPixels, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let given = |trainer: &mut Self, _| {
            (trainer.draws_on_device, trainer.marched) = (false, None);
            pixels
        };
        self.step_with(given, report)
    }

    fn step_with(
        &mut self,
        pixels: impl FnOnce(&mut Self, Moment) -> StepPixels,
        report: &mut impl FnMut(Event),
    ) -> Result<Outcome, TrainError> {
        let start = Instant::now();
        let taken = self.take_step(pixels);
        self.count_step(taken, start.elapsed().as_secs_f64(), report)
    }

    /// Changes the weights, and counts no time yet. False if training is over, and nothing was done.
    fn take_step(&mut self, pixels: impl FnOnce(&mut Self, Moment) -> StepPixels) -> bool {
        if self.has_collapsed() || self.is_over() {
            return false;
        }
        let before = Traffic::now();
        let at = Moment { step: self.progress.step, progress: self.done() };
        self.update_occupancy(at);
        let pixels = pixels(self, at);
        let Forward { total, numbers, counts, rays, samples_per_ray } = self.forward(at, &pixels);
        let lr = self.config.train.lr.at(at);
        let evaluated = counts.evaluated as f64 / counts.total.max(1) as f64;
        let finite = finite_after(self.unreported.last().map(|taken| taken.finite.clone()), total.clone());
        let grads = self.profile.time(Phase::Backward, || GradientsParams::from_grads(total.backward(), &self.model));
        let rates = learning_rates(&self.config.train, at);
        let (optimiser, model) = (&mut self.optimiser, taken(&mut self.model));
        let step = |model| optimiser.step(rates, model, grads);
        self.model = self.profile.time(Phase::Optimiser, || step_if(finite.clone(), model, step));
        self.model.exposure = self.model.exposure.take().map(Exposure::centred);
        self.progress.count(counts, samples_per_ray);
        self.progress.step += 1;
        self.progress.at = at;
        if WeightAverage::<F>::takes(self.config.train.weight_averaging, self.progress.step, self.done()) {
            self.weight_average.add(self.model.valid());
        }
        self.unreported.push(Taken { at, numbers, lr, rays, evaluated, finite, seconds: [0.0; 2] });
        if self.unreported.len() >= self.read_every {
            Numbers::read(self.unreported.iter_mut().map(|taken| &mut taken.numbers));
        }
        self.profile.count_since(before);
        true
    }

    /// Counts the last step, if one was `taken`, as `seconds` of training, and reports what is known.
    pub(crate) fn count_step(
        &mut self,
        taken: bool,
        seconds: f64,
        report: &mut impl FnMut(Event),
    ) -> Result<Outcome, TrainError> {
        if let Some(last) = self.unreported.last_mut().filter(|_| taken) {
            self.progress.seconds += seconds;
            last.seconds = [seconds, self.progress.seconds];
            if !last.numbers.is_read() && !self.is_over() {
                return Ok(Outcome::Running);
            }
        }
        self.catch_up(report)
    }

    /// Waits for the device, and reports the steps that are not reported yet.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn catch_up(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let (before, start) = (Traffic::now(), Instant::now());
        let mut unreported = std::mem::take(&mut self.unreported);
        if Numbers::read(unreported.iter_mut().map(|taken| &mut taken.numbers)) {
            // What a device had left to do is training, too.
            let waited = start.elapsed().as_secs_f64();
            self.progress.seconds += waited;
            unreported.last_mut().expect("is read").seconds[0] += waited;
        }
        self.profile.count_since(before);
        let rays: usize = unreported.iter().map(|taken| taken.rays).sum();
        let rays_per_second = rays as f64 / unreported.iter().map(|taken| taken.seconds[0]).sum::<f64>();
        for Taken { at, numbers, lr, evaluated, seconds, .. } in unreported {
            if let Err(error) = numbers.check(at.step) {
                self.progress.step = at.step;
                return Err(error);
            }
            let step = at.step + 1;
            report(Event::Step {
                step,
                seconds: seconds[1],
                loss: numbers.total(),
                psnr: -10.0 * numbers.mse().max(1e-12).log10(),
                lr,
                rays_per_second,
                acc: numbers.acc(),
                evaluated,
                losses: numbers.losses(),
            });
            if self.watch(at, &numbers, report)? {
                // What came after it is of a field that is given up.
                break;
            }
        }
        Ok(match () {
            () if self.has_collapsed() => Outcome::Collapsed,
            () if self.is_over() => Outcome::Finished,
            () => Outcome::Running,
        })
    }

    /// [`Self::take_step`] of pixels that are drawn.
    pub(crate) fn take_drawn_step(&mut self) -> bool {
        self.take_step(Self::draw)
    }

    /// Whether there is nothing left to do.
    fn is_over(&self) -> bool {
        self.done() >= 1.0 || self.progress.early_stopping.plateaued
    }

    /// Notices an error that has plateaued, and a field that went empty, and tells whether it did; the latter starts over with
    /// other weights while that is allowed.
    fn watch(&mut self, at: Moment, numbers: &Numbers, report: &mut impl FnMut(Event)) -> Result<bool, TrainError> {
        let step = at.step + 1;
        let full_size = self.scenes[0].images.at(&self.config.train, at).is_full_size();
        let (config, stopping) = (&self.config.train.early_stopping, &mut self.progress.early_stopping);
        if full_size && !stopping.plateaued && stopping.add(config, f64::from(numbers.mse())) {
            report(Event::Plateau { step });
        }
        let empty = self.progress.empty_steps.add(numbers.acc(), numbers.foreground);
        if empty {
            // With the weights of another run there are no other ones to start over with.
            let others = self.config.train.init.as_os_str().is_empty();
            let restarted = others && self.progress.restarts < self.config.train.restarts;
            report(Event::Collapse { step, restarted });
            if restarted {
                self.restart()?;
            }
        }
        Ok(empty)
    }

    fn restart(&mut self) -> Result<(), TrainError> {
        let restarts = self.progress.restarts + 1;
        let seed = Noise::new(self.seed, restarts as u64, RandomStream::Restart).bits();
        self.model = self.builder.model(&self.config, self.scene(), seed, &self.device)?;
        self.weight_average = WeightAverage::default();
        self.optimiser = optimiser(&self.config);
        self.occupancy = occupancy_grid(&self.config, &self.scenes[0].scene);
        self.pixel_errors = PixelErrors::default();
        self.marched = None;
        self.progress = self.progress.restarted();
        Ok(())
    }

    fn update_occupancy(&mut self, at: Moment) {
        let Some(grid) = self.occupancy.as_mut().filter(|grid| grid.is_due(at.step)) else { return };
        self.marched = None;
        let scene = &self.scenes[0];
        let noise = Noise::new(self.seed, at.step as u64, RandomStream::Occupancy);
        let field = self.model.fine.valid().conditioned(scene.photographs.all(), None);
        let length = scene.renderer.step_length(at);
        let extent = Extent::Ball { variance: grid.cell_variance() };
        self.profile.time(Phase::Occupancy, || {
            grid.update(noise, length, |positions| densities(&field, positions, &extent, at))
        });
    }
}
