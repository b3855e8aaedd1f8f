use infonerf_render::{RenderConfig, Renderer, TrainedModel};
use infonerf_scene::Scene;

/// Field with its scene and renderer, of which a package is made.
pub(crate) struct Subjects<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) renderer: &'a Renderer,
    pub(crate) config: &'a RenderConfig,
    pub(crate) trained: &'a TrainedModel,
}
