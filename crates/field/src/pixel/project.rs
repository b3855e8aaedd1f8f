//! From world points to each source view's pixels and axes.

use burn::tensor::Tensor;
use infonerf_ops::upload;
use rayon::prelude::*;

use crate::field::{SourceView, Sources};
use crate::points::{Points, along_axes};

/// Min depth in front of a camera, scene units: nearer points, and points behind it, are projected as if at this depth.
const MIN_DEPTH: f32 = 1e-3;

fn project(view: &SourceView, p: &[f32; 3]) -> (f32, f32) {
    let [x, y, z] = view.to_camera.map(|[a, b, c, shift]| a * p[0] + b * p[1] + c * p[2] + shift);
    let depth = (-z).max(MIN_DEPTH);
    (view.centre[0] + view.focal[0] * x / depth, view.centre[1] - view.focal[1] * y / depth)
}

/// Returns `(view, x, y)` of each of `positions` (`[M, 3]` row-major) in each view, in pixels, view by view.
pub(super) fn pixels(views: &[SourceView], positions: &[f32]) -> Vec<(usize, f32, f32)> {
    let of_view = |(index, view): (usize, &SourceView)| -> Vec<_> {
        positions.as_chunks().0.iter().map(|p| project(view, p)).map(|(x, y)| (index, x, y)).collect()
    };
    views.par_iter().enumerate().flat_map_iter(of_view).collect()
}

/// Computes ω·R (x − middle) of positions and R d of directions in each view's axes R, `[V·M, 3]` each; ω is `frequency`.
pub(super) fn view_points(sources: &Sources, points: &Points, frequency: f32) -> (Tensor<2>, Tensor<2>) {
    let middle = upload(sources.middle.to_vec(), [1, 3], &points.positions.device());
    let positions = (points.positions.clone() - middle) * frequency;
    let in_views = |vectors: Tensor<2>| {
        let in_view = |view: &SourceView| along_axes(vectors.clone(), view.to_camera.map(|[x, y, z, _]| [x, y, z]));
        Tensor::cat(sources.views.iter().map(in_view).collect(), 0)
    };
    (in_views(positions), in_views(points.sample_directions()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_behind_the_camera_stays_finite() {
        // At (0, 0, 5), looking down −z, 8 × 6 pixels.
        let to_camera = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -5.0]];
        let (focal, centre) = ([10.0, 12.0], [4.0, 3.0]);
        let view = SourceView { width: 8, height: 6, rgb: [].into(), focal, centre, to_camera };
        let [(_, x, y)] = pixels(&[view], &[1.0, 1.0, 5.0])[..] else { panic!("one point") };
        assert!(x.is_finite() && y.is_finite() && x > 8.0 && y < 0.0);
    }
}
