//! Evaluation of a run on its test views, and the record of it.

use std::path::Path;

use anyhow::{Context, Result};
use infonerf_dataset::SceneSource;
use infonerf_loss::Need;
use infonerf_metrics::to_rgb8;
use infonerf_render::Pivot;
use infonerf_report::{CameraErrors, Record, TestViews, depth_image, error_image, save_png};
use infonerf_scene::{Backdrop, Camera, PoseError, Scene, TestProtocol, View};
use infonerf_train::config::{Disturbance, Unseen};
use infonerf_train::{
    Config, Evaluated, Evaluation, Information, Progress, TestView, Trainer, fit_test_poses, information,
};

use crate::run::{Control, RunEvent, Session, Trained, Watch};
use crate::run_plan::RunPlan;

/// Renders and measures the test views, writes the images, and returns the record without its peak memory; `None` if `watch`
/// stops the evaluation. `progress` is that of all fields, including the `left_out` ones that went empty.
pub(super) fn evaluate(
    session: &Session,
    trained: &Trained,
    folder: &Path,
    progress: &Progress,
    left_out: usize,
    watch: &mut Watch<'_>,
) -> Result<Option<Record>> {
    let Trained { plan, trainers, .. } = trained;
    let scene = trainers[0].scene();
    let protocol = plan.config.eval.metric_protocol();
    let tested = plan.config.eval.measured(&scene.test);
    let evaluation = Evaluation::new(&session.networks, &protocol);
    let measured = measure(evaluation, trained, &tested, folder, watch)?;
    let Some((evaluated, information)) = measured else { return Ok(None) };
    let has_files = matches!(plan.source, SceneSource::Folder { .. });
    let files = |views: &[&View]| views.iter().filter(|_| has_files).map(|view| view.file.clone()).collect();
    let measured = evaluated.measured.representable();
    let mut notes = notes(plan, scene, progress.restarts);
    let fields = trainers.len() + left_out;
    let empty = || format!("{left_out} of {fields} fields became empty and are left out of the pictures");
    notes.extend((left_out > 0).then(empty));
    notes.extend(filled_note(scene, evaluated.opacity));
    notes.extend(measured.notes.iter().map(ToString::to_string));
    let mut photographs = scene.train.iter().flat_map(|view| &view.image.rgb);
    let faint = evaluated.shows_nothing && photographs.any(|color| *color != scene.background);
    Ok(Some(Record {
        experiment: plan.experiment.clone(),
        scene: plan.scene.clone(),
        variant: plan.variant.clone(),
        setting: None,
        seed: plan.seed,
        preset: plan.preset.name().to_owned(),
        device: session.device.name.name().to_owned(),
        train_views: scene.train.iter().map(|view| view.id).collect(),
        train_files: files(&scene.train.iter().collect::<Vec<_>>()),
        test_views: TestViews {
            protocol: plan.config.eval.test.to_string(),
            count: tested.len(),
            ids: tested.iter().map(|view| view.id).collect(),
        },
        test_files: files(&tested),
        image_size: [scene.test[0].image.width as usize, scene.test[0].image.height as usize],
        iterations: progress.step as u64,
        train_seconds: progress.seconds,
        render_seconds_per_image: evaluated.seconds_per_image,
        samples_total: progress.samples_total,
        samples_evaluated: progress.samples_evaluated,
        evaluation: protocol.to_string(),
        metrics: measured.set,
        ray_entropy_bits: information.map(|information| information.entropy_bits),
        information_gain: information.map(|information| information.gain),
        cameras: pose_errors(trainers),
        peak_rss_bytes: None,
        collapsed: trainers[0].progress().has_collapsed() || faint,
        notes,
    }))
}

/// Renders and measures the `tested` views, writes their images, and measures test rays; `None` if `watch` stops it.
fn measure(
    mut evaluation: Evaluation<'_>,
    Trained { plan, trainers, models, .. }: &Trained,
    tested: &[&View],
    folder: &Path,
    watch: &mut Watch<'_>,
) -> Result<Option<(Evaluated, Option<Information>)>> {
    let (scene, renderer, steps) = (trainers[0].scene(), trainers[0].renderer(), plan.config.eval.pose_steps);
    let mut stopped = false;
    let mut go_on = |event: RunEvent<'_>| {
        stopped = stopped || watch(event) == Control::Stop;
        !stopped
    };
    for (index, view) in tested.iter().enumerate() {
        if !go_on(RunEvent::Evaluating { view: index, views: tested.len() }) {
            return Ok(None);
        }
        let fit_on = &mut || go_on(RunEvent::Measuring);
        let members = fit_test_poses(renderer, models, view, Pivot::of(scene), steps, fit_on);
        if !go_on(RunEvent::Measuring) {
            return Ok(None);
        }
        write_pictures(folder, scene, view, &evaluation.add(renderer, &members, view)?)?;
    }
    let evaluated = evaluation.finish().context("eval.test: expected at least one test view, found none")?;
    let of_member = |trainer: &Trainer| {
        let go_on = &mut || go_on(RunEvent::Measuring);
        information(renderer, &trainer.snapshot(), scene, &plan.config, plan.seed, go_on)
    };
    let information = Information::mean(&trainers.iter().filter_map(of_member).collect::<Vec<_>>());
    Ok((!stopped).then_some((evaluated, information)))
}

