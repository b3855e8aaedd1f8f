use std::sync::Arc;

use burn::tensor::Device;
use infonerf_field::FieldSpec;
use infonerf_loss::{Objective, TermSetup};
use infonerf_render::{Placement, Renderer, Warp};
use infonerf_scene::{Scene, ViewRegion};

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
    pub(crate) fn new(config: &Config, scene: Arc<Scene>, device: &Device) -> Result<Self, TrainError> {
        let cameras: Vec<_> = scene.train.iter().map(|view| view.camera.clone()).collect();
        if let Some(view) = scene.train.iter().find(|view| view.image.alpha.is_none())
            && config.render.occupancy.carve
        {
            let cause = format!("expected training images with an alpha channel: {} has none", view.name);
            return Err(TrainError::config("render.occupancy.carve", cause));
        }
        if !Warp::of(&scene, config.render.space).is_identity() {
            let refuse = |key: &str, cause: &str, found: bool| match found {
                true => {
                    Err(TrainError::config(key, format!("expected {cause}: {} is not bounded by a box", scene.name)))
                }
                false => Ok(()),
            };
            let placement = config.render.placement == Placement::Interval;
            refuse("render.placement", "\"mid\" or \"left\" (or render.space = \"box\")", placement)?;
            let photographs = config.field.sees_photographs();
            refuse("field.kind", "a field that looks at no photographs (or render.space = \"box\")", photographs)?;
            refuse("render.occupancy.carve", "false (or render.space = \"box\")", config.render.occupancy.carve)?;
        }
        let objective = Objective::new(&config.loss, &TermSetup { scene: &scene, device })
            .map_err(|error| TrainError::Config(error.to_string()))?;
        Ok(Self {
            renderer: Renderer::new(&config.render, &scene),
            region: ViewRegion::new(&cameras),
            images: TrainingImages::new(&scene, &config.train),
            photographs: Photographs::new(&scene),
            objective,
            scene,
        })
    }

    pub(crate) fn unseen<'a>(&'a self, config: &'a Config) -> UnseenViews<'a> {
        UnseenViews { scene: &self.scene, region: &self.region, config: &config.train }
    }
}
