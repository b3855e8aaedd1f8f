//! Checks of a scene before training, for implausible cameras, images and ranges.

use std::path::Path;

use infonerf_scene::poses::angle;
use infonerf_scene::{Camera, Image, Layout, Scene, SceneError, SceneRequest, TestProtocol, View, ViewSelection};

use crate::capture::{MAX_BYTES, assemble, compare, count_pixels, grid, some_of};
use crate::loaders;

/// Cameras are far off if their distance from the box exceeds this many times its diagonal.
const FAR_OFF: f32 = 20.0;
/// The up direction is doubtful if its mean cosine with the cameras' own up directions is below this.
const UPRIGHT: f64 = 0.5;
/// Views closer together than this, in degrees, have hardly any parallax.
const NARROW_DEG: f64 = 2.0;
/// Cameras stand at one point if their distance from the first, divided by the diagonal of the box, is at most this.
const SAME_POINT: f64 = 1e-5;
/// An image is blurred if its detail is below this fraction of the median detail.
const BLURRED: f32 = 0.2;
/// An image is dark if the mean of its values is below this fraction of the median mean.
const DARK: f32 = 0.4;
/// An image is empty if the standard deviation of its values is below this.
const BLANK: f32 = 0.004;
/// A mask is nearly empty if it keeps less than this fraction of the pixels.
const SMALL_MASK: f32 = 0.005;
/// Longest side, in pixels, of the images in which [`check_folder`] looks for blur; less if there are many.
const CHECKED_SIZE: u32 = 512;

/// Loads the scene in the folder `dir` with all of its views, checks it, and compares its poses with its photographs.
/// Returns the number of views, the warnings, and a note on photographs that were not compared.
///
/// # Errors
/// Errors of [`crate::load`].
pub fn check_folder(dir: &Path) -> Result<(usize, Vec<String>, Option<String>), SceneError> {
    let request = fitting_request(dir, MAX_BYTES)?;
    let (doubts, note) = compare(&loaders::read(dir, &request)?.prepared()?)?;
    let scene = assemble(loaders::read(dir, &request)?, &request, false)?;
    let mut warnings = check(&scene, doubts.is_empty());
    warnings.extend(doubts);
    Ok((scene.train.len() + scene.test.len(), warnings, note))
}

/// Returns the request for all views at [`CHECKED_SIZE`], halved until the images take at most `limit` bytes.
fn fitting_request(dir: &Path, limit: u64) -> Result<SceneRequest, SceneError> {
    let mut size = CHECKED_SIZE;
    loop {
        let (train, test) = (ViewSelection::All, TestProtocol::All);
        let request = SceneRequest { train, test, image_size: Some(size), ..SceneRequest::default() };
        let pixels = count_pixels(loaders::read(dir, &request)?, &request)?;
        // A pixel with alpha takes 16 bytes.
        if size == 1 || pixels.train.saturating_add(pixels.test) <= limit / 16 {
            return Ok(request);
        }
        size /= 2;
    }
}

/// Returns the warnings about `scene` that should be looked at before training on it; about a lack of parallax only if its
/// photographs raise no doubts about its poses, which explain it better.
fn check(scene: &Scene, is_undoubted: bool) -> Vec<String> {
    let mut warnings = scene.warnings.clone();
    let (bounds, diagonal) = (&scene.space.bounds, scene.space.bounds.size().length());
    let is_far = |camera: &Camera| camera.position().distance(bounds.centre()) > FAR_OFF * diagonal;
    let far = format!("more than {FAR_OFF} box diagonals away from the box (are scale and box right?)");
    let is_blind = |camera: &Camera| grid(camera).all(|ray| bounds.intersect(&ray).is_none());
    let blind = "that see nothing of the box (are the axes of the poses OpenGL's?)";
    let placed = [faulty(scene, is_far, &far), faulty(scene, is_blind, blind)];
    let parallax = at_one_point(scene).or_else(|| baseline(scene).filter(|_| is_undoubted));
    warnings.extend(placed.into_iter().chain([tilted(scene), parallax]).flatten());
    warnings.extend(images(scene));
    warnings
}

