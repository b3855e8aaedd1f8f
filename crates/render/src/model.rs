use burn::module::Module;
use infonerf_field::{Field, RadianceField, Sources};

use crate::{Exposure, OccupancyGrid};

/// What is trained: one field, or a coarse one that tells a fine one where to look.
#[derive(Module, Debug)]
pub struct Model<F: Module> {
    /// The field of the coarse pass, where that is not the one of the fine pass.
    pub coarse: Option<F>,
    /// The field that is rendered.
    pub fine: F,
    /// Gain and bias of each training view; none where all photographs are taken to have one exposure.
    pub exposure: Option<Exposure>,
}

impl<F: Field> Model<F> {
    /// The model as it answers when its fields look at `sources`: see [`Field::conditioned`].
    pub fn conditioned(&self, sources: &Sources, seed: Option<u64>) -> Self {
        Self {
            coarse: self.coarse.as_ref().map(|field| field.conditioned(sources, seed)),
            fine: self.fine.conditioned(sources, seed),
            exposure: self.exposure.clone(),
        }
    }
}

/// A trained model without gradients, and what is known to be empty around it: what pictures are rendered from.
#[derive(Clone, Debug)]
pub struct TrainedModel<F: Field = RadianceField> {
    /// The model, as `valid()`.
    pub model: Model<F>,
    /// What pictures of it may skip.
    pub occupancy: Option<OccupancyGrid>,
}
