//! Scenes: photographs with their cameras, and the space between them.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::camera::Camera;
use crate::format::{Backdrop, Format};
use crate::image::{Image, resized_dimensions, resized_mask};
use crate::ray::Ray;
use crate::space::Space;

/// One photograph with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index in its pool: the frames of the file for split data sets, all training (or all held-out)
    /// views in order for captures split here. DTU and ZJU-MoCap number their views themselves.
    pub id: usize,
    /// The image's path within the scene, without extension, such as `train/r_26`.
    pub name: String,
    /// The image's path within the scene's folder, such as `train/r_26.png`.
    pub file: String,
    /// Intrinsics for `image` and the pose.
    pub camera: Camera,
    /// The photograph, composited on the scene's background.
    pub image: Arc<Image>,
    /// Exact distance along the unit ray through each pixel's centre, row-major, scene units; `f32::INFINITY` where nothing is
    /// hit. `None` where the scene does not know it, or where the image was resized: distances cannot be averaged.
    pub depth: Option<Arc<[f32]>>,
    /// Pixels that masked metrics use, row-major: those of the object in DTU, those of the person in ZJU-MoCap, and
    /// those that a capture's mask keeps. `None` without a mask.
    pub mask: Option<Arc<[bool]>>,
    /// Pixels for training and comparison, row-major: they belong to the photograph, their ray is known, and no mask
    /// leaves them out. `None` if all do.
    pub valid: Option<Arc<[bool]>>,
}

impl View {
    /// Returns a view of a PNG called `name`, with all pixels valid and without depth or mask.
    pub fn new(id: usize, name: impl Into<String>, camera: Camera, image: impl Into<Arc<Image>>) -> Self {
        let name = name.into();
        let file = format!("{name}.png");
        Self { id, name, file, camera, image: image.into(), depth: None, mask: None, valid: None }
    }

    /// Returns the view with pixels `factor` times as wide, each the mean over the area that it covers, and without
    /// depth: distances cannot be averaged.
    pub fn reduced(&self, factor: u32) -> Self {
        self.resized((self.image.width.max(self.image.height) / factor.max(1)).max(1))
    }

    /// Returns the view reduced to `longest` pixels on its longest side, as by [`Self::reduced`].
    pub fn resized(&self, longest: u32) -> Self {
        let from = (self.image.width, self.image.height);
        let size @ (width, height) = resized_dimensions(from.0, from.1, longest);
        let resized = |mask: &Option<Arc<[bool]>>| mask.as_ref().map(|mask| resized_mask(mask, from, size).into());
        Self {
            camera: self.camera.resized(width, height),
            image: Arc::new(self.image.resized(width, height)),
            depth: None,
            mask: resized(&self.mask),
            valid: resized(&self.valid),
            ..self.clone()
        }
    }
}

/// Training and test views with what is known of the space between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The folder's or the procedural scene's name.
    pub name: String,
    /// The chosen training views, in the order of the selection. All have one size.
    pub train: Vec<View>,
    /// The chosen test views, of the same size.
    pub test: Vec<View>,
    /// Format that the scene was loaded from.
    pub format: Format,
    /// Colour of a ray that meets nothing, display-encoded RGB in `[0, 1]`: the colour behind transparent pixels, or
    /// for photographs without a known backdrop the mean colour of the training views.
    pub background: [f32; 3],
    /// Whether `background` is the true colour behind the content.
    pub backdrop: Backdrop,
    /// Extent of the content, and arrangement of the cameras around it.
    pub space: Space,
    /// Cameras of all training views, chosen or not, at the scene's image size. Only images of chosen views are read.
    pub all_train_cameras: Vec<Camera>,
    /// Exact cameras of `train` if these were [disturbed](Scene::disturbed), in the frame of the test views.
    pub exact_cameras: Option<Vec<Camera>>,
    /// Cameras of `train` before matches between photographs refined them; `None` if they were not refined.
    pub unrefined_cameras: Option<Vec<Camera>>,
    /// Position of the scene's origin in the coordinates of its files; 0 unless the files' coordinates are too far from
    /// 0 for the precision of `f32`. Exports add it.
    pub origin: DVec3,
    /// Lines about the data for a person to read: changes that loading made, and doubts.
    pub warnings: Vec<String>,
    /// Lines about the data that are no reason for doubt, such as changes of the cameras.
    pub notes: Vec<String>,
}

impl Default for Scene {
    /// Returns a scene without views, with the space of NeRF's synthetic scenes.
    fn default() -> Self {
        Self {
            name: String::new(),
            train: Vec::new(),
            test: Vec::new(),
            format: Format::default(),
            background: [1.0; 3],
            backdrop: Backdrop::default(),
            space: Space::default(),
            all_train_cameras: Vec::new(),
            exact_cameras: None,
            unrefined_cameras: None,
            origin: DVec3::ZERO,
            warnings: Vec::new(),
            notes: Vec::new(),
        }
    }
}