/// Describes the cameras for which `is_faulty` as `N of M cameras … : NAMES`.
fn faulty(scene: &Scene, is_faulty: impl Fn(&Camera) -> bool, what: &str) -> Option<String> {
    let all: Vec<&View> = scene.train.iter().chain(&scene.test).collect();
    let found: Vec<&str> = all.iter().filter(|view| is_faulty(&view.camera)).map(|view| &*view.name).collect();
    some_of(&found, all.len(), &format!("cameras {what}"))
}

/// Describes an up direction that is far from the cameras' own, unless they look straight up or down.
fn tilted(scene: &Scene) -> Option<String> {
    let cameras = &scene.all_train_cameras;
    if cameras.len() < 2 {
        return None;
    }
    let up = scene.space.up.as_dvec3();
    let agreement = cameras.iter().map(|c| c.to_world.y_axis.truncate().dot(up)).sum::<f64>() / cameras.len() as f64;
    let steep = cameras.iter().map(|c| c.forward_f64().dot(up).abs()).sum::<f64>() / cameras.len() as f64;
    // Up axes of cameras that look straight up or down are no evidence.
    (agreement < UPRIGHT && steep < 0.7).then(|| {
        format!("the up direction ({:.2}, {:.2}, {:.2}) is doubtful: the cameras were not held level", up.x, up.y, up.z)
    })
}

/// Describes training cameras that all stand at one point, up to [`SAME_POINT`].
fn at_one_point(scene: &Scene) -> Option<String> {
    let first = scene.train.first()?.camera.position_f64();
    let tolerance = SAME_POINT * f64::from(scene.space.bounds.size().length());
    let is_there = |view: &View| view.camera.position_f64().distance(first) <= tolerance;
    (scene.train.len() > 1 && scene.train.iter().all(is_there)).then(|| {
        "all training cameras stand at one point: photographs of a camera that was only turned show no depth".into()
    })
}

/// Describes training views that are all close together, by angles at the scene's centre.
fn baseline(scene: &Scene) -> Option<String> {
    let from_centre = |view: &View| (view.camera.position() - scene.space.centre).as_dvec3().normalize_or_zero();
    let directions: Vec<_> = scene.train.iter().map(from_centre).collect();
    let pairs = directions.iter().enumerate().flat_map(|(i, a)| directions[..i].iter().map(move |b| angle(*a, *b)));
    let widest = pairs.fold(0.0, f64::max).to_degrees();
    (directions.len() > 1 && widest < NARROW_DEG && scene.space.layout != Layout::Inside)
        .then(|| format!("the training views are within {widest:.1}° of each other: they show hardly any depth"))
}

fn images(scene: &Scene) -> Vec<String> {
    let (mut found, mut blank, mut whole) = (Vec::new(), Vec::new(), Vec::new());
    let tested = scene.test.iter().filter(|test| scene.train.iter().all(|v| v.file != test.file));
    let views = scene.train.iter().chain(tested);
    let measured: Vec<(&View, [f32; 3])> = views.map(|view| (view, measures(&view.image))).collect();
    let [median, _, brightness] = [0, 1, 2].map(|i| {
        let mut values: Vec<f32> = measured.iter().map(|(_, values)| values[i]).collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    });
    for (view, [detail, spread, mean]) in measured {
        // A short exposure darkens details, too.
        let detail = detail * (brightness / mean).max(1.0).powi(2);
        if spread < BLANK {
            blank.push(&view.name);
        } else if detail < BLURRED * median {
            let share = 100.0 * detail / median;
            found.push(format!("{} is blurred: it has {share:.0} % of the others' detail", view.name));
        }
        if mean < DARK * brightness && spread >= BLANK {
            let share = 100.0 * mean / brightness;
            found.push(format!("{} is dark: it has {share:.0} % of the others' brightness", view.name));
        }
        if let Some(mask) = &view.mask {
            let share = mask.iter().filter(|&&m| m).count() as f32 / mask.len().max(1) as f32;
            if share < SMALL_MASK {
                found.push(format!("the mask of {} leaves in {:.2} % of its pixels", view.name, 100.0 * share));
            }
            whole.extend((!mask.contains(&false)).then_some(view.name.as_str()));
        }
    }
    let all = scene.train.len() + scene.test.len();
    found.extend(some_of(&blank, all, "images show nothing, as all their pixels are alike"));
    found.extend(some_of(&whole, all, "views with a mask that hides nothing"));
    found
}

