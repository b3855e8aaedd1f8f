//! Check of the given cameras against matches between the photographs.

use std::collections::BTreeMap;

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use infonerf_scene::image::{GreyImage, read_rgba, resized_dimensions};
use infonerf_scene::{Camera, Format, SceneError, Space};
use infonerf_sfm::{ImageMatches, Pose, explains, ray, verified_matches};
use rayon::prelude::*;

use super::extent::quantile;
use super::{Capture, StatedExtent, join_names};
use crate::frame::Frame;

/// Max number of photographs that are matched.
const MAX_IMAGES: usize = 48;
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
/// Min number of matches with one other photograph to judge a photograph alone, more than repeated structures give, and the share
/// of explained matches below which its pose, or the poses of a group, are doubted.
const PHOTOGRAPH_MIN_MATCHES: usize = 40;
const PHOTOGRAPH_EXPLAINED: f64 = 0.3;
/// A photograph with fewer than `FOREIGN` matches is doubted if the median photograph has at least `USUAL` ones.
const FOREIGN: usize = 10;
const USUAL: usize = 100;
/// Photographs are joined to a group if more than this share of their matches is explained.
const JOINED: f64 = 0.6;
/// Min share of all matches that are explained within two groups whose poses do not fit each other, and min ratio of the matches
/// between these groups to those within: far views of symmetrical objects have some false matches.
const GROUPED: f64 = 0.25;
const CONTACT: f64 = 0.02;
/// Min sine of the angle between the rays of a match from which a distance is measured: 1°.
const MIN_PARALLAX: f32 = 0.0175;
/// Share of measured points outside near, far and a stated box above which these are doubted.
const OUTSIDE: f64 = 0.8;
/// Plausible principal points divided by the image side (`CENTRAL`), and plausible ratios fy / fx (`SQUARE`).
const CENTRAL: std::ops::RangeInclusive<f64> = 0.25..=0.75;
const SQUARE: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Plausible focal lengths divided by the longer side of the image: fields of view from 5° to 118°.
const FOCAL_LENGTHS: std::ops::RangeInclusive<f64> = 0.3..=11.5;

/// Compares the poses of a capture with its photographs and returns one line per doubt: poses that do not explain matches
/// between photographs, with the convention that explains most of them, or near, far and a box that the matches contradict.
/// Returns a note, too, if some photographs were not compared.
pub(crate) fn compare(capture: &Capture<'_>) -> Result<(Vec<String>, Option<String>), SceneError> {
    let mut frames: Vec<&Frame> = capture.found.train.iter().chain(&capture.found.test).collect();
    frames.retain(|frame| frame.image.is_file());
    frames.sort_by_key(|frame| natural(&frame.name));
    frames.dedup_by(|a, b| a.image == b.image);
    let chosen = spread(frames.len());
    let read: Result<Vec<_>, _> = chosen.par_iter().map(|&i| small(frames[i])).collect();
    let (images, cameras): (Vec<GreyImage>, Vec<Camera>) = read?.into_iter().unzip();
    let focal: Vec<f64> = cameras.iter().map(|camera| (camera.fx * camera.fy).sqrt()).collect();
    let matches = verified_matches(&images, &focal, FEATURES);
    let count: usize = matches.iter().map(|pair| pair.pixels.len()).sum();
    if count < MIN_MATCHES {
        let note = format!("no poses were compared with the photographs: {count} matches between these are too few");
        return Ok((Vec::new(), Some(note)));
    }
    let (compared, total) = (chosen.len(), frames.len());
    let note = (compared < total).then(|| format!("{compared} of {total} photographs were compared with their poses"));
    let all = Matched { frames, chosen, cameras, matches, count, format: capture.found.format };
    let has_box = matches!(&capture.found.extent, StatedExtent::Estimated(known) if known.bounds.is_some());
    Ok((all.doubts(&capture.space, has_box), note))
}

