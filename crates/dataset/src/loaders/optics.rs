//! Intrinsics and lenses of `transforms*.json` files, used by other formats too.

use glam::DMat4;
use infonerf_scene::{Camera, Lens, SceneError};

use super::json::{Node, PIXELS};

/// Lens distortion coefficients of nerfstudio and instant-ngp.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// The largest plausible lens coefficient.
const LARGEST: f64 = 1e6;
/// The values of `camera_model` that are known; what they mean is in the coefficients.
const MODELS: &str = "one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, \
                      SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE";

/// Focal lengths and principal points that differ by at most this, in pixels, belong to the same camera.
const SAME_PIXELS: f64 = 0.1;
/// Fields of view that differ by at most this, in radians, belong to the same camera.
const SAME_ANGLE: f64 = 1e-4;

/// Intrinsics before the image size is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Intrinsics {
    /// Horizontal field of view in radians; square pixels, centred principal point.
    Fov(f64),
    /// Focal lengths and principal point in pixels, and the image size that they hold for where it
    /// is stated.
    Pixels { focal: [f64; 2], centre: Option<[f64; 2]>, size: Option<(u32, u32)> },
}

impl Intrinsics {
    /// The camera without distortion for an image of the given size.
    pub fn camera(&self, (width, height): (u32, u32), pose: DMat4) -> Camera {
        match *self {
            Self::Fov(angle) => Camera::from_fov(width, height, angle, pose),
            Self::Pixels { focal, centre, .. } => {
                let centre = centre.unwrap_or([f64::from(width) / 2.0, f64::from(height) / 2.0]);
                Camera::pinhole((width, height), focal, centre, pose)
            }
        }
    }

    /// Whether both belong to the same camera, up to rounding in files and in the decomposition of projections.
    pub fn is_like(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance;
        let near_pixels = |a: [f64; 2], b: [f64; 2]| (0..2).all(|axis| near(a[axis], b[axis], SAME_PIXELS));
        match (*self, *other) {
            (Self::Fov(a), Self::Fov(b)) => near(a, b, SAME_ANGLE),
            (
                Self::Pixels { focal, centre, size },
                Self::Pixels { focal: other_focal, centre: other_centre, size: other_size },
            ) => {
                let centres = match (centre, other_centre) {
                    (Some(a), Some(b)) => near_pixels(a, b),
                    (a, b) => a == b,
                };
                near_pixels(focal, other_focal) && centres && size == other_size
            }
            _ => false,
        }
    }

    /// The image size that the file states.
    pub fn stated_size(&self) -> Option<(u32, u32)> {
        match self {
            Self::Pixels { size, .. } => *size,
            Self::Fov(_) => None,
        }
    }

    /// The stated size, or twice the principal point, or a square of one pixel.
    pub fn nominal_size(&self) -> (u32, u32) {
        let doubled = |c: f64| (2.0 * c).round().clamp(1.0, 1e6) as u32;
        match *self {
            Self::Pixels { size: Some(size), .. } => size,
            Self::Pixels { centre: Some([x, y]), .. } => (doubled(x), doubled(y)),
            Self::Pixels { focal: [x, y], .. } => (doubled(0.5 * x), doubled(0.5 * y)),
            Self::Fov(_) => (1, 1),
        }
    }
}

