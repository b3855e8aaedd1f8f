//! Learned cameras.

use std::sync::Arc;

use crate::common::{scene_of, steps};
use burn::tensor::Device;
use glam::DVec3;
use infonerf_render::Pivot;
use infonerf_scene::{Camera, PoseError, Scene, View, rotation_angle_deg};
use infonerf_train::{Config, Preset, Trainer, fit_test_poses};

const STEPS: usize = 300;

/// Returns a config of preset `fast` for images of 48², at first of half that size.
fn config(refine: &str) -> Config {
    let settings = "field.resolutions=[16,32,64] train.downscale={steps=[[0.0,2],[0.4,1]]} train.iterations=300 train.rays=512 \
                    train.target_samples=0 train.cameras.lr={from=2e-3,to=1e-4,curve='exponential',warmup=50}";
    let refine = format!("train.cameras.refine={refine}");
    Config::of(Preset::Fast, settings.split_whitespace().chain([refine.as_str()])).unwrap()
}

/// Returns the error of one camera's pose: degrees, and percent of its distance from the origin.
fn apart(found: &Camera, truth: &Camera) -> [f64; 2] {
    let moved = found.position_f64().distance(truth.position_f64()) / truth.position_f64().length();
    [rotation_angle_deg(&found.rotation(), &truth.rotation()), 100.0 * moved]
}

/// Checks that the pose of an image is recovered with a fixed field, which was trained on many exact views.
#[test]
fn pose_of_an_image_is_recovered() {
    let scene = scene_of("knot", 30, 48);
    let mut trainer = Trainer::new(&config("none"), scene.clone(), 0, None, &Device::flex()).unwrap();
    steps(&mut trainer, STEPS);
    let trained = [trainer.trained()];
    let fit = |view: &View| {
        let fitted = fit_test_poses(trainer.renderer(), &trained, view, Pivot::of(&scene), 100, &mut || true);
        fitted.into_owned().remove(0)
    };
    let one = |view: &View| Scene { train: vec![view.clone()], ..Scene::default() };
    for view in &scene.test {
        let off = one(view).disturbed(2.0, 0.03, 1).train.remove(0);
        let fitted = fit(&off);
        let (before, after) = (apart(&off.camera, &view.camera), apart(&fitted.camera(&off.camera), &view.camera));
        assert!((0..2).all(|i| after[i] < 0.5 * before[i]), "{before:?} {after:?}");
    }
    let mut blind = scene.test[0].clone();
    blind.valid = Some(vec![false; blind.image.rgb.len()].into());
    let kept = fit(&blind);
    assert!(apart(&kept.camera(&blind.camera), &blind.camera).into_iter().all(|error| error < 0.1));
}

/// Checks that disturbed cameras of many views approach the exact ones; in so few steps only by a little.
#[test]
fn disturbed_cameras_approach_the_exact_ones() {
    let scene = Arc::new(scene_of("knot", 30, 48).as_ref().clone().disturbed(3.0, 0.04, 1));
    let mut trainer = Trainer::new(&config("photometric"), scene.clone(), 0, None, &Device::flex()).unwrap();
    steps(&mut trainer, STEPS);
    let given = scene.training_cameras();
    let exact = scene.exact_cameras.as_ref().unwrap();
    let error = |cameras: &[Camera]| PoseError::of(cameras, exact, DVec3::ZERO);
    let (before, after) = (error(&given), error(&trainer.cameras()));
    assert!(after.rotation_deg < 0.95 * before.rotation_deg, "{before:?} {after:?}");
    assert!(after.translation_percent < 0.95 * before.translation_percent, "{before:?} {after:?}");
}
