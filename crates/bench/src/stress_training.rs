//! Training under stress: many seeds of tiny runs with settings and scenes that make it diverge or collapse.

use std::sync::Arc;

use anyhow::{Context, Result};
use infonerf_experiment::RunPlan;
use infonerf_report::TextTable;
use infonerf_scene::{Range, Scene};
use infonerf_train::{Event, Outcome, TrainError, Trainer, evaluate_view};
use serde::Serialize;
use serde_json::json;

use crate::context::Bench;
use crate::output::number;
use crate::trial::with_settings;

const PROTOCOL: &str = "each row: one run per seed of a tiny field on 24-pixel images, with the other settings as the preset has \
                        them; train PSNR is of the first training view, rendered in the end; recovered: started over with \
                        other weights and ended with a field that is not empty; faint: ended with empty renders, \
                        for which a run is reported as collapsed";

/// Settings with which a run takes about a second.
const TINY: &str = "scene.size=24 eval.test=first-1 eval.information_rays=0 train.rays=96 train.unseen_rays=48 \
                    train.target_samples=0 train.downscale=1 \
                    render.samples={from=24,to=48,end=0.5,curve=\"exponential\"} render.occupancy.resolution=16 \
                    render.occupancy.warmup=10 render.occupancy.every=8";

const FACTORED: &str = "field.resolutions=[8,16,32] field.channels=2 field.width=16";

/// Small network with the paper's losses: ReLU density, a coarse network, no priors.
const NERF: &str = "field={kind=\"nerf\",layers=3,width=32,skip=1,position_frequencies=6,direction_frequencies=2,density=\"relu\",detail=1.0} \
                    render.samples=16 render.fine_samples=16 render.occupancy.enabled=false \
                    loss.silhouette.weight=0.0 loss.entropy.weight=1e-3 train.lr=5e-4";

type Change = fn(&mut Scene);

/// Name, settings of the field, further settings, and a change of the scene.
type StressSetting = (&'static str, &'static str, &'static [&'static str], Change);

const FAST: [(&str, &[&str], Change); 22] = [
    ("as configured", &[], keep),
    ("lambda1 = 0", &["loss.entropy.weight=0"], keep),
    ("lambda1 = 0.1", &["loss.entropy.weight=0.1"], keep),
    ("lambda1 = 1", &["loss.entropy.weight=1"], keep),
    ("lambda1 = 10", &["loss.entropy.weight=10"], keep),
    ("lambda2 = 1e-5", &["loss.kl.weight=1e-5"], keep),
    ("lambda2 = 0.1", &["loss.kl.weight=0.1"], keep),
    ("lambda2 = 1 (the authors' default)", &["loss.kl.weight=1"], keep),
    ("lambda2 = 10", &["loss.kl.weight=10"], keep),
    ("lambda1 = lambda2 = 10", &["loss.entropy.weight=10", "loss.kl.weight=10"], keep),
    ("learning rate x 100", &["train.lr=0.2"], keep),
    ("learning rate x 100, both losses at 1", &["train.lr=0.2", "loss.entropy.weight=1", "loss.kl.weight=1"], keep),
    ("one view", &["scene.views={kind=\"seed\",count=1}"], keep),
    ("identical views", &[], identical),
    ("views that look away", &[], looking_away),
    ("black images", &[], |scene| paint(scene, |_| [0.0; 3])),
    ("white images", &[], |scene| paint(scene, |_| [1.0; 3])),
    ("noise images", &[], |scene| paint(scene, noise)),
    ("noise images, both losses at 1", &["loss.entropy.weight=1", "loss.kl.weight=1"], |scene| {
        paint(scene, noise);
    }),
    ("a scene of 1e-3 units", &[], |scene| scale(scene, 1e-3)),
    ("a scene of 1e3 units", &[], |scene| scale(scene, 1e3)),
    ("silhouette of 1", &["loss.silhouette.weight=1.0"], keep),
];

const MLP: [(&str, &[&str]); 5] = [
    ("NeRF MLP", &[]),
    ("NeRF MLP, lambda2 = 1 (the authors' default)", &["loss.kl.weight=1"]),
    ("NeRF MLP, lambda1 = lambda2 = 10", &["loss.entropy.weight=10", "loss.kl.weight=10"]),
    ("NeRF MLP, learning rate x 100", &["train.lr=0.05"]),
    (
        "NeRF MLP, last interval 1e10, lambda1 = 1",
        &["render.last_interval=infinite", "render.placement=left", "loss.entropy.weight=1"],
    ),
];

#[derive(Default, Serialize)]
struct SettingOutcome {
    setting: &'static str,
    runs: usize,
    /// Number of runs stopped because a loss was not finite.
    stopped: usize,
    /// Number of runs that ended with weights or renders that are not finite.
    not_finite: usize,
    /// Number of runs that ended, and were reported, as collapsed.
    collapsed: usize,
    restarts: usize,
    /// Number of runs that restarted and ended with a field that is not empty.
    recovered: usize,
    /// Number of runs that ended with empty renders, which an experiment reports as collapsed.
    faint: usize,
    train_psnr: Option<f64>,
}

