//! Check of the given cameras against matches between the photographs.

mod alternatives;
mod extent;
mod groups;

use glam::{DMat4, DVec2};
use infonerf_scene::image::{GreyImage, read_rgba, resized_dimensions};
use infonerf_scene::{Camera, Format, SceneError, Space};
use infonerf_sfm::{ImageMatches, Pose, explains, ray, verified_matches};
use rayon::prelude::*;

use self::alternatives::{conventions, intrinsics};
use self::groups::Misfits;
use super::sizes::long_side;
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

/// Compares the poses of a capture with its photographs and returns one line per doubt: poses that do not explain matches
/// between photographs, with the convention that explains most of them, or near, far and a box that the matches contradict.
/// Returns a note, too, if some photographs were not compared.
pub(crate) fn compare(capture: &Capture<'_>) -> Result<(Vec<String>, Option<String>), SceneError> {
    let mut frames: Vec<&Frame> = capture.found.train.iter().chain(&capture.found.test).collect();
    frames.retain(|frame| frame.image.is_file());
    // Numbers at the ends of names count by their value.
    frames.sort_by_key(|frame| (frame.name.len(), &frame.name));
    frames.dedup_by(|a, b| a.image == b.image);
    let chosen = spread(frames.len());
    let read: Result<Vec<_>, _> = chosen.par_iter().map(|&i| small(frames[i])).collect();
    let (images, cameras): (Vec<GreyImage>, Vec<Camera>) = read?.into_iter().unzip();
    let focal: Vec<f64> = cameras.iter().map(|camera| (camera.fx * camera.fy).sqrt()).collect();
    let matches = verified_matches(&images, &focal, FEATURES);
    let count: usize = matches.iter().map(|pair| pair.pixels.len()).sum();
    if count < MIN_MATCHES {
        let note = format!("too few matches between the photographs for a comparison with their poses: {count}");
        return Ok((Vec::new(), Some(note)));
    }
    let (compared, total) = (chosen.len(), frames.len());
    let note = (compared < total).then(|| format!("{compared} of {total} photographs were compared with their poses"));
    let all = Matched { frames, chosen, cameras, matches, count, format: capture.found.format };
    Ok((all.doubts(&capture.space, &capture.found.extent), note))
}

