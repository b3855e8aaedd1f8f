//! Pictures with the residuals of the training views.

use crate::common::{fast_config, scene, steps};
use burn::tensor::Device;
use infonerf_render::{TrainedModel, render_image};
use infonerf_train::Trainer;

#[test]
fn residuals_bring_a_training_view_nearer_to_its_image() {
    let settings =
        ["train.cameras.refine=none", "train.iterations=200", "train.target_samples=0", "render.residuals=true"];
    let mut trainer = Trainer::new(&fast_config(&settings), scene(), 0, None, &Device::flex()).unwrap();
    steps(&mut trainer, 200);
    let view = &trainer.scene().train[0];
    let error = |trained: TrainedModel| {
        let picture = render_image(trainer.renderer(), &[trained], &view.camera);
        let hit = picture.depth.iter().map(|depth| depth.is_finite());
        let errors = picture.rgb.iter().zip(&view.image.rgb).zip(hit.clone()).filter(|(_, hit)| *hit);
        let squares: f32 = errors.flat_map(|((a, b), _)| a.iter().zip(b)).map(|(a, b)| (a - b).powi(2)).sum();
        (squares, hit.filter(|hit| *hit).count())
    };
    let ((without, hits), (with, _)) =
        (error(TrainedModel { residuals: None, ..trainer.trained() }), error(trainer.trained()));
    assert!(hits > 20, "{hits} of the pixels hit something");
    // Pixels next to those that hit nothing, of which a small picture has many, stay as they are.
    assert!(with < 0.6 * without, "{without} to {with}");
}
