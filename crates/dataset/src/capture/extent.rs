//! Space of a capture (near, far, box, layout), estimated from its cameras and points. Detects cameras far from all
//! others, and worlds far from their origin.

use glam::{DVec3, Vec2, Vec3};
use infonerf_scene::poses::ViewRegion;
use infonerf_scene::{Aabb, Camera, Layout, Range, Ray, Space};

use crate::frame::Frame;

/// Number of rows and columns in the grid of rays that represents an image.
const GRID: usize = 5;
/// Max number of points that are projected into each camera.
const MAX_POINTS: usize = 20_000;
/// Min number of visible points from which near and far are estimated.
const MIN_POINTS: usize = 32;
/// Max ratio of a distance to the median: greater distances are sky or errors of a reconstruction, and are left out.
const BEYOND: f32 = 30.0;
/// Max ratio of a point's distance from the box's middle to the median distance; farther points are left out.
const OUTSIDE: f32 = 10.0;
/// Max ratio of the reach of the cameras to the 75 % quantile of their distances from the middle.
const REACH: f32 = 3.0;

/// Estimates the space of a capture that does not state it.
///
/// With points, near is 0.8 times the 0.5 % quantile and far 1.1 times the 99.5 % quantile of distances from cameras to
/// points that they see. These are `distances`, or if too few, distances to points that project into the images.
/// Without points, let `c` be the point nearest to all optical axes, `r` the max distance of cameras from `c`, and `s`
/// their max distance from their mean (both at most [`REACH`] times the 75 % quantile). Then near is `r / 20` and far
/// `r (1 + √3)`; for cameras that look outward `s / 20` and `10 s`, with s = 1 if it is 0.
///
/// Around an object the bounds are the box of the points' 1 % to 99 % quantiles, a tenth wider, or the cube `c ± r`.
/// Otherwise they contain all that the cameras see up to far.
pub(crate) fn capture_space(cameras: &[Camera], points: Vec<Vec3>, distances: Vec<f32>) -> Space {
    let region = ViewRegion::new(cameras);
    let focus = region.centre().as_vec3();
    let reach = robust_greatest(cameras.iter().map(|camera| camera.position_f64().distance(region.centre()) as f32));
    let reach = if reach > 0.0 { reach } else { 1e-3 };
    let median_distance = || quantile(&sorted(points.iter().map(|p| p.distance(focus))), 0.5);
    let layout = match Layout::of(cameras) {
        // Most points lie beyond the cameras.
        Layout::Object if points.len() >= MIN_POINTS && median_distance() > reach => Layout::Inside,
        layout => layout,
    };
    let mean = cameras.iter().map(Camera::position).sum::<Vec3>() / cameras.len().max(1) as f32;
    let spread = robust_greatest(cameras.iter().map(|c| c.position().distance(mean)));

    let seen = plausible_distances(distances).or_else(|| visible_distances(cameras, &points));
    let (near, far) = match (&seen, layout) {
        (Some(seen), _) => (0.8 * quantile(seen, 0.005), 1.1 * quantile(seen, 0.995)),
        (None, Layout::Inside) => {
            let unit = if spread > 1e-6 { spread } else { 1.0 };
            (0.05 * unit, 10.0 * unit)
        }
        (None, _) => (0.05 * reach, (1.0 + 3f32.sqrt()) * reach),
    };
    let frusta = || frusta_bounds(cameras, Range::Distance { near, far });
    let bounds = if layout == Layout::Object { point_box(&points, focus) } else { frusta() };
    let bounds = bounds.unwrap_or_else(|| Aabb::cube(focus, reach));
    let (centre, radius) = match layout {
        Layout::Inside => (mean, spread.max(0.05 * far)),
        Layout::Forward if seen.is_some() => {
            let ahead = cameras.iter().map(|c| c.forward()).sum::<Vec3>().normalize_or(Vec3::NEG_Z);
            let middle = quantile(seen.as_deref().unwrap_or(&[reach]), 0.5);
            (mean + ahead * middle, middle + spread)
        }
        _ => (focus, reach),
    };
    Space { bounded: false, layout, centre, radius, points, ..Space::known(cameras, (near, far), bounds) }
}

/// Returns the max distance, or [`REACH`] times the 75 % quantile of distances if that is less.
fn robust_greatest(distances: impl Iterator<Item = f32>) -> f32 {
    let sorted = sorted(distances);
    sorted.last().map_or(0.0, |last| last.min(REACH * quantile(&sorted, 0.75).max(1e-3 * last)))
}

