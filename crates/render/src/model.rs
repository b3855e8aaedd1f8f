use std::sync::Arc;

use burn::module::Module;
use glam::DVec3;
use infonerf_field::{Field, RadianceField, Sources};
use infonerf_scene::{Camera, Similarity};
use infonerf_schedule::Moment;

use crate::exposure::Exposure;
use crate::occupancy::OccupancyGrid;
use crate::refinement::CameraRefinement;
use crate::residuals::Residuals;

/// Trained fields: one, or a coarse and a fine one (NeRF's hierarchical sampling).
#[derive(Module, Debug)]
pub struct Model<F: Module> {
    /// The field of the coarse pass, if it is not that of the fine pass.
    pub coarse: Option<F>,
    /// The field that is rendered.
    pub fine: F,
    /// Gain and bias per training view; `None` if images are taken to have one exposure.
    pub exposure: Option<Exposure>,
    /// Corrections of the training cameras; `None` if these are taken to be exact.
    pub cameras: Option<CameraRefinement>,
}

impl<F: Field> Model<F> {
    /// Returns a model of one field, with neither a coarse one nor corrections.
    pub fn of(fine: F) -> Self {
        Self { coarse: None, fine, exposure: None, cameras: None }
    }

    /// Returns the model with its fields conditioned on `sources`: see [`Field::conditioned`].
    pub fn conditioned(&self, sources: &Sources, seed: Option<u64>) -> Self {
        Self {
            coarse: self.coarse.as_ref().map(|field| field.conditioned(sources, seed)),
            fine: self.fine.conditioned(sources, seed),
            ..self.clone()
        }
    }
}

/// Frame of the cameras that were learned with a model, relative to the scene's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelFrame {
    /// Map from the scene's world to the model's.
    pub similarity: Similarity,
    /// Factor from the scene's focal lengths to those of the model.
    pub zoom: f64,
}

impl ModelFrame {
    /// Returns the frame of `learned` cameras, which started as `given`. Poses are aligned with those of `exact` cameras
    /// of the same views, about the scene's `centre`. The zoom is the geometric mean of learned over given focal lengths.
    pub fn of(exact: &[Camera], given: &[Camera], learned: &[Camera], centre: DVec3) -> Self {
        let logs = given.iter().zip(learned).map(|(given, learned)| (learned.fx / given.fx).ln());
        let zoom = (logs.sum::<f64>() / given.len().max(1) as f64).exp();
        Self { similarity: Similarity::between(exact, learned, centre), zoom }
    }

    /// Converts a camera of the scene to this frame.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let moved = self.similarity.camera(camera);
        Camera { fx: self.zoom * moved.fx, fy: self.zoom * moved.fy, ..moved }
    }
}

/// A trained model without gradients and its occupancy grid, from which pictures are rendered.
#[derive(Clone, Debug)]
pub struct TrainedModel<F: Field = RadianceField> {
    /// Model without gradients, as `valid()` returns it.
    pub model: Model<F>,
    /// Grid of empty space, which pictures skip.
    pub occupancy: Option<OccupancyGrid>,
    /// The moment of the last training step, at which the fields are evaluated: detail that fades in later is not learned.
    pub at: Moment,
    /// Map from the scene's frame to that of the cameras it was trained with; `None` if these are the scene's own.
    pub frame: Option<ModelFrame>,
    /// Residuals that pictures add to what the field shows; `None` for the field alone.
    pub residuals: Option<Arc<Residuals>>,
}

impl<F: Field> TrainedModel<F> {
    /// Returns a model at the moment of its last step, in the scene's frame, with neither empty space nor residuals.
    pub fn of(model: Model<F>, at: Moment) -> Self {
        Self { model, occupancy: None, at, frame: None, residuals: None }
    }

    /// Returns a camera of the scene in the frame of the model.
    pub fn camera(&self, camera: &Camera) -> Camera {
        self.frame.map_or_else(|| camera.clone(), |frame| frame.camera(camera))
    }

    /// Returns the length of the scene's unit in the frame of the model.
    pub fn scale(&self) -> f32 {
        self.frame.map_or(1.0, |frame| frame.similarity.scale as f32)
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat4;

    use super::*;

    #[test]
    fn the_zoom_is_the_geometric_mean_of_the_focal_lengths_ratios() {
        let given = DVec3::AXES.map(|at| Camera::from_fov(8, 8, 0.5, DMat4::from_translation(at)));
        let mut learned = given.clone();
        learned.iter_mut().zip([1.1, 1.2, 1.3]).for_each(|(camera, factor)| camera.fx *= factor);
        let frame = ModelFrame::of(&given, &given, &learned, DVec3::ZERO);
        approx::assert_relative_eq!(frame.zoom, (1.1_f64 * 1.2 * 1.3).cbrt(), max_relative = 1e-12);
        let (camera, [fx, fy]) = (frame.camera(&given[1]), [given[1].fx, given[1].fy].map(|focal| frame.zoom * focal));
        assert_eq!([camera.fx, camera.fy], [fx, fy]);
    }
}
