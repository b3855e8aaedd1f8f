//! Depth maps of posed photographs by plane-sweep stereo.
//!
//! Each view's neighbours are warped onto surfaces of constant disparity (Collins 1996) and compared with it by normalised
//! cross-correlation over windows. Semi-global matching (Hirschmüller 2008) smooths the disparities, and a depth is kept only
//! where another view's depth confirms it. Only the photographs' valid pixels and cameras are used.
//!
//! ```
//! use infonerf_procedural::load;
//! use infonerf_scene::{SceneRequest, ViewSelection};
//! use infonerf_stereo::{StereoSettings, depth_maps};
//!
//! let train = ViewSelection::Seed { seed: 0, count: 3 };
//! let request = SceneRequest { train, image_size: Some(48), ..SceneRequest::default() };
//! let scene = load("room", &request)?;
//! let maps = depth_maps(&scene, &StereoSettings::default());
//! assert_eq!(maps.len(), 3);
//! let agreed: usize = maps.iter().map(|map| map.matched()).sum();
//! assert!(agreed > 100, "{agreed}");
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod correlation;
mod semi_global;
mod sweep;

use glam::{Vec2, Vec3};
use infonerf_scene::image::{GreyImage, resized_mask};
use infonerf_scene::{Camera, Layout, Ray, Scene, View};
use rayon::prelude::*;

use crate::sweep::PlaneSweep;

/// Settings of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct StereoSettings {
    /// The longest side of the images that are compared, in pixels; larger ones are averaged down.
    pub size: u32,
    /// The longest side of the larger images in which depths are refined; `None` leaves them as found.
    pub refined_size: Option<u32>,
    /// Max number of views with which each view is compared.
    pub neighbours: usize,
}

impl Default for StereoSettings {
    fn default() -> Self {
        Self { size: 252, refined_size: None, neighbours: 4 }
    }
}

/// Reduction of the images in which the range of depths is found first.
const REDUCTION: u32 = 3;
/// Min share of matched pixels from which the range of depths is found.
const MIN_MATCHES: f32 = 0.01;

/// Computes a depth map of each training view of `scene`, in their order: an empty one without another view close to it.
///
/// The scene's near and far are often far too wide. A first search in small images finds which disparities occur,
/// and the second spends its planes on those. Large windows, relative to the image, match more; small ones place more exactly:
/// a third search in larger images replaces the depths that it agrees with.
pub fn depth_maps(scene: &Scene, settings: &StereoSettings) -> Vec<DepthMap> {
    let maps_of = |size, range| search(scene, size, settings.neighbours, range);
    let small = maps_of((settings.size / REDUCTION).max(1), DisparityRange::ALL);
    let occurring = disparity_range(&small).unwrap_or(DisparityRange::ALL);
    let maps = maps_of(settings.size, occurring);
    let is_larger = |view: &View| view.image.width.max(view.image.height) > settings.size;
    match settings.refined_size {
        Some(size) if scene.train.iter().any(is_larger) => {
            maps.iter().zip(maps_of(size, occurring)).map(|(map, fine)| map.refined(fine)).collect()
        }
        _ => maps,
    }
}

/// Returns the depth map of each training view, of images whose longest side has at most `size` pixels.
fn search(scene: &Scene, size: u32, neighbours: usize, range: DisparityRange) -> Vec<DepthMap> {
    let images: Vec<GreyImage> = scene.train.iter().map(|view| valid_grey(view, size)).collect();
    let resized = |(view, image): (&View, &GreyImage)| view.camera.resized(image.width as u32, image.height as u32);
    let cameras: Vec<Camera> = scene.train.iter().zip(&images).map(resized).collect();
    let neighbours_of = |view| neighbours_of(scene, &cameras, view, neighbours, range);
    let neighbours: Vec<Vec<usize>> = (0..cameras.len()).map(neighbours_of).collect();
    let map = |view: usize| {
        let others: Vec<_> = neighbours[view].iter().map(|&other| (&images[other], &cameras[other])).collect();
        let sweep = PlaneSweep::new(scene, &cameras[view], &others, range);
        let costs = sweep.costs(&images[view], &others);
        let mut map = sweep.depths(&semi_global::labels(&costs, sweep.planes, &images[view]));
        let invalid = map.disparity.iter_mut().zip(&images[view].values).filter(|(_, value)| value.is_nan());
        invalid.for_each(|(disparity, _)| *disparity = f32::NAN);
        map
    };
    let maps: Vec<DepthMap> = (0..cameras.len()).map(map).collect();
    cross_checked(&maps, &cameras, &neighbours)
}