/// Returns the ascending distances from each camera to the points in its image; `None` for fewer than [`MIN_POINTS`].
fn visible_distances(cameras: &[Camera], points: &[Vec3]) -> Option<Vec<f32>> {
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let distance = |camera: &Camera, p: Vec3| seen_at(camera, p).map(|_| p.distance(camera.position()));
    let distances = |camera| points.iter().step_by(step).filter_map(move |&p| distance(camera, p));
    plausible_distances(cameras.iter().flat_map(distances).collect())
}

/// Returns the pixel at which `camera` sees a point, if it lies within the image.
pub(crate) fn seen_at(camera: &Camera, point: Vec3) -> Option<Vec2> {
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    camera.project(point).filter(|pixel| pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(size).all())
}

/// Sorts distances that are finite, positive and at most [`BEYOND`] medians; `None` for fewer than [`MIN_POINTS`].
fn plausible_distances(mut distances: Vec<f32>) -> Option<Vec<f32>> {
    distances.retain(|d| d.is_finite() && *d > 0.0);
    let mut distances = sorted(distances.into_iter());
    let limit = BEYOND * quantile(&distances, 0.5);
    distances.retain(|d| *d <= limit);
    (distances.len() >= MIN_POINTS).then_some(distances)
}

/// Returns the box of the points' 1 % to 99 % quantiles on each axis, a tenth of its size wider on each side. Points
/// farther from `middle` than [`OUTSIDE`] times the median are left out. `None` for fewer than [`MIN_POINTS`].
fn point_box(points: &[Vec3], middle: Vec3) -> Option<Aabb> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let limit = OUTSIDE * quantile(&sorted(points.iter().map(|p| p.distance(middle))), 0.5);
    let points: Vec<Vec3> = points.iter().copied().filter(|p| p.distance(middle) <= limit).collect();
    let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
    for axis in 0..3 {
        let values = sorted(points.iter().map(|p| p[axis]));
        (min[axis], max[axis]) = (quantile(&values, 0.01), quantile(&values, 0.99));
    }
    let margin = 0.1 * (max - min).max(Vec3::splat(1e-3));
    Some(Aabb { min: min - margin, max: max + margin })
}

fn sorted(values: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut sorted: Vec<f32> = values.collect();
    sorted.sort_by(f32::total_cmp);
    sorted
}

/// Returns the quantile `q` of ascending values, or 0 without values.
pub(super) fn quantile<T: Copy + Default>(sorted: &[T], q: f64) -> T {
    let last = sorted.len().saturating_sub(1);
    sorted.get((last as f64 * q).round() as usize).copied().unwrap_or_default()
}

/// Returns the smallest box around the near and far ends, within `range`, of a grid of rays through each camera.
pub(crate) fn frusta_bounds(cameras: &[Camera], range: Range) -> Option<Aabb> {
    let ends = |ray: Ray| range.along(&ray).map(|(near, far)| [ray.at(near), ray.at(far)]);
    Aabb::containing(cameras.iter().flat_map(grid).filter_map(ends).flatten().filter(|p: &Vec3| p.is_finite()))
}

/// Returns rays through a grid of pixel positions, the borders included.
pub(crate) fn grid(camera: &Camera) -> impl Iterator<Item = Ray> + use<'_> {
    let at = |i: usize, side: u32| i as f32 / (GRID - 1) as f32 * side as f32;
    (0..GRID * GRID).map(move |i| camera.ray(at(i % GRID, camera.width), at(i / GRID, camera.height)))
}

/// Returns the space in front of cameras that see content between two depths along their axes, `None` if it has no bounds.
pub(super) fn space_of_depths(cameras: &[Camera], (near, far): (f32, f32)) -> Option<Space> {
    let range = Range::Depth { near, far };
    let bounds = frusta_bounds(cameras, range)?;
    let farthest = cameras.iter().flat_map(grid).filter_map(|ray| range.along(&ray)).map(|r| r.1).fold(far, f32::max);
    let space = Space { range, bounded: false, ..Space::known(cameras, (near, farthest), bounds) };
    let centre = match space.layout {
        Layout::Object => ViewRegion::new(cameras).centre().as_vec3(),
        Layout::Inside => space.centre,
        Layout::Forward => {
            let harmonic_mean = 2.0 / (1.0 / near + 1.0 / far);
            let position = cameras.iter().map(Camera::position).sum::<Vec3>() / cameras.len().max(1) as f32;
            let ahead = cameras.iter().map(Camera::forward).sum::<Vec3>().normalize_or(Vec3::NEG_Z);
            position + harmonic_mean * ahead
        }
    };
    Some(space.centred(centre, cameras))
}

