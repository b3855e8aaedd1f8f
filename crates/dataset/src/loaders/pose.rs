//! Camera poses from files.

use glam::{DMat3, DMat4};
use infonerf_scene::SceneError;

use super::json::Node;
use crate::limits::FARTHEST;

/// How far `RᵀR` may be from the identity in any element: rounding to 4 digits passes, a scale of
/// 1.001 does not.
const TOLERANCE: f64 = 1e-3;
const EXPECTED_FLAT: &str = "16 numbers, the rows of a 4×4 rigid camera-to-world matrix";
const EXPECTED: &str = "a 4×4 rigid camera-to-world matrix (rotation and translation)";

/// Reads a 4×4 matrix given as rows and checks that it is a rigid transform.
///
/// # Errors
/// The matrix is not 4×4, not finite, singular, mirrored, scaled or sheared, its last row is
/// not 0 0 0 1, or it is farther than [`FARTHEST`] from the origin.
pub(super) fn read_pose(node: &Node<'_>) -> Result<DMat4, SceneError> {
    let rows = node.items(EXPECTED)?;
    if rows.len() != 4 {
        return Err(node.fault(EXPECTED, format!("{} rows", rows.len())));
    }
    let mut values = [[0.0; 4]; 4];
    for (value, row) in values.iter_mut().zip(&rows) {
        *value = row.numbers("4 finite numbers, a row of a 4×4 matrix")?;
    }
    rigid(node, DMat4::from_cols_array_2d(&values).transpose())
}

/// Reads a 4×4 matrix given as 16 numbers, row by row, and checks that it is a rigid transform.
///
/// # Errors
/// As [`read_pose`].
pub(crate) fn read_flat_pose(node: &Node<'_>) -> Result<DMat4, SceneError> {
    rigid(node, DMat4::from_cols_array(&node.numbers(EXPECTED_FLAT)?).transpose())
}

fn rigid(node: &Node<'_>, pose: DMat4) -> Result<DMat4, SceneError> {
    match fault(&pose) {
        Some(found) => Err(node.fault(EXPECTED, found)),
        None => Ok(pose),
    }
}

/// Why `pose` is not a rigid transform; `None` if it is one.
pub(super) fn fault(pose: &DMat4) -> Option<String> {
    if !pose.is_finite() {
        return Some("a value that is not finite".into());
    }
    let last = pose.row(3);
    if !last.abs_diff_eq(glam::DVec4::W, TOLERANCE) {
        return Some(format!("last row {:?}", last.to_array()));
    }
    let position = pose.w_axis.truncate();
    if position.abs().max_element() > FARTHEST {
        return Some(format!("a position more than {FARTHEST:e} units from the origin"));
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
