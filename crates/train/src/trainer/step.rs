//! A step: draw, render, evaluate the objective, optimize.

use std::time::Instant;

use burn::module::{Module, ModuleMapper, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;
use infonerf_field::{Extent, Field};
use infonerf_loss::{LossValues, Need, Renders, UnseenImage};
use infonerf_ops::adam::{finite_after, step_if};
use infonerf_ops::means::mean_squared_difference;
use infonerf_render::{Counts, Exposure, Model, Noise, Passes, RandomStream, RayBatch, RenderOutput, RenderRequest};
use infonerf_schedule::Moment;

use super::batch::StepBatch;
use super::report::{PendingStep, StepLosses};
use super::{Outcome, Trainer, densities, occupancy_grid};
use crate::config::NeighbourSampling;
use crate::error::TrainError;
use crate::event::Event;
use crate::model::{learning_rates, optimizer};
use crate::pixels::{image_rays, unseen_camera};
use crate::profile::Phase;
use crate::sources::draw_sources;
use crate::weight_averaging::WeightAverage;

impl<F: Field> Trainer<F> {
    /// Takes one step and reports what happened.
    ///
    /// A GPU is not waited for in each step: the events of 16 steps are reported after the last one ([`Self::read_every`]).
    ///
    /// # Errors
    /// If a loss of a step is not finite. The weights are then as they were before that step.
    pub fn step(&mut self, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let start = Instant::now();
        let step = self.take_step(None);
        self.count_step(step, start.elapsed().as_secs_f64(), report)
    }

    /// Takes one step on a batch that is given and not drawn. Samples along its rays are jittered by the run's seed and step.
    ///
    /// # Errors
    /// As [`Self::step`].
    ///
    /// # Panics
    /// If there is no such scene or camera, or no seen pixel.
    pub fn step_on(&mut self, batch: StepBatch, report: &mut impl FnMut(Event)) -> Result<Outcome, TrainError> {
        let start = Instant::now();
        let step = self.take_step(Some(batch));
        self.count_step(step, start.elapsed().as_secs_f64(), report)
    }

    /// Takes a step on `batch`, or on a drawn one. The step is to be given to [`Self::count_step`] with its time. `None` if
    /// training is over.
    pub(crate) fn take_step(&mut self, batch: Option<StepBatch>) -> Option<PendingStep> {
        if self.progress.has_collapsed() || self.is_over() {
            return None;
        }
        let at = Moment { step: self.progress.step, progress: self.done() };
        self.update_occupancy(at);
        let start = Instant::now();
        let batch = batch.unwrap_or_else(|| self.draw(at));
        self.profile.book(Phase::Rays, start);
        let model = self.conditioned(&batch, at);
        let (renders, samples, rays) = self.render(&batch, &model, at);
        let losses = self.evaluate(&batch, &model, &renders, at);
        let segments = renders.seen.fine.segments();
        self.progress.count(samples, segments.samples() as f64 / segments.rays() as f64);
        let (total, losses) = (losses.total.clone(), StepLosses::new(&losses, &renders));
        // Adam changes weights in place if nothing else holds them.
        drop((model, renders));
        let finite = self.optimize(total, at);
        let evaluated = samples.evaluated as f64 / samples.total.max(1) as f64;
        let lr = self.config.train.lr.at(at);
        let mut step = PendingStep { at, losses, lr, rays, evaluated, finite, seconds: [0.0; 2] };
        if self.pending.len() + 1 >= self.read_every {
            StepLosses::read(self.pending.iter_mut().chain([&mut step]).map(|step| &mut step.losses));
        }
        Some(step)
    }

    /// Returns the model of the step, conditioned on the images that its fields are given.
    fn conditioned(&mut self, batch: &StepBatch, at: Moment) -> Model<F> {
        let noise = |stream| Noise::new(self.seed, at.step as u64, stream);
        let (sources, latent) = (noise(RandomStream::Sources), noise(RandomStream::Latent).bits());
        let scene = &self.scenes[batch.scene];
        // The view of the first pixel is that of all pixels if a batch is of one image.
        let sources = draw_sources(&scene.sources, &self.config.train, batch.seen.at[0].view, sources);
        self.profile.time(Phase::Seen, || self.model.conditioned(&sources, Some(latent)))
    }

    /// Renders what the objective needs. Also returns the numbers of samples and of rays.
    fn render(&mut self, batch: &StepBatch, model: &Model<F>, at: Moment) -> (Renders, Counts, usize) {
        let noise = |stream| Noise::new(self.seed, at.step as u64, stream);
        let (scene, train) = (&self.scenes[batch.scene], &self.config.train);
        let (renderer, needs) = (&scene.renderer, scene.objective.needs(at));
        let occupancy = self.occupancy.as_ref().filter(|grid| grid.is_used_in(at.step));
        let (profile, mut samples, mut ray_count) = (&mut self.profile, Counts::default(), 0);
        // Samples lie at the distances of `partner`, the output of other rays, if it is given.
        let mut render = |phase, rays: &RayBatch, color: bool, partner: Option<&RenderOutput>| {
            let passes = profile.time(phase, || match partner {
                None => renderer.render(model, rays, RenderRequest { color, hidden: false }, occupancy, at),
                Some(partner) => Passes { coarse: None, fine: renderer.along(&model.fine, partner, rays, at) },
            });
            samples += passes.counts();
            ray_count += passes.fine.segments().rays();
            passes
        };
        let rays = batch.rays(&train.neighbours, scene, model, &needs, noise);
        let mut seen = render(Phase::Seen, &rays.seen, needs.contains(&Need::SeenColor), None);
        if let Some(exposure) = &model.exposure {
            seen = seen.exposed(exposure, &batch.seen.at.iter().map(|pixel| pixel.view).collect::<Vec<_>>());
        }
        let unseen = rays.unseen.map(|rays| render(Phase::Unseen, &rays, false, None).fine);
        let is_paired = train.neighbours.sampling == NeighbourSampling::Partner;
        let mut near = |rays: RayBatch, partner: &RenderOutput| {
            render(Phase::Neighbours, &rays, false, is_paired.then_some(partner)).fine
        };
        let seen_neighbours = rays.seen_neighbours.map(|rays| near(rays, &seen.fine));
        let unseen_neighbours = rays.unseen_neighbours.zip(unseen.as_ref()).map(|(rays, unseen)| near(rays, unseen));
        let size = needs.iter().find_map(|need| if let Need::Picture { size } = need { Some(*size) } else { None });
        let picture = size.map(|size| {
            let noise = noise(RandomStream::Picture);
            let (rays, size) = image_rays(&unseen_camera(&scene.scene, &scene.region, train, noise), size);
            let rays = renderer.rays(rays, &self.device).jittered(noise.child(RandomStream::Samples));
            let color = render(Phase::Unseen, &rays, true, None).fine.color;
            let view = noise.child(RandomStream::View).below(0, 0, scene.scene.train.len());
            UnseenImage { rgb: color.expect("colour was asked for"), size, view }
        });
        let target = batch.target(scene, model);
        let color = seen.fine.color.clone();
        let squared_error = color.map(|color| mean_squared_difference(color, target.rgb.clone()));
        let penalty = |need: &Need| {
            let Need::Penalty(name) = *need else { return None };
            Some((name, model.fine.penalty(name)?))
        };
        let penalties = needs.iter().filter_map(penalty).collect();
        let renders =
            Renders { seen, target, squared_error, unseen, seen_neighbours, unseen_neighbours, picture, penalties };
        (renders, samples, ray_count)
    }

    /// Evaluates the objective, with the prior of refined cameras.
    fn evaluate(&self, batch: &StepBatch, model: &Model<F>, renders: &Renders, at: Moment) -> LossValues {
        let mut losses = self.scenes[batch.scene].objective.values(at, renders);
        if let Some(cameras) = &model.cameras {
            let prior = cameras.prior();
            losses.total = losses.total + prior.clone() * self.config.train.cameras.prior;
            losses.values.push(("cameras", prior));
        }
        losses
    }

    /// Takes an Adam step on the objective `total`, unless it is not finite. Returns the flag [`PendingStep::finite`].
    fn optimize(&mut self, total: Tensor<1>, at: Moment) -> Tensor<1> {
        let finite = finite_after(self.pending.last().map(|step| step.finite.clone()), total.clone());
        let Self { profile, model, optimizer, .. } = self;
        // A step without due terms, or whose rays all pass through skipped space, has no gradient.
        let backward = || match total.is_tracked() {
            true => GradientsParams::from_grads(total.backward(), model),
            false => GradientsParams::new(),
        };
        let grads = profile.time(Phase::Backward, backward);
        let rates = learning_rates(&self.config.train, at);
        let before = take_model(model);
        *model = profile
            .time(Phase::Optimizer, || step_if(finite.clone(), before, |model| optimizer.step(rates, model, grads)));
        model.exposure = model.exposure.take().map(Exposure::centred);
        self.progress.step += 1;
        self.progress.at = at;
        if WeightAverage::<F>::includes(self.config.train.weight_averaging, self.progress.step, self.done()) {
            self.weight_average.add(self.model.valid());
        }
        finite
    }

    pub(super) fn is_over(&self) -> bool {
        self.done() >= 1.0
    }

    pub(super) fn restart(&mut self) -> Result<(), TrainError> {
        let restarts = self.progress.restarts + 1;
        let seed = Noise::new(self.seed, restarts as u64, RandomStream::Restart).bits();
        self.model = self.builder.model(&self.config, self.scene(), seed, &self.device)?;
        self.weight_average = WeightAverage { mean: None, count: 0 };
        self.optimizer = optimizer(&self.config);
        self.occupancy = occupancy_grid(&self.config, self.scene());
        self.progress = self.progress.restarted();
        Ok(())
    }

    fn update_occupancy(&mut self, at: Moment) {
        let Some(grid) = self.occupancy.as_mut().filter(|grid| grid.is_due(at.step)) else { return };
        let scene = &self.scenes[0];
        let noise = Noise::new(self.seed, at.step as u64, RandomStream::Occupancy);
        let field = self.model.fine.valid().conditioned(&scene.sources, None);
        let length = scene.renderer.step_length(at);
        let extent = Extent::Ball { variance: grid.cell_variance() };
        let sigma = |positions| densities(&field, positions, &extent, at);
        self.profile.time(Phase::Occupancy, || grid.update(noise, length, sigma));
    }
}

/// Moves the model out, leaving empty tensors, so that Adam can update weights in place.
fn take_model<F: Field>(model: &mut Model<F>) -> Model<F> {
    struct Emptied;
    impl ModuleMapper for Emptied {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|weights| Tensor::empty([0; D], &weights.device()))
        }
    }
    let emptied = model.clone().map(&mut Emptied);
    std::mem::replace(model, emptied)
}
