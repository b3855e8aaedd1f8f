use glam::Vec3;
use infonerf_field::{Extent, Field, FieldOutput, Points};
use infonerf_ops::upload;
use infonerf_schedule::Moment;

/// Evaluates `field` at `positions`, three values per point, that lie on no ray and each represent a region of size
/// `extent`: returns density and, if asked for, `color`. Points are seen along +z, or each along its own of
/// `directions`, which cones need.
pub fn evaluate_at<F: Field>(
    field: &F,
    positions: Vec<f32>,
    directions: Option<&[Vec3]>,
    extent: Extent,
    color: bool,
    at: Moment,
) -> FieldOutput {
    let (device, count) = (field.device(), positions.len() / 3);
    let points = Points::scattered(upload(positions, [count, 3], &device), extent);
    let Some(directions) = directions else { return field.evaluate(&points, color, at) };
    let directions = upload(directions.iter().flat_map(|v| v.to_array()).collect(), [count, 3], &device);
    field.evaluate(&points.seen_along(directions), color, at)
}
