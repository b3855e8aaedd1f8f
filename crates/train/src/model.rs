//! The model that a config describes, as training finds it, and its optimiser.

use burn::module::ParamGroup;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use infonerf_field::RadianceField;
use infonerf_ops::adam::Adam;
use infonerf_render::Model;
use infonerf_scene::Aabb;

use crate::{Checkpoint, Config, TrainError};

/// Weights drawn from `seed`, or those of the run that `train.init` names.
pub(crate) fn build(config: &Config, bounds: Aabb, seed: u64, device: &Device) -> Result<Model, TrainError> {
    let bounds = [bounds.min.to_array(), bounds.max.to_array()];
    let field = |seed| {
        RadianceField::new(&config.field, bounds, seed, device).map_err(|error| TrainError::Config(error.to_string()))
    };
    let own_coarse = config.render.fine_samples > 0 && !config.field.shares_passes();
    let coarse = if own_coarse { Some(field(seed.wrapping_add(1 << 32))?) } else { None };
    begun(config, Model { coarse, fine: field(seed)? })
}

/// `model` with the weights of the run in `train.init`, if one is named.
fn begun(config: &Config, model: Model) -> Result<Model, TrainError> {
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
    let tables = Adam { rate: t.table_rate, ..adam.clone() };
    ModuleOptimizer::from(adam).with_group(ParamGroup::from_predicate("tables"), tables, None)
}
