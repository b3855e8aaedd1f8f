//! Exports of a run: its surface, gaussian splats and cameras.

use std::collections::HashSet;
use std::path::Path;

use anyhow::Result;
use infonerf_dataset::{SceneSource, transforms};
use infonerf_export::{
    Chamfer, DensityGrid, ExportError, Gaussian, SplatTarget, Surface, chamfer, gaussians, refine, splat_image,
    surface_density,
};
use infonerf_metrics::{Picture, psnr};
use infonerf_procedural as procedural;
use infonerf_render::render_image;
use infonerf_report::Quantity;
use infonerf_scene::image::stored_dimensions;
use infonerf_scene::{Lens, TestProtocol, View, ViewRegion, resized_dimensions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::records::read_records;
use crate::run::Trained;
use crate::run_plan::RunPlan;

/// Number of points sampled on a surface to compare it with the exact one. `TRUTH_SIZE` is the side, in pixels, of the cameras
/// that sample the exact surface. Both suffice for distances of a fraction of a voxel.
const SURFACE_POINTS: usize = 100_000;
const TRUTH_SIZE: u32 = 48;
const TEST_VIEWS: usize = 8;
/// Number of images that splats are fitted to in addition to those of the training cameras.
const SPLAT_VIEWS: usize = 36;
/// Longest side, in pixels, of the images that splats are fitted to. `SPLAT_STEPS` is the number of steps of the fit.
const SPLAT_SIDE: u32 = 200;
const SPLAT_STEPS: usize = 240;

/// Mean PSNR on test views of gaussian splats and of the fields that they were made from, in dB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatFidelity {
    /// Number of test views.
    pub views: usize,
    /// PSNR of the splats.
    pub splats: f64,
    /// PSNR of the fields, without residuals.
    pub fields: f64,
}

impl Trained {
    /// Extracts the surface of the fields within the scene's box, at `resolution` voxels along its longest side: the
    /// isosurface that looks most like the fields to the training cameras.
    ///
    /// # Errors
    /// If the resolution is out of range, or the fields have no surface.
    pub fn surface(&self, resolution: usize) -> Result<Surface, ExportError> {
        let cameras = self.scene().training_cameras();
        Surface::extract(&DensityGrid::sample(self, resolution, surface_density(self, &cameras)?)?)
    }

    /// Makes gaussian splats on `surface`, fitted to images of the fields from the training cameras and from random
    /// poses in the region that they span. Test views are not used.
    pub fn splats(&self, surface: &Surface) -> Vec<Gaussian> {
        let (scene, models) = (self.scene(), self.fields());
        let training = scene.training_cameras();
        let (region, mut rng) = (ViewRegion::new(&training), ChaCha8Rng::seed_from_u64(0));
        let more: Vec<_> = (0..SPLAT_VIEWS).map(|_| region.sample(&mut rng)).collect();
        let first = &training[0];
        let side = first.width.max(first.height).min(SPLAT_SIDE);
        let (width, height) = resized_dimensions(first.width, first.height, side);
        // Splats are rendered without lens distortion.
        let camera = first.resized(width, height).with_lens(Lens::default());
        let target = |pose| {
            let camera = camera.with_pose(pose);
            SplatTarget { image: render_image(self.renderer(), &models, &camera).rgb, camera }
        };
        let poses = training.iter().map(|camera| camera.to_world).chain(more);
        let targets: Vec<SplatTarget> = poses.map(target).collect();
        let mut splats = gaussians(surface, self);
        refine(&mut splats, &targets, scene.background, SPLAT_STEPS);
        splats
    }

    /// Measures `splats` and the fields on up to eight test views. Returns `None` if no test view has a camera without lens
    /// distortion, since splats are only rendered without.
    pub fn splat_fidelity(&self, splats: &[Gaussian]) -> Result<Option<SplatFidelity>> {
        let (scene, models) = (self.scene(), self.fields());
        let views = scene.test.iter().filter(|view| view.camera.lens.is_perspective()).take(TEST_VIEWS);
        let (mut count, mut sums) = (0, [0.0; 2]);
        for view in views {
            let [width, height] = [view.image.width, view.image.height].map(|side| side as usize);
            let truth = Picture::new(view.image.rgb.clone(), width, height)?;
            let shown = splat_image(splats, &view.camera, scene.background);
            let rendered = render_image(self.renderer(), &models, &view.camera).rgb;
            for (sum, image) in sums.iter_mut().zip([shown, rendered]) {
                *sum += psnr(&Picture::new(image, width, height)?.rounded(), &truth)?;
            }
            count += 1;
        }
        let [splats, fields] = sums.map(|sum| sum / count as f64);
        Ok((count > 0).then_some(SplatFidelity { views: count, splats, fields }))
    }

    /// Measures the Chamfer distance of `surface` from the exact one that the training cameras see; `None` unless it is built in.
    ///
    /// # Errors
    /// If there is no such built-in scene.
    pub fn surface_error(&self, surface: &Surface) -> Result<Option<Chamfer>> {
        let SceneSource::Procedural(name) = &self.plan.source else { return Ok(None) };
        let truth = procedural::surface_points(name, TRUTH_SIZE)?;
        Ok(chamfer(&surface.sample(SURFACE_POINTS), &truth))
    }
}

