//! Poses of photographs, found by `infonerf-sfm`.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{DVec2, Vec2Swizzles};
use infonerf_scene::image::{GreyImage, dimensions, focal_length, orientation, quarter_turns, read_rgba, resized_mask};
use infonerf_scene::{Camera, SceneError, resized_dimensions};
use infonerf_sfm::{NoReconstruction, Photograph, Point, SparseModel, reconstruct};
use rayon::prelude::*;

use super::{MIN_IMAGES, OVERLAPPING};
use crate::capture::{list_photographs, mask_of, read_mask};
use crate::colmap::{ColmapCamera, ColmapImage, Reconstruction, opengl};
use crate::files::{file_name, write_file};

/// Longest side, in pixels, of the images in which features are looked for.
const MAX_SIDE: u32 = 1600;
/// Number of photographs that are decoded at the same time; each of twelve million pixels takes 350 MB.
const AT_ONCE: usize = 4;
/// File next to a reconstruction that this module made, whose cameras fit photographs that EXIF data mirror as they are shown.
pub(crate) const MARK: &str = "infonerf.txt";
/// COLMAP's number of the lens model SIMPLE_RADIAL.
const SIMPLE_RADIAL: usize = 2;

/// Poses of photographs, and how many have none.
pub(super) struct OwnPoses {
    /// Placed photographs, their lens and the points they see.
    pub model: Reconstruction,
    /// Colours of the points; point number `n` has index `n - 1`.
    colours: Vec<[u8; 3]>,
    /// Number of photographs without a pose.
    pub left_out: usize,
}

impl OwnPoses {
    /// Writes the reconstruction to `sparse/0`.
    pub(super) fn write(&self, sparse: &Path) -> Result<(), SceneError> {
        let place = sparse.join("0");
        let written = self.model.write(&place, |id| self.colours[id as usize - 1]);
        let text =
            "Found by infonerf. Cameras of photographs that EXIF data mirror are for the photographs as shown.\n";
        let marked = written.and_then(|()| write_file(&place.join(MARK), text));
        marked.inspect_err(|_| drop(fs::remove_dir_all(sparse)))
    }
}

/// Error of finding poses.
#[derive(Debug)]
pub(super) struct PosesNotFound {
    pub(super) error: SceneError,
    /// Whether too few photographs overlap for this program, of which another may place more.
    pub(super) too_few_overlap: bool,
}

impl From<SceneError> for PosesNotFound {
    fn from(error: SceneError) -> Self {
        Self { error, too_few_overlap: false }
    }
}

