//! A page that shows where a scene's cameras are.

use infonerf_scene::{Camera, Scene, Space};
use serde_json::{Value, json};

const MAX_POINTS: usize = 8000;
const PAGE: &str = include_str!("page.html");

/// Returns a self-contained web page that draws the scene's cameras with their frusta, its points and its box in 3D.
/// Dragging rotates, the wheel zooms, and a click on a camera names it.
///
/// Besides the scene's cameras it draws `learned`, the cameras that a run has learned, in the scene's frame, and the
/// exact cameras if the scene's are disturbed.
pub fn info_page(scene: &Scene, learned: &[Camera]) -> String {
    let chosen = |camera: &Camera| scene.train.iter().any(|v| v.camera.to_world == camera.to_world);
    let others = scene.all_train_cameras.iter().filter(|c| !chosen(c)).map(|c| drawn(c, "", "other"));
    let mut cameras: Vec<Value> = others.collect();
    cameras.extend(scene.test.iter().map(|v| drawn(&v.camera, &v.name, "test")));
    cameras.extend(scene.train.iter().map(|v| drawn(&v.camera, &v.name, "train")));
    for (found, kind) in [(learned, "learned"), (scene.exact_cameras.as_deref().unwrap_or(&[]), "exact")] {
        cameras.extend(found.iter().zip(&scene.train).map(|(camera, view)| drawn(camera, &view.name, kind)));
    }
    let step = scene.space.points.len().div_ceil(MAX_POINTS).max(1);
    let points: Vec<_> = scene.space.points.iter().step_by(step).map(|p| p.to_array()).collect();
    let Space { near, far, bounds, layout, up, centre, radius, .. } = &scene.space;
    let data = json!({
        "cameras": cameras, "points": points, "box": [bounds.min.to_array(), bounds.max.to_array()],
        "centre": centre.to_array(), "radius": radius, "up": up.to_array(), "near": near, "far": far,
    });
    let (name, format) = (&scene.name, scene.format);
    let words = format!("{name}: {format}, cameras {layout}, near {near:.3}, far {far:.3}");
    let warnings: String = scene.warnings.iter().map(|w| format!("<p class=\"warning\">{}</p>", escaped(w))).collect();
    // Only a closing tag ends a script.
    let data = data.to_string().replace("</", "<\\/");
    PAGE.replace("{{title}}", &escaped(&words)).replace("{{warnings}}", &warnings).replace("{{data}}", &data)
}

/// Returns a camera's position and the unit directions of its corners.
fn drawn(camera: &Camera, name: &str, kind: &str) -> Value {
    let (w, h) = (camera.width as f32, camera.height as f32);
    let corners = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(x, y)| camera.ray(x, y).direction.to_array());
    json!({"name": name, "kind": kind, "at": camera.position().to_array(), "corners": corners})
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use infonerf_procedural::train_cameras;

    #[test]
    fn a_page_holds_the_scene_and_needs_nothing_else() {
        let scene = Scene {
            name: "<b>".into(),
            all_train_cameras: train_cameras(8),
            space: Space { points: vec![Vec3::X; 20_000], ..Space::default() },
            warnings: vec!["a < b".into()],
            ..Scene::default()
        };
        let page = info_page(&scene, &[]);
        assert!(page.contains("&lt;b&gt;: procedural") && page.contains("a &lt; b") && !page.contains("{{"));
        assert!(!page.contains("http") && !page.contains("src="));
        assert_eq!(page.matches("\"corners\"").count(), 100);
        assert!(page.len() < 400_000, "{}", page.len());
    }
}