impl RunPlan {
    /// Describes how an export of the run in `folder` differs from the model that its record measures; `None` if it does not.
    /// With `first_field`, the export has only the first of several fields. No export has residuals.
    pub fn export_note(&self, folder: &Path, first_field: bool) -> Option<String> {
        let several = first_field && self.members() > 1;
        let fields = several.then(|| format!("the first of {} fields alone", self.members()));
        let residuals = self.config.render.residuals.then(|| "without the residuals of the training views".to_owned());
        let parts: Vec<String> = fields.into_iter().chain(residuals).collect();
        let held_out = self.config.eval.test != TestProtocol::Training;
        let records = read_records(&self.record_path(folder)).unwrap_or_default();
        let psnr = records.first().filter(|_| held_out).and_then(|record| Quantity::PSNR.value(record));
        let whole = psnr.map_or(String::new(), |psnr| {
            format!("; the whole model has {} dB PSNR on held-out views", Quantity::PSNR.format(psnr))
        });
        (!parts.is_empty()).then(|| format!("{}{whole}", parts.join(", ")))
    }

    /// Returns the training and test cameras as a `transforms.json` for nerfstudio and instant-ngp, to be placed next to the
    /// scene's images. Intrinsics are at the size of the image files, and each file is listed once.
    ///
    /// # Errors
    /// If the scene cannot be loaded.
    pub fn cameras(&self) -> Result<Value> {
        let mut scene = self.load()?;
        if let SceneSource::Folder { path } = &self.source {
            scene.train.iter_mut().chain(&mut scene.test).for_each(|view| at_file_size(view, path));
        }
        let mut cameras = transforms(&scene);
        let mut seen = HashSet::new();
        if let Some(frames) = cameras["frames"].as_array_mut() {
            frames.retain(|frame| seen.insert(frame["file_path"].as_str().map(str::to_owned)));
            // nerfstudio reads `camera_model` at the top level of the file, not in a frame.
            let model = frames.first().map(|frame| frame["camera_model"].clone());
            cameras["camera_model"] = model.unwrap_or_default();
        }
        // nerfstudio evaluates on `val_filenames` while it trains.
        cameras["val_filenames"] = cameras["test_filenames"].clone();
        Ok(cameras)
    }
}

/// Scales the camera of `view` to the size of its image file below `folder`, without the margins that the view has among images
/// of other proportions. If the file does not fit, such as one that EXIF rotates, the camera is left as it is.
fn at_file_size(view: &mut View, folder: &Path) {
    let Ok((width, height)) = stored_dimensions(&folder.join(&view.file)) else { return };
    let camera = &view.camera;
    let scale = f64::from(camera.width.max(camera.height)) / f64::from(width.max(height));
    let [w, h] = [width, height].map(|side| (f64::from(side) * scale).round() as u32);
    let fills = camera.width.abs_diff(w) <= 1 && camera.height.abs_diff(h) <= 1;
    if fills || margins(view) == [camera.width.saturating_sub(w) / 2, camera.height.saturating_sub(h) / 2] {
        let (w, h) = if fills { (camera.width, camera.height) } else { (w, h) };
        view.camera = camera.framed(w, h).resized(width, height);
    }
}

/// Returns the numbers of columns and of rows at either side of `view` that have no valid pixel.
fn margins(view: &View) -> [u32; 2] {
    let (width, height) = (view.camera.width, view.camera.height);
    let is_valid = |i: &u32| view.valid.as_ref().is_none_or(|valid| valid[*i as usize]);
    let valid = (0..width * height).filter(is_valid).map(|i| (i % width, i / width));
    let within = valid.map(|(x, y)| [x.min(width - 1 - x), y.min(height - 1 - y)]);
    within.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1])]).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::DMat4;
    use infonerf_report::Record;
    use infonerf_scene::{Camera, Image};

    use super::*;
    use crate::testing::{first_run, with_psnr};

    /// Takes an upright image of 12×16 pixels for one that was halved, or put into the middle of a square.
    #[test]
    fn cameras_are_exported_at_the_size_of_their_file() {
        let guard = tempfile::tempdir().unwrap();
        let own = Camera::pinhole((12, 16), [20.0; 2], [5.5, 8.0], DMat4::IDENTITY);
        Image::filled(12, 16, [0.5; 3]).write_png(&guard.path().join("a.png")).unwrap();
        let exported = |camera: Camera, is_valid: fn(usize) -> bool| {
            let valid = (0..(camera.width * camera.height) as usize).map(is_valid).collect();
            let image = Image::filled(camera.width, camera.height, [0.5; 3]);
            let view = View::new(0, "a", camera, image);
            let mut view = View { file: "a.png".into(), valid: Some(valid), ..view };
            at_file_size(&mut view, guard.path());
            view.camera
        };
        assert_eq!(exported(own.resized(6, 8), |_| true), own);
        assert_eq!(exported(own.resized(6, 8), |i| i % 6 > 1), own);
        assert_eq!(exported(own.framed(16, 16), |i| (2..14).contains(&(i % 16))), own);
        // Not the image's rectangle.
        let square = own.framed(16, 16);
        assert_eq!(exported(square.clone(), |i| (3..13).contains(&(i % 16))), square);
    }

    #[test]
    fn export_note_names_the_field_and_the_held_out_psnr() {
        let folder = tempfile::tempdir().unwrap();
        let note = |set: &[&str], first_field| {
            let plan = first_run(set);
            let record = serde_json::to_vec(&[with_psnr(24.314, Record::default())]).unwrap();
            fs::write(plan.record_path(folder.path()), record).unwrap();
            plan.export_note(folder.path(), first_field).unwrap_or_default()
        };
        let several = ["train.ensemble.size=3", "train.ensemble.seconds_per_member=0", "render.residuals=true"];
        let whole = "; the whole model has 24.31 dB PSNR on held-out views";
        let residuals = "without the residuals of the training views";
        assert_eq!(note(&[], true), "");
        assert_eq!(note(&several, true), format!("the first of 3 fields alone, {residuals}{whole}"));
        assert_eq!(note(&several, false), format!("{residuals}{whole}"));
        assert_eq!(note(&["render.residuals=true", "eval.test=training"], true), residuals);
    }
}