/// Finds the poses of the photographs in `images`, which is `dir` or a folder in it. `progress` receives a line for
/// each step, and the reason for each photograph without a pose.
///
/// All photographs share one lens: images of different sizes are resized to one longest side, the median, and those below
/// half of it are left out. Features are used in opaque pixels within the masks.
pub(super) fn find(
    dir: &Path,
    images: &Path,
    focal: Option<f64>,
    mut progress: impl FnMut(&str),
) -> Result<OwnPoses, PosesNotFound> {
    let all = list_photographs(images)?;
    progress(&format!("finding the poses of {} photographs", all.len()));
    let sides = all.iter().map(|path| dimensions(path).map(|(w, h)| w.max(h))).collect::<Result<Vec<u32>, _>>()?;
    let mut sorted = sides.clone();
    sorted.sort_unstable();
    let longest = sorted.get(sorted.len().saturating_sub(1) / 2).map_or(MAX_SIDE, |median| MAX_SIDE.min(*median));
    let (kept, small): (Vec<_>, Vec<_>) =
        all.into_iter().zip(sides).partition(|(_, side)| *side >= longest.div_ceil(2));
    for (path, side) in &small {
        let reason = format!("its longest side of {side} pixels is below half of the usual {longest}");
        progress(&format!("{}: not placed: {reason}", file_name(path)));
    }
    let paths: Vec<PathBuf> = kept.into_iter().map(|(path, _)| path).collect();
    let mut photographs = Vec::new();
    for some in paths.chunks(AT_ONCE) {
        let read: Result<Vec<_>, _> = some.par_iter().map(|path| SmallPhotograph::read(dir, path, longest)).collect();
        photographs.extend(read?);
    }
    let fault = |reason: String, too_few_overlap: bool| {
        let error = SceneError::malformed(images, OVERLAPPING, reason);
        PosesNotFound { error, too_few_overlap }
    };
    let masked = photographs.iter().filter(|photograph| photograph.mask.is_some()).count();
    if masked > 0 {
        progress(&format!("features count within masks: {masked} of {} photographs", photographs.len()));
    }
    let input: Vec<Photograph> = photographs.iter().map(SmallPhotograph::photograph).collect();
    let found = reconstruct(&input, focal, &mut progress)
        .map_err(|why| fault(format!("{why}{}", cause(&photographs)), why != NoReconstruction::NoDepth))?;
    let mut lost = Vec::new();
    for (i, (path, pose)) in paths.iter().zip(&found.poses).enumerate() {
        let Err(reason) = pose else { continue };
        let line = format!("{}: not placed: {reason}{}", file_name(path), cause(&photographs[i..=i]));
        progress(&line);
        lost.push(line);
    }
    if paths.len() - lost.len() < MIN_IMAGES {
        return Err(fault(lost.swap_remove(0), true));
    }
    let colour = |point: &Point| {
        let (by, pixel) = point.seen[0];
        photographs[by].colour(pixel - (found.lens.centre - photographs[by].middle()))
    };
    let colours = found.points.iter().map(colour).collect();
    let model = in_stored_pixels(&found, &paths, &photographs)?;
    Ok(OwnPoses { model, colours, left_out: lost.len() + small.len() })
}

/// Converts the poses and points of the reduced, upright `photographs` at `paths` to a reconstruction of their stored pixels, in
/// which photographs of one size share a camera.
fn in_stored_pixels(
    found: &SparseModel,
    paths: &[PathBuf],
    photographs: &[SmallPhotograph],
) -> Result<Reconstruction, SceneError> {
    let points = (1u64..).zip(found.points.iter().map(|point| point.position)).collect();
    let mut all = Reconstruction { cameras: BTreeMap::new(), images: Vec::new(), points };
    for (i, (path, photograph)) in paths.iter().zip(photographs).enumerate() {
        let Ok(pose) = &found.poses[i] else { continue };
        let reduced = f64::from(photograph.size.0) / photograph.width as f64;
        let margin = found.lens.centre - photograph.middle();
        let centre = [photograph.size.0, photograph.size.1].map(|side| f64::from(side) / 2.0);
        let focal = found.lens.focal * reduced;
        let pose = opengl(pose.rotation.transpose(), pose.centre());
        let stored = Camera::pinhole(photograph.size, [focal; 2], centre, pose).turned(photograph.turned_back);
        let lens = vec![focal, stored.cx, stored.cy, found.lens.k1];
        let camera = ColmapCamera::new(path, "camera", SIMPLE_RADIAL, (stored.width, stored.height), lens)?;
        let known = all.cameras.iter().find(|(_, known)| **known == camera).map(|(id, _)| *id);
        let id = known.unwrap_or(all.cameras.len() as u32 + 1);
        all.cameras.insert(id, camera);
        let observations = (1u64..).zip(&found.points).flat_map(|(point_id, point)| {
            let seen = point.seen.iter().filter(|(by, _)| *by == i);
            seen.map(move |(_, pixel)| (photograph.stored((*pixel - margin) * reduced), point_id))
        });
        let (name, observations) = (file_name(path), observations.collect());
        all.images.push(ColmapImage { id: i as u32 + 1, name, camera: id, pose: stored.to_world, observations });
    }
    Ok(all)
}

/// Returns the cause of missing poses if less than a twentieth of each photograph counts; otherwise an empty text.
fn cause(photographs: &[SmallPhotograph]) -> &'static str {
    let is_covered = |mask: &Vec<bool>| 20 * mask.iter().filter(|&&counts| counts).count() < mask.len();
    let are_covered = photographs.iter().all(|photograph| photograph.mask.as_ref().is_some_and(is_covered));
    if are_covered { "; masks or transparency cover nearly all pixels" } else { "" }
}

