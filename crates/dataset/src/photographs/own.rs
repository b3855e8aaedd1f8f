//! Poses by `infonerf-sfm`.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::DVec2;
use infonerf_scene::image::dimensions;
use infonerf_scene::{Image, SceneError, resized_dimensions};
use infonerf_sfm::{Grey, Photograph, Settings, focal, reconstruct};
use rayon::prelude::*;

use crate::colmap::{ColmapCamera, ColmapImage, Reconstruction, opengl};

/// The longest side, in pixels, of the images in which features are looked for.
const LONGEST: u32 = 1600;
/// Photographs that are decoded at a time: twelve million pixels take 350 MB while they are.
const AT_ONCE: usize = 4;
/// Below this many photographs with a pose there is no scene.
const FEWEST: usize = 2;
/// COLMAP's number of the lens model SIMPLE_RADIAL.
const SIMPLE_RADIAL: usize = 2;

/// Finds the poses of the photographs in the folder `images`, and writes those of them that have one to `sparse/0`.
/// `progress` is told what is done, and of each photograph without a pose why.
///
/// # Errors
/// An image cannot be read or has another size; or fewer than two can be placed. Nothing is written then.
pub(super) fn pose(images: &Path, sparse: &Path, mut progress: impl FnMut(&str)) -> Result<(), SceneError> {
    let paths = crate::loaders::list_images(images)?;
    let size = one_size(&paths)?;
    progress(&format!("finding the poses of {} photographs", paths.len()));
    let mut photographs = Vec::new();
    for some in paths.chunks(AT_ONCE) {
        photographs.extend(some.par_iter().map(|path| Small::read(path)).collect::<Result<Vec<_>, _>>()?);
    }
    let fault =
        |reason: String| SceneError::malformed(images, "photographs that overlap enough to find their poses", reason);
    let input: Vec<Photograph> = photographs.iter().map(Small::photograph).collect();
    let found = reconstruct(&input, &Settings::default(), &mut progress).map_err(fault)?;
    let mut lost = Vec::new();
    for (path, pose) in paths.iter().zip(&found.poses) {
        let state = match pose {
            Ok(_) => "placed".to_owned(),
            Err(reason) => format!("not placed: {reason}"),
        };
        let line = format!("{}: {state}", name(path));
        progress(&line);
        lost.extend(pose.is_err().then_some(line));
    }
    if paths.len() - lost.len() < FEWEST {
        return Err(fault(lost.swap_remove(0)));
    }
    let reduced = f64::from(size.0) / input[0].image.width as f64;
    let lens = [found.lens.focal * reduced, f64::from(size.0) / 2.0, f64::from(size.1) / 2.0, found.lens.k1];
    let camera = ColmapCamera::new(images, "camera", SIMPLE_RADIAL, size, lens.to_vec())?;
    let mut all = Reconstruction {
        cameras: BTreeMap::from([(1, camera)]),
        images: Vec::new(),
        points: (1u64..).zip(found.points.iter().map(|point| point.position)).collect(),
    };
    for (i, pose) in found.poses.iter().enumerate() {
        let Ok(pose) = pose else { continue };
        let observations = (1u64..).zip(&found.points).flat_map(|(id, point)| {
            point.seen.iter().filter(|(by, _)| *by == i).map(move |(_, pixel)| (*pixel * reduced, id))
        });
        all.images.push(ColmapImage {
            id: i as u32 + 1,
            name: name(&paths[i]),
            camera: 1,
            pose: opengl(pose.rotation.transpose(), pose.centre()),
            observations: observations.collect(),
        });
    }
    let colour = |id: u64| {
        let (by, pixel) = found.points[id as usize - 1].seen[0];
        photographs[by].colour(pixel)
    };
    let written = all.write(&sparse.join("0"), colour);
    if written.is_err() {
        let _ = fs::remove_dir_all(sparse);
    }
    written
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The size of all images.
fn one_size(paths: &[PathBuf]) -> Result<(u32, u32), SceneError> {
    let first = dimensions(&paths[0])?;
    for path in &paths[1..] {
        let size = dimensions(path)?;
        if size != first {
            let expected = format!("{}×{} pixels, as {} has", first.0, first.1, name(&paths[0]));
            return Err(SceneError::malformed(path, expected, format!("{}×{}", size.0, size.1)));
        }
    }
    Ok(first)
}

/// A photograph at most [`LONGEST`] pixels long.
struct Small {
    width: usize,
    height: usize,
    rgb: Vec<[u8; 3]>,
    focal: Option<f64>,
}

impl Small {
    fn read(path: &Path) -> Result<Self, SceneError> {
        let focal = File::open(path).ok().and_then(|file| focal(&mut BufReader::new(file)));
        let image = Image::read(path, [1.0; 3])?;
        let (width, height) = resized_dimensions(image.width, image.height, image.width.max(image.height).min(LONGEST));
        let rgb = image.resized(width, height).to_rgb8().as_chunks().0.to_vec();
        Ok(Self { width: width as usize, height: height as usize, rgb, focal })
    }

    fn photograph(&self) -> Photograph {
        let rgb = self.rgb.iter().map(|colour| colour.map(|value| f32::from(value) / 255.0));
        Photograph { image: Grey::of_rgb(self.width, self.height, rgb), focal: self.focal }
    }

    fn colour(&self, pixel: DVec2) -> [u8; 3] {
        let at = |v: f64, size: usize| (v as usize).min(size - 1);
        self.rgb[at(pixel.y, self.height) * self.width + at(pixel.x, self.width)]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use infonerf_scene::{Camera, PoseError, SceneRequest, Similarity, TestProtocol, ViewSelection};

    use super::*;
    use crate::loaders::testing::shared_data;
    use crate::{SceneSource, load};

    /// Mean errors of cameras after [`Similarity::between`] has aligned them: of rotations in degrees, and of positions in
    /// percent of the mean distance between cameras.
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

    /// Prints the table of docs/photographs.md: with `INFONERF_LINES`, what a user is told too.
    #[test]
    #[ignore = "needs published captures: INFONERF_DATA=DIR"]
    fn poses_of_published_captures() {
        let told = std::env::var_os("INFONERF_LINES").is_some();
        let llff = |name| (name, format!("nerf_llff_data/{name}"), "images_8");
        let captures = [llff("fern"), llff("flower"), ("tumbler", "colmap_tumbler".into(), "images")];
        eprintln!(
            "| photographs | placed | rotation, degrees | position, % | focal length, found / published | points | seconds |"
        );
        eprintln!("|---|---|---|---|---|---|---|");
        for (capture, dir, folder) in captures {
            let dir = shared_data(&dir);
            let request = SceneRequest {
                train: ViewSelection::All,
                test: TestProtocol::All,
                image_size: Some(16),
                ..Default::default()
            };
            let scene = load(&SceneSource::Folder { path: dir.clone() }, &request).unwrap();
            let views: Vec<_> = scene.train.iter().chain(&scene.test).collect();
            let mut files = crate::loaders::list_images(&dir.join(folder)).unwrap();
            files.sort_by_key(|path| (name(path).len(), name(path)));
            for (count, spread) in [(4, false), (4, true), (9, false), (9, true)] {
                let pick = |i: usize| if spread { i * (files.len() - 1) / (count - 1) } else { i + 2 };
                let guard = tempfile::tempdir().unwrap();
                for path in (0..count).map(|i| &files[pick(i)]) {
                    fs::copy(path, guard.path().join(name(path))).unwrap();
                }
                let started = std::time::Instant::now();
                let tell = |line: &str| {
                    if told {
                        eprintln!("{line}");
                    }
                };
                let result = pose(guard.path(), &guard.path().join("sparse"), tell);
                let seconds = started.elapsed().as_secs_f64();
                let which = format!("{capture}, {count} {}", if spread { "all over" } else { "side by side" });
                if let Err(error) = result {
                    eprintln!("| {which} | {error} | | | | | {seconds:.0} |");
                    continue;
                }
                let read = Reconstruction::read(guard.path()).unwrap();
                let truth = |image: &ColmapImage| {
                    let stem = Path::new(&image.name).file_stem();
                    &views.iter().find(|view| Path::new(&view.name).file_name() == stem).unwrap().camera
                };
                let (found, truth): (Vec<Camera>, Vec<Camera>) =
                    read.images.iter().map(|image| (truth(image).with_pose(image.pose), truth(image).clone())).unzip();
                let (turn, off) = errors(&found, &truth, scene.space.centre.as_dvec3());
                let focal = read.cameras[&1].parameters[0] / f64::from(read.cameras[&1].width);
                let published = views[0].camera.fx / f64::from(views[0].camera.width);
                let (placed, points) = (found.len(), read.points.len());
                eprintln!(
                    "| {which} | {placed} | {turn:.2} | {off:.1} | {focal:.2} / {published:.2} | {points} | {seconds:.0} |"
                );
                if !spread || capture != "tumbler" {
                    assert!(placed == count && turn < 1.0 && off < 5.0);
                }
            }
        }
    }
}
