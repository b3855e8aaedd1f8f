//! Check of the given cameras against matches between the photographs.

use glam::{DMat3, DMat4, DVec2, DVec3};
use infonerf_scene::image::{GreyImage, read_rgba, resized_dimensions};
use infonerf_scene::{Camera, SceneError};
use infonerf_sfm::{ImageMatches, Pose, explains, ray, verified_matches};
use rayon::prelude::*;

use super::Capture;
use crate::frame::Frame;

/// Max number of photographs that are matched.
const MAX_IMAGES: usize = 24;
/// Number of photographs in a run with consecutive names, which often overlap. Several runs are matched.
const RUN: usize = 4;
/// Longest side of the images that are matched, in pixels.
const SIZE: u32 = 480;
const FEATURES: usize = 1500;
/// Max distance of a match from the cameras' epipolar geometry, divided by the longer side, at which they explain it.
const TOLERANCE: f64 = 8e-3;
/// Min number of matches on which cameras are judged.
const MIN_MATCHES: usize = 60;
/// Share of explained matches below which the poses are doubted.
const EXPLAINED: f64 = 0.5;
/// Min share of matches that another convention must explain to be named.
const CONVINCING: f64 = 0.7;
/// Min share and min lead of another convention's explained matches at which poses above [`EXPLAINED`] are doubted too.
const MIN_BETTER_SHARE: f64 = 0.9;
const MIN_LEAD: f64 = 0.12;
/// Min number of a photograph's matches to judge it alone, and share of explained ones below which its pose is doubted.
const PHOTOGRAPH_MIN_MATCHES: usize = 30;
const PHOTOGRAPH_EXPLAINED: f64 = 0.3;
/// Plausible principal points divided by the image side (`CENTRAL`), and plausible ratios fy / fx (`SQUARE`).
const CENTRAL: std::ops::RangeInclusive<f64> = 0.25..=0.75;
const SQUARE: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Plausible focal lengths divided by the longer side of the image: fields of view from 5° to 118°.
const FOCAL_LENGTHS: std::ops::RangeInclusive<f64> = 0.3..=11.5;

/// Compares the poses of a capture with its photographs and returns one line per doubt: poses that do not explain matches
/// between photographs, with the convention that explains most of them.
pub(crate) fn compare(capture: &Capture<'_>) -> Result<Vec<String>, SceneError> {
    let mut frames: Vec<&Frame> = capture.found.train.iter().chain(&capture.found.test).collect();
    frames.retain(|frame| frame.image.is_file());
    frames.sort_by_key(|frame| natural(&frame.name));
    frames.dedup_by(|a, b| a.image == b.image);
    let chosen = spread(frames.len());
    let read: Result<Vec<_>, _> = chosen.par_iter().map(|&i| small(frames[i])).collect();
    let (images, cameras): (Vec<GreyImage>, Vec<Camera>) = read?.into_iter().unzip();
    let names: Vec<&str> = chosen.iter().map(|&i| frames[i].name.as_str()).collect();
    let focal: Vec<f64> = cameras.iter().map(|camera| (camera.fx * camera.fy).sqrt()).collect();
    let matches = verified_matches(&images, &focal, FEATURES);
    let count: usize = matches.iter().map(|pair| pair.pixels.len()).sum();
    if count < MIN_MATCHES {
        return Ok(Vec::new());
    }
    let poses: Vec<DMat4> = frames.iter().map(|frame| frame.pose).collect();
    // Number of explained matches of each pair, for cameras at `poses` with focal lengths multiplied by `factor`.
    let explained = |poses: &[DMat4], factor: f64| -> Vec<usize> {
        let of_pair = |pair: &ImageMatches| {
            let [a, b] = [pair.a, pair.b].map(|i| Pose::of(&poses[chosen[i]]));
            let longer = f64::from(cameras[pair.a].width.max(cameras[pair.a].height));
            let tolerance = TOLERANCE * longer / (factor * cameras[pair.a].fx);
            let is_explained = |&(in_a, in_b): &(DVec2, DVec2)| {
                let rays = ray(&cameras[pair.a], in_a, factor).zip(ray(&cameras[pair.b], in_b, factor));
                rays.is_some_and(|rays| explains([&a, &b], rays, tolerance))
            };
            pair.pixels.iter().filter(|pixels| is_explained(pixels)).count()
        };
        matches.par_iter().map(of_pair).collect()
    };
    let share = |poses: &[DMat4], factor: f64| explained(poses, factor).iter().sum::<usize>() as f64 / count as f64;
    let given = share(&poses, 1.0);
    let all_names: Vec<&str> = frames.iter().map(|frame| frame.name.as_str()).collect();
    let taken_as = conventions(&poses, &all_names).into_iter().map(|(name, poses)| (share(&poses, 1.0), name.into()));
    let mean = focal.iter().sum::<f64>() / focal.len() as f64;
    let longer = f64::from(cameras[0].width.max(cameras[0].height));
    let focal_lengths = (0..17).map(|i| 0.5 * 1.12f64.powi(i)).map(|times| {
        (share(&poses, times * longer / mean), format!("with focal lengths of about {times:.2} image widths"))
    });
    let best = taken_as.chain(focal_lengths).max_by(|a, b| a.0.total_cmp(&b.0));
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let is_better = best.as_ref().is_some_and(|(share, _)| *share >= MIN_BETTER_SHARE && *share >= given + MIN_LEAD);
    if given >= EXPLAINED && !is_better {
        let mut doubts = Vec::new();
        for (image, explained, all) in unexplained_photographs(&matches, &explained(&poses, 1.0), chosen.len()) {
            let (name, share) = (names[image], percent(explained as f64 / all as f64));
            let text = format!("explains {share} of {all} matches with other photographs: is its pose right?");
            doubts.push(format!("the camera of {name} {text}"));
        }
        return Ok(doubts);
    }
    let advice = match best {
        Some((share, name)) if share >= CONVINCING => format!("{name} they would explain {}", percent(share)),
        _ => "are they of these photographs, and in this order?".to_owned(),
    };
    let (given, images) = (percent(given), chosen.len());
    Ok(vec![format!("the cameras explain {given} of {count} matches between {images} photographs: {advice}")])
}