/// Returns the space of cameras around one object on a transparent background. Its cube about their centre fits into
/// the narrowest field of view; near and far are the camera distances minus and plus half the cube's diagonal.
pub(super) fn object_space(cameras: &[Camera]) -> Space {
    let region = ViewRegion::new(cameras);
    let centre = region.centre().as_vec3();
    let (nearest, farthest) = (region.radii().0 as f32, (region.radii().1 as f32).max(1e-3));
    let half = |c: &Camera| {
        let tangent = 0.5 * (f64::from(c.width) / c.fx).min(f64::from(c.height) / c.fy);
        c.position().distance(centre) * tangent as f32
    };
    let half = (1.05 * cameras.iter().map(half).fold(f32::INFINITY, f32::min)).clamp(0.01 * farthest, farthest);
    let corner = 3f32.sqrt() * half;
    let near = (nearest - corner).max(0.05 * farthest);
    Space::known(cameras, (near, farthest + corner), Aabb::cube(centre, half))
}

/// A camera is an outlier if it is farther from the median position than this many times the 75 % quantile of distances.
const FAR_OUT: f64 = 6.0;
/// Min number of cameras among which outliers are left out. Among at least `FEW` they are only named, if they are farther away
/// than `FAR_OUT_OF_FEW` times that quantile.
const MIN_CAMERAS: usize = 6;
const FEW: usize = 4;
const FAR_OUT_OF_FEW: f64 = 30.0;
/// Max share of cameras that are left out as outliers; if more are far away, all are kept.
const MAX_SHARE: f64 = 0.1;
/// Ratio of the cameras' distance from the world's origin to their spread above which the origin is moved to the
/// cameras. At this distance `f32` resolves 10⁻⁵ of the spread.
const DISTANT: f64 = 100.0;
/// Distance from the origin above which a world is moved to its cameras, if these all stand in one place.
const DISTANT_PLACE: f64 = 1e4;
/// Max number of names in a warning.
const MAX_LISTED: usize = 5;

/// Returns the median position of the cameras, and the 75 % quantile of their distances from it.
fn middle_and_spread(frames: &[Frame]) -> (DVec3, f64) {
    let quantile_of = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        quantile(&values, share)
    };
    let middle =
        DVec3::from_array([0, 1, 2].map(|axis| quantile_of(frames.iter().map(|f| f.pose.w_axis[axis]).collect(), 0.5)));
    (middle, quantile_of(frames.iter().map(|f| place(f).distance(middle)).collect(), 0.75))
}

/// Joins names with commas; `…` replaces those after the first [`MAX_LISTED`].
pub(crate) fn join_names<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let listed = names.take(MAX_LISTED + 1).enumerate().map(|(i, name)| if i < MAX_LISTED { name } else { "…" });
    listed.collect::<Vec<_>>().join(", ")
}

/// Describes `names` among `all`: `N of M WHAT: NAMES`; `None` without names.
pub(crate) fn some_of<S: AsRef<str>>(names: &[S], all: usize, what: &str) -> Option<String> {
    let listed = join_names(names.iter().map(AsRef::as_ref));
    (!names.is_empty()).then(|| format!("{} of {all} {what}: {listed}", names.len()))
}

fn place(frame: &Frame) -> DVec3 {
    frame.pose.w_axis.truncate()
}

/// Removes the frames whose camera is far from all training cameras, if these are not few. Returns a warning that names them.
pub(super) fn leave_out(train: &mut Vec<Frame>, test: &mut Vec<Frame>) -> Option<String> {
    if train.len() < FEW {
        return None;
    }
    let far_out = if train.len() < MIN_CAMERAS { FAR_OUT_OF_FEW } else { FAR_OUT };
    let (middle, spread) = middle_and_spread(train);
    let times = |frame: &Frame| place(frame).distance(middle) / spread;
    let is_far = |frame: &Frame| spread > 0.0 && times(frame) > far_out;
    let far: Vec<&Frame> = train.iter().chain(test.iter()).filter(|frame| is_far(frame)).collect();
    let (most, all) = (far.iter().map(|frame| times(frame)).fold(0.0, f64::max), train.len() + test.len());
    if far.len() as f64 > (MAX_SHARE * all as f64).max(1.0) {
        return None;
    }
    let names: Vec<&str> = far.iter().map(|frame| frame.name.as_str()).collect();
    let end = if train.len() < MIN_CAMERAS { " (is every pose right?)" } else { ", left out" };
    let warning = some_of(&names, all, &format!("cameras up to {most:.0} times farther out than the others{end}"));
    if train.len() >= MIN_CAMERAS {
        train.retain(|frame| !is_far(frame));
        test.retain(|frame| !is_far(frame));
    }
    warning
}