struct SmallPhotograph {
    width: usize,
    height: usize,
    rgb: Vec<[u8; 3]>,
    /// Whether each pixel is opaque and within the mask; `None` if all are.
    mask: Option<Vec<bool>>,
    size: (u32, u32),
    /// Number of clockwise quarter turns from the upright photograph to its stored pixels.
    turned_back: u8,
    /// Focal length divided by the longer side, if EXIF data state it.
    focal: Option<f64>,
}

impl SmallPhotograph {
    /// Reads a photograph of the capture in `dir` and reduces its longest side to `longest`.
    fn read(dir: &Path, path: &Path, longest: u32) -> Result<Self, SceneError> {
        let image = read_rgba(path)?;
        let size = (image.width, image.height);
        let focal = File::open(path).ok().and_then(|file| focal_length(&mut BufReader::new(file), size));
        let (width, height) = resized_dimensions(size.0, size.1, longest);
        let mut counts: Vec<bool> = image.pixels.iter().map(|[.., opacity]| *opacity >= 0.5).collect();
        if let Some(mask) = mask_of(dir, path) {
            // Reconstructions refer to stored pixels.
            let masked = read_mask(path, &mask, size, true)?;
            counts.iter_mut().zip(masked).for_each(|(counts, masked)| *counts &= masked);
        }
        let mask = counts.contains(&false).then(|| resized_mask(&counts, size, (width, height)));
        let rgb = image.composite([1.0; 3]).resized(width, height).to_rgb8().as_chunks().0.to_vec();
        let turned_back = (4 - quarter_turns(orientation(path)).unwrap_or(0)) % 4;
        Ok(Self { width: width as usize, height: height as usize, rgb, mask, size, turned_back, focal })
    }

    /// Converts a pixel of the upright photograph to a stored one.
    fn stored(&self, pixel: DVec2) -> DVec2 {
        let size = DVec2::new(f64::from(self.size.0), f64::from(self.size.1));
        let turned = |(pixel, size): (DVec2, DVec2), _| (DVec2::new(size.y - pixel.y, pixel.x), size.yx());
        (0..self.turned_back).fold((pixel, size), turned).0
    }

    fn middle(&self) -> DVec2 {
        0.5 * DVec2::new(self.width as f64, self.height as f64)
    }

    fn photograph(&self) -> Photograph {
        let rgb = self.rgb.iter().map(|colour| colour.map(|value| f32::from(value) / 255.0));
        Photograph { image: GreyImage::luma(self.width, self.height, rgb), mask: self.mask.clone(), focal: self.focal }
    }