/// Returns a sort key of a name in which numbers count by their value.
fn natural(name: &str) -> Vec<(String, u64)> {
    let (mut key, mut rest) = (Vec::new(), name);
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let end = rest[text..].find(|c: char| !c.is_ascii_digit()).map_or(rest.len(), |digits| text + digits);
        key.push((rest[..text].to_owned(), rest[text..end].parse().unwrap_or(0)));
        rest = &rest[end..];
    }
    key
}

/// Chooses at most [`MAX_IMAGES`] of `count` images: runs of neighbours spread over all.
fn spread(count: usize) -> Vec<usize> {
    if count <= MAX_IMAGES {
        return (0..count).collect();
    }
    let runs = MAX_IMAGES / RUN;
    (0..MAX_IMAGES).map(|i| i / RUN * (count - RUN) / (runs - 1) + i % RUN).collect()
}

/// Reads an image in grey with a longest side of at most [`SIZE`] pixels, and its camera.
fn small(frame: &Frame) -> Result<(GreyImage, Camera), SceneError> {
    let image = read_rgba(&frame.image)?;
    let (width, height) = (image.width, image.height);
    let size = resized_dimensions(width, height, width.max(height).min(SIZE));
    let image = image.composite_resized(size.0, size.1, [1.0; 3]);
    let grey = GreyImage::luma(size.0 as usize, size.1 as usize, image.rgb.into_iter());
    Ok((grey, frame.camera(width, height).resized(size.0, size.1)))
}

/// Describes implausible focal lengths, principal points and ratios fy / fx.
pub(crate) fn implausible(names: &[&str], cameras: &[Camera]) -> Vec<String> {
    let mut doubts = Vec::new();
    let over_longer = |c: &Camera| (c.fx * c.fy).sqrt() / f64::from(c.width.max(c.height));
    if let Some(i) = cameras.iter().position(|c| c.lens.is_perspective() && !FOCAL_LENGTHS.contains(&over_longer(c))) {
        let (name, found) = (names[i], over_longer(&cameras[i]));
        let doubt = "image widths: is it in pixels, and for images of this size?";
        doubts.push(format!("the focal length of {name} is {found:.2} {doubt}"));
    }
    let middle = |c: &Camera| [c.cx / f64::from(c.width), c.cy / f64::from(c.height)];
    if let Some(i) = cameras.iter().position(|c| !middle(c).iter().all(|share| CENTRAL.contains(share))) {
        let (name, [x, y]) = (names[i], middle(&cameras[i]));
        let place = format!("is at {x:.2} of the width and {y:.2} of the height");
        doubts.push(format!("the principal point of {name} {place}: is it for images of this size?"));
    }
    if let Some(i) = cameras.iter().position(|c| !SQUARE.contains(&(c.fy / c.fx))) {
        let (name, ratio) = (names[i], cameras[i].fy / cameras[i].fx);
        doubts
            .push(format!("the focal lengths of {name} differ by a factor of {ratio:.2}: are its pixels not square?"));
    }
    doubts
}

