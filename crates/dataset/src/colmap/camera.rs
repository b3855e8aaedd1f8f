//! COLMAP's lens models.

use std::path::Path;

use glam::DMat4;
use infonerf_scene::{Camera, Lens, SceneError};

/// COLMAP's camera models by id: name and number of parameters, which is 0 for models that are not supported.
pub const MODELS: [(&str, usize); 11] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 0),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 0),
];

/// Longest image side, in pixels.
const MAX_SIDE: u32 = 1 << 20;

/// A camera of a reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// The model's index in [`MODELS`].
    pub model: usize,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// The model's parameters, in COLMAP's order.
    pub parameters: Vec<f64>,
    pinhole: ([f64; 2], [f64; 2]),
    lens: Lens,
}

impl ColmapCamera {
    /// Checks the numbers of a camera. `path` and `place` are what an error names.
    pub(crate) fn new(
        path: &Path,
        place: &str,
        model: usize,
        (width, height): (u32, u32),
        parameters: Vec<f64>,
    ) -> Result<Self, SceneError> {
        let fault = |expected: &str, found: String| SceneError::field(path, place, expected, found);
        let (fx, fy, cx, cy, rest) = match (model, parameters.as_slice()) {
            (0 | 2 | 3 | 8 | 9, &[f, cx, cy, ref rest @ ..]) => (f, f, cx, cy, rest),
            (1 | 4 | 5 | 6, &[fx, fy, cx, cy, ref rest @ ..]) => (fx, fy, cx, cy, rest),
            _ => return Err(fault(&known(), format!("number {model}"))),
        };
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(fault("an image side from 1 to 1048576 pixels", format!("{width}×{height}")));
        }
        if ![fx, fy].iter().all(|f| (1e-3..=1e9).contains(f)) {
            return Err(fault("a positive focal length in pixels", format!("{fx} and {fy}")));
        }
        if !parameters.iter().all(|p| p.abs() <= 1e9) {
            return Err(fault("finite parameters of a lens", format!("{parameters:?}")));
        }
        let k = |i: usize| rest.get(i).copied().unwrap_or(0.0);
        let lens = match model {
            0 | 1 => Lens::PERSPECTIVE,
            2 | 3 => Lens::radial_tangential([k(0), k(1), 0.0, 0.0], [0.0; 2]),
            4 => Lens::radial_tangential([k(0), k(1), 0.0, 0.0], [k(2), k(3)]),
            6 => Lens::rational([k(0), k(1), k(4), k(5), k(6), k(7)], [k(2), k(3)]),
            _ => Lens::fisheye([k(0), k(1), k(2), k(3)]),
        };
        Ok(Self { model, width, height, parameters, pinhole: ([fx, fy], [cx, cy]), lens })
    }

    /// Returns the camera at a camera-to-world pose (OpenGL).
    pub fn at(&self, pose: DMat4) -> Camera {
        let (focal, centre) = self.pinhole;
        Camera::pinhole((self.width, self.height), focal, centre, pose).with_lens(self.lens)
    }
}

/// Describes the known models.
pub(super) fn known() -> String {
    let names: Vec<_> = MODELS.iter().filter(|m| m.1 > 0).map(|m| m.0).collect();
    format!("a known lens model ({})", names.join(", "))
}
