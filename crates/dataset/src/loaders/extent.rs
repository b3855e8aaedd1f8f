//! The space of a real capture (near, far, box, layout), estimated from its cameras and points; and which views to hold out.

use glam::Vec3;
use infonerf_scene::poses::{ViewRegion, up_direction};
use infonerf_scene::{Aabb, Camera, Layout, Range, Space, TestProtocol};

/// Every this many views one is held out for test, starting with the first.
const HOLD_OUT: usize = 8;
/// Rows and columns of rays that stand for an image.
const GRID: usize = 5;
/// The most points that are looked at for each camera.
const MOST_POINTS: usize = 20_000;
/// Fewer visible points than this say nothing of near and far.
const FEWEST_POINTS: usize = 32;

/// Splits views into a training and a test pool: views 0, 8, 16, … are for test, unless a single view is all there is, or
/// `protocol` tests training views.
pub(super) fn hold_out<T>(views: Vec<T>, protocol: &TestProtocol) -> (Vec<T>, Vec<T>) {
    let alone = views.len() == 1 || *protocol == TestProtocol::Training;
    let (test, train): (Vec<_>, Vec<_>) = views.into_iter().enumerate().partition(|(i, _)| !alone && i % HOLD_OUT == 0);
    let strip = |pool: Vec<(usize, T)>| pool.into_iter().map(|(_, view)| view).collect();
    (strip(train), strip(test))
}

/// The space of a capture that says nothing of it itself.
///
/// With points, near and far are 0.8 of the 0.5 % and 1.1 of the 99.5 % quantile of the distances from the cameras to the
/// points that they see: `distances` where these are known, else to those that fall into their images. Without, and with `c` the point nearest to all optical axes and `r` the greatest distance of a
/// camera from it: r / 20 and `r (1 + √3)`; for cameras that look outward, `s / 20` and `10 s` where `s` is how far they
/// are from their mean, or 1.
///
/// Around an object the bounds are the box of the points' 1 % to 99 % quantiles, a tenth wider, or the cube `c ± r`.
/// Otherwise they hold all that the cameras see up to far.
pub(super) fn capture_space(cameras: &[Camera], points: Vec<Vec3>, distances: Vec<f32>) -> Space {
    let region = ViewRegion::new(cameras);
    let focus = region.centre().as_vec3();
    let reach = (region.radii().1 as f32).max(1e-3);
    let layout = layout_with(cameras, &points, focus, reach);
    let mean = cameras.iter().map(Camera::position).sum::<Vec3>() / cameras.len().max(1) as f32;
    let spread = cameras.iter().map(|c| c.position().distance(mean)).fold(0.0, f32::max);

    let seen = ascending(distances).or_else(|| visible_distances(cameras, &points));
    let (near, far) = match (&seen, layout) {
        (Some(seen), _) => (0.8 * quantile(seen, 0.005), 1.1 * quantile(seen, 0.995)),
        (None, Layout::Inside) => {
            let unit = if spread > 1e-6 { spread } else { 1.0 };
            (0.05 * unit, 10.0 * unit)
        }
        (None, _) => (0.05 * reach, (1.0 + 3f32.sqrt()) * reach),
    };
    let frusta = || frusta_bounds(cameras, Range::Distance { near, far });
    let cube = Aabb::cube(focus, reach);
    let bounds = match layout {
        Layout::Object => point_box(&points).unwrap_or(cube),
        _ => frusta().unwrap_or(cube),
    };
    let (centre, radius) = match layout {
        Layout::Inside => (mean, spread.max(0.05 * far)),
        Layout::Forward if seen.is_some() => {
            let ahead = cameras.iter().map(|c| c.forward()).sum::<Vec3>().normalize_or(Vec3::NEG_Z);
            let middle = quantile(seen.as_deref().unwrap_or(&[reach]), 0.5);
            (mean + ahead * middle, middle + spread)
        }
        _ => (focus, reach),
    };
    let up = up_direction(cameras).as_vec3();
    Space {
        range: Range::Distance { near, far },
        near,
        far,
        bounds,
        bounded: false,
        layout,
        up,
        centre,
        radius,
        points,
        body: None,
    }
}

/// How the cameras stand, where points may show that the content lies beyond them.
fn layout_with(cameras: &[Camera], points: &[Vec3], focus: Vec3, reach: f32) -> Layout {
    let layout = Layout::of(cameras);
    if layout != Layout::Object || points.len() < FEWEST_POINTS {
        return layout;
    }
    let mut distances: Vec<f32> = points.iter().map(|p| p.distance(focus)).collect();
    distances.sort_by(f32::total_cmp);
    if quantile(&distances, 0.5) > reach { Layout::Inside } else { layout }
}

/// The distances, in ascending order, from each camera to the points that fall into its image; `None` for too few.
fn visible_distances(cameras: &[Camera], points: &[Vec3]) -> Option<Vec<f32>> {
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let distances = cameras
        .iter()
        .flat_map(|camera| {
            points.iter().step_by(step).filter_map(move |&p| {
                let pixel = camera.project(p)?;
                let (w, h) = (camera.width as f32, camera.height as f32);
                let inside = (0.0..=w).contains(&pixel.x) && (0.0..=h).contains(&pixel.y);
                inside.then(|| p.distance(camera.position()))
            })
        })
        .collect();
    ascending(distances)
}