/// Returns the given matrices read in the conventions of other programs, each with the words that name the convention.
fn conventions(given: &[DMat4], names: &[&str]) -> Vec<(&'static str, Vec<DMat4>)> {
    let flip = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
    let turn = |pose: &DMat4| DMat3::from_mat4(*pose);
    let each = |change: &dyn Fn(&DMat4) -> DMat4| given.iter().map(change).collect::<Vec<_>>();
    let rolled = |degrees: f64| each(&|pose| *pose * DMat4::from_rotation_z(degrees.to_radians()));
    let transposed = |pose: &DMat4| DMat4 { w_axis: pose.w_axis, ..DMat4::from_mat3(turn(pose).transpose()) };
    let moved = |pose: &DMat4| DMat4 { w_axis: (-(turn(pose) * pose.w_axis.truncate())).extend(1.0), ..*pose };
    let shifted = |by: usize| (0..given.len()).map(|i| given[(i + by) % given.len()]).collect();
    let mut all = vec![
        ("with OpenCV's axes (y down, z forward)", each(&|pose| *pose * flip)),
        ("as world-to-camera matrices", each(&|pose| pose.inverse())),
        ("as world-to-camera matrices with OpenCV's axes", each(&|pose| pose.inverse() * flip)),
        ("with transposed rotations", each(&transposed)),
        ("with transposed rotations and OpenCV's axes", each(&|pose| transposed(pose) * flip)),
        ("with the translations taken as those of world-to-camera matrices", each(&moved)),
        ("each with the pose of the next photograph", shifted(1)),
        ("each with the pose of the photograph before", shifted(given.len() - 1)),
        ("in the opposite order", given.iter().rev().copied().collect()),
        ("with cameras rolled by 90°", rolled(90.0)),
        ("with cameras rolled by 180°", rolled(180.0)),
        ("with cameras rolled by 270°", rolled(270.0)),
    ];
    let mut as_text: Vec<usize> = (0..names.len()).collect();
    as_text.sort_by_key(|&i| names[i]);
    if as_text.windows(2).any(|pair| pair[0] > pair[1]) {
        let mut by_text = vec![DMat4::IDENTITY; given.len()];
        let mut by_number = by_text.clone();
        for (place, &image) in as_text.iter().enumerate() {
            (by_text[image], by_number[place]) = (given[place], given[image]);
        }
        all.push(("in the order of image names as text", by_text));
        all.push(("in the order of the numbers in image names", by_number));
    }
    all
}

