//! COLMAP's lens models.

use std::f64::consts::PI;
use std::path::Path;

use glam::DMat4;
use infonerf_scene::{Camera, Lens, SceneError};

use crate::files::PIXELS;

/// COLMAP's camera models by id: name and parameters. Unsupported models have no parameters.
pub(super) const MODELS: [(&str, &[&str]); 12] = [
    ("SIMPLE_PINHOLE", &["fx", "cx", "cy"]),
    ("PINHOLE", &["fx", "fy", "cx", "cy"]),
    ("SIMPLE_RADIAL", &["fx", "cx", "cy", "k1"]),
    ("RADIAL", &["fx", "cx", "cy", "k1", "k2"]),
    ("OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]),
    ("OPENCV_FISHEYE", &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"]),
    ("FULL_OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
    ("FOV", &["fx", "fy", "cx", "cy", "omega"]),
    ("SIMPLE_RADIAL_FISHEYE", &["fx", "cx", "cy", "k1"]),
    ("RADIAL_FISHEYE", &["fx", "cx", "cy", "k1", "k2"]),
    ("THIN_PRISM_FISHEYE", &[]),
    ("RAD_TAN_THIN_PRISM_FISHEYE", &[]),
];

/// Returns the lens of a model; `value` returns coefficients by name. `None` if the model is unknown, or the angle of
/// FOV is 0 or not below π. Perspective models have a polynomial lens; FULL_OPENCV, and any with k₅ or k₆, a rational one.
pub(crate) fn lens(model: &str, value: impl Fn(&str) -> f64) -> Option<Lens> {
    let k = ["k1", "k2", "k3", "k4", "k5", "k6"].map(&value);
    let p = ["p1", "p2"].map(&value);
    let low = [k[0], k[1], k[2], k[3]];
    match model {
        "OPENCV_FISHEYE" | "FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => Some(Lens::fisheye(low)),
        "FOV" => Some(value("omega")).filter(|omega| *omega != 0.0 && omega.abs() < PI).map(Lens::fov),
        "FULL_OPENCV" => Some(Lens::rational(k, p)),
        "PERSPECTIVE" | "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => {
            Some(if [k[4], k[5]] == [0.0; 2] { Lens::radial_tangential(low, p) } else { Lens::rational(k, p) })
        }
        _ => None,
    }
}

/// Max image side in pixels.
const MAX_SIDE: u32 = 1 << 20;

/// A camera of a reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// COLMAP's number of the model.
    pub model: usize,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// The model's parameters, in COLMAP's order.
    pub parameters: Vec<f64>,
    camera: Camera,
}

impl ColmapCamera {
    /// Checks the numbers of a camera. Errors name `path` and `place`.
    pub(crate) fn new(
        path: &Path,
        place: &str,
        model: usize,
        (width, height): (u32, u32),
        parameters: Vec<f64>,
    ) -> Result<Self, SceneError> {
        let fault = |expected: &str, found: String| SceneError::field(path, place, expected, found);
        let (name, names) = MODELS.get(model).copied().unwrap_or_default();
        let value = |key: &str| names.iter().zip(&parameters).find(|(name, _)| **name == key).map(|(_, value)| *value);
        let lens = lens(name, |key| value(key).unwrap_or(0.0));
        let (Some(lens), Some(fx), Some(cx), Some(cy)) = (lens, value("fx"), value("cx"), value("cy")) else {
            return Err(fault(&known(), format!("{} {parameters:?}", model_name(model))));
        };
        let fy = value("fy").unwrap_or(fx);
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(fault("an image side from 1 to 1048576 pixels", format!("{width}×{height}")));
        }
        if ![fx, fy].iter().all(|f| PIXELS.contains(f)) {
            return Err(fault("a positive focal length in pixels", format!("{fx} and {fy}")));
        }
        if !parameters.iter().all(|p| p.abs() <= 1e9) {
            return Err(fault("finite parameters of a lens", format!("{parameters:?}")));
        }
        let camera = Camera::pinhole((width, height), [fx, fy], [cx, cy], DMat4::IDENTITY).with_lens(lens);
        Ok(Self { model, width, height, parameters, camera })
    }

    /// Returns the camera at a camera-to-world pose (OpenGL).
    pub fn at(&self, pose: DMat4) -> Camera {
        self.camera.with_pose(pose)
    }
}

/// Returns COLMAP's name of the model of this number.
pub(super) fn model_name(model: usize) -> String {
    MODELS.get(model).map_or_else(|| format!("number {model}"), |model| model.0.to_owned())
}

pub(super) fn known() -> String {
    let names: Vec<_> = MODELS.iter().filter(|m| !m.1.is_empty()).map(|m| m.0).collect();
    format!("a known lens model ({})", names.join(", "))
}
