//! Whole training steps of every kind of field.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result};
use burn::tensor::Device;
use infonerf_experiment::RunPlan;
use infonerf_ops::to_host;
use infonerf_train::{Config, Event, Outcome, Preset, Trainer, evaluate_view, weights};

use super::comparison::max_or_nan;

/// Minimum denominator of a loss's relative error.
const MIN_LOSS: f64 = 0.01;
pub(super) const STEPS: usize = 20;

/// Settings with which a run takes about a second.
const TINY: &str = "scene.size=16 eval.test=first-1 eval.information_rays=0 train.rays=24 train.unseen_rays=12 \
                    loss.kl.weight=1e-3 render.occupancy.enabled=true render.occupancy.resolution=8 \
                    render.occupancy.warmup=2 render.occupancy.every=3";

/// Small field of one kind, trained with as many loss terms as the kind supports.
pub(super) struct FieldCase {
    pub(super) name: &'static str,
    preset: Preset,
    settings: &'static str,
}

/// Fields of all kinds that train without data of their own.
pub(super) const FIELDS: [FieldCase; 4] = [
    FieldCase {
        name: "NeRF",
        preset: Preset::Paper,
        settings: "field={kind=\"nerf\",layers=3,width=16,skip=1,position_frequencies=4,direction_frequencies=2,density=\"softplus\",detail=1.0} \
                   render.samples=10 render.fine_samples=6 loss.kl.rays=all",
    },
    FieldCase {
        name: "mip-NeRF",
        preset: Preset::Paper,
        settings: "field={kind=\"mip\",layers=3,width=16,skip=1,position_frequencies=6,direction_frequencies=2,detail=1.0} \
                   render.samples=10 render.fine_samples=6 render.placement=interval render.clip_to_bounds=true",
    },
    FieldCase {
        name: "factored field",
        preset: Preset::Fast,
        // GPUs leave out no negligible gradients, so the host must not either.
        settings: "field.resolutions=[4,8,16] field.channels=2 field.width=16 field.layers=1 field.negligible=0.0 \
                   render.samples=12 train.target_samples=400 loss.entropy.weight=1e-3",
    },
    FieldCase {
        name: "PixelNeRF",
        preset: Preset::Paper,
        // Without a grid: four bundles of rays are one on GPUs.
        settings: "field={kind=\"pixelnerf\",encoder={width=4,blocks=[1,1],weights=\"\"},blocks=3,pool_after=2,width=8,frequencies=2,lowest_frequency=1.5,density=\"softplus\"} \
                   render.samples=8 render.fine_samples=4 train.batch=held-out train.sources=2 \
                   render.occupancy.enabled=false train.neighbours.sampling=own loss.kl.rays=all",
    },
];

pub(super) struct Course {
    /// Losses of each step, by term, with their sum as `total`.
    pub(super) losses: Vec<BTreeMap<String, f32>>,
    /// Render of the first test view after the last step, three values per pixel.
    pub(super) render: Vec<f32>,
}

impl FieldCase {
    fn trainer(&self, plan: &RunPlan, extra: &[&str], device: &Device) -> Result<Trainer> {
        let settings = TINY.split(' ').chain(self.settings.split(' ')).chain(extra.iter().copied());
        let plan = RunPlan { config: Config::of(self.preset, settings).context(self.name)?, ..plan.clone() };
        plan.trainer(&Arc::new(plan.load()?), 0, None, device)
    }

    /// Returns −g/(1 + |g|) for the gradient g of the loss by each parameter: with ε = 1, Adam's first step is the rate times it.
    pub(super) fn gradients(&self, plan: &RunPlan, device: &Device) -> Result<Vec<Vec<f32>>> {
        const RATE: f32 = 100.0;
        let lr = format!("train.lr={RATE:?}");
        let settings = ["train.iterations=12", &lr, "train.adam_epsilon=1.0", "train.weight_averaging=0.0"];
        let mut trainer = self.trainer(plan, &settings, device)?;
        let read = |trainer: &Trainer| weights(&trainer.model()).into_iter().map(to_host).collect::<Vec<_>>();
        let before = read(&trainer);
        trainer.step(&mut |_| ())?;
        let moved = |(a, b): (&Vec<f32>, Vec<f32>)| a.iter().zip(b).map(|(a, b)| (b - a) / RATE).collect();
        Ok(before.iter().zip(read(&trainer)).map(moved).collect())
    }

    /// Takes [`STEPS`] steps from the start, and returns their losses and a render.
    pub(super) fn course(&self, plan: &RunPlan, device: &Device) -> Result<Course> {
        let mut trainer = self.trainer(plan, &[&format!("train.iterations={STEPS}")], device)?;
        let mut steps = Vec::new();
        let mut report = |event| {
            if let Event::Step { loss, losses, .. } = event {
                steps.push(losses.into_iter().chain([("total".to_owned(), loss)]).collect());
            }
        };
        while trainer.step(&mut report)? == Outcome::Running {}
        let view = trainer.scene().test.first().context("expected a test view")?;
        let view = evaluate_view(trainer.renderer(), &[trainer.trained()], view)?;
        Ok(Course { losses: steps, render: view.image.rgb.into_iter().flatten().collect() })
    }
}

/// Computes the largest relative difference of all losses of all steps; `None` if steps or terms differ.
pub(super) fn loss_difference(got: &Course, want: &Course) -> Option<f64> {
    let steps = got.losses.iter().zip(&want.losses);
    if got.losses.len() != want.losses.len() || !steps.clone().all(|(got, want)| got.keys().eq(want.keys())) {
        return None;
    }
    let error = |(got, want): (&f32, &f32)| {
        let (got, want) = (f64::from(*got), f64::from(*want));
        (got - want).abs() / want.abs().max(MIN_LOSS)
    };
    Some(steps.flat_map(|(got, want)| got.values().zip(want.values())).map(error).fold(0.0, max_or_nan))
}