/// Returns the photographs (of `count`) whose cameras explain few of their matches, worst first: index, number of
/// `explained` matches, number of matches. Matches with a photograph that is already returned do not count.
fn unexplained_photographs(matches: &[ImageMatches], explained: &[usize], count: usize) -> Vec<(usize, usize, usize)> {
    let mut found: Vec<(usize, usize, usize)> = Vec::new();
    loop {
        let is_known = |image: usize| found.iter().any(|(wrong, ..)| *wrong == image);
        let of = |image: usize| {
            let own = matches.iter().zip(explained).filter(|(pair, _)| pair.a == image || pair.b == image);
            let own = own.filter(|(pair, _)| !is_known(pair.a) && !is_known(pair.b));
            let counts = own.map(|(pair, explained)| (*explained, pair.pixels.len()));
            counts.fold((image, 0, 0), |(_, sum, all), (explained, own)| (image, sum + explained, all + own))
        };
        let share = |(_, explained, all): &(usize, usize, usize)| *explained as f64 / *all as f64;
        let judged = (0..count).map(of).filter(|(_, _, all)| *all >= PHOTOGRAPH_MIN_MATCHES);
        let worst = judged.min_by(|a, b| share(a).total_cmp(&share(b)));
        match worst.filter(|worst| share(worst) < PHOTOGRAPH_EXPLAINED) {
            Some(worst) => found.push(worst),
            None => return found,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaders::testing::{load, photographs_of, request};

    /// Returns the doubts about twelve photographs of a built-in scene whose poses and focal lengths `given` states.
    fn doubts(given: impl Fn(usize, &[Camera]) -> (DMat4, f64)) -> Vec<String> {
        let cameras: Vec<Camera> = infonerf_procedural::photographs("table", 160, 40)[..12].to_vec();
        let stated = |i: usize| {
            let (pose, focal) = given(i, &cameras);
            Camera { fx: focal, fy: focal, ..cameras[i].with_pose(pose) }
        };
        let stated: Vec<Camera> = (0..cameras.len()).map(stated).collect();
        let guard = photographs_of("table", &cameras, &stated, |i| format!("images/p{i}.png"));
        let scene = load(guard.path(), &request()).unwrap();
        let capture = crate::loaders::read(guard.path(), &request()).unwrap().prepared().unwrap();
        [scene.warnings, compare(&capture).unwrap()].concat()
    }

    /// Pose and focal length that a capture states for a camera of a list.
    type Stated<'a> = &'a dyn Fn(usize, &[Camera]) -> (DMat4, f64);

    fn assert_named(cases: &[(Stated<'_>, &str)]) {
        for (stated, named) in cases {
            let found = doubts(stated);
            let last = found.last().map_or("", String::as_str);
            assert!(last.contains("matches between 12 photographs") && last.contains(named), "{named}: {found:?}");
        }
    }

    #[test]
    fn the_axes_of_poses_are_named() {
        let flip = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let quarter = DMat4::from_rotation_z(90f64.to_radians());
        let transposed =
            |pose: &DMat4| DMat4 { w_axis: pose.w_axis, ..DMat4::from_mat3(DMat3::from_mat4(*pose).transpose()) };
        assert_named(&[
            (&|i, all| (all[i].to_world * flip, all[i].fx), "with OpenCV's axes"),
            (&|i, all| (all[i].to_world.inverse(), all[i].fx), "as world-to-camera matrices they"),
            (&|i, all| (all[i].to_world * quarter, all[i].fx), "with cameras rolled by 270°"),
            (&|i, all| (transposed(&all[i].to_world), all[i].fx), "with transposed rotations they"),
        ]);
    }

    #[test]
    fn the_order_of_poses_and_the_focal_length_are_named() {
        assert_eq!(doubts(|i, all| (all[i].to_world, all[i].fx)), [""; 0]);
        let order = [0, 1, 10, 11, 2, 3, 4, 5, 6, 7, 8, 9];
        assert_named(&[
            (&|i, all| (all[order[i]].to_world, all[i].fx), "in the order of"),
            (&|i, all| (all[(i + 1) % 12].to_world, all[i].fx), "each with the pose of the photograph before"),
            (&|i, all| (all[11 - i].to_world, all[i].fx), "in the opposite order"),
            (&|i, all| (all[i].to_world, 0.7 * all[i].fx), "with focal lengths of about 1.39 image widths"),
        ]);
        let in_pixels = doubts(|i, all| (all[i].to_world, 24.0));
        assert!(in_pixels[0].contains("is 0.15 image widths: is it in pixels"), "{in_pixels:?}");
        assert!(in_pixels.last().unwrap().contains("with focal lengths of about"), "{in_pixels:?}");
    }

    /// Turns the camera of photograph 3 away, and gives photograph 8 the pose of photograph 5.
    #[test]
    fn photographs_with_wrong_poses_are_named() {
        let away = DMat4::from_rotation_y(std::f64::consts::PI);
        let found = doubts(|i, all| match i {
            3 => (all[3].to_world * away, all[3].fx),
            8 => (all[5].to_world, all[8].fx),
            _ => (all[i].to_world, all[i].fx),
        });
        let is_named = |name: &str| found.iter().any(|doubt| doubt.contains(name) && doubt.ends_with("pose right?"));
        assert!(found.len() == 2 && is_named("images/p3") && is_named("images/p8"), "{found:?}");
    }

    #[test]
    fn implausible_intrinsics_are_named() {
        let camera = Camera::pinhole((100, 80), [90.0; 2], [50.0, 40.0], DMat4::IDENTITY);
        let doubts = |other: Camera| implausible(&["a", "b"], &[camera.clone(), other]);
        assert_eq!(doubts(camera.clone()), [""; 0]);
        for (other, said) in [
            (Camera { fx: 3.0, fy: 3.0, ..camera.clone() }, "the focal length of b is 0.03 image widths"),
            (Camera { cx: 0.0, ..camera.clone() }, "the principal point of b is at 0.00 of the width and 0.50"),
            (Camera { fy: 180.0, ..camera.clone() }, "the focal lengths of b differ by a factor of 2.00"),
        ] {
            let found = doubts(other);
            assert!(found.len() == 1 && found[0].starts_with(said), "{found:?}");
        }
    }

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let mut names = ["p10", "p9", "a/p1", "p9b", "q1"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["a/p1", "p9", "p9b", "p10", "q1"]);
    }
}
