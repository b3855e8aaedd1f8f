use std::sync::Arc;

use burn::tensor::Device;
use infonerf_loss::{Objective, TermSetup};
use infonerf_render::Renderer;
use infonerf_scene::{Scene, ViewRegion};

use crate::config::checks;
use crate::photographs::Photographs;
use crate::pixels::UnseenViews;
use crate::training_images::TrainingImages;
use crate::{Config, TrainError};

/// A scene with what training makes of it once.
#[derive(Debug)]
pub(crate) struct TrainingScene {
    pub(crate) scene: Arc<Scene>,
    pub(crate) renderer: Renderer,
    /// Where unseen poses are.
    pub(crate) region: ViewRegion,
    pub(crate) images: TrainingImages,
    /// Training views as a field sees them that looks at photographs.
    pub(crate) photographs: Photographs,
    pub(crate) objective: Objective,
}

impl TrainingScene {
    /// For a field that `sees` photographs or does not.
    pub(crate) fn new(config: &Config, scene: Arc<Scene>, sees: bool, device: &Device) -> Result<Self, TrainError> {
        let cameras: Vec<_> = scene.train.iter().map(|view| view.camera.clone()).collect();
        checks::of_scene(config, &scene)?;
        let renderer = Renderer::new(&config.render, &scene);
        let setup = TermSetup { scene: &scene, warp: renderer.warp(), device };
        let objective = Objective::new(&config.loss, &setup)?;
        Ok(Self {
            renderer,
            region: ViewRegion::new(&cameras),
            images: TrainingImages::new(&scene, &config.train),
            photographs: Photographs::new(&scene, sees),
            objective,
            scene,
        })
    }

    pub(crate) fn unseen<'a>(&'a self, config: &'a Config) -> UnseenViews<'a> {
        UnseenViews { scene: &self.scene, region: &self.region, config: &config.train }
    }
}
