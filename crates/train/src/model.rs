//! Builds the model that a config describes, with its initial weights, and its optimizer.

use std::sync::Arc;

use burn::lr_scheduler::module_lr_scheduler::{ModuleLearningRate, ModuleLrScheduler};
use burn::module::{Module, ModuleVisitor, Param, ParamGroup};
use burn::optim::ModuleOptimizer;
use burn::tensor::{Device, Tensor};
use infonerf_field::{BodyVertices, Field, FieldConfig, FieldSetup, FieldSpec, RadianceField, SourceImages};
use infonerf_ops::adam::Adam;
use infonerf_render::{CameraRefinement, Exposure, Model, Pivot, Warp};
use infonerf_scene::{Aabb, Scene};
use infonerf_schedule::{Fault, Moment};

use crate::checkpoint::Checkpoint;
use crate::config::{Config, TrainConfig};
use crate::error::TrainError;

type Build<F> = dyn Fn(u64, &Device) -> Result<F, TrainError> + Send + Sync;

/// Builds fields with their initial weights, the same for the same seed.
#[derive(Clone)]
pub(crate) struct FieldBuilder<F> {
    build: Arc<Build<F>>,
    /// Builds the coarse pass's network; `None` if both passes share one.
    build_coarse: Option<Arc<Build<F>>>,
    pub(crate) sees_images: bool,
}

impl FieldBuilder<RadianceField> {
    pub(crate) fn configured(config: &Config, scene: &Scene) -> Self {
        let Aabb { min, max } = field_bounds(config, scene);
        let (bounds, body) = ([min.to_array(), max.to_array()], scene.space.body.clone());
        let vertices: Vec<[f32; 3]> = body.iter().flat_map(|body| &body.vertices).map(|v| v.to_array()).collect();
        let build = |config: FieldConfig| -> Arc<Build<RadianceField>> {
            let (body, vertices) = (body.clone(), vertices.clone());
            Arc::new(move |seed: u64, device: &Device| {
                let body = body.as_ref().map(|body| BodyVertices {
                    vertices: &vertices,
                    axes: body.axes.to_cols_array_2d(),
                    origin: body.origin.to_array(),
                });
                Ok(RadianceField::new(&config, &FieldSetup { bounds, seed, device, body })?)
            })
        };
        Self {
            build: build(config.field.clone()),
            build_coarse: config.field.coarse().map(build),
            sees_images: sees_images(&config.field),
        }
    }
}

impl<F: Field> FieldBuilder<F> {
    pub(crate) fn custom(build: impl Fn(u64, &Device) -> F + Send + Sync + 'static) -> Self {
        let build: Arc<Build<F>> = Arc::new(move |seed: u64, device: &Device| Ok(build(seed, device)));
        Self { build_coarse: Some(build.clone()), build, sees_images: true }
    }

    /// Returns a model for `scene` with weights drawn from `seed`, or those of the run that `train.init` names.
    pub(crate) fn model(
        &self,
        config: &Config,
        scene: &Scene,
        seed: u64,
        device: &Device,
    ) -> Result<Model<F>, TrainError> {
        let build_coarse = self.build_coarse.as_ref().filter(|_| config.render.is_hierarchical());
        let coarse = build_coarse.map(|build| build(seed.wrapping_add(1 << 32), device)).transpose()?;
        let model = with_initial_weights(config, Model { coarse, ..Model::of((self.build)(seed, device)?) })?;
        let (train, views) = (&config.train, scene.train.len());
        let exposure = train.exposure_compensation.then(|| Exposure::new(views, device));
        let refined = train.cameras.refine.is_photometric();
        let cameras = refined.then(|| CameraRefinement::new(views, Pivot::of(scene), train.cameras.focal, device));
        Ok(Model { exposure, cameras, ..model })
    }
}

/// Returns whether a field of this config is conditioned on photographs: on those drawn in a step, or always on the first.
pub(crate) fn sees_images(config: &FieldConfig) -> bool {
    config.traits().sources != SourceImages::None
}

/// Returns the box that a field of `scene` is made for.
pub(crate) fn field_bounds(config: &Config, scene: &Scene) -> Aabb {
    Warp::of(scene, config.render.space).bounds(scene)
}

/// Returns `model` with the weights of the run in `train.init`, if one is named.
fn with_initial_weights<F: Field>(config: &Config, model: Model<F>) -> Result<Model<F>, TrainError> {
    let folder = &config.train.init;
    if folder.as_os_str().is_empty() {
        return Ok(model);
    }
    let fault = |cause: String| {
        let expected = "the folder of a run of the same field with a checkpoint, as `infonerf pretrain` leaves";
        Fault::new("train.init", expected, format!("{}: {cause}", folder.display()))
    };
    let (checkpoint, _) = Checkpoint::load(folder).map_err(|error| fault(error.to_string()))?;
    let checkpoint = checkpoint.ok_or_else(|| fault("no checkpoint".into()))?;
    let restored = checkpoint.restore_model(model).map_err(|error| {
        let causes = error.to_string();
        // The error lists every tensor that does not fit; the first one is enough.
        fault(causes.split("\", \"").next().unwrap_or_default().to_owned())
    });
    Ok(restored?)
}

/// Returns the learning rates of the step at `at`: of cameras, and of all other parameters.
pub(crate) fn learning_rates(config: &TrainConfig, at: Moment) -> ModuleLearningRate {
    let cameras = ParamGroup::from_predicate("cameras");
    ModuleLrScheduler::new(config.lr.at(at)).with_group(cameras, config.cameras.lr.at(at)).step()
}

pub(crate) fn optimizer(config: &Config) -> ModuleOptimizer {
    let t = &config.train;
    let adam = Adam { epsilon: t.adam_epsilon, beta2: t.adam_beta2, ..Adam::default() };
    let tables = Adam { rate: t.grid_lr_multiplier, ..adam.clone() };
    ModuleOptimizer::from(adam).with_group(ParamGroup::from_predicate("tables"), tables, None)
}

/// Lists all weights of a module, each flattened, in the module's order.
pub fn weights(module: &impl Module) -> Vec<Tensor<1>> {
    struct Visited(Vec<Tensor<1>>);
    impl ModuleVisitor for Visited {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.0.push(param.val().flatten(0, D - 1));
        }
    }
    let mut visited = Visited(Vec::new());
    module.visit(&mut visited);
    visited.0
}