/// A frame's own intrinsics and lens or, field by field, those of the file.
pub(super) fn read_optics(root: &Node<'_>, frame: &Node<'_>) -> Result<(Intrinsics, Lens), SceneError> {
    let find = |key: &str| frame.find(key).or_else(|| root.find(key));
    let lens = read_lens(&find)?;
    let Some(focal_x) = find("fl_x") else {
        let expected = "a horizontal field of view between 0 and π radians";
        let node = match find("camera_angle_x") {
            Some(node) => node,
            None => root.get("camera_angle_x", &format!("{expected} (or `fl_x`)"))?,
        };
        let angle = node.number(expected)?;
        if angle <= 0.0 || angle >= std::f64::consts::PI {
            return Err(node.error(expected));
        }
        return Ok((Intrinsics::Fov(angle), lens));
    };
    let expected = "a positive focal length in pixels";
    let fx = focal_x.pixels(expected)?;
    let fy = find("fl_y").map_or(Ok(fx), |node| node.pixels(expected))?;
    let position = |node: Node<'_>| {
        let expected = "a position in pixels";
        let position = node.number(expected)?;
        if position.abs() <= *PIXELS.end() { Ok(position) } else { Err(node.error(expected)) }
    };
    let number = |key| find(key).map(position).transpose();
    let centre = number("cx")?.zip(number("cy")?).map(|(x, y)| [x, y]);
    let side = |key| find(key).map(|node| read_side(&node)).transpose();
    let size = side("w")?.zip(side("h")?);
    Ok((Intrinsics::Pixels { focal: [fx, fy], centre, size }, lens))
}

/// The lens of `camera_model` (or instant-ngp's `is_fisheye`) and the coefficients.
///
/// Without a model it is OpenCV's polynomial; with k₅ or k₆, or as FULL_OPENCV, its rational one.
fn read_lens<'a>(find: &impl Fn(&str) -> Option<Node<'a>>) -> Result<Lens, SceneError> {
    let mut values = [0.0; DISTORTION.len()];
    for (value, key) in values.iter_mut().zip(DISTORTION) {
        if let Some(node) = find(key) {
            let expected = "a distortion coefficient";
            *value = node.number(expected)?;
            if value.abs() > LARGEST {
                return Err(node.error(expected));
            }
        }
    }
    let [k1, k2, k3, k4, k5, k6, p1, p2] = values;
    let name = match find("camera_model") {
        Some(node) => Some((node.text(MODELS)?.to_ascii_uppercase(), node)),
        None => None,
    };
    let fisheye = match find("is_fisheye") {
        Some(node) => node.flag("true or false")?,
        None => false,
    };
    let plain = || {
        if [k5, k6] == [0.0; 2] {
            Lens::radial_tangential([k1, k2, k3, k4], [p1, p2])
        } else {
            Lens::rational([k1, k2, k3, k4, k5, k6], [p1, p2])
        }
    };
    match &name {
        None if fisheye => Ok(Lens::fisheye([k1, k2, k3, k4])),
        None => Ok(plain()),
        Some((name, node)) => match name.as_str() {
            "OPENCV_FISHEYE" | "FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => {
                Ok(Lens::fisheye([k1, k2, k3, k4]))
            }
            "FULL_OPENCV" => Ok(Lens::rational([k1, k2, k3, k4, k5, k6], [p1, p2])),
            "PERSPECTIVE" | "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => Ok(plain()),
            _ => Err(node.error(MODELS)),
        },
    }
}

fn read_side(node: &Node<'_>) -> Result<u32, SceneError> {
    let expected = "an image side in whole pixels";
    let side = node.positive(expected)?;
    if side.fract() != 0.0 || side > f64::from(u32::MAX) {
        return Err(node.error(expected));
    }
    Ok(side as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_makes_no_other_camera() {
        let pixels = |fx: f64, cx: Option<f64>| Intrinsics::Pixels {
            focal: [fx, fx],
            centre: cx.map(|cx| [cx, 300.0]),
            size: Some((800, 600)),
        };
        let camera = pixels(1446.134, Some(411.6));
        assert!(camera.is_like(&pixels(1446.136, Some(411.65))));
        assert!(!camera.is_like(&pixels(1447.0, Some(411.6))) && !camera.is_like(&pixels(1446.134, Some(412.6))));
        assert!(!camera.is_like(&pixels(1446.134, None)) && pixels(1.0, None).is_like(&pixels(1.0, None)));
        assert!(Intrinsics::Fov(0.6911112).is_like(&Intrinsics::Fov(0.6911113)));
        assert!(!Intrinsics::Fov(0.69).is_like(&Intrinsics::Fov(0.70)) && !Intrinsics::Fov(0.69).is_like(&camera));
    }
}
