use infonerf_render::{RenderConfig, Renderer, TrainedModel};
use infonerf_scene::Scene;

/// A field with its scene and renderer: what a package is made from.
pub(crate) struct Subjects<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) renderer: &'a Renderer,
    pub(crate) config: &'a RenderConfig,
    pub(crate) trained: &'a TrainedModel,
}