/// Distances that are finite and positive, sorted; `None` for too few.
fn ascending(mut distances: Vec<f32>) -> Option<Vec<f32>> {
    distances.retain(|d| d.is_finite() && *d > 0.0);
    distances.sort_by(f32::total_cmp);
    (distances.len() >= FEWEST_POINTS).then_some(distances)
}

/// The box of the points' 1 % to 99 % quantiles on each axis, a tenth of its size wider on each side.
fn point_box(points: &[Vec3]) -> Option<Aabb> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
    for axis in 0..3 {
        let mut values: Vec<f32> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f32::total_cmp);
        (min[axis], max[axis]) = (quantile(&values, 0.01), quantile(&values, 0.99));
    }
    let margin = 0.1 * (max - min).max(Vec3::splat(1e-3));
    Some(Aabb { min: min - margin, max: max + margin })
}

/// The value below which a share `q` of the ascending `sorted` lies, or 0 where there are none.
fn quantile(sorted: &[f32], q: f64) -> f32 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((last as f64 * q).round() as usize).copied().unwrap_or(0.0)
}

/// The smallest box around what the cameras see within `range`, of a grid of rays through each.
pub(super) fn frusta_bounds(cameras: &[Camera], range: Range) -> Option<Aabb> {
    let ends = cameras.iter().flat_map(grid).filter_map(|ray| {
        let (near, far) = range.along(&ray)?;
        Some([ray.at(near), ray.at(far)])
    });
    Aabb::containing(ends.flatten().filter(|p: &Vec3| p.is_finite()))
}

/// Rays through a grid of pixel positions, the borders included.
pub(crate) fn grid(camera: &Camera) -> impl Iterator<Item = infonerf_scene::Ray> + use<'_> {
    let at = |i: usize, side: u32| i as f32 / (GRID - 1) as f32 * side as f32;
    (0..GRID * GRID).map(move |i| camera.ray(at(i % GRID, camera.width), at(i / GRID, camera.height)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use infonerf_scene::look_along;

    #[test]
    fn every_eighth_is_held_out() {
        let (train, test) = hold_out((0..20).collect(), &TestProtocol::All);
        assert_eq!(test, [0, 8, 16]);
        assert_eq!(train.len(), 17);
        assert_eq!(hold_out(vec![7], &TestProtocol::All), (vec![7], vec![]));
        assert_eq!(hold_out(vec![7, 8], &TestProtocol::Training), (vec![7, 8], vec![]));
    }

    #[test]
    fn frusta_of_one_camera() {
        let camera = Camera::from_fov(2, 2, std::f64::consts::FRAC_PI_2, glam::DMat4::IDENTITY);
        let bounds = frusta_bounds(std::slice::from_ref(&camera), Range::Depth { near: 1.0, far: 2.0 }).unwrap();
        assert!((bounds.min - Vec3::new(-2.0, -2.0, -2.0)).length() < 1e-5);
        assert!((bounds.max - Vec3::new(2.0, 2.0, -1.0)).length() < 1e-5);
        let bounds = frusta_bounds(&[camera], Range::Distance { near: 1.0, far: 2.0 }).unwrap();
        assert!((bounds.min.z + 2.0).abs() < 1e-5 && bounds.max.z > -0.6);
    }

    fn room() -> Vec<Camera> {
        (0..8)
            .map(|i| {
                let a = f64::from(i) * std::f64::consts::TAU / 8.0;
                let d = DVec3::new(a.cos(), a.sin(), 0.0);
                Camera::from_fov(16, 12, 1.2, look_along(DVec3::Z + 0.4 * d, d, DVec3::Z))
            })
            .collect()
    }

    #[test]
    fn a_room_seen_from_within_lies_in_its_bounds() {
        let cameras = room();
        let walls: Vec<Vec3> = (0..400)
            .map(|i| {
                let a = i as f32 * 0.7;
                Vec3::new(3.0 * a.cos(), 3.0 * a.sin(), 0.2 + 0.004 * i as f32)
            })
            .collect();
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

    #[test]
    fn points_give_the_box_of_an_object() {
        let cameras = infonerf_procedural::train_cameras(20);
        let mut points: Vec<Vec3> = (0..1000)
            .map(|i| {
                let a = i as f32;
                Vec3::new((a * 0.37).sin(), (a * 0.91).cos(), 0.5 * (a * 0.53).sin())
            })
            .collect();
        points.push(Vec3::splat(500.0));
        let space = capture_space(&cameras, points, Vec::new());
        assert_eq!(space.layout, Layout::Object);
        assert!((space.bounds.max.x - 1.2).abs() < 0.05 && (space.bounds.max.z - 0.6).abs() < 0.05, "{space:?}");
        assert!(space.near > 1.5 && space.far < 7.0);
        assert!(space.centre.length() < 1e-3 && (space.radius - 4.03).abs() < 0.01);
    }
}
