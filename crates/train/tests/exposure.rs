//! Images of changing exposure.

use std::sync::Arc;

use crate::common::{fast_config, losses, scene_of};
use burn::tensor::{Device, Tensor};
use infonerf_ops::to_host;
use infonerf_scene::Scene;
use infonerf_train::Trainer;

/// Share of the light that is left in the first image.
const DARKER: f32 = 0.5;
const STEPS: usize = 600;

/// Returns a scene of many views of the same surfaces. The first photograph is darker, but for the background.
fn scene_of_changing_exposure() -> Scene {
    let mut scene = scene_of("knot", 16, 16).as_ref().clone();
    let background = scene.background;
    let image = Arc::make_mut(&mut scene.train[0].image);
    for (color, alpha) in image.rgb.iter_mut().zip(image.alpha.as_ref().expect("a built-in scene has alpha")) {
        for (value, behind) in color.iter_mut().zip(background) {
            let behind = (1.0 - alpha) * behind;
            *value = DARKER * (*value - behind) + behind;
        }
    }
    scene
}

/// Returns the training loss over the last steps, and the colour that each view shows for grey.
fn trained(compensated: bool) -> (f32, Option<Vec<f32>>) {
    let settings = format!(
        "train.exposure_compensation={compensated} train.cameras.refine=none train.iterations={STEPS} train.rays=128 \
         train.target_samples=0 train.lr=1e-2 train.grid_lr_multiplier=2.0"
    );
    let config = fast_config(&settings.split(' ').collect::<Vec<_>>());
    let device = Device::flex();
    let mut trainer = Trainer::new(&config, scene_of_changing_exposure(), 0, None, &device).unwrap();
    let losses: Vec<f32> = losses(&mut trainer, STEPS).iter().map(|(losses, _)| losses["rgb"]).collect();
    let last = &losses[STEPS - 50..];
    let shown = trainer.model().exposure.map(|exposure| {
        let views: Vec<usize> = (0..trainer.scene().train.len()).collect();
        let (grey, opaque) = (Tensor::full([views.len(), 3], 0.5, &device), Tensor::ones([views.len()], &device));
        let shown = to_host(exposure.apply(grey, opaque, [0.0; 3], &views));
        shown.chunks_exact(3).map(|rgb| rgb.iter().sum::<f32>() / 3.0).collect()
    });
    (last.iter().sum::<f32>() / last.len() as f32, shown)
}

/// Checks that the gain of a darker image is learned, and that the image no longer contradicts the others.
#[test]
fn darker_image_is_compensated_for() {
    let (plain, none) = trained(false);
    assert_eq!(none, None);
    let (compensated, shown) = trained(true);
    let shown = shown.unwrap();
    assert!((shown.iter().sum::<f32>() / shown.len() as f32 - 0.5).abs() < 1e-3, "the mean stays: {shown:?}");
    let others = shown[1..].iter().sum::<f32>() / (shown.len() - 1) as f32;
    assert!((shown[0] / others - DARKER).abs() < 0.15, "{shown:?}");
    assert!(compensated < 0.8 * plain, "{compensated} with, {plain} without");
}