/// Reduces a view to a grey image, NaN where a pixel is not valid: such pixels are matched neither in it nor in others.
fn valid_grey(view: &View, size: u32) -> GreyImage {
    let mut image = GreyImage::mean(&view.image, size);
    if let Some(valid) = &view.valid {
        let from = (view.image.width, view.image.height);
        let valid = resized_mask(valid, from, (image.width as u32, image.height as u32));
        image.values.iter_mut().zip(valid).filter(|(_, valid)| !valid).for_each(|(value, _)| *value = f32::NAN);
    }
    image
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct DisparityRange {
    min: f32,
    max: f32,
}

impl DisparityRange {
    const ALL: Self = Self { min: 0.0, max: f32::INFINITY };

    /// Returns the min and max disparity along `ray` at which content of `scene` may lie.
    fn along(&self, scene: &Scene, ray: &Ray) -> Option<(f32, f32)> {
        let (near, far) = scene.interval(ray)?;
        let (min, max) = ((1.0 / far).max(self.min), (1.0 / near.max(1e-3 * far)).min(self.max));
        (min < max).then_some((min, max))
    }
}

/// Returns the range from the 1 % to the 99 % quantile of matched disparities, a quarter wider; `None` for too few matches.
fn disparity_range(maps: &[DepthMap]) -> Option<DisparityRange> {
    let found = matched_disparities(maps);
    let pixels: usize = maps.iter().map(|map| map.disparity.len()).sum();
    if found.is_empty() || (found.len() as f32) < MIN_MATCHES * pixels as f32 {
        return None;
    }
    let margin = found.len() / 100;
    Some(DisparityRange { min: 0.8 * found[margin], max: 1.25 * found[found.len() - 1 - margin] })
}

/// Returns the disparities of all matched pixels, sorted.
fn matched_disparities(maps: &[DepthMap]) -> Vec<f32> {
    let mut found: Vec<f32> = maps.iter().flat_map(|map| &map.disparity).copied().filter(|d| d.is_finite()).collect();
    found.sort_by(f32::total_cmp);
    found
}

/// Best angle between two lines of sight for depth: smaller ones show little depth, larger ones show different sides
/// (MVSNet, Yao et al. 2018, Sec. 4.1).
const BEST_ANGLE_DEG: f32 = 5.0;
/// Max angle between two lines of sight at which windows look similar.
const MAX_ANGLE_DEG: f32 = 45.0;

/// Returns at most `count` cameras other than `view`, the best first.
fn neighbours_of(scene: &Scene, cameras: &[Camera], view: usize, count: usize, within: DisparityRange) -> Vec<usize> {
    let camera = &cameras[view];
    let Some(point) = middle(scene, camera, within) else { return Vec::new() };
    let sight = |camera: &Camera| (point - camera.position()).normalize_or_zero();
    let scored = |other: usize| {
        let angle = sight(camera).angle_between(sight(&cameras[other])).to_degrees();
        let spread = if angle < BEST_ANGLE_DEG { 1.0 } else { 10.0 };
        let score = (-0.5 * ((angle - BEST_ANGLE_DEG) / spread).powi(2)).exp();
        (angle <= MAX_ANGLE_DEG).then_some((score, other))
    };
    let seeing = (0..cameras.len()).filter(|&other| other != view && cameras[other].project(point).is_some());
    let mut scored: Vec<(f32, usize)> = seeing.filter_map(scored).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().take(count).map(|(_, other)| other).collect()
}

/// Returns the point that `camera` looks at, on its middle ray: as far away as the scene's centre if the cameras
/// surround an object, else at the geometric mean of the min and max disparity.
fn middle(scene: &Scene, camera: &Camera, within: DisparityRange) -> Option<Vec3> {
    let ray = camera.ray(camera.width as f32 / 2.0, camera.height as f32 / 2.0);
    let (far, near) = within.along(scene, &ray)?;
    let distance = match scene.space.layout {
        Layout::Object => scene.space.centre.distance(ray.origin).clamp(1.0 / near, 1.0 / far),
        Layout::Forward | Layout::Inside => 1.0 / (near * far).sqrt(),
    };
    Some(ray.at(distance))
}

/// Depth map of a view: the inverse distance to the surface that each pixel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Inverse distance along the unit ray through each pixel's centre, row-major, 1/scene unit; NaN where nothing was matched.
    pub disparity: Vec<f32>,
    /// Difference in disparity between planes at each pixel, 1/scene unit: the resolution of the disparity.
    pub step: Vec<f32>,
}

