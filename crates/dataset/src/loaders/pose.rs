//! Camera poses from files.

use glam::{DMat3, DMat4, DQuat, DVec3};
use infonerf_scene::SceneError;

use crate::files::MAX_COORDINATE;
use crate::files::json::Node;

/// Max difference of an element of `RᵀR` from the identity: rounding to 4 digits passes, a scale of 1.001 does not.
const TOLERANCE: f64 = 1e-3;
/// Max cosine between axes that are corrected to right angles.
const SHEAR: f64 = 0.02;
/// Max relative difference of the axes' lengths from their mean that is corrected.
const STRETCH: f64 = 0.15;
const SCALES: std::ops::RangeInclusive<f64> = 1e-3..=1e3;
const EXPECTED: &str = "a 4×4 rigid camera-to-world matrix (rotation and translation)";

/// Reads the 3×4 or 4×4 matrix in `field`, given as rows or as 16 numbers, as a rigid transform. A scale and slight
/// shear of its rotation are removed; the flag returns whether they were. `None` if it is null or has nulls, which also
/// stand for numbers that are not finite: the image has no pose.
pub(crate) fn read_pose(frame: &Node<'_>, field: &str) -> Result<Option<(DMat4, bool)>, SceneError> {
    let Some(node) = frame.find(field) else { return Ok(None) };
    let rows = node.items(EXPECTED)?;
    if rows.iter().any(Node::is_incomplete) || node.is_incomplete() {
        return Ok(None);
    }
    let mut values = [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    match rows.len() {
        16 => values = DMat4::from_cols_array(&node.numbers(EXPECTED)?).to_cols_array_2d(),
        3 | 4 => {
            for (value, row) in values.iter_mut().zip(&rows) {
                *value = row.numbers("4 finite numbers, a row of a 4×4 matrix")?;
            }
        }
        _ => return Err(node.fault(EXPECTED, format!("{} rows", rows.len()))),
    }
    let given = DMat4::from_cols_array_2d(&values).transpose();
    if fault(&given).is_none() {
        return Ok(Some((given, false)));
    }
    let matrix = orthonormalised(&given).unwrap_or(given);
    match fault(&matrix) {
        Some(found) => Err(node.fault(EXPECTED, found)),
        None => Ok(Some((matrix, true))),
    }
}

/// Removes scale and slight shear from the rotation of `pose`; `None` if they are too large or the last row is not 0 0 0 1.
fn orthonormalised(pose: &DMat4) -> Option<DMat4> {
    if !pose.row(3).abs_diff_eq(glam::DVec4::W, TOLERANCE) {
        return None;
    }
    let rotation = DMat3::from_mat4(*pose);
    let axes = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
    let lengths = axes.map(DVec3::length);
    let mean = lengths.iter().sum::<f64>() / 3.0;
    if !SCALES.contains(&mean) || lengths.iter().any(|length| (length / mean - 1.0).abs() > STRETCH) {
        return None;
    }
    let [x, y, z] = axes.map(DVec3::normalize);
    if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|cosine| cosine.abs() > SHEAR) || x.cross(y).dot(z) < 0.0 {
        return None;
    }
    let exact = DMat3::from_quat(DQuat::from_mat3(&DMat3::from_cols(x, y, z)).normalize());
    let [x, y, z] = [exact.x_axis, exact.y_axis, exact.z_axis].map(|axis| axis.extend(0.0));
    Some(DMat4 { x_axis: x, y_axis: y, z_axis: z, ..*pose })
}

/// Describes why `pose` is not a rigid transform; `None` if it is one.
pub(super) fn fault(pose: &DMat4) -> Option<String> {
    if !pose.is_finite() {
        return Some("a value that is not finite".into());
    }
    let last = pose.row(3);
    if !last.abs_diff_eq(glam::DVec4::W, TOLERANCE) {
        let reason = if pose.w_axis == glam::DVec4::W { "a transposed matrix, with the " } else { "" };
        return Some(format!("{reason}last row {:?}", last.to_array()));
    }
    let position = pose.w_axis.truncate();
    if position.abs().max_element() > MAX_COORDINATE {
        return Some(format!("a position more than {MAX_COORDINATE:e} units from the origin"));
    }
    let rotation = DMat3::from_mat4(*pose);
    let determinant = rotation.determinant();
    if determinant.abs() < 1e-9 {
        return Some("a singular matrix".into());
    }
    if determinant < 0.0 {
        return Some(format!("a mirrored matrix (determinant {determinant:.6})"));
    }
    let rest = rotation.transpose() * rotation - DMat3::IDENTITY;
    if !rest.abs_diff_eq(DMat3::ZERO, TOLERANCE) {
        return Some(format!("scale or shear (determinant {determinant:.6})"));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_rotations_are_corrected() {
        let rigid = DMat4::from_rotation_translation(DQuat::from_rotation_y(0.7), DVec3::new(1.0, 2.0, 3.0));
        let scaled = |x: f64, y: f64, z: f64| rigid * DMat4::from_scale(DVec3::new(x, y, z));
        for pose in [scaled(1.002, 1.002, 1.002), scaled(0.01, 0.01, 0.01), scaled(1.0, 0.9, 1.0)] {
            assert!(fault(&pose).is_some() && orthonormalised(&pose).unwrap().abs_diff_eq(rigid, 1e-12));
        }
        let mut sheared = rigid;
        sheared.x_axis += 0.1 * rigid.y_axis;
        for pose in [scaled(-1.0, 1.0, 1.0), scaled(2.0, 1.0, 1.0), scaled(0.0, 0.0, 0.0), sheared] {
            assert!(orthonormalised(&pose).is_none());
        }
    }
}