/// Returns the middle of the training cameras if the world's origin is so far away that `f32` would lose detail.
pub(super) fn distant_middle(train: &[Frame]) -> Option<DVec3> {
    let (middle, spread) = middle_and_spread(train);
    let limit = if spread > 0.0 { DISTANT * spread } else { DISTANT_PLACE };
    (middle.length() > limit).then_some(middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use infonerf_scene::look_along;

    #[test]
    fn frusta_of_one_camera() {
        let camera = Camera::from_fov(2, 2, std::f64::consts::FRAC_PI_2, glam::DMat4::IDENTITY);
        let bounds = frusta_bounds(std::slice::from_ref(&camera), Range::Depth { near: 1.0, far: 2.0 }).unwrap();
        assert!((bounds.min - Vec3::new(-2.0, -2.0, -2.0)).length() < 1e-5);
        assert!((bounds.max - Vec3::new(2.0, 2.0, -1.0)).length() < 1e-5);
        let bounds = frusta_bounds(&[camera], Range::Distance { near: 1.0, far: 2.0 }).unwrap();
        assert!((bounds.min.z + 2.0).abs() < 1e-5 && bounds.max.z > -0.6);
    }

    /// Returns cameras on an arc about the origin.
    fn around(distance: f64) -> Vec<Camera> {
        let camera = |i: u32| {
            let towards = DVec3::new((0.3 * f64::from(i)).sin(), (0.3 * f64::from(i)).cos(), 0.0);
            Camera::from_fov(16, 12, 1.2, look_along(-distance * towards, towards, DVec3::Z))
        };
        (0..8).map(camera).collect()
    }

    #[test]
    fn a_far_sky_does_not_move_the_centre() {
        let space = space_of_depths(&around(3.0), (1.0, 1e4)).unwrap();
        assert!(space.layout == Layout::Object && space.centre.length() < 1e-2, "{}", space.centre);
    }

    #[test]
    fn a_tiny_world_is_estimated_like_a_large_one() {
        let [tiny, usual] = [3e-5, 3.0].map(|distance| capture_space(&around(distance), Vec::new(), Vec::new()));
        for (found, expected) in [(usual.near, 0.15), (usual.far, 3.0 * (1.0 + 3f32.sqrt())), (usual.radius, 3.0)] {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
        let ratios = [tiny.near / usual.near, tiny.far / usual.far, tiny.radius / usual.radius];
        assert!(ratios.iter().all(|ratio| (1e5 * ratio - 1.0).abs() < 1e-3), "{ratios:?}");
    }

    #[test]
    fn distances_before_a_row_of_cameras_state_range_and_centre() {
        let row = [-1.0, 0.0, 1.0].map(|x| Camera::from_fov(16, 12, 1.2, look_along(DVec3::X * x, DVec3::Y, DVec3::Z)));
        let space = capture_space(&row, Vec::new(), (0..=200u16).map(|i| 2.0 + 0.01 * f32::from(i)).collect());
        assert_eq!(space.layout, Layout::Forward);
        assert!(space.centre.distance(3.0 * Vec3::Y) < 1e-5 && (space.radius - 4.0).abs() < 1e-5, "{space:?}");
        assert!((space.near - 0.8 * 2.01).abs() < 1e-5 && (space.far - 1.1 * 3.99).abs() < 1e-5, "{space:?}");
    }

    #[test]
    fn a_room_seen_from_within_lies_in_its_bounds() {
        let camera = |i: u32| {
            let a = f64::from(i) * std::f64::consts::TAU / 8.0;
            let d = DVec3::new(a.cos(), a.sin(), 0.0);
            Camera::from_fov(16, 12, 1.2, look_along(DVec3::Z + 0.4 * d, d, DVec3::Z))
        };
        let cameras: Vec<Camera> = (0..8).map(camera).collect();
        let wall = |i: f32| Vec3::new(3.0 * (0.7 * i).cos(), 3.0 * (0.7 * i).sin(), 0.2 + 0.004 * i);
        let walls: Vec<Vec3> = (0..400u16).map(|i| wall(f32::from(i))).collect();
        for points in [vec![], walls.clone()] {
            let known = !points.is_empty();
            let space = capture_space(&cameras, points, Vec::new());
            assert_eq!(space.layout, Layout::Inside);
            assert!((space.centre - Vec3::Z).length() < 1e-3 && space.up.z > 0.999);
            for ray in cameras.iter().flat_map(grid) {
                let (near, far) = space.range.along(&ray).unwrap();
                assert!(space.bounds.contains(ray.at(near)) && space.bounds.contains(ray.at(0.999 * far)));
            }
            assert!(walls.iter().all(|&p| space.bounds.contains(p)), "{:?}", space.bounds);
            if known {
                assert!((2.0..2.7).contains(&space.near) && (2.8..5.0).contains(&space.far), "{space:?}");
            }
        }
    }
}