impl DepthMap {
    /// Returns disparity and step of the pixel that contains the continuous position `(x, y)` of `camera`'s image,
    /// which may be larger than the map. `None` where nothing was matched.
    pub fn at(&self, camera: &Camera, x: f32, y: f32) -> Option<(f32, f32)> {
        let column = (x / camera.width as f32 * self.width as f32) as usize;
        let row = (y / camera.height as f32 * self.height as f32) as usize;
        let at = row.min(self.height - 1) * self.width + column.min(self.width - 1);
        let disparity = self.disparity[at];
        disparity.is_finite().then_some((disparity, self.step[at]))
    }

    /// Returns the larger map `fine` where this map confirms it: has its disparity up to [`TOLERANCE`] steps within two pixels. Where
    /// it does not, the result has this map's disparity, or none.
    fn refined(&self, mut fine: Self) -> Self {
        for i in 0..fine.disparity.len() {
            let column = (2 * (i % fine.width) + 1) * self.width / (2 * fine.width);
            let row = (2 * (i / fine.width) + 1) * self.height / (2 * fine.height);
            let near = |at: usize, end: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(end);
            let mut around =
                near(row, self.height).flat_map(|y| near(column, self.width).map(move |x| y * self.width + x));
            if !around.any(|j| (self.disparity[j] - fine.disparity[i]).abs() <= TOLERANCE * self.step[j]) {
                let own = row * self.width + column;
                (fine.disparity[i], fine.step[i]) = (self.disparity[own], self.step[own]);
            }
        }
        fine
    }

    /// Returns the 99 % quantile of matched disparities, the nearest surface without stray matches; `None` if there are none.
    pub fn nearest(&self) -> Option<f32> {
        let found = matched_disparities(std::slice::from_ref(self));
        found.get(found.len().saturating_sub(1 + found.len() / 100)).copied()
    }

    /// Returns the number of pixels that have a depth.
    pub fn matched(&self) -> usize {
        self.disparity.iter().filter(|disparity| disparity.is_finite()).count()
    }
}

/// Max difference between two views' disparities of one point, in steps between planes.
const TOLERANCE: f32 = 1.5;
/// Max distance, in pixels of the smaller map and along each axis, of depths that confirm those of a larger map.
const REACH: usize = 2;

