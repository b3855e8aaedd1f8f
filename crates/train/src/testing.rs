//! A scene for tests.

use infonerf_scene::{Scene, SceneRequest, ViewSelection};

/// Returns the built-in knot with `count` training views, `size` pixels wide.
pub(crate) fn knot(count: usize, size: u32) -> Scene {
    let train = ViewSelection::Seed { seed: 0, count };
    infonerf_procedural::load("knot", &SceneRequest { train, image_size: Some(size), ..SceneRequest::default() })
        .unwrap()
}