/// Positions of points in both photographs of a pair.
type Pixels = Vec<(DVec2, DVec2)>;

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

    /// Returns the matches of each pair that `cameras` explain. Other pairs than those of photograph `only` have none.
    fn explained(&self, cameras: &[Camera], only: Option<usize>) -> Vec<Pixels> {
        let of_pair = |pair: &ImageMatches| {
            let [a, b] = [&cameras[pair.a], &cameras[pair.b]];
            let poses = [a, b].map(|camera| Pose::of(&camera.to_world));
            let tolerance = TOLERANCE * long_side(a) / a.fx;
            let is_explained = |&(in_a, in_b): &(DVec2, DVec2)| {
                ray(a, in_a).zip(ray(b, in_b)).is_some_and(|rays| explains(poses.each_ref(), rays, tolerance))
            };
            let is_meant = only.is_none_or(|only| [pair.a, pair.b].contains(&only));
            pair.pixels.iter().copied().filter(|pixels| is_meant && is_explained(pixels)).collect()
        };
        self.matches.par_iter().map(of_pair).collect()
    }

    fn share(&self, cameras: &[Camera], only: Option<usize>) -> f64 {
        self.explained(cameras, only).iter().map(Vec::len).sum::<usize>() as f64 / self.count as f64
    }

    fn doubts(&self, space: &Space, stated: &StatedExtent) -> Vec<String> {
        let explained = self.explained(&self.cameras, None);
        let share = explained.iter().map(Vec::len).sum::<usize>() as f64 / self.count as f64;
        let Misfits { groups, photographs } = self.misfits(&explained);
        let better = self.better(share);
        if better.is_some() || share < EXPLAINED && groups.is_empty() {
            let advice = better.unwrap_or_else(|| "are they of these photographs, and in this order?".into());
            let (share, count, images) = (percent(share), self.count, self.chosen.len());
            let text = format!("the cameras explain {share} of {count} matches between {images} photographs");
            return vec![format!("{text}: {advice}")];
        }
        if !groups.is_empty() {
            return groups;
        }
        if !photographs.is_empty() {
            return photographs;
        }
        Vec::from_iter(self.contradicted_extent(&explained, space, stated))
    }

    /// Returns advice if cameras with other intrinsics, or all or some in another convention, explain clearly more matches.
    fn better(&self, share: f64) -> Option<String> {
        let is_better = |other: f64| {
            other >= CONVINCING && share < EXPLAINED || other >= MIN_BETTER_SHARE && other >= share + MIN_LEAD
        };
        if !is_better(1.0) {
            return None;
        }
        let (all, names): (Vec<DMat4>, Vec<&str>) = self.frames.iter().map(|f| (f.pose, f.name.as_str())).unzip();
        let posed = |(name, poses): (&'static str, Vec<DMat4>)| {
            let camera = |(camera, &i): (&Camera, &usize)| camera.with_pose(poses[i]);
            (name.to_owned(), self.cameras.iter().zip(&self.chosen).map(camera).collect())
        };
        let read: Vec<(String, Vec<Camera>)> = conventions(&all, &names, self.format).into_iter().map(posed).collect();
        // Axes and inverse matrices may be those of some cameras only.
        let mixed = read[..3].iter().map(|(name, cameras)| self.mixed(cameras, name));
        let mixed = mixed.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(share, _)| *share >= MIN_BETTER_SHARE);
        let whole = intrinsics(&self.cameras).into_iter().chain(read);
        let best = whole.map(|(name, cameras)| (self.share(&cameras, None), name)).max_by(|a, b| a.0.total_cmp(&b.0));
        let mixed = mixed.filter(|mixed| best.as_ref().is_none_or(|best| mixed.0 >= best.0 + MIN_LEAD));
        let (share, name) = mixed.or(best).filter(|(share, _)| is_better(*share))?;
        Some(format!("{name} they would explain {}", percent(share)))
    }

    /// Replaces those cameras with which more matches are explained by the ones of another convention. Returns the share of
    /// explained matches, and words that name the convention and the cameras.
    fn mixed(&self, other: &[Camera], convention: &str) -> (f64, String) {
        let mut cameras = self.cameras.clone();
        for i in (0..cameras.len()).chain(0..cameras.len()) {
            let before = self.share(&cameras, Some(i));
            let changed = if cameras[i] == other[i] { &self.cameras[i] } else { &other[i] };
            let kept = std::mem::replace(&mut cameras[i], changed.clone());
            if self.share(&cameras, Some(i)) <= before {
                cameras[i] = kept;
            }
        }
        let changed: Vec<usize> = (0..cameras.len()).filter(|&i| cameras[i] != self.cameras[i]).collect();
        let (count, all, names) = (changed.len(), cameras.len(), join_names(changed.iter().map(|&i| self.name(i))));
        (self.share(&cameras, None), format!("{convention} for {count} of {all} cameras ({names})"))
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Estimate;
    use crate::loaders::testing::{photographs_of, request};
    use glam::{DMat3, DQuat, DVec3};
    use infonerf_scene::{Aabb, Lens};

    fn table() -> Vec<Camera> {
        infonerf_procedural::photographs("table", 160, 40)[..12].to_vec()
    }

    /// Returns the doubts about photographs of sixty points that `taken` took; no matches of photograph `unmatched` are known.
    fn doubts(
        taken: &[Camera],
        given: &[Camera],
        (format, unmatched): (Format, usize),
        (far, stated): (f32, StatedExtent),
    ) -> Vec<String> {
        let frame = |(i, camera): (usize, &Camera)| Frame::new(&format!("p{i}"), format!("p{i}.png").into(), camera);
        let frames: Vec<Frame> = given.iter().enumerate().map(frame).collect();
        let seen = |camera: usize, i: u8| {
            let point = [0.7, 1.3, 2.9].map(|times| (times * f32::from(i)).sin());
            taken[camera].project(point.into()).map(|pixel| pixel.as_dvec2())
        };
        let pixels = |a, b| (0..60).filter_map(|i| seen(a, i).zip(seen(b, i))).collect();
        let pairs = (0..12).flat_map(|b| (0..b).map(move |a| (a, b))).filter(|(a, b)| ![*a, *b].contains(&unmatched));
        let matches: Vec<ImageMatches> = pairs.map(|(a, b)| ImageMatches { a, b, pixels: pixels(a, b) }).collect();
        let count = matches.iter().map(|pair| pair.pixels.len()).sum();
        let (frames, chosen, cameras) = (frames.iter().collect(), (0..12).collect(), given.to_vec());
        let bounds = if let StatedExtent::Estimated(Estimate { bounds, .. }) = &stated { *bounds } else { None };
        let space = Space::known(taken, (0.5, far), Aabb::cube(glam::Vec3::ZERO, 1.0)).with(None, bounds);
        Matched { frames, chosen, cameras, matches, count, format }.doubts(&space, &stated)
    }

    /// Returns an extent of which nothing is stated, with a far end of 20.
    fn unstated() -> (f32, StatedExtent) {
        (20.0, StatedExtent::Estimated(Estimate::default()))
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
            let all = table();
            let poses: Vec<DMat4> = all.iter().map(|camera| camera.to_world).collect();
            let given: Vec<Camera> = (0..12).map(|i| all[i].with_pose(change(i, &poses))).collect();
            let found = doubts(&all, &given, (format, 12), unstated());
            assert!(found.len() == 1 && found[0].contains(said), "{said}: {found:?}");
        }
    }

    /// Turns the camera of photograph 3 away, and gives photograph 8 the pose of photograph 5; photograph 2 is of another scene.
    #[test]
    fn photographs_that_do_not_fit_are_named() {
        let mut given = table();
        given[3].to_world *= DMat4::from_rotation_y(std::f64::consts::PI);
        given[8].to_world = given[5].to_world;
        let found = doubts(&table(), &given, (Format::Transforms, 2), unstated());
        let starts = ["p2 has hardly any matches", "the camera of p3 explains", "the camera of p8 explains"];
        assert!(
            found.iter().zip(starts).all(|(doubt, start)| doubt.starts_with(start)) && found.len() == 3,
            "{found:?}"
        );
        assert_eq!(doubts(&table(), &table(), (Format::Transforms, 12), unstated()), [""; 0]);
    }

    /// Gives cameras other intrinsics than those that took the photographs.
    #[test]
    fn wrong_principal_points_and_lenses_are_named() {
        let with = |lens: Lens| table().iter().map(|camera| camera.with_lens(lens)).collect::<Vec<_>>();
        let bent = |k1: f64| with(Lens::radial_tangential([k1, 0.0, 0.0, 0.0], [0.0; 2]));
        let off = table().into_iter().map(|camera| Camera { cx: 0.0, cy: 0.0, ..camera }).collect();
        for (taken, given, said) in [
            (table(), off, "with the principal point in the middle they"),
            (table(), bent(2.0), "without lens distortion they"),
            (bent(-0.8), bent(0.8), "with lens coefficients of the other sign they"),
            (with(Lens::fisheye([0.0; 4])), bent(-3.0), "as fisheyes they"),
        ] {
            let found = doubts(&taken, &given, (Format::Transforms, 12), unstated());
            assert!(found.len() == 1 && found[0].contains(said), "{said}: {found:?}");
        }
    }

    #[test]
    fn a_stated_extent_without_the_matched_points_is_doubted() {
        let bounds = |middle: f32| {
            let bounds = Some(Aabb::cube(glam::Vec3::splat(middle), 1.0));
            StatedExtent::Estimated(Estimate { bounds, ..Estimate::default() })
        };
        let depths = |far| (far, StatedExtent::Depths(0.5, far));
        for (stated, said) in [
            (depths(20.0), None),
            ((20.0, bounds(0.0)), None),
            (
                (20.0, bounds(9.0)),
                Some("100 % of matched points lie outside the box, near and far (0.500 to 20.000), "),
            ),
            ((4.0, bounds(0.0)), None),
            (depths(4.0), Some("% of matched points lie outside near and far (0.500 to 4.000), ")),
            (depths(200.0), Some("far (200.000) is more than 20 times as far away as 99 % of the matched points")),
        ] {
            let found = doubts(&table(), &table(), (Format::Llff, 12), stated);
            let is_said = found.iter().zip(said).all(|(doubt, said)| doubt.contains(said));
            assert!(found.len() == said.iter().len() && is_said, "{said:?}: {found:?}");
        }
    }

    #[test]
    fn photographs_that_were_not_compared_are_counted() {
        for (size, count, said) in [
            (64, 49, "48 of 49 photographs were compared with their poses"),
            (8, 2, "too few matches between the photographs for a comparison with their poses: 0"),
        ] {
            let cameras = vec![infonerf_procedural::photographs("table", size, 1).remove(0); count];
            let guard = photographs_of("table", &cameras, &cameras, |i| format!("images/p{i}.png"));
            let capture = crate::loaders::read(guard.path(), &request()).unwrap().prepared().unwrap();
            assert_eq!(compare(&capture).unwrap().1.as_deref(), Some(said));
        }
    }

    #[test]
    fn photographs_of_a_built_in_scene_are_compared() {
        for (times, said) in
            [(1.0, None), (0.7, Some("with focal lengths of about 1.39 image widths they would explain"))]
        {
            let scaled = |c: &Camera| Camera { fx: times * c.fx, fy: times * c.fy, ..c.clone() };
            let given: Vec<Camera> = table().iter().map(scaled).collect();
            let guard = photographs_of("table", &table(), &given, |i| format!("images/p{i}.png"));
            let capture = crate::loaders::read(guard.path(), &request()).unwrap().prepared().unwrap();
            let (found, note) = compare(&capture).unwrap();
            assert!(note.is_none() && found.len() == said.iter().len(), "{found:?}");
            assert!(found.iter().zip(said).all(|(doubt, said)| doubt.contains(said)), "{found:?}");
        }
    }
}