/// Photographs of a capture by name, with the cameras and all `count` matches of the chosen ones.
struct Matched<'a> {
    frames: Vec<&'a Frame>,
    chosen: Vec<usize>,
    cameras: Vec<Camera>,
    matches: Vec<ImageMatches>,
    count: usize,
    format: Format,
}

impl Matched<'_> {
    fn name(&self, chosen: usize) -> &str {
        &self.frames[self.chosen[chosen]].name
    }

    /// Returns the explained matches of each pair, for cameras at `poses` with focal lengths multiplied by `factor`. Other pairs
    /// than those of photograph `only` have none.
    fn explained(&self, poses: &[DMat4], factor: f64, only: Option<usize>) -> Vec<Vec<(DVec2, DVec2)>> {
        let of_pair = |pair: &ImageMatches| {
            let [a, b] = [pair.a, pair.b].map(|i| Pose::of(&poses[i]));
            let longer = f64::from(self.cameras[pair.a].width.max(self.cameras[pair.a].height));
            let tolerance = TOLERANCE * longer / (factor * self.cameras[pair.a].fx);
            let is_explained = |&(in_a, in_b): &(DVec2, DVec2)| {
                let rays = ray(&self.cameras[pair.a], in_a, factor).zip(ray(&self.cameras[pair.b], in_b, factor));
                rays.is_some_and(|rays| explains([&a, &b], rays, tolerance))
            };
            let is_meant = only.is_none_or(|only| pair.a == only || pair.b == only);
            pair.pixels.iter().copied().filter(|pixels| is_meant && is_explained(pixels)).collect()
        };
        self.matches.par_iter().map(of_pair).collect()
    }

    fn share(&self, poses: &[DMat4], factor: f64, only: Option<usize>) -> f64 {
        self.explained(poses, factor, only).iter().map(Vec::len).sum::<usize>() as f64 / self.count as f64
    }

    fn doubts(&self, space: &Space, has_box: bool) -> Vec<String> {
        let poses: Vec<DMat4> = self.cameras.iter().map(|camera| camera.to_world).collect();
        let explained = self.explained(&poses, 1.0, None);
        let share = explained.iter().map(Vec::len).sum::<usize>() as f64 / self.count as f64;
        let (worlds, mut doubts) = self.apart(&explained);
        let better = self.better(&poses, share);
        if better.is_some() || share < EXPLAINED && worlds.is_empty() {
            let advice = better.unwrap_or_else(|| "are they of these photographs, and in this order?".into());
            let (share, count, images) = (percent(share), self.count, self.chosen.len());
            let text = format!("the cameras explain {share} of {count} matches between {images} photographs");
            return vec![format!("{text}: {advice}")];
        }
        if doubts.is_empty() && worlds.is_empty() {
            doubts.extend(self.contradicted_extent(&explained, space, has_box));
        }
        if worlds.is_empty() { doubts } else { worlds }
    }

    /// Returns advice if the cameras explain clearly more matches with another focal length, or all or some of them in another
    /// convention.
    fn better(&self, given: &[DMat4], share: f64) -> Option<String> {
        let is_better = |other: f64| {
            other >= CONVINCING && share < EXPLAINED || other >= MIN_BETTER_SHARE && other >= share + MIN_LEAD
        };
        if !is_better(1.0) {
            return None;
        }
        let mean = self.cameras.iter().map(|c| (c.fx * c.fy).sqrt()).sum::<f64>() / self.cameras.len() as f64;
        let longer = f64::from(self.cameras[0].width.max(self.cameras[0].height));
        let focal_lengths = (0..17).map(|i| 0.5 * 1.12f64.powi(i)).map(|times| {
            let text = format!("with focal lengths of about {times:.2} image widths");
            (self.share(given, times * longer / mean, None), text)
        });
        let (all, names): (Vec<DMat4>, Vec<&str>) = self.frames.iter().map(|f| (f.pose, f.name.as_str())).unzip();
        let chosen = |all: Vec<DMat4>| self.chosen.iter().map(|&i| all[i]).collect::<Vec<_>>();
        let read = conventions(&all, &names, self.format).into_iter();
        let readings: Vec<_> = read.map(|(name, poses)| (name, chosen(poses))).collect();
        let whole = readings.iter().map(|(name, poses)| (self.share(poses, 1.0, None), (*name).into()));
        let best = focal_lengths.chain(whole).max_by(|a, b| a.0.total_cmp(&b.0));
        // Axes and inverse matrices may be those of some cameras only.
        let mixed = readings[..3].iter().map(|(name, poses)| self.mixed(given, poses, name));
        let mixed = mixed.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(share, _)| *share >= MIN_BETTER_SHARE);
        let mixed = mixed.filter(|mixed| best.as_ref().is_none_or(|best| mixed.0 >= best.0 + MIN_LEAD));
        let (share, name) = mixed.or(best).filter(|(share, _)| is_better(*share))?;
        Some(format!("{name} they would explain {}", percent(share)))
    }

    /// Replaces those poses with which more matches are explained by the ones of another convention. Returns the share of
    /// explained matches, and words that name the convention and the cameras.
    fn mixed(&self, given: &[DMat4], other: &[DMat4], convention: &str) -> (f64, String) {
        let mut poses = given.to_vec();
        for i in (0..poses.len()).chain(0..poses.len()) {
            let before = self.share(&poses, 1.0, Some(i));
            let kept = poses[i];
            poses[i] = if kept == given[i] { other[i] } else { given[i] };
            if self.share(&poses, 1.0, Some(i)) <= before {
                poses[i] = kept;
            }
        }
        let changed: Vec<usize> = (0..poses.len()).filter(|&i| poses[i] != given[i]).collect();
        let (count, all, names) = (changed.len(), poses.len(), join_names(changed.iter().map(|&i| self.name(i))));
        (self.share(&poses, 1.0, None), format!("{convention} for {count} of {all} cameras ({names})"))
    }

    /// Joins photographs to groups within which matches are explained, the pair with most explained matches first. Describes
    /// groups whose poses do not fit the largest group, and single photographs that do not, or that have hardly any matches.
    fn apart(&self, explained: &[Vec<(DVec2, DVec2)>]) -> (Vec<String>, Vec<String>) {
        let mut group: Vec<usize> = (0..self.chosen.len()).collect();
        loop {
            let mut weights = BTreeMap::<[usize; 2], f64>::new();
            for (pair, explained) in self.matches.iter().zip(explained) {
                let [a, b] = [group[pair.a], group[pair.b]];
                let weight = explained.len() as f64 - JOINED * pair.pixels.len() as f64;
                *weights.entry([a.min(b), a.max(b)]).or_default() += weight;
            }
            let joined = weights.into_iter().filter(|([a, b], weight)| a != b && *weight > 0.0);
            let Some(([a, b], _)) = joined.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            group.iter_mut().filter(|other| **other == b).for_each(|other| *other = a);
        }
        // Numbers of explained matches and of all matches in the pairs for which `is_meant`.
        let sums = |is_meant: &dyn Fn(usize, usize) -> bool| {
            let meant = self.matches.iter().zip(explained).filter(|(pair, _)| is_meant(pair.a, pair.b));
            meant.fold((0, 0), |(sum, all), (pair, explained)| (sum + explained.len(), all + pair.pixels.len()))
        };
        let mut counts: Vec<usize> = (0..group.len()).map(|i| sums(&|a, b| a == i || b == i).1).collect();
        counts.sort_unstable();
        let is_usual = counts.len() == self.frames.len() && quantile(&counts, 0.5) >= USUAL;
        let members = |of: usize| (0..group.len()).filter(|&i| group[i] == of).collect::<Vec<_>>();
        let names = |of: usize| join_names(members(of).into_iter().map(|i| self.name(i)));
        let first = (0..group.len()).rev().max_by_key(|&i| members(i).len()).unwrap_or(0);
        let (mut worlds, mut single) = (Vec::new(), Vec::new());
        for other in (0..group.len()).filter(|&i| group[i] == i && i != first) {
            let both = |a: usize, b: usize| [a, b].iter().all(|&i| [first, other].contains(&group[i]));
            let (fit, between) = sums(&|a, b| both(a, b) && group[a] != group[b]);
            let (right, within) = sums(&|a, b| both(a, b) && group[a] == group[b]);
            let [share, own] = [fit as f64 / between as f64, right as f64 / within as f64];
            let is_single = members(other).len() == 1;
            let of_other = self.matches.iter().filter(|p| both(p.a, p.b) && (p.a == other || p.b == other));
            let most = of_other.map(|pair| pair.pixels.len()).max().unwrap_or(0);
            let is_world = between as f64 >= CONTACT * within as f64 && right as f64 >= GROUPED * self.count as f64;
            let text = format!("{} of {between} matches", percent(share));
            if is_single && is_usual && between < FOREIGN {
                let text = "has hardly any matches with the other photographs: does it belong to this scene?";
                single.push(format!("{} {text}", names(other)));
            } else if is_single && share < PHOTOGRAPH_EXPLAINED && most >= PHOTOGRAPH_MIN_MATCHES {
                let text = format!("explains {text} with other photographs: is its pose right?");
                single.push(format!("the camera of {} {text}", names(other)));
            } else if !is_single && is_world && share < PHOTOGRAPH_EXPLAINED && between >= MIN_MATCHES {
                let text = format!("they explain {text} between the two groups, {} of those within", percent(own));
                let [first, other] = [first, other].map(names);
                worlds.push(format!("the poses of {first} and of {other} do not fit each other: {text}"));
            }
        }
        (worlds, single)
    }

    /// Describes near, far and a stated box outside which most of the points lie that `explained` matches show.
    fn contradicted_extent(&self, explained: &[Vec<(DVec2, DVec2)>], space: &Space, has_box: bool) -> Option<String> {
        let (mut distances, mut outside) = (Vec::new(), 0);
        for (pair, pixels) in self.matches.iter().zip(explained) {
            let [a, b] = [&self.cameras[pair.a], &self.cameras[pair.b]];
            let apart = (b.position_f64() - a.position_f64()).as_vec3();
            for (in_a, in_b) in pixels {
                let [a, b] = [(a, in_a), (b, in_b)].map(|(camera, p)| camera.ray(p.x as f32, p.y as f32));
                let normal = a.direction.cross(b.direction);
                if normal.length() >= MIN_PARALLAX {
                    let distance = apart.cross(b.direction).dot(normal) / normal.length_squared();
                    let is_within = space.range.along(&a).is_some_and(|(near, far)| (near..=far).contains(&distance));
                    outside += usize::from(!is_within || has_box && !space.bounds.contains(a.at(distance)));
                    distances.push(distance);
                }
            }
        }
        distances.sort_by(f32::total_cmp);
        let share = outside as f64 / distances.len() as f64;
        let [from, to] = [0.1, 0.9].map(|share| quantile(&distances, share));
        let (limits, Space { near, far, .. }) = (if has_box { "the box, near and far" } else { "near and far" }, space);
        let text = format!("of matched points lie outside {limits} ({near:.3} to {far:.3}), {from:.3} to {to:.3} away");
        (distances.len() >= MIN_MATCHES && share > OUTSIDE)
            .then(|| format!("{} {text}: are these and the poses in one unit?", percent(share)))
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
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
    let first = |is_odd: &dyn Fn(&Camera) -> bool| cameras.iter().position(is_odd).map(|i| (names[i], &cameras[i]));
    let over_longer = |c: &Camera| (c.fx * c.fy).sqrt() / f64::from(c.width.max(c.height));
    let focal = first(&|c| c.lens.is_perspective() && !FOCAL_LENGTHS.contains(&over_longer(c))).map(|(name, c)| {
        let doubt = "image widths: is it in pixels, and for images of this size?";
        format!("the focal length of {name} is {:.2} {doubt}", over_longer(c))
    });
    let middle = |c: &Camera| [c.cx / f64::from(c.width), c.cy / f64::from(c.height)];
    let centre = first(&|c| !middle(c).iter().all(|share| CENTRAL.contains(share))).map(|(name, c)| {
        let [x, y] = middle(c);
        let place = format!("is at {x:.2} of the width and {y:.2} of the height");
        format!("the principal point of {name} {place}: is it for images of this size?")
    });
    let ratio = first(&|c| !SQUARE.contains(&(c.fy / c.fx))).map(|(name, c)| {
        format!("the focal lengths of {name} differ by a factor of {:.2}: are its pixels not square?", c.fy / c.fx)
    });
    [focal, centre, ratio].into_iter().flatten().collect()
}