/// Returns the mean square of the discrete Laplacian of the grey values, their standard deviation, and their mean.
fn measures(image: &Image) -> [f32; 3] {
    let (w, h) = (image.width as usize, image.height as usize);
    let grey: Vec<f32> = image.rgb.iter().map(|p| p.iter().sum::<f32>() / 3.0).collect();
    let n = grey.len().max(1) as f32;
    let mean = grey.iter().sum::<f32>() / n;
    let spread = (grey.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt();
    let at = |x: usize, y: usize| grey[y * w + x];
    let laplacian = |x, y| 4.0 * at(x, y) - at(x - 1, y) - at(x + 1, y) - at(x, y - 1) - at(x, y + 1);
    let inner = |side: usize| 1..side.max(2) - 1;
    let pixels = inner(h).flat_map(|y| inner(w).map(move |x| (x, y)));
    let sum = pixels.fold(0.0, |sum, (x, y)| sum + f64::from(laplacian(x, y)).powi(2));
    let detail = (sum / (inner(w).len() * inner(h).len()).max(1) as f64) as f32;
    [detail, spread, mean]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::source::{SceneSource, load};
    use glam::Vec3;
    use infonerf_scene::Aabb;

    fn scene() -> Scene {
        let (train, test) = (ViewSelection::Seed { seed: 0, count: 5 }, TestProtocol::First(1));
        let request = SceneRequest { train, test, image_size: Some(24), ..Default::default() };
        load(&SceneSource::Procedural("knot".into()), &request).unwrap()
    }

    #[test]
    fn images_are_checked_at_a_size_that_fits() {
        let guard = tempfile::tempdir().unwrap();
        loaders::testing::blender(guard.path(), 5, 2);
        let size = |limit: u64| fitting_request(guard.path(), limit).unwrap().image_size;
        assert_eq!((size(16 * 7 * 64), size(16 * 7 * 64 - 1)), (Some(CHECKED_SIZE), Some(4)));
        let (views, _, note) = check_folder(guard.path()).unwrap();
        assert!(views == 7 && note.unwrap().starts_with("too few matches"));
    }

    #[test]
    fn each_fault_is_found_and_a_sound_scene_has_none() {
        let sound = scene();
        assert_eq!(check(&sound, true), [""; 0]);
        /// A change of the scene, and a part of each warning that it leads to.
        type Case<'a> = (&'a dyn Fn(&mut Scene), &'a [&'a str]);
        let cases: [Case<'_>; 9] = [
            (&|s| s.warnings.push("x".into()), &["x"]),
            (&|s| s.space.bounds = Aabb::cube(Vec3::X * 50.0, 1.0), &["see nothing of the box"]),
            (&|s| s.space.up = Vec3::X, &["the up direction"]),
            (&|s| s.train[1].image = Arc::new(Image::filled(24, 24, [0.5; 3])), &["1 of 6 images show nothing"]),
            (&|s| s.train[1].image = Arc::new(s.train[1].image.resized(3, 3).resized(24, 24)), &["is blurred"]),
            (
                &|s| Arc::make_mut(&mut s.train[1].image).rgb.iter_mut().for_each(|p| *p = p.map(|v| v / 5.0)),
                &["is dark"],
            ),
            (&|s| s.train[1].mask = Some(vec![false; 24 * 24].into()), &["leaves in 0.00 % of its pixels"]),
            (
                &|s| s.test[0].mask = Some(vec![true; 24 * 24].into()),
                &["1 of 6 views with a mask that hides nothing: "],
            ),
            (&|s| s.train.iter_mut().for_each(|v| v.camera = sound.train[0].camera.clone()), &["stand at one point"]),
        ];
        let changed = |change: &dyn Fn(&mut Scene)| {
            let mut scene = sound.clone();
            change(&mut scene);
            check(&scene, true)
        };
        for (change, expected) in cases {
            let found = changed(change);
            let each = found.iter().zip(expected).all(|(warning, part)| warning.contains(part));
            assert!(found.len() == expected.len() && each, "{expected:?}: {found:?}");
        }
        let small = changed(&|s| s.space.bounds = Aabb::cube(Vec3::ZERO, 0.01));
        assert!(small[0].contains("box diagonals away from the box"), "{small:?}");
    }
}
