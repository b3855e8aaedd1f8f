use std::sync::Arc;

use burn::tensor::Device;
use infonerf_field::FieldSpec;
use infonerf_loss::{Objective, TermSetup};
use infonerf_render::{Placement, Renderer, Space, Warp};
use infonerf_scene::{Scene, ViewRegion};

use crate::config::check_enough_views;
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
        if let Some((key, images)) = config.field.first_photographs() {
            check_enough_views(key, images, scene.train.len())?;
        }
        if config.render.space == Space::Ndc && !Warp::has_ndc(&scene) {
            let cause = format!("expected another space than \"ndc\": the cameras of {} face all ways", scene.name);
            return Err(TrainError::config("render.space", cause));
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
            refuse(
                "field.kind",
                "a field that hangs on no body (or render.space = \"box\")",
                config.field.needs_body(),
            )?;
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

#[cfg(test)]
mod tests {
    use infonerf_procedural::load;
    use infonerf_scene::SceneRequest;

    use super::*;
    use crate::Preset;

    /// Also where the config alone does not say how many views there will be.
    #[test]
    fn more_photographs_than_there_are_cannot_be_looked_at() {
        let request = SceneRequest { image_size: Some(4), ..SceneRequest::default() };
        let scene = load("knot", &request).unwrap();
        let fault = |images: usize| {
            let mut table = Preset::Fast.table();
            let encoder = format!("encoder={{images={images},size=[16,16],width=1}}");
            let field = "kind='neuralvolumes',latent=4,resolution=4,width=8,maps=1,warp_resolution=2";
            for setting in ["scene.views={kind='all'}", &format!("field={{{field},{encoder}}}")] {
                crate::config::assign(&mut table, setting).unwrap();
            }
            let config = Config::from_table(table).unwrap();
            TrainingScene::new(&config, Arc::new(scene.clone()), &Device::flex()).err().map(|error| error.to_string())
        };
        let views = scene.train.len();
        assert_eq!(fault(views), None);
        let message = fault(views + 1).unwrap();
        let expected = format!("field.encoder.images: expected at most {views}, as many as there are training views");
        assert!(message.starts_with(&expected), "{message}");
    }

    #[test]
    fn cameras_that_face_all_ways_have_no_device_coordinates() {
        let request = SceneRequest { image_size: Some(4), ..SceneRequest::default() };
        let mut scene = load("knot", &request).unwrap();
        let mut config = Config::from_table(Preset::Fast.table()).unwrap();
        config.render.space = Space::Ndc;
        let views = scene.train.clone();
        scene.train = views[..1].to_vec();
        scene.all_train_cameras = vec![views[0].camera.clone()];
        assert!(TrainingScene::new(&config, Arc::new(scene.clone()), &Device::flex()).is_ok());
        // Two cameras back to back.
        let turned = glam::DMat4::from_rotation_y(std::f64::consts::PI);
        scene.train = vec![views[0].clone(), views[0].clone()];
        scene.train[1].camera.to_world = views[0].camera.to_world * turned;
        scene.all_train_cameras = scene.train.iter().map(|view| view.camera.clone()).collect();
        let message = TrainingScene::new(&config, Arc::new(scene), &Device::flex()).unwrap_err().to_string();
        assert!(message.contains("render.space") && message.contains("knot"), "{message}");
    }
}
