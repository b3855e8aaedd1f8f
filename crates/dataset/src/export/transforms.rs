//! The cameras of a scene in nerfstudio's format.

use glam::{DVec3, Vec3};
use infonerf_scene::{LensModel, Scene, View};
use serde_json::{Value, json};

/// Returns `transforms.json` of nerfstudio and instant-ngp with the training and test views of `scene`: a frame for
/// each with its own size, focal lengths, principal point and lens, the pose as OpenGL's camera-to-world matrix, and the
/// path of its image; which are for training and which for test; near, far and the box. Coordinates are those of the
/// files that the scene was loaded from: [`Scene::origin`] is added.
///
/// The images themselves are not part of it.
pub fn transforms(scene: &Scene) -> Value {
    let names = |views: &[View]| -> Vec<String> { views.iter().map(|view| view.file.clone()).collect() };
    let frames: Vec<Value> = scene.train.iter().chain(&scene.test).map(|view| frame(view, scene.origin)).collect();
    let corner = |corner: Vec3| {
        let moved = (corner.as_dvec3() + scene.origin).to_array();
        if scene.origin == DVec3::ZERO { json!(corner.to_array()) } else { json!(moved) }
    };
    let bounds = [corner(scene.space.bounds.min), corner(scene.space.bounds.max)];
    json!({
        "near": scene.space.near, "far": scene.space.far, "aabb": bounds,
        "train_filenames": names(&scene.train), "test_filenames": names(&scene.test), "frames": frames,
    })
}

fn frame(view: &View, origin: DVec3) -> Value {
    let camera = &view.camera;
    let mut pose = camera.to_world;
    pose.w_axis += origin.extend(0.0);
    let mut frame = json!({
        "file_path": view.file, "transform_matrix": pose.transpose().to_cols_array_2d(),
        "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
    });
    let (model, k, p) = match camera.lens.model() {
        LensModel::Perspective => ("PINHOLE", Vec::new(), None),
        LensModel::RadialTangential { k, q, p } if q == [0.0; 3] => ("OPENCV", k.to_vec(), Some(p)),
        // In OpenCV's full model k₄ to k₆ are coefficients of the denominator.
        LensModel::RadialTangential { k, q, p } => ("FULL_OPENCV", [&k[..3], &q].concat(), Some(p)),
        LensModel::Fov { .. } => ("FOV", Vec::new(), None),
        LensModel::Fisheye { k } => ("OPENCV_FISHEYE", k.to_vec(), None),
    };
    frame["camera_model"] = json!(model);
    if let LensModel::Fov { omega } = camera.lens.model() {
        frame["omega"] = json!(omega);
    }
    let named = |letter: &'static str| (1..).map(move |i| format!("{letter}{i}"));
    for (key, value) in named("k").zip(k).chain(named("p").zip(p.into_iter().flatten())) {
        frame[key] = json!(value);
    }
    frame
}