/// Returns the given matrices read in the conventions of other programs, each with the words that name the convention in a
/// file of `format`.
fn conventions(given: &[DMat4], names: &[&str], format: Format) -> Vec<(&'static str, Vec<DMat4>)> {
    let [flip, mirror] = [-1.0, 1.0].map(|y| DMat4::from_scale(DVec3::new(1.0, y, -1.0)));
    let (mut axes, mut inverse) = ("with OpenCV's axes (y down, z forward)", "as world-to-camera matrices");
    let mut inverse_flipped = "as world-to-camera matrices with OpenCV's axes";
    let mut quarter = ["with cameras rolled by 270°", "with OpenCV's axes and cameras rolled by 270°"];
    match format {
        Format::Colmap | Format::Dtu | Format::Zju => {
            (axes, inverse_flipped) = ("with OpenGL's axes (y up, z backward)", "as camera-to-world matrices");
            inverse = "as camera-to-world matrices with OpenGL's axes";
        }
        Format::Llff => {
            quarter = ["with the columns right, up, backward", "with the columns right, down, forward"];
            axes = "with the columns up, right, forward";
        }
        _ => {}
    }
    let turn = |pose: &DMat4| DMat3::from_mat4(*pose);
    let each = |change: &dyn Fn(&DMat4) -> DMat4| given.iter().map(change).collect::<Vec<_>>();
    let rolled = |degrees: f64| each(&|pose| *pose * DMat4::from_rotation_z(degrees.to_radians()));
    let transposed = |pose: &DMat4| DMat4 { w_axis: pose.w_axis, ..DMat4::from_mat3(turn(pose).transpose()) };
    let moved = |pose: &DMat4| DMat4 { w_axis: (-(turn(pose) * pose.w_axis.truncate())).extend(1.0), ..*pose };
    let shifted = |by: usize| (0..given.len()).map(|i| given[(i + by) % given.len()]).collect();
    let mut all = vec![
        (axes, each(&|pose| *pose * flip)),
        (inverse, each(&|pose| pose.inverse())),
        (inverse_flipped, each(&|pose| pose.inverse() * flip)),
        ("with transposed rotations", each(&transposed)),
        ("with transposed rotations and OpenCV's axes", each(&|pose| transposed(pose) * flip)),
        ("with the translations taken as those of world-to-camera matrices", each(&moved)),
        ("each with the pose of the next photograph", shifted(1)),
        ("each with the pose of the photograph before", shifted(given.len() - 1)),
        ("in the opposite order", given.iter().rev().copied().collect()),
        ("with cameras rolled by 90°", rolled(90.0)),
        ("with cameras rolled by 180°", rolled(180.0)),
        (quarter[0], rolled(270.0)),
        (quarter[1], each(&|pose| *pose * DMat4::from_rotation_z(270f64.to_radians()) * flip)),
        ("as matrices of a left-handed world (z reversed)", each(&|pose| mirror * *pose * mirror)),
        ("as matrices of a left-handed world (y reversed)", each(&|pose| mirror * *pose * mirror * flip)),
    ];
    if format == Format::Colmap {
        let reordered = |pose: &DMat4| {
            let file = (*pose * flip).inverse();
            let q = DQuat::from_mat4(&file);
            let rotation = DMat4::from_quat(DQuat::from_xyzw(q.w, q.x, q.y, q.z));
            DMat4 { w_axis: file.w_axis, ..rotation }.inverse() * flip
        };
        all.push(("with quaternions in the order x, y, z, w", each(&reordered)));
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaders::testing::{photographs_of, request};
    use infonerf_scene::Aabb;

    /// Pose and focal length that a capture states for a camera of a list.
    type Stated<'a> = &'a dyn Fn(usize, &[Camera]) -> (DMat4, f64);

    fn table() -> Vec<Camera> {
        infonerf_procedural::photographs("table", 160, 40)[..12].to_vec()
    }

    fn stated(given: Stated<'_>) -> Vec<Camera> {
        let camera = |i: usize| {
            let (pose, focal) = given(i, &table());
            Camera { fx: focal, fy: focal, ..table()[i].with_pose(pose) }
        };
        (0..12).map(camera).collect()
    }

    /// Returns the doubts about twelve photographs of sixty points; no matches of photograph `unmatched` are known.
    fn doubts(given: Stated<'_>, format: Format, unmatched: usize) -> Vec<String> {
        let (exact, cameras) = (table(), stated(given));
        let frame = |(i, camera): (usize, &Camera)| Frame::new(&format!("p{i}"), format!("p{i}.png").into(), camera);
        let frames: Vec<Frame> = cameras.iter().enumerate().map(frame).collect();
        let seen = |camera: usize, i: u8| {
            let point = [0.7, 1.3, 2.9].map(|times| (times * f32::from(i)).sin());
            exact[camera].project(point.into()).map(|pixel| pixel.as_dvec2())
        };
        let pixels = |a, b| (0..60).filter_map(|i| seen(a, i).zip(seen(b, i))).collect();
        let pairs = (0..12).flat_map(|b| (0..b).map(move |a| (a, b))).filter(|(a, b)| ![*a, *b].contains(&unmatched));
        let matches: Vec<ImageMatches> = pairs.map(|(a, b)| ImageMatches { a, b, pixels: pixels(a, b) }).collect();
        let count = matches.iter().map(|pair| pair.pixels.len()).sum();
        let (frames, chosen) = (frames.iter().collect(), (0..12).collect());
        let space = Space::known(&exact, (0.5, 20.0), Aabb::cube(glam::Vec3::ZERO, 1.0));
        Matched { frames, chosen, cameras, matches, count, format }.doubts(&space, false)
    }

    #[test]
    fn conventions_and_the_order_of_poses_are_named() {
        let [flip, mirror] = [-1.0, 1.0].map(|y| DMat4::from_scale(DVec3::new(1.0, y, -1.0)));
        let quarter = DMat4::from_rotation_z(90f64.to_radians());
        let moved = DMat4::from_rotation_translation(DQuat::from_rotation_x(0.5), DVec3::new(0.5, 1.0, 2.0));
        let transposed =
            |pose: &DMat4| DMat4 { w_axis: pose.w_axis, ..DMat4::from_mat3(DMat3::from_mat4(*pose).transpose()) };
        let reordered = |pose: &DMat4| {
            let (file, q) = ((*pose * flip).inverse(), DQuat::from_mat4(&(*pose * flip).inverse()));
            let rotation = DMat4::from_quat(DQuat::from_xyzw(q.y, q.z, q.w, q.x));
            DMat4 { w_axis: file.w_axis, ..rotation }.inverse() * flip
        };
        let order = [0, 1, 10, 11, 2, 3, 4, 5, 6, 7, 8, 9];
        let mixed = "with OpenCV's axes (y down, z forward) for 6 of 12 cameras (p0, p2, p4, p6, p8, …) they would";
        let worlds = "the poses of p5, p6, p7, p8, p9, … and of p0, p1, p2, p3, p4 do not fit each other: they explain";
        let (json, blender, colmap, llff) = (Format::Transforms, Format::Blender, Format::Colmap, Format::Llff);
        /// Stated pose of a camera of a list, the format, and a part of the doubt.
        type Case<'a> = (&'a dyn Fn(usize, &[DMat4]) -> DMat4, Format, &'a str);
        let cases: [Case<'_>; 18] = [
            (&|i, all| all[i] * flip, json, "with OpenCV's axes (y down, z forward) they"),
            (&|i, all| all[i].inverse(), json, "as world-to-camera matrices they"),
            (&|i, all| all[i] * quarter, json, "with cameras rolled by 270° they"),
            (&|i, all| transposed(&all[i]), json, "with transposed rotations they"),
            (&|i, all| mirror * all[i] * mirror, blender, "as matrices of a left-handed world (z reversed) they"),
            (&|i, all| mirror * all[i] * mirror * flip, blender, "left-handed world (y reversed) they"),
            (&|i, all| all[i] * flip, colmap, "with OpenGL's axes (y up, z backward) they"),
            (&|i, all| flip * all[i].inverse() * flip, colmap, "as camera-to-world matrices they"),
            (&|i, all| all[i].inverse(), Format::Dtu, "as camera-to-world matrices with OpenGL's axes they"),
            (&|i, all| reordered(&all[i]), colmap, "with quaternions in the order x, y, z, w they"),
            (&|i, all| all[i] * quarter, llff, "with the columns right, up, backward they"),
            (&|i, all| all[i] * flip * quarter, llff, "with the columns right, down, forward they"),
            (&|i, all| all[order[i]], json, "in the order of"),
            (&|i, all| all[(i + 1) % 12], json, "each with the pose of the photograph before"),
            (&|i, all| all[11 - i], json, "in the opposite order"),
            (&|i, all| if i % 2 == 0 { all[i] * flip } else { all[i] }, json, mixed),
            (&|i, all| if i > 4 { moved * all[i] } else { all[i] }, json, worlds),
            (
                &|i, all| DMat4 { w_axis: (30.0 * all[i].w_axis.truncate()).extend(1.0), ..all[i] },
                json,
                "lie outside near and far (0.500 to 20",
            ),
        ];
        for (change, format, said) in cases {
            let poses = |all: &[Camera]| all.iter().map(|camera| camera.to_world).collect::<Vec<_>>();
            let found = doubts(&|i, all| (change(i, &poses(all)), all[i].fx), format, 12);
            assert!(found.len() == 1 && found[0].contains(said), "{said}: {found:?}");
        }
    }

    /// Turns the camera of photograph 3 away, and gives photograph 8 the pose of photograph 5; photograph 2 is of another scene.
    #[test]
    fn photographs_that_do_not_fit_are_named() {
        let away = DMat4::from_rotation_y(std::f64::consts::PI);
        let wrong = |i: usize, all: &[Camera]| match i {
            3 => (all[3].to_world * away, all[3].fx),
            8 => (all[5].to_world, all[8].fx),
            _ => (all[i].to_world, all[i].fx),
        };
        let found = doubts(&wrong, Format::Transforms, 2);
        let starts = ["p2 has hardly any matches", "the camera of p3 explains", "the camera of p8 explains"];
        assert!(
            found.iter().zip(starts).all(|(doubt, start)| doubt.starts_with(start)) && found.len() == 3,
            "{found:?}"
        );
        assert_eq!(doubts(&|i, all| (all[i].to_world, all[i].fx), Format::Transforms, 12), [""; 0]);
    }

    #[test]
    fn photographs_of_a_built_in_scene_are_compared() {
        for (times, said) in
            [(1.0, None), (0.7, Some("with focal lengths of about 1.39 image widths they would explain"))]
        {
            let given = stated(&|i, all| (all[i].to_world, times * all[i].fx));
            let guard = photographs_of("table", &table(), &given, |i| format!("images/p{i}.png"));
            let capture = crate::loaders::read(guard.path(), &request()).unwrap().prepared().unwrap();
            let (found, note) = compare(&capture).unwrap();
            assert!(note.is_none() && found.len() == said.iter().len(), "{found:?}");
            assert!(found.iter().zip(said).all(|(doubt, said)| doubt.contains(said)), "{found:?}");
        }
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
