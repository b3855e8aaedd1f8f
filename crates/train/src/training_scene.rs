use std::sync::Arc;

use burn::tensor::Device;
use infonerf_field::Sources;
use infonerf_loss::Objective;
use infonerf_render::Renderer;
use infonerf_scene::{Scene, ViewRegion};

use crate::config::{Config, checks};
use crate::error::TrainError;
use crate::images::TrainingImages;
use crate::sources::all_sources;

/// Scene with everything that training derives from it once.
pub(crate) struct TrainingScene {
    pub(crate) scene: Arc<Scene>,
    pub(crate) renderer: Renderer,
    pub(crate) region: ViewRegion,
    pub(crate) images: TrainingImages,
    /// Training views for fields that are conditioned on images.
    pub(crate) sources: Sources,
    pub(crate) objective: Objective,
}

impl TrainingScene {
    /// Prepares a scene for training; training views are kept as sources if the field `sees` images.
    pub(crate) fn new(config: &Config, scene: Arc<Scene>, sees: bool, device: &Device) -> Result<Self, TrainError> {
        checks::check_scene(config, &scene)?;
        let objective = Objective::new(&config.loss, &scene, device)?;
        Ok(Self {
            renderer: Renderer::new(&config.render, &scene),
            region: ViewRegion::new(&scene.training_cameras()),
            images: TrainingImages::new(&scene, &config.train),
            sources: all_sources(&scene, sees),
            objective,
            scene,
        })
    }
}