    fn colour(&self, pixel: DVec2) -> [u8; 3] {
        let at = |v: f64, size: usize| (v as usize).min(size - 1);
        self.rgb[at(pixel.y, self.height) * self.width + at(pixel.x, self.width)]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use infonerf_scene::image::list_images;
    use infonerf_scene::{PoseError, Rgba8, SceneRequest, Similarity, TestProtocol, ViewSelection};

    use super::super::{colmap, program};
    use super::*;
    use crate::loaders::testing::{load, request, set_orientation, shared_data, write_mask};
    use crate::source::SceneSource;

    /// Returns mean errors of cameras after [`Similarity::between`] has aligned them: of rotations in degrees, and of
    /// positions in percent of the mean distance between cameras.
    fn errors(found: &[Camera], truth: &[Camera], centre: DVec3) -> (f64, f64) {
        let similarity = Similarity::between(truth, found, centre).inverse();
        let place = Camera::position_f64;
        let off = found.iter().zip(truth).map(|(found, truth)| place(&similarity.camera(found)).distance(place(truth)));
        let off = off.sum::<f64>() / truth.len() as f64;
        let pairs =
            || truth.iter().enumerate().flat_map(|(i, a)| truth[..i].iter().map(|b| place(a).distance(place(b))));
        let apart = pairs().sum::<f64>() / pairs().count() as f64;
        (PoseError::of(found, truth, centre).rotation_deg, 100.0 * off / apart)
    }

    /// Uses square photographs in four EXIF orientations, one of them mirrored: their sizes do not reveal the orientation.
    #[test]
    fn photographs_that_exif_data_turn_are_placed_as_they_are_shown() {
        let train = "0,1,3,9".parse().unwrap();
        let request = SceneRequest { train, test: TestProtocol::First(1), image_size: Some(360), ..request() };
        let truth = crate::load(&SceneSource::Procedural("room".into()), &request).unwrap();
        let guard = tempfile::tempdir().unwrap();
        for (i, (view, exif)) in truth.train.iter().zip([2, 6, 3, 8]).enumerate() {
            let (png, jpeg) = (guard.path().join("shown.png"), guard.path().join(format!("{i}.jpg")));
            view.image.write_png(&png).unwrap();
            let shown = image::open(&png).unwrap();
            let stored = match exif {
                2 => shown.fliph(),
                6 => shown.rotate270(),
                3 => shown.rotate180(),
                8 => shown.rotate90(),
                _ => shown,
            };
            stored.into_rgb8().save(&jpeg).unwrap();
            set_orientation(&jpeg, exif);
            fs::remove_file(&png).unwrap();
        }
        image::RgbImage::new(100, 100).save(guard.path().join("small.png")).unwrap();
        let mut lines = Vec::new();
        let found = find(guard.path(), guard.path(), None, |line| lines.push(line.to_owned())).unwrap();
        let small = "small.png: not placed: its longest side of 100 pixels is below half of the usual 360";
        assert!(found.left_out == 1 && lines.iter().any(|line| line == small), "{lines:?}");
        let focal = found.model.cameras[&1].parameters[0] / truth.train[0].camera.fx;
        assert!((focal - 1.0).abs() < 0.05, "{focal}");
        found.write(&guard.path().join("sparse")).unwrap();
        let tested = SceneRequest { test: TestProtocol::Training, train: ViewSelection::All, ..Default::default() };
        let found = load(guard.path(), &tested).unwrap();
        assert!(!found.warnings.iter().any(|warning| warning.contains("EXIF")), "{:?}", found.warnings);
        let (turn, off) = errors(&found.given_cameras(), &truth.given_cameras(), truth.space.centre.as_dvec3());
        assert!(turn < 0.5 && off < 5.0, "{turn}° {off} %");
    }

    /// Gives one photograph a mask, and makes the lower part of another transparent.
    #[test]
    fn features_count_within_masks_and_where_photographs_are_opaque() {
        let train = "0,1,3".parse().unwrap();
        let request = SceneRequest { train, test: TestProtocol::First(1), image_size: Some(360), ..request() };
        let truth = crate::load(&SceneSource::Procedural("room".into()), &request).unwrap();
        let guard = tempfile::tempdir().unwrap();
        let (dir, images) = (guard.path(), guard.path().join("images"));
        for (i, view) in truth.train.iter().enumerate() {
            let colours = view.image.to_rgb8();
            let opacity = |pixel: usize| if i == 2 && pixel >= 360 * 200 { 0 } else { 255 };
            let pixels = colours.as_chunks().0.iter().enumerate().map(|(i, &[r, g, b])| [r, g, b, opacity(i)]);
            fs::create_dir_all(&images).unwrap();
            let photograph = Rgba8 { width: 360, height: 360, pixels: pixels.collect() };
            photograph.write_png(&images.join(format!("{i}.png"))).unwrap();
        }
        let lowest = || {
            let of = |image: &ColmapImage| image.observations.iter().map(|(pixel, _)| pixel.y).fold(0.0, f64::max);
            find(dir, &images, None, |_| {}).unwrap().model.images.iter().map(of).collect::<Vec<f64>>()
        };
        let before = lowest();
        assert!(before[0] > 250.0 && before[1] > 250.0 && before[2] < 202.0, "{before:?}");
        fs::create_dir(dir.join("masks")).unwrap();
        write_mask(&dir.join("masks/0.png"), (360, 360), |i| i < 360 * 200);
        let masked = lowest();
        assert!(masked[0] < 202.0 && masked[1] > 202.0 && masked[2] < 202.0, "{masked:?}");
        fs::remove_file(dir.join("masks/0.png")).unwrap();
        image::RgbImage::new(360, 360).save(dir.join("masks/2.png")).unwrap();
        let mut lines = Vec::new();
        find(dir, &images, None, |line| lines.push(line.to_owned())).unwrap();
        let reason = "15 needed; masks or transparency cover nearly all pixels";
        assert!(lines.iter().any(|line| line.starts_with("2.png: ") && line.ends_with(reason)), "{lines:?}");
    }

    /// Prints the table of docs/photographs.md: the poses of this crate's solver, and COLMAP's if it is on PATH.
    #[test]
    #[ignore = "needs published captures: INFONERF_DATA=DIR"]
    fn poses_of_published_captures() {
        let llff = |name| (name, format!("nerf_llff_data/{name}"), "images_8");
        let captures = [llff("fern"), llff("flower"), llff("room"), ("tumbler", "colmap_tumbler".into(), "images")];
        let columns = "placed | degrees | position, % | focal length | seconds |";
        eprintln!("| photographs | published focal length | {columns} COLMAP: {columns}");
        eprintln!("|{}", "---|".repeat(12));
        let solve = |images: &Path, by_colmap: bool| {
            if !by_colmap {
                return Some(find(images.parent()?, images, None, |_| {}).ok()?.model);
            }
            let colmap = program(colmap::PROGRAM, std::env::var_os("PATH"))?;
            colmap::find(&colmap, &images.with_extension("work"), images, &mut |_: &str| ()).ok()
        };
        for (capture, dir, folder) in captures {
            let dir = shared_data(&dir);
            let scene = load(&dir, &SceneRequest { image_size: Some(16), ..request() }).unwrap();
            let views: Vec<_> = scene.train.iter().chain(&scene.test).collect();
            let truth = |image: &ColmapImage| {
                let stem = Path::new(&image.name).file_stem();
                &views.iter().find(|view| Path::new(&view.name).file_name() == stem).unwrap().camera
            };
            let mut files = list_images(&dir.join(folder)).unwrap();
            files.sort_by_key(|path| (file_name(path).len(), file_name(path)));
            let selections = [(4, false), (4, true), (9, false), (9, true), (20, true), (60, true)];
            for (count, spread) in selections.into_iter().filter(|(count, _)| *count <= files.len()) {
                let pick = |i: usize| if spread { i * (files.len() - 1) / (count - 1) } else { i + 2 };
                let guard = tempfile::tempdir().unwrap();
                let images = guard.path().join("images");
                fs::create_dir(&images).unwrap();
                for path in (0..count).map(|i| &files[pick(i)]) {
                    fs::copy(path, images.join(file_name(path))).unwrap();
                }
                let row = |by_colmap: bool| {
                    let started = std::time::Instant::now();
                    let solved = solve(&images, by_colmap);
                    let seconds = started.elapsed().as_secs_f64();
                    let Some(model) = solved else {
                        return (0, f64::INFINITY, format!("0 | – | – | – | {seconds:.0} |"));
                    };
                    let found = model.images.iter().map(|image| truth(image).with_pose(image.pose)).collect::<Vec<_>>();
                    let truth = model.images.iter().map(|image| truth(image).clone()).collect::<Vec<_>>();
                    let (turn, off) = errors(&found, &truth, scene.space.centre.as_dvec3());
                    let (_, camera) = model.cameras.first_key_value().unwrap();
                    let focal = camera.parameters[0] / f64::from(camera.width.max(camera.height));
                    let placed = found.len();
                    (placed, turn, format!("{placed} | {turn:.2} | {off:.1} | {focal:.2} | {seconds:.0} |"))
                };
                let ((placed, turn, ours), (.., colmaps)) = (row(false), row(true));
                let which = format!("{capture}, {count} {}", if spread { "all over" } else { "side by side" });
                let published = views[0].camera.fx / f64::from(views[0].camera.width.max(views[0].camera.height));
                eprintln!("| {which} | {published:.2} | {ours} {colmaps}");
                if capture != "tumbler" || !spread {
                    assert!(placed == count && turn < 1.0, "{placed} {turn}");
                }
            }
        }
    }
}
