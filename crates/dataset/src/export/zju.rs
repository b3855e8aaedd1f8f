//! A person in ZJU-MoCap's format: distorted photographs, masks, the calibration in a pickle, the body.

use std::fs;
use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::{Body, Camera, Lens, SceneError};

use super::{intrinsics, make, opencv, photographs, write_mask};
use crate::files::npy as arrays;
use crate::files::pickle::{dict, list, npy, object, write_numbers, write_text};

/// Number of cameras.
const VIEWS: usize = 23;
/// k₁ k₂ p₁ p₂ k₃ of every lens.
const DISTORTION: [f64; 5] = [-0.1, 0.05, 1e-3, -2e-3, 0.01];
/// Millimetres per scene unit: translations are in millimetres, a scene unit is a metre.
const MILLIMETRES: f64 = 1000.0;

/// Writes one frame: `annots.npy`, `Camera_B<i>/000000.png`, the same under `mask_cihp`, and of a scene with a body
/// `new_vertices/0.npy` and `new_params/0.npy`, whose frame is the world's.
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let cameras = procedural::photographs(name, size, VIEWS).iter().map(|camera| camera.with_lens(lens())).collect();
    let photographs = photographs(name, cameras)?;
    for (i, photograph) in photographs.iter().enumerate() {
        let image = image_path(i, 0);
        let mask = Path::new("mask_cihp").join(&image);
        for path in [Path::new(&image), &mask] {
            make(&dir.join(path.with_file_name("")))?;
        }
        photograph.image.write_png(&dir.join(&image))?;
        write_mask(&dir.join(mask), photograph, &procedural::object_mask(name, &photograph.camera)?)?;
    }
    if let Some(body) = procedural::body(name)? {
        write_body(dir, &body)?;
    }
    let cameras: Vec<Camera> = photographs.into_iter().map(|p| p.camera).collect();
    write_file(&dir.join("annots.npy"), &npy(&annotations(&cameras, 1)))
}

fn image_path(camera: usize, frame: usize) -> String {
    format!("Camera_B{camera}/{frame:06}.png")
}

pub(crate) fn lens() -> Lens {
    let [k1, k2, p1, p2, k3] = DISTORTION;
    Lens::rational([k1, k2, k3, 0.0, 0.0, 0.0], [p1, p2])
}

/// Returns the pickle in `annots.npy`: `cams` with lists of K, D (of [`DISTORTION`]), R (world to camera) and T, and
/// `ims` with the images of each frame.
pub(crate) fn annotations(cameras: &[Camera], frames: usize) -> Vec<u8> {
    let of = |sides: &[usize], values: &dyn Fn(&Camera) -> Vec<f64>| {
        list(&cameras.iter().map(|camera| write_numbers(sides, &values(camera))).collect::<Vec<_>>())
    };
    let translation = |camera: &Camera| {
        let (rotation, centre) = opencv(camera);
        -(rotation * centre) * MILLIMETRES
    };
    let cams = dict(&[
        ("K", of(&[3, 3], &|c| intrinsics(c).transpose().to_cols_array().to_vec())),
        ("D", of(&[5, 1], &|_| DISTORTION.to_vec())),
        ("R", of(&[3, 3], &|c| opencv(c).0.transpose().to_cols_array().to_vec())),
        ("T", of(&[3, 1], &|c| translation(c).to_array().to_vec())),
    ]);
    let frame = |frame: usize| {
        let names: Vec<_> = (0..cameras.len()).map(|camera| write_text(&image_path(camera, frame))).collect();
        dict(&[("ims", list(&names))])
    };
    let frames: Vec<_> = (0..frames).map(frame).collect();
    object(dict(&[("cams", cams), ("ims", list(&frames))]))
}

fn write_body(dir: &Path, body: &Body) -> Result<(), SceneError> {
    for folder in ["new_vertices", "new_params"] {
        make(&dir.join(folder))?;
    }
    let vertices: Vec<f32> = body.vertices.iter().flat_map(|v| v.to_array()).collect();
    arrays::write(&dir.join("new_vertices/0.npy"), &[body.vertices.len() as u64, 3], &vertices)?;
    let still = || write_numbers(&[1, 3], &[0.0; 3]);
    write_file(&dir.join("new_params/0.npy"), &npy(&object(dict(&[("Rh", still()), ("Th", still())]))))
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    fs::write(path, bytes).map_err(|e| SceneError::io(path, e))
}