fn write_pictures(folder: &Path, scene: &Scene, view: &View, result: &TestView) -> Result<()> {
    let image = &result.image;
    let (width, height) = (image.width, image.height);
    let pictures = [
        ("test", to_rgb8(&image.rgb, width, height)?),
        ("truth", to_rgb8(&view.image.rgb, width, height)?),
        ("depth", depth_image(&image.depth, &image.acc, width, height, scene.space.near, scene.space.far)?),
        ("error", error_image(&image.rgb, &view.image.rgb, width, height)?),
    ];
    for (kind, picture) in pictures {
        save_png(&picture, &folder.join(kind).join(format!("{:03}.png", view.id)))?;
    }
    Ok(())
}

/// Returns the pose errors of the training cameras before and after training, the mean over the fields; `None` without true cameras.
fn pose_errors(trainers: &[Trainer]) -> Option<CameraErrors> {
    let scene = trainers[0].scene();
    let exact = scene.exact_cameras.as_ref()?;
    let error = |cameras: &[Camera]| {
        let error = PoseError::of(cameras, exact, scene.space.centre.as_dvec3());
        [error.rotation_deg, error.translation_percent]
    };
    let learned = trainers.iter().map(|trainer| error(&trainer.cameras()));
    let sum = learned.fold([0.0; 2], |sum, error| [sum[0] + error[0], sum[1] + error[1]]);
    let [rotation_deg_before, translation_percent_before] = error(&scene.given_cameras());
    let [rotation_deg, translation_percent] = sum.map(|sum| sum / trainers.len() as f64);
    Some(CameraErrors { rotation_deg_before, rotation_deg, translation_percent_before, translation_percent })
}

/// Returns a note on the part of the pictures, `1 − opacity` in the mean, that is filled in for an unknown backdrop.
fn filled_note(scene: &Scene, opacity: f64) -> Option<String> {
    let percent = 100.0 * (1.0 - opacity);
    let filled = "these pixels are filled from their neighbourhood";
    (scene.backdrop == Backdrop::Unknown && percent >= 0.05)
        .then(|| format!("{percent:.1} % of the test pictures show nothing that was learned: {filled}"))
}

/// Returns notes on what renders of test views have in addition to the field.
pub fn picture_notes(config: &Config) -> Vec<String> {
    let residuals = "pictures add the residuals of the training views nearest to them (render.residuals)";
    let steps = config.eval.pose_steps;
    let fitted =
        format!("the pose of each test view was fitted to its photograph in {steps} steps before it was measured");
    let notes = [(config.render.residuals, residuals.to_owned()), (steps > 0, fitted)];
    notes.into_iter().filter_map(|(holds, note)| holds.then_some(note)).collect()
}

fn notes(plan: &RunPlan, scene: &Scene, restarts: usize) -> Vec<String> {
    let mut notes = [scene.warnings.as_slice(), &scene.notes].concat();
    notes.extend(plan.data.is_none().then(|| "procedural scene, not a published data set".to_owned()));
    let by_clock = |s: f64| format!("trained for {s} s by the clock: another machine takes another number of steps");
    notes.extend(plan.budget.map(by_clock));
    if plan.config.train.unseen == Unseen::Dataset && plan.config.loss.needs().iter().any(Need::is_unseen) {
        let unseen = "unseen poses are those of all training images of the data set but the tested ones, chosen or not";
        notes.push(unseen.to_owned());
    }
    let Disturbance { degrees, distance } = plan.config.scene.disturb;
    if scene.exact_cameras.is_some() {
        notes.push(format!(
            "training cameras were disturbed by {degrees}° and {} % of their distance; test cameras are aligned with them by \
             a similarity",
            100.0 * distance
        ));
    } else if plan.config.train.cameras.refine.is_photometric() {
        notes.push("training cameras were learned; test cameras are aligned with them by a similarity".into());
    }
    notes.extend(picture_notes(&plan.config));
    if plan.config.eval.test == TestProtocol::Training {
        let tested = "tested on the training views, each without its own residual: figures measure how well these are fitted, \
                      not the quality of new views";
        notes.push(tested.to_owned());
    }
    let mut supervision = Vec::new();
    for (name, spec) in plan.config.loss.active() {
        match spec.skip_reason(scene) {
            Some(reason) => notes.push(format!("loss.{name} is {reason}")),
            None => supervision.extend(spec.extra_supervision().map(|known| format!("loss.{name} knows {known}"))),
        }
    }
    notes.extend(supervision);
    notes.extend(plan.config.render.without_effect().into_iter().map(str::to_owned));
    notes.extend(plan.config.initial_weights());
    let restarted = || format!("the field went empty {restarts} times and training started over with other weights");
    notes.extend((restarts > 0).then(restarted));
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::first_run;

    #[test]
    fn settings_with_side_effects_are_noted() {
        let noted = |part: &str, set: &[&str]| {
            let plan = first_run(set);
            notes(&plan, &Scene::default(), 0).iter().any(|note| note.contains(part))
        };
        let unseen =
            |set: &[&str]| noted("unseen poses", &[&["train.unseen=dataset", "loss.entropy.rays=seen"], set].concat());
        assert!(!unseen(&["loss.entropy.weight=1e-3", "loss.kl.weight=0"]));
        assert!(unseen(&["loss.entropy.weight=0", "loss.kl.weight=1e-3", "loss.kl.rays=unseen"]));
        assert!(unseen(&["loss.entropy.weight=0", "loss.opacity_prior={weight=1e-3,rays=\"all\"}"]));
        for (key, set) in [
            ("render.early_stop_transmittance", "render.placement=left"),
            ("render.early_stop_transmittance", "render.fine_samples=8"),
            ("render.hidden_depth", "render.occupancy.enabled=false"),
            ("render.residuals", "render.residuals=true"),
        ] {
            assert!(noted(key, &[set]) && !noted(key, &[]), "{key} with {set}");
        }
    }
}
