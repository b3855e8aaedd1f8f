//! From world points to each source view's pixels and axes: pure functions on the host.

use rayon::prelude::*;

use crate::{Points, SourceView};

/// Points and directions in the axes of each view, `[V·M, 3]` row-major, view by view.
pub(super) struct ViewPoints {
    /// ω·R (x − middle).
    pub(super) positions: Vec<f32>,
    /// R d, one per sample.
    pub(super) directions: Vec<f32>,
}

/// Least depth before a camera, scene units: points beside or behind it are projected as if at that depth.
const LEAST_DEPTH: f32 = 1e-3;

fn rotate(view: &SourceView, v: [f32; 3]) -> [f32; 3] {
    view.to_camera.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The pixel position of a world point.
fn project(view: &SourceView, p: [f32; 3]) -> (f32, f32) {
    let [x, y, z] = [0, 1, 2].map(|axis| rotate(view, p)[axis] + view.to_camera[axis][3]);
    let depth = (-z).max(LEAST_DEPTH);
    (view.centre[0] + view.focal[0] * x / depth, view.centre[1] - view.focal[1] * y / depth)
}

fn triples(flat: &[f32]) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
    flat.chunks_exact(3).map(|v| [v[0], v[1], v[2]])
}

/// `(view, x, y)` of each of `positions` (`[M, 3]` row-major) in each view, in pixels, view by view.
pub(super) fn pixels(views: &[SourceView], positions: &[f32]) -> Vec<(usize, f32, f32)> {
    let of_view = |(index, view): (usize, &SourceView)| -> Vec<_> {
        triples(positions).map(|p| project(view, p)).map(|(x, y)| (index, x, y)).collect()
    };
    views.par_iter().enumerate().flat_map_iter(of_view).collect()
}

/// Positions about `middle`, scaled by `frequency`, and directions, both in each view's axes.
pub(super) fn view_points(views: &[SourceView], points: Points<'_>, middle: [f32; 3], frequency: f32) -> ViewPoints {
    let position = |view: &SourceView, p: [f32; 3]| {
        rotate(view, [0, 1, 2].map(|axis| p[axis] - middle[axis])).map(|x| frequency * x)
    };
    let positions: Vec<f32> =
        views.par_iter().flat_map_iter(|view| triples(points.positions).flat_map(move |p| position(view, p))).collect();
    let of_view = |view: &SourceView| -> Vec<f32> {
        let rays = triples(points.directions).map(|d| rotate(view, d)).zip(points.segments.ranges());
        rays.flat_map(|(d, range)| range.flat_map(move |_| d)).collect()
    };
    let directions = views.par_iter().flat_map_iter(of_view).collect();
    ViewPoints { positions, directions }
}

#[cfg(test)]
mod tests {
    use infonerf_ops::Segments;

    use super::*;
    use crate::Extent;

    /// At (0, 0, 5), looking down −z, 8 × 6 pixels.
    fn view() -> SourceView {
        SourceView {
            width: 8,
            height: 6,
            rgb: vec![[0.0; 3]; 48].into(),
            focal: [10.0, 12.0],
            centre: [4.0, 3.0],
            to_camera: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -5.0]],
        }
    }

    #[test]
    fn points_fall_on_pixels() {
        let mut turned = view();
        // A quarter turn about z: camera x is world y.
        turned.to_camera = [[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -5.0]];
        let got = pixels(&[view(), turned], &[0.0, 0.0, 0.0, 1.0, 0.5, 0.0]);
        assert_eq!(got, [(0, 4.0, 3.0), (0, 6.0, 1.8), (1, 4.0, 3.0), (1, 5.0, 5.4)]);
    }

    #[test]
    fn a_point_behind_the_camera_stays_finite() {
        let [(_, x, y)] = pixels(&[view()], &[1.0, 1.0, 5.0])[..] else { panic!("one point") };
        assert!(x.is_finite() && y.is_finite() && x > 8.0 && y < 0.0);
    }

    #[test]
    fn every_sample_has_its_rays_direction() {
        let segments = Segments::from_counts([2, 1]);
        let positions = [1.0, 2.0, 3.0, 1.0, 2.0, 4.0, 0.0, 0.0, 0.0];
        let directions = [0.0, 0.0, 1.0, 0.0, 1.0, 0.0];
        let extent = Extent::Ball { variance: 0.0 };
        let points =
            Points { positions: &positions, directions: &directions, segments: &segments, extent, tracked: None };
        let got = view_points(&[view()], points, [1.0, 1.0, 1.0], 2.0);
        assert_eq!(got.directions, [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
        assert_eq!(got.positions, [0.0, 2.0, 4.0, 0.0, 2.0, 6.0, -2.0, -2.0, -2.0]);
    }
}
