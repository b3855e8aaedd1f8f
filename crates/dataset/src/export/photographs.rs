//! Photographs of procedural scenes in the formats of LLFF, DTU and ZJU-MoCap.

use std::path::Path;

use glam::{DMat3, DMat4, DVec3, Vec3};
use infonerf_procedural as procedural;
use infonerf_scene::{Aabb, Body, Camera, Image, Lens, Ray, SceneError};
use infonerf_sfm::Pose;
use rayon::prelude::*;

use crate::files::pickle::{self, dict, list, numbers, object, text};
use crate::files::{make_folder, npy, write_file, write_mask};

/// Colour of photographs where the scene is transparent.
const WHITE: [f32; 3] = [1.0; 3];
/// Number of photographs in LLFF's format.
const LLFF_VIEWS: usize = 40;
/// Number of views of a full scan, which the published protocols need.
const DTU_VIEWS: usize = 49;
/// Number of cameras in ZJU-MoCap's format.
const ZJU_VIEWS: usize = 23;
/// k₁ k₂ p₁ p₂ k₃ of every lens.
const DISTORTION: [f64; 5] = [-0.1, 0.05, 1e-3, -2e-3, 0.01];
/// Millimetres per scene unit: translations are in millimetres, a scene unit is a metre.
const MILLIMETRES: f64 = 1000.0;

struct ExportedView {
    camera: Camera,
    image: Image,
    /// Depth as in [`procedural::Rendering`].
    depth: Vec<f32>,
}