/// Trains tiny runs that are made to diverge or collapse; returns whether all losses, weights and renders were finite.
pub fn run(bench: &Bench, seeds: u32, steps: u32, print: &mut dyn FnMut(&str)) -> Result<bool> {
    print(&bench.heading());
    let mut rows = Vec::new();
    let fast = FAST.map(|(name, settings, change)| (name, FACTORED, settings, change));
    let mlp = MLP.map(|(name, settings)| (name, NERF, settings, keep as Change));
    for setting in fast.into_iter().chain(mlp) {
        print(&format!("training: {}", setting.0));
        rows.push(measure(bench, setting, seeds, steps)?);
        // Results are saved after each setting, so that they stay if the rest is interrupted.
        bench.save_results(PROTOCOL, &rows, json!({ "steps": steps }))?;
    }
    let table = TextTable::new(
        &rows,
        &[
            ("setting", |row: &SettingOutcome| row.setting.to_owned()),
            ("runs", |row| row.runs.to_string()),
            ("stopped", |row| row.stopped.to_string()),
            ("not finite", |row| row.not_finite.to_string()),
            ("collapsed", |row| row.collapsed.to_string()),
            ("restarts", |row| row.restarts.to_string()),
            ("recovered", |row| row.recovered.to_string()),
            ("faint", |row| row.faint.to_string()),
            ("train PSNR", |row| number(row.train_psnr, 2)),
        ],
    );
    print(&format!("\n{}", table.to_text()));
    bench.save_csv(&table)?;
    Ok(rows.iter().all(|row| row.stopped == 0 && row.not_finite == 0))
}

fn measure(bench: &Bench, setting: StressSetting, seeds: u32, steps: u32) -> Result<SettingOutcome> {
    let (name, field, settings, change) = setting;
    let iterations = format!("train.iterations={steps}");
    let fixed = TINY.split(' ').chain(field.split(' '));
    let settings = fixed.chain(settings.iter().copied()).chain([iterations.as_str()]);
    let plan = with_settings(&bench.plans[0], settings).context(name)?;
    let mut outcome = SettingOutcome { setting: name, ..SettingOutcome::default() };
    let mut psnrs = Vec::new();
    for seed in (0..seeds).map(u64::from) {
        let plan = RunPlan { seed, ..plan.clone() };
        let mut scene = plan.load()?;
        change(&mut scene);
        let mut trainer = Trainer::new(&plan.config, scene, seed, None, &bench.session.device.device)?;
        psnrs.extend(outcome.count(&mut trainer)?);
    }
    outcome.train_psnr = (!psnrs.is_empty()).then(|| psnrs.iter().sum::<f64>() / psnrs.len() as f64);
    Ok(outcome)
}

impl SettingOutcome {
    /// Trains to the end and counts the outcome; returns the PSNR of the first training view.
    fn count(&mut self, trainer: &mut Trainer) -> Result<Option<f64>> {
        self.runs += 1;
        let outcome = loop {
            let mut finite = true;
            let mut report = |event| {
                if let Event::Step { loss, losses, .. } = event {
                    finite &= losses.into_values().chain([loss]).all(f32::is_finite);
                }
            };
            match trainer.step(&mut report) {
                Ok(Outcome::Running) if finite => {}
                Ok(outcome) if finite => break outcome,
                Ok(_) | Err(TrainError::NonFinite { .. }) => {
                    self.stopped += 1;
                    return Ok(None);
                }
                Err(error) => return Err(error.into()),
            }
        };
        let view = &trainer.scene().train[0].clone();
        // A checkpoint fails if weights are not finite, an evaluation if pixels are not.
        let rendered = trainer.checkpoint(&mut |_| ());
        let rendered = rendered.and_then(|_| evaluate_view(trainer.renderer(), &[trainer.trained()], view));
        let Ok(rendered) = rendered else {
            self.not_finite += 1;
            return Ok(None);
        };
        let shown = view.image.rgb.iter().any(|color| *color != trainer.scene().background);
        let restarts = trainer.progress().restarts;
        self.restarts += restarts;
        match outcome {
            Outcome::Collapsed => self.collapsed += 1,
            _ if shown && rendered.shows_nothing() => self.faint += 1,
            _ if restarts > 0 => self.recovered += 1,
            _ => {}
        }
        Ok(rendered.value("psnr"))
    }
}

fn keep(_: &mut Scene) {}

fn identical(scene: &mut Scene) {
    let first = scene.train[0].clone();
    scene.train.iter_mut().for_each(|view| *view = first.clone());
}

/// Rotates every camera about its own vertical axis by 180°.
fn looking_away(scene: &mut Scene) {
    for view in &mut scene.train {
        let pose = &mut view.camera.to_world;
        (pose.x_axis, pose.z_axis) = (-pose.x_axis, -pose.z_axis);
    }
}

fn paint(scene: &mut Scene, color: fn(usize) -> [f32; 3]) {
    for view in &mut scene.train {
        Arc::make_mut(&mut view.image).rgb.iter_mut().enumerate().for_each(|(i, pixel)| *pixel = color(i));
    }
}

/// Returns a random colour that depends on the pixel alone.
fn noise(pixel: usize) -> [f32; 3] {
    let mut rng = fastrand::Rng::with_seed(pixel as u64);
    [rng.f32(), rng.f32(), rng.f32()]
}

fn scale(scene: &mut Scene, factor: f32) {
    let views = scene.train.iter_mut().chain(&mut scene.test).map(|view| &mut view.camera);
    for camera in views.chain(&mut scene.all_train_cameras) {
        let position = &mut camera.to_world.w_axis;
        *position = (position.truncate() * f64::from(factor)).extend(position.w);
    }
    scene.train.iter_mut().chain(&mut scene.test).for_each(|view| view.depth = None);
    let space = &mut scene.space;
    (space.near, space.far) = (space.near * factor, space.far * factor);
    space.range = Range::Distance { near: space.near, far: space.far };
    (space.bounds.min, space.bounds.max) = (space.bounds.min * factor, space.bounds.max * factor);
}