/// Clears each pixel that no other view of `pairs` confirms. A view confirms it if its own map, at the pixel where it
/// sees the surface point, has the point's disparity up to [`TOLERANCE`] steps.
fn cross_checked(maps: &[DepthMap], cameras: &[Camera], pairs: &[Vec<usize>]) -> Vec<DepthMap> {
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
        DepthMap { disparity: (0..map.disparity.len()).map(kept).collect(), ..map.clone() }
    };
    (0..maps.len()).into_par_iter().map(checked).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};
    use infonerf_scene::Range;

    use super::*;

    /// Returns a scene with content 2 to 8 in front of each camera.
    fn scene() -> Scene {
        let mut scene = Scene::default();
        scene.space.range = Range::Distance { near: 2.0, far: 8.0 };
        scene
    }

    /// Returns a camera that looks at the origin from a distance of 4.
    fn looking(angle_deg: f64) -> Camera {
        let back = DMat4::from_translation(DVec3::new(0.0, 0.0, 4.0));
        Camera::from_fov(40, 30, 1.0, DMat4::from_rotation_y(angle_deg.to_radians()) * back)
    }

    #[test]
    fn neighbours_see_the_middle_from_about_five_degrees() {
        let (mut scene, aside) = (scene(), Vec3::new(1.0, 2.0, 3.0));
        scene.space.centre = aside;
        let moved = |camera: Camera| camera.with_pose(DMat4::from_translation(aside.as_dvec3()) * camera.to_world);
        let cameras = [0.0, 30.0, 12.0, 4.0, 60.0, 1.0, 180.0].map(looking).map(moved);
        assert_eq!(neighbours_of(&scene, &cameras, 0, 3, DisparityRange::ALL), [2, 3, 1]);
        assert_eq!(neighbours_of(&scene, &cameras, 0, 9, DisparityRange::ALL), [2, 3, 1, 5]);
    }

    #[test]
    fn the_middle_is_the_centre_of_objects_and_amid_disparities() {
        let mut scene = scene();
        let mut check = |layout, centre: f32, min, expected: f32| {
            (scene.space.layout, scene.space.centre) = (layout, centre * Vec3::Z);
            let found = middle(&scene, &looking(0.0), DisparityRange { min, ..DisparityRange::ALL }).unwrap();
            approx::assert_abs_diff_eq!(found.z, expected, epsilon = 1e-5);
            assert!(found.truncate().length() < 1e-5, "{found}");
        };
        check(Layout::Object, 1.0, 0.0, 1.0);
        check(Layout::Object, 3.5, 0.0, 2.0);
        check(Layout::Forward, 1.0, 0.0, 0.0);
        check(Layout::Inside, 1.0, 0.25, 4.0 - 8.0f32.sqrt());
    }

    #[test]
    fn the_range_of_disparities_is_wider_than_that_of_enough_matches() {
        let mut disparity: Vec<f32> = (1..=200).map(|i| i as f32).collect();
        disparity.resize(19_000, f32::NAN);
        let mut map = DepthMap { width: 0, height: 0, disparity, step: Vec::new() };
        let expected = DisparityRange { min: 0.8 * 3.0, max: 1.25 * 198.0 };
        assert_eq!(disparity_range(std::slice::from_ref(&map)), Some(expected));
        map.disparity.resize(21_000, f32::NAN);
        assert_eq!(disparity_range(&[map]), None, "less than one in a hundred");
    }

    #[test]
    fn borders_belong_to_the_last_pixels() {
        let map = DepthMap { width: 2, height: 2, disparity: vec![1.0, 2.0, 3.0, 4.0], step: vec![0.1; 4] };
        let camera = Camera::from_fov(4, 6, 1.0, DMat4::IDENTITY);
        for (x, y, disparity) in [(0.0, 0.0, 1.0), (1.9, 3.1, 3.0), (4.0, 2.9, 2.0), (2.0, 6.0, 4.0)] {
            assert_eq!(map.at(&camera, x, y), Some((disparity, 0.1)));
        }
    }

    /// Compares two maps of a plane at a distance of 2, which moves by two pixels between the views. The other map has one pixel.
    #[test]
    fn a_depth_is_kept_where_another_view_confirms_it() {
        let at = |x| Camera::pinhole((8, 6), [8.0; 2], [4.0, 3.0], DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        let distance = |i: usize| {
            let (x, y) = ((i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5);
            2.0 * Vec3::new((x - 4.0) / 8.0, (y - 3.0) / 8.0, 1.0).length()
        };
        let disparity = (0..48).map(|i| 1.0 / distance(i)).collect();
        let map = DepthMap { width: 8, height: 6, disparity, step: vec![0.01; 48] };
        for (steps, expected) in [(0.0, vec![21]), (1.4, vec![21]), (-1.4, vec![21]), (1.6, vec![]), (-1.6, vec![])] {
            let mut other = DepthMap { disparity: vec![f32::NAN; 48], ..map.clone() };
            other.disparity[19] = map.disparity[19] + steps * 0.01;
            let checked = cross_checked(&[map.clone(), other], &[at(0.0), at(0.5)], &[vec![1], vec![]]);
            let kept: Vec<usize> = (0..48).filter(|&i| checked[0].disparity[i].is_finite()).collect();
            assert_eq!((kept, checked[1].matched()), (expected, 0), "{steps}");
        }
    }

    /// Refines depths of the left half of a map of 8 × 1 pixels.
    #[test]
    fn depths_of_larger_images_count_where_smaller_ones_confirm_them() {
        let disparity = [[1.0; 4], [f32::NAN; 4]].concat();
        let coarse = DepthMap { width: 8, height: 1, disparity, step: vec![0.1; 8] };
        let fine = |x: usize, disparity: f32| {
            let mut fine = DepthMap { width: 16, height: 2, disparity: vec![f32::NAN; 32], step: vec![0.05; 32] };
            fine.disparity[16 + x] = disparity;
            let refined = coarse.refined(fine);
            (refined.disparity[16 + x], refined.step[16 + x])
        };
        for (x, disparity) in [(0, 1.14), (7, 0.86), (11, 1.0)] {
            assert_eq!(fine(x, disparity), (disparity, 0.05));
        }
        for (x, disparity) in [(0, 1.16), (7, 0.84), (3, f32::NAN)] {
            assert_eq!(fine(x, disparity), (1.0, 0.1));
        }
        assert!(fine(12, 1.0).0.is_nan(), "three pixels from the next depth");
    }

    #[test]
    fn the_nearest_surface_is_not_a_stray_match() {
        let mut disparity: Vec<f32> = (0..200).map(|i| 1.0 + i as f32 / 200.0).collect();
        (disparity[0], disparity[199]) = (f32::NAN, 50.0);
        let map = DepthMap { width: 200, height: 1, step: vec![0.1; 200], disparity };
        assert!(map.nearest().is_some_and(|nearest| (1.9..2.0).contains(&nearest)), "{:?}", map.nearest());
        assert_eq!(DepthMap { disparity: vec![f32::NAN; 200], ..map }.nearest(), None);
    }
}