impl ExportedView {
    /// Returns the ray through the centre of a pixel.
    fn ray(&self, pixel: usize) -> Ray {
        let width = self.camera.width as usize;
        self.camera.ray((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5)
    }
}

fn photographs(name: &str, size: u32, count: usize, lens: Lens) -> Result<Vec<ExportedView>, SceneError> {
    let photograph = |camera: &Camera| {
        let camera = camera.with_lens(lens);
        let procedural::Rendering { rgba, depth } = procedural::render(name, &camera)?;
        Ok(ExportedView { camera, image: rgba.to_f32().composite(WHITE), depth })
    };
    procedural::photographs(name, size, count).par_iter().map(photograph).collect()
}

/// Returns the intrinsic matrix `K` for pixel coordinates in which pixel centres are whole numbers.
fn intrinsics(camera: &Camera) -> DMat3 {
    let centre = DVec3::new(camera.cx - 0.5, camera.cy - 0.5, 1.0);
    DMat3::from_cols(DVec3::X * camera.fx, DVec3::Y * camera.fy, centre)
}

/// Writes `images/image<NNN>.png` and a row for each: the camera's down, right and backward axes, its position, and
/// (height, width, focal length) as columns of a 3×5 matrix, then the depths of the nearest and the farthest point.
pub(super) fn write_llff(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let (near, far, _) = procedural::extent(name)?;
    let photographs = photographs(name, size, LLFF_VIEWS, Lens::PERSPECTIVE)?;
    make_folder(&dir.join("images"))?;
    for (i, photograph) in photographs.iter().enumerate() {
        photograph.image.write_png(&dir.join(format!("images/image{i:03}.png")))?;
    }
    let rows: Vec<f64> = photographs.iter().flat_map(|p| row(p, (near, far))).collect();
    npy::write(&dir.join("poses_bounds.npy"), &[photographs.len() as u64, 17], &rows)
}

/// Returns the row of a photograph in `poses_bounds.npy`; `extent` is (near, far) for one without visible points.
fn row(photograph: &ExportedView, extent: (f32, f32)) -> [f64; 17] {
    let camera = &photograph.camera;
    let [x, y, z, at] = [0, 1, 2, 3].map(|column| camera.to_world.col(column));
    let size = [f64::from(camera.height), f64::from(camera.width), camera.fx];
    let (near, far) = depths(photograph).unwrap_or(extent);
    let mut row = [0.0; 17];
    for i in 0..3 {
        row[5 * i..5 * i + 5].copy_from_slice(&[-y[i], x[i], z[i], at[i], size[i]]);
    }
    row[15..].copy_from_slice(&[f64::from(near), f64::from(far)]);
    row
}

/// Returns the min and max depth of visible points along the camera's axis.
fn depths(photograph: &ExportedView) -> Option<(f32, f32)> {
    let depths = photograph.depth.iter().enumerate().filter(|(_, distance)| distance.is_finite());
    let depths = depths.map(|(i, distance)| distance * photograph.ray(i).cosine);
    depths.map(|depth| (depth, depth)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// Writes `image/<NNNNNN>.png`, `mask/<NNN>.png` and `cameras_sphere.npz`: `world_mat_<i>` is `K [R | t]`, and
/// `scale_mat_<i>` maps the unit sphere to the sphere around the subject.
pub(super) fn write_dtu(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let photographs = photographs(name, size, DTU_VIEWS, Lens::PERSPECTIVE)?;
    ["image", "mask"].iter().try_for_each(|folder| make_folder(&dir.join(folder)))?;
    // Surface points that the subject's pixels show.
    let mut seen = Vec::new();
    for (i, photograph) in photographs.iter().enumerate() {
        let mask = procedural::object_mask(name, &photograph.camera)?;
        let subject = (0..mask.len()).filter(|&i| mask[i] && photograph.depth[i].is_finite());
        seen.extend(subject.map(|i| photograph.ray(i).at(photograph.depth[i])));
        photograph.image.write_png(&dir.join(format!("image/{i:06}.png")))?;
        write_mask(&dir.join(format!("mask/{i:03}.png")), (size, size), |pixel| mask[pixel as usize])?;
    }
    let (centre, radius) = sphere(&seen);
    let scale = DMat4::from_translation(centre) * DMat4::from_scale(DVec3::splat(radius));
    npy::write_archive(&dir.join("cameras_sphere.npz"), &matrices(photographs.iter().map(|p| &p.camera), scale))
}

/// Returns `world_mat_<i>` = `K [R | t]` of each camera, and `scale_mat_<i>` = `scale`.
pub(crate) fn matrices<'a>(cameras: impl Iterator<Item = &'a Camera>, scale: DMat4) -> Vec<npy::NamedArray> {
    let of = |(i, camera): (usize, &Camera)| {
        let matrices = [("world", projection(camera)), ("scale", scale)];
        matrices.map(|(kind, m)| (format!("{kind}_mat_{i}"), vec![4, 4], m.transpose().to_cols_array().to_vec()))
    };
    cameras.enumerate().flat_map(of).collect()
}

/// Returns `K [R | t]` with a last row of (0, 0, 0, 1). It projects world points to pixels with whole numbers as centres.
fn projection(camera: &Camera) -> DMat4 {
    let m = intrinsics(camera) * Pose::of(&camera.to_world).rotation;
    let t = -(m * camera.position_f64());
    DMat4::from_cols(m.x_axis.extend(0.0), m.y_axis.extend(0.0), m.z_axis.extend(0.0), t.extend(1.0))
}

/// Returns a sphere around the centre of the points' box that contains all `points`, with a margin of a twentieth.
fn sphere(points: &[Vec3]) -> (DVec3, f64) {
    let centre = Aabb::containing(points.iter().copied()).map_or(Vec3::ZERO, |bounds| bounds.centre());
    let farthest = points.iter().map(|p| p.distance(centre)).fold(1e-3, f32::max);
    (centre.as_dvec3(), 1.05 * f64::from(farthest))
}

/// Writes one frame: `annots.npy`, images `Camera_B<i>/000000.png`, and masks of these names in `mask_cihp`. A scene
/// with a body also gets `new_vertices/0.npy`, and `new_params/0.npy` with the identity.
pub(super) fn write_zju(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let photographs = photographs(name, size, ZJU_VIEWS, lens())?;
    for (i, photograph) in photographs.iter().enumerate() {
        let image = image_path(i, 0);
        let mask = Path::new("mask_cihp").join(&image);
        [Path::new(&image), &mask].iter().try_for_each(|path| make_folder(&dir.join(path.with_file_name(""))))?;
        photograph.image.write_png(&dir.join(&image))?;
        let subject = procedural::object_mask(name, &photograph.camera)?;
        write_mask(&dir.join(mask), (size, size), |pixel| subject[pixel as usize])?;
    }
    if let Some(body) = procedural::body(name)? {
        write_body(dir, &body)?;
    }
    let cameras: Vec<Camera> = photographs.into_iter().map(|p| p.camera).collect();
    write_file(&dir.join("annots.npy"), pickle::npy(&annotations(&cameras, 1)))
}

fn image_path(camera: usize, frame: usize) -> String {
    format!("Camera_B{camera}/{frame:06}.png")
}

pub(crate) fn lens() -> Lens {
    let [k1, k2, p1, p2, k3] = DISTORTION;
    Lens::rational([k1, k2, k3, 0.0, 0.0, 0.0], [p1, p2])
}

/// Returns the pickle in `annots.npy`: `cams` with lists of K, D (of [`DISTORTION`]), R (world to camera) and T, and
/// `ims` with the images of each frame.
pub(crate) fn annotations(cameras: &[Camera], frames: usize) -> Vec<u8> {
    let of = |sides: &[usize], values: &dyn Fn(&Camera) -> Vec<f64>| {
        list(&cameras.iter().map(|camera| numbers(sides, &values(camera))).collect::<Vec<_>>())
    };
    let pose = |camera: &Camera| Pose::of(&camera.to_world);
    let cams = dict(&[
        ("K", of(&[3, 3], &|c| intrinsics(c).transpose().to_cols_array().to_vec())),
        ("D", of(&[5, 1], &|_| DISTORTION.to_vec())),
        ("R", of(&[3, 3], &|c| pose(c).rotation.transpose().to_cols_array().to_vec())),
        ("T", of(&[3, 1], &|c| (pose(c).translation * MILLIMETRES).to_array().to_vec())),
    ]);
    let frame = |frame: usize| {
        let names: Vec<_> = (0..cameras.len()).map(|camera| text(&image_path(camera, frame))).collect();
        dict(&[("ims", list(&names))])
    };
    let frames: Vec<_> = (0..frames).map(frame).collect();
    object(dict(&[("cams", cams), ("ims", list(&frames))]))
}

fn write_body(dir: &Path, body: &Body) -> Result<(), SceneError> {
    ["new_vertices", "new_params"].iter().try_for_each(|folder| make_folder(&dir.join(folder)))?;
    let vertices: Vec<f32> = body.vertices.iter().flat_map(|v| v.to_array()).collect();
    npy::write(&dir.join("new_vertices/0.npy"), &[body.vertices.len() as u64, 3], &vertices)?;
    let still = || numbers(&[1, 3], &[0.0; 3]);
    write_file(&dir.join("new_params/0.npy"), pickle::npy(&object(dict(&[("Rh", still()), ("Th", still())]))))
}
