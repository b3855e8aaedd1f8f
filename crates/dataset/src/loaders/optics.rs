//! Intrinsics and lenses of `transforms*.json` files, used by other formats too.

use infonerf_scene::{Lens, SceneError};

use crate::colmap::lens;
use crate::files::json::{Node, PIXELS};
use crate::frame::Intrinsics;

/// Lens distortion coefficients of nerfstudio and instant-ngp.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// Largest plausible lens coefficient.
const MAX_COEFFICIENT: f64 = 1e6;
/// Values of `camera_model` that are known; the coefficients decide which lens they mean.
const MODELS: &str = "one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, \
                      SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE";

/// Reads the intrinsics and lens of a frame, each field from the frame if it has it, else from the file's root.
pub(super) fn read_optics(root: &Node<'_>, frame: &Node<'_>) -> Result<(Intrinsics, Lens), SceneError> {
    let find = |key: &str| frame.find(key).or_else(|| root.find(key));
    let lens = read_lens(&find)?;
    let Some(focal_x) = find("fl_x") else {
        let expected = "a horizontal field of view between 0 and π radians";
        let missing = || root.get("camera_angle_x", &format!("{expected} (or `fl_x`)"));
        let node = find("camera_angle_x").map_or_else(missing, Ok)?;
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

/// Reads the lens from `camera_model` (or instant-ngp's `is_fisheye`) and the coefficients.
fn read_lens<'a>(find: &impl Fn(&str) -> Option<Node<'a>>) -> Result<Lens, SceneError> {
    let mut values = [0.0; DISTORTION.len()];
    for (value, key) in values.iter_mut().zip(DISTORTION) {
        if let Some(node) = find(key) {
            let expected = "a distortion coefficient";
            *value = node.number(expected)?;
            if value.abs() > MAX_COEFFICIENT {
                return Err(node.error(expected));
            }
        }
    }
    let fisheye = find("is_fisheye").map_or(Ok(false), |node| node.flag("true or false"))?;
    let model = find("camera_model");
    let name = match &model {
        Some(node) => node.text(MODELS)?.to_ascii_uppercase(),
        None => if fisheye { "FISHEYE" } else { "PERSPECTIVE" }.to_owned(),
    };
    let value = |key: &str| DISTORTION.iter().zip(values).find(|(known, _)| **known == key).map_or(0.0, |(_, v)| v);
    match (lens(&name, value), model) {
        (None, Some(node)) => Err(node.error(MODELS)),
        (lens, _) => Ok(lens.unwrap_or_default()),
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
