use glam::Vec2;
use infonerf_scene::Camera;
use rayon::prelude::*;

/// Depth map of a view: the inverse distance to the surface that each pixel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Inverse distance along the unit ray through each pixel's centre, row-major, 1/scene unit; NaN where nothing was matched.
    pub disparity: Vec<f32>,
    /// The step between planes at each pixel, in the same unit: how exact a disparity can be.
    pub step: Vec<f32>,
}

impl DepthMap {
    /// Returns disparity and step at the continuous position `(x, y)` of `camera`'s image, which may be larger than the
    /// map: those of the pixel that it lies in. `None` where nothing was matched.
    pub fn at(&self, camera: &Camera, x: f32, y: f32) -> Option<(f32, f32)> {
        let column = (x / camera.width as f32 * self.width as f32) as usize;
        let row = (y / camera.height as f32 * self.height as f32) as usize;
        let at = row.min(self.height - 1) * self.width + column.min(self.width - 1);
        let disparity = self.disparity[at];
        disparity.is_finite().then_some((disparity, self.step[at]))
    }

    /// Returns the disparity that all but a hundredth of the matched pixels are below: the nearest surface of the view.
    /// `None` if there are none.
    pub fn nearest(&self) -> Option<f32> {
        let mut found: Vec<f32> = self.disparity.iter().copied().filter(|disparity| disparity.is_finite()).collect();
        found.sort_by(f32::total_cmp);
        found.get(found.len().saturating_sub(1 + found.len() / 100)).copied()
    }

    /// Returns the number of pixels that have a depth.
    pub fn matched(&self) -> usize {
        self.disparity.iter().filter(|disparity| disparity.is_finite()).count()
    }
}

/// Greatest difference between two views' disparities of one point, in steps between planes.
const TOLERANCE: f32 = 1.5;

/// Clears each pixel whose surface point is confirmed by no other view of `pairs`: one whose own map has, at the pixel
/// where it sees the point, the point's disparity to within [`TOLERANCE`] steps.
pub(crate) fn agreed(maps: &[DepthMap], cameras: &[Camera], pairs: &[Vec<usize>]) -> Vec<DepthMap> {
    let checked = |view: usize| {
        let (map, camera) = (&maps[view], &cameras[view]);
        let confirmed = |i: usize| {
            let disparity = map.disparity[i];
            if !disparity.is_finite() || disparity <= 0.0 {
                return false;
            }
            let (x, y) = ((i % map.width) as f32 + 0.5, (i / map.width) as f32 + 0.5);
            let point = camera.ray(x, y).at(1.0 / disparity);
            pairs[view].iter().any(|&other| {
                let there = &cameras[other];
                let size = Vec2::new(there.width as f32, there.height as f32);
                let place = there.project(point).filter(|p| p.cmpge(Vec2::ZERO).all() && p.cmplt(size).all());
                let found = place.and_then(|place| maps[other].at(there, place.x, place.y));
                let expected = 1.0 / point.distance(there.position());
                found.is_some_and(|(disparity, step)| (expected - disparity).abs() <= TOLERANCE * step)
            })
        };
        let kept = |i: usize| if confirmed(i) { map.disparity[i] } else { f32::NAN };
        let disparity = (0..map.disparity.len()).map(kept).collect();
        DepthMap { disparity, ..map.clone() }
    };
    (0..maps.len()).into_par_iter().map(checked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_surface_is_not_a_stray_match() {
        let mut disparity: Vec<f32> = (0..200).map(|i| 1.0 + i as f32 / 200.0).collect();
        (disparity[0], disparity[199]) = (f32::NAN, 50.0);
        let map = DepthMap { width: 200, height: 1, step: vec![0.1; 200], disparity };
        assert!(map.nearest().is_some_and(|nearest| (1.9..2.0).contains(&nearest)), "{:?}", map.nearest());
        assert_eq!(DepthMap { disparity: vec![f32::NAN; 200], ..map }.nearest(), None);
    }
}