impl Scene {
    /// Moves every principal point by half a pixel, so that the ray of a pixel goes through its corner, `(x, y)`, in place
    /// of its centre, `(x + 0.5, y + 0.5)`.
    #[must_use]
    pub fn with_rays_through_corners(mut self) -> Self {
        let views = self.train.iter_mut().chain(&mut self.test).map(|view| &mut view.camera);
        for camera in views.chain(&mut self.all_train_cameras) {
            camera.cx += 0.5;
            camera.cy += 0.5;
        }
        self
    }

    /// Returns the distances `(near, far)` between which content lies along `ray`, `0 ≤ near < far`; `None` without content.
    pub fn interval(&self, ray: &Ray) -> Option<(f32, f32)> {
        self.space.range.along(ray)
    }

    /// Returns the cameras of `train` as they are now, refined or not.
    pub fn training_cameras(&self) -> Vec<Camera> {
        self.train.iter().map(|view| view.camera.clone()).collect()
    }

    /// Returns the cameras of `train` as they were given.
    pub fn given_cameras(&self) -> Vec<Camera> {
        self.unrefined_cameras.clone().unwrap_or_else(|| self.training_cameras())
    }

    /// Returns the number of pixels of the scene's views.
    pub fn pixels(&self) -> PixelCount {
        let of = |views: &[View]| views.iter().map(|view| view.image.rgb.len() as u64).sum();
        PixelCount { views: self.train.len(), train: of(&self.train), test: of(&self.test) }
    }

    /// Returns the scene with the mean colour of its training views as background if what lies behind its content is
    /// unknown: the one colour that is nearest to all of their pixels in squared error.
    pub fn with_guessed_background(mut self) -> Self {
        if self.backdrop == Backdrop::Unknown {
            self.background = mean_color(&self.train);
        }
        self
    }
}

/// Returns the mean colour of all valid pixels of `views`; white if there are none.
fn mean_color(views: &[View]) -> [f32; 3] {
    let (mut sum, mut count) = (DVec3::ZERO, 0usize);
    for view in views {
        let is_valid = |i: usize| view.valid.as_ref().is_none_or(|valid| valid[i]);
        for (_, &pixel) in view.image.rgb.iter().enumerate().filter(|(i, _)| is_valid(*i)) {
            count += 1;
            sum += Vec3::from(pixel).as_dvec3();
        }
    }
    if count == 0 { [1.0; 3] } else { (sum / count as f64).as_vec3().to_array() }
}

/// Numbers of chosen views and of their pixels, which decide how much memory a scene takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelCount {
    /// Number of training views.
    pub views: usize,
    /// Pixels of all training views together.
    pub train: u64,
    /// Pixels of all test views together.
    pub test: u64,
}

impl PixelCount {
    /// Counts the pixels of `train` and `test` views of one size.
    pub fn new((width, height): (u32, u32), train: usize, test: usize) -> Self {
        let each = u64::from(width) * u64::from(height);
        Self { views: train, train: each.saturating_mul(train as u64), test: each.saturating_mul(test as u64) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_backgrounds_become_the_mean_of_valid_pixels() {
        let mut image = Image::filled(2, 1, [0.25; 3]);
        image.rgb[1] = [0.75; 3];
        let view = View::new(0, "a", Camera::from_fov(2, 1, 1.0, glam::DMat4::IDENTITY), image);
        let background = |backdrop, valid: [bool; 2]| {
            let view = View { valid: Some(valid.into()), ..view.clone() };
            Scene { train: vec![view], backdrop, ..Scene::default() }.with_guessed_background().background
        };
        assert_eq!(background(Backdrop::Unknown, [true, true]), [0.5; 3]);
        assert_eq!(background(Backdrop::Unknown, [true, false]), [0.25; 3]);
        assert_eq!(background(Backdrop::Unknown, [false, false]), [1.0; 3]);
        assert_eq!(background(Backdrop::Colour, [true, false]), Scene::default().background);
    }

    #[test]
    fn a_reduced_view_sees_the_same() {
        let pose = glam::DMat4::IDENTITY;
        let mut image = Image::filled(4, 2, [0.25; 3]);
        image.rgb[0] = [1.0, 0.25, 0.25];
        let view = View {
            depth: Some(vec![1.0; 8].into()),
            mask: Some(vec![true, true, false, false, true, false, false, true].into()),
            ..View::new(0, "a", Camera::from_fov(4, 2, 1.0, pose), image)
        };
        let half = view.reduced(2);
        assert_eq!(half.image.rgb, [[0.4375, 0.25, 0.25], [0.25; 3]]);
        assert_eq!(half.mask.unwrap()[..], [true, false], "a pixel counts if half of it does");
        assert_eq!((half.camera, half.depth), (Camera::from_fov(2, 1, 1.0, pose), None));
        assert_eq!(view.reduced(100).image.rgb.len(), 1, "never less than a pixel");
    }
}
