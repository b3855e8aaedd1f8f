//! The model that a config describes, as training finds it, and its optimiser.

use std::fmt;
use std::sync::Arc;

use burn::module::ParamGroup;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use infonerf_field::{Body, Field, FieldSetup, FieldSpec, RadianceField};
use infonerf_ops::adam::Adam;
use infonerf_render::{Exposure, Model};
use infonerf_scene::{self as scene, Aabb};

use crate::{Checkpoint, Config, TrainError};

type Build<F> = dyn Fn(u64, &Device) -> Result<F, TrainError> + Send + Sync;

/// Makes fields with their first weights: the same ones for the same seed.
#[derive(Clone)]
pub(crate) struct FieldBuilder<F> {
    build: Arc<Build<F>>,
    shares_passes: bool,
}

impl<F> fmt::Debug for FieldBuilder<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FieldBuilder").field("shares_passes", &self.shares_passes).finish_non_exhaustive()
    }
}

impl FieldBuilder<RadianceField> {
    /// Fields as `config` describes them, for a scene within `bounds` that may be of a `body`.
    pub(crate) fn configured(config: &Config, bounds: Aabb, body: Option<scene::Body>) -> Self {
        let bounds = [bounds.min.to_array(), bounds.max.to_array()];
        let (config, shares_passes) = (config.field.clone(), config.field.shares_passes());
        let vertices: Vec<[f32; 3]> = body.iter().flat_map(|body| &body.vertices).map(|v| v.to_array()).collect();
        let build = move |seed: u64, device: &Device| {
            let body = body.as_ref().map(|body| Body {
                vertices: &vertices,
                axes: body.axes.to_cols_array_2d(),
                origin: body.origin.to_array(),
            });
            RadianceField::new(&config, &FieldSetup { bounds, seed, device, body })
                .map_err(|error| TrainError::Config(error.to_string()))
        };
        Self { build: Arc::new(build), shares_passes }
    }
}

impl<F: Field> FieldBuilder<F> {
    /// Fields that `build` makes of a seed and a device.
    pub(crate) fn custom(build: impl Fn(u64, &Device) -> F + Send + Sync + 'static) -> Self {
        Self { build: Arc::new(move |seed, device| Ok(build(seed, device))), shares_passes: false }
    }

    /// A model for `views` training views with weights drawn from `seed`, or those of the run that `train.init` names.
    pub(crate) fn model(
        &self,
        config: &Config,
        views: usize,
        seed: u64,
        device: &Device,
    ) -> Result<Model<F>, TrainError> {
        let own_coarse = config.render.is_hierarchical() && !self.shares_passes;
        let coarse = if own_coarse { Some((self.build)(seed.wrapping_add(1 << 32), device)?) } else { None };
        let model = begun(config, Model { coarse, fine: (self.build)(seed, device)?, exposure: None })?;
        let exposure = config.train.exposure_compensation.then(|| Exposure::new(views, device));
        Ok(Model { exposure, ..model })
    }
}

/// `model` with the weights of the run in `train.init`, if one is named.
fn begun<F: Field>(config: &Config, model: Model<F>) -> Result<Model<F>, TrainError> {
    let folder = &config.train.init;
    if folder.as_os_str().is_empty() {
        return Ok(model);
    }
    let fault = |cause: String| TrainError::config("train.init", format!("{}: {cause}", folder.display()));
    let (checkpoint, _) = Checkpoint::load(folder).map_err(|error| fault(error.to_string()))?;
    let checkpoint = checkpoint
        .ok_or_else(|| fault("expected the folder of a run with a checkpoint, as `infonerf pretrain` leaves".into()))?;
    checkpoint.restore_model(model).map_err(|error| {
        let causes = error.to_string();
        // A list of every tensor that does not fit: the first one says enough.
        let first = causes.split("\", \"").next().unwrap_or_default();
        fault(format!("expected weights of the same field: {first}"))
    })
}

pub(crate) fn optimiser(config: &Config) -> ModuleOptimizer {
    let t = &config.train;
    let adam = Adam { epsilon: t.adam_epsilon, beta2: t.adam_beta2, ..Adam::default() };
    let tables = Adam { rate: t.grid_lr_multiplier, ..adam.clone() };
    ModuleOptimizer::from(adam).with_group(ParamGroup::from_predicate("tables"), tables, None)
}
