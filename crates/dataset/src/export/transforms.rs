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
    let corner = |corner: Vec3| (corner.as_dvec3() + scene.origin).to_array();
    let bounds = if scene.origin == DVec3::ZERO {
        json!([scene.space.bounds.min.to_array(), scene.space.bounds.max.to_array()])
    } else {
        json!([corner(scene.space.bounds.min), corner(scene.space.bounds.max)])
    };
    json!({
        "near": scene.space.near,
        "far": scene.space.far,
        "aabb": bounds,
        "train_filenames": names(&scene.train),
        "test_filenames": names(&scene.test),
        "frames": frames,
    })
}

fn frame(view: &View, origin: DVec3) -> Value {
    let camera = &view.camera;
    let mut pose = camera.to_world;
    pose.w_axis += origin.extend(0.0);
    let mut frame = json!({
        "file_path": view.file,
        "transform_matrix": pose.transpose().to_cols_array_2d(),
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
    });
    let (model, coefficients) = match camera.lens.model() {
        LensModel::Perspective => ("PINHOLE", Vec::new()),
        LensModel::RadialTangential { k, q, p } if q == [0.0; 3] => {
            ("OPENCV", vec![("k1", k[0]), ("k2", k[1]), ("k3", k[2]), ("k4", k[3]), ("p1", p[0]), ("p2", p[1])])
        }
        // In OpenCV's full model k₄ to k₆ are those of the denominator.
        LensModel::RadialTangential { k, q, p } => {
            let numerator = [("k1", k[0]), ("k2", k[1]), ("k3", k[2])];
            let rest = [("k4", q[0]), ("k5", q[1]), ("k6", q[2]), ("p1", p[0]), ("p2", p[1])];
            ("FULL_OPENCV", numerator.into_iter().chain(rest).collect())
        }
        LensModel::Fisheye { k } => ("OPENCV_FISHEYE", vec![("k1", k[0]), ("k2", k[1]), ("k3", k[2]), ("k4", k[3])]),
    };
    frame["camera_model"] = json!(model);
    for (key, value) in coefficients {
        frame[key] = json!(value);
    }
    frame
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::loaders::testing::{assert_same_rays, load, request, write_json, write_view};
    use infonerf_procedural::train_cameras;
    use infonerf_scene::{Camera, Image, Lens};

    /// Written, and read by the loader of the format.
    #[test]
    fn cameras_of_every_lens_load_back() {
        let (k, p) = ([0.05, -0.02, 0.01, 0.003], [1e-3, -2e-3]);
        let lenses = [
            Lens::PERSPECTIVE,
            Lens::radial_tangential(k, p),
            Lens::rational([0.2, 0.1, 0.01, 0.1, 0.05, 0.002], p),
            Lens::fisheye(k),
        ];
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(dir.path().join("images")).unwrap();
        let views: Vec<View> = lenses
            .into_iter()
            .enumerate()
            .map(|(id, lens)| {
                let focal = 20.0 + id as f64;
                let pose = train_cameras(8)[id].to_world;
                let camera = Camera::pinhole((18, 14), [focal, focal + 0.5], [8.75, 7.5], pose).with_lens(lens);
                let name = format!("images/f_{id}");
                write_view(&dir.path().join(format!("{name}.png")), &camera);
                View::new(id, name, camera, Image::filled(18, 14, [0.0; 3]))
            })
            .collect();
        let scene = Scene { train: views[..3].to_vec(), test: views[3..].to_vec(), ..Scene::default() };
        let written = transforms(&scene);
        assert_eq!(
            (&written["frames"][1]["file_path"], &written["test_filenames"][0]),
            (&json!("images/f_1.png"), &json!("images/f_3.png"))
        );
        write_json(&dir.path().join("transforms.json"), &written);
        let read = load(dir.path(), &request()).unwrap();
        assert_eq!((read.train.len(), read.test.len()), (3, 1));
        assert_eq!(
            (read.space.near, read.space.far, read.space.bounds),
            (scene.space.near, scene.space.far, scene.space.bounds)
        );
        for (found, expected) in read.train.iter().chain(&read.test).zip(&views) {
            assert_eq!(found.name, expected.name);
            assert_same_rays(&found.camera, &expected.camera);
        }
    }
}
