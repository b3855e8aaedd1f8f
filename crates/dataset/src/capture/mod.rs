//! Capture pipeline: from what a loader found in a folder to a [`Scene`](infonerf_scene::Scene).
//!
//! A capture is examined before anything is trained on it. [`Found::prepared`] turns images and cameras as EXIF
//! states, finds masks, leaves out cameras that are far from all others, moves the middle of a distant world to the
//! origin, and estimates where the content lies. [`assemble`] brings the chosen images to one scale, and [`compare`]
//! checks the poses against matches between the photographs. Changes and doubts are lines of the scene's warnings.

mod assemble;
mod compare;
mod extent;
mod mask;
mod plausible;
mod sizes;

pub(crate) use assemble::{MAX_BYTES, assemble, count_pixels, in_order, scene_name};
pub(crate) use compare::compare;
pub(crate) use extent::{capture_space, frusta_bounds, grid, join_names, some_of};
pub(crate) use mask::{IMAGE_FOLDERS, list_photographs, mask_of, read_mask, read_stored_mask, stray_masks};

use std::path::Path;

use glam::DVec3;
use infonerf_scene::image::{orientation, quarter_turns, stored_dimensions};
use infonerf_scene::select::pool::Named;
use infonerf_scene::{Aabb, Camera, Format, SceneError, Space, TestProtocol};

use crate::frame::{Frame, Intrinsics, cameras_of, numbered, with_images};

/// One view in this many is held out for test, starting with the first.
const HOLD_OUT: usize = 8;
/// Max relative difference between proportions that counts as rounding of image sides.
const SAME_PROPORTIONS: f64 = 0.01;

/// Contents of a scene's folder as its loader read them, with no image decoded.
pub(crate) struct Found<'a> {
    pub dir: &'a Path,
    pub format: Format,
    pub train: Vec<Frame>,
    pub test: Vec<Frame>,
    /// Ids of the test frames that are the format's own test split; `None` if all are.
    pub split: Option<Vec<usize>>,
    pub selections: Named,
    pub protocols: Named,
    pub extent: StatedExtent,
    /// Whether cameras of images that EXIF data mirror are for the images as they are shown.
    pub fits_shown: bool,
    /// Colour that mattes are composited on, if the format defines it.
    pub background: Option<[f32; 3]>,
    pub warnings: Vec<String>,
    /// Lines that are no reason for doubt.
    pub notes: Vec<String>,
}

/// Extent of the content, as far as a format states it.
pub(crate) enum StatedExtent {
    /// Complete: near, far, box and layout are known.
    Known(Box<Space>),
    /// The nearest and the farthest depth along the viewing axes.
    Depths(f32, f32),
    /// Partial or nothing: the rest is estimated from cameras and points.
    Estimated(Estimate),
}

#[derive(Default)]
pub(crate) struct Estimate {
    pub points: Vec<DVec3>,
    pub range: Option<(f32, f32)>,
    pub bounds: Option<Aabb>,
    /// Whether images show one object on a transparent background.
    pub transparent: bool,
}

pub(crate) struct Capture<'a> {
    pub found: Found<'a>,
    pub space: Space,
    /// Position of the scene's origin in the coordinates of the capture's files.
    pub origin: DVec3,
}

impl<'a> Found<'a> {
    /// Makes the contents of a folder without names for views and without warnings. All test frames are the test split.
    pub fn new(dir: &'a Path, format: Format, train: Vec<Frame>, test: Vec<Frame>, extent: StatedExtent) -> Self {
        let (selections, protocols, warnings, notes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (split, background, fits_shown) = (None, None, false);
        Self { dir, format, train, test, split, selections, protocols, extent, fits_shown, background, warnings, notes }
    }

    /// Makes the contents of a folder without a split: frames without their image are left out, with a warning, and
    /// every eighth of the others is held out for test.
    pub fn captured(dir: &'a Path, format: Format, frames: Vec<Frame>, test: &TestProtocol, known: Estimate) -> Self {
        let (frames, warning) = with_images(frames);
        let (train, test) = hold_out(frames, test);
        let found = Self::new(dir, format, numbered(train), numbered(test), StatedExtent::Estimated(known));
        Self { warnings: warning.into_iter().collect(), ..found }
    }

    /// Rotates frames by EXIF data, finds masks, removes outlier cameras, moves a distant origin, and derives the space.
    pub fn prepared(mut self) -> Result<Capture<'a>, SceneError> {
        self.turn();
        self.warnings.extend(mask::find_masks(self.dir, self.format, &mut self.train, &mut self.test));
        let mut origin = DVec3::ZERO;
        if let StatedExtent::Estimated(estimate) = &mut self.extent {
            self.warnings.extend(extent::leave_out(&mut self.train, &mut self.test));
            if let Some(middle) = extent::distant_middle(&self.train) {
                origin = middle;
                let frames = self.train.iter_mut().chain(&mut self.test);
                frames.for_each(|frame| frame.pose.w_axis -= middle.extend(0.0));
                estimate.points.iter_mut().for_each(|point| *point -= middle);
                let moved = |corner: glam::Vec3| (corner.as_dvec3() - middle).as_vec3();
                estimate.bounds = estimate.bounds.map(|Aabb { min, max }| Aabb { min: moved(min), max: moved(max) });
                self.warnings.push(format!(
                    "the world's origin is far from the cameras: ({:.3}, {:.3}, {:.3}) is taken off all coordinates, and \
                     added again in exported cameras",
                    middle.x, middle.y, middle.z
                ));
            }
        }
        Ok(Capture { space: self.space(&cameras_of(&self.train)?)?, found: self, origin })
    }

    /// Rotates each camera that is for the stored pixels of an image which EXIF data rotate, since images are decoded upright.
    ///
    /// A stated size decides whether a camera is for the stored pixels or the upright image. If it fits both (square images,
    /// half turns), cameras of JSON files are taken for the upright image, and those of other formats for the stored pixels.
    fn turn(&mut self) {
        let by_stored = self.is_by_stored();
        let (mut doubtful, mut mirrored) = (Vec::new(), Vec::new());
        let all = self.train.len() + self.test.len();
        for frame in self.train.iter_mut().chain(&mut self.test) {
            let Some(quarters) = quarter_turns(orientation(&frame.image)) else {
                mirrored.extend((!self.fits_shown).then_some(&*frame.name));
                continue;
            };
            let stored = if quarters > 0 { stored_dimensions(&frame.image).ok() } else { None };
            let Some((width, height)) = stored else { continue };
            let shown = if quarters == 2 { (width, height) } else { (height, width) };
            let fits = |size: (u32, u32)| frame.stated_size().is_none_or(|stated| same_proportions(stated, size));
            let is_either = fits((width, height)) && fits(shown);
            if fits((width, height)) && (by_stored || !is_either) {
                let camera = frame.camera(width, height).turned(quarters);
                (frame.pose, frame.lens, frame.intrinsics) = (camera.to_world, camera.lens, Intrinsics::of(&camera));
            } else if is_either {
                doubtful.push(&*frame.name);
            }
        }
        let turned = "images turned by EXIF data, whose cameras are taken for the images as they are shown";
        self.warnings.extend(some_of(&mirrored, all, "images mirrored by EXIF data, whose cameras may not fit"));
        self.warnings.extend(some_of(&doubtful, all, turned));
    }

    /// Whether cameras are for the stored pixels of images that EXIF data turn, if no size tells.
    fn is_by_stored(&self) -> bool {
        !matches!(self.format, Format::Blender | Format::Transforms)
    }

    /// Derives the space from the training cameras and the extent that the format states.
    fn space(&mut self, cameras: &[Camera]) -> Result<Space, SceneError> {
        let estimate = match &self.extent {
            StatedExtent::Known(space) => return Ok(Space::clone(space)),
            StatedExtent::Depths(near, far) => {
                let expected = "poses and depths with finite bounds";
                let space = extent::space_of_depths(cameras, (*near, *far));
                return space.ok_or_else(|| SceneError::malformed(self.dir, expected, "no finite bounds"));
            }
            StatedExtent::Estimated(estimate) => estimate,
        };
        let all = || self.train.iter().chain(&self.test);
        let unseen = !estimate.points.is_empty() && all().all(|frame| frame.points.is_empty());
        if unseen && !self.test.is_empty() {
            let fault = "the reconstruction does not say who sees a point";
            self.warnings.push(format!("{fault}: those of test photographs shape the space too"));
        }
        let mut is_seen = vec![unseen; estimate.points.len()];
        self.train.iter().flat_map(|frame| &frame.points).for_each(|&point| is_seen[point] = true);
        let seen = estimate.points.iter().zip(is_seen).filter(|(_, seen)| *seen);
        let points = seen.map(|(point, _)| point.as_vec3()).collect();
        let distances = self.train.iter().flat_map(|frame| {
            let position = frame.pose.w_axis.truncate();
            frame.points.iter().map(move |&point| estimate.points[point].distance(position) as f32)
        });
        let space = if estimate.transparent {
            extent::object_space(cameras)
        } else {
            capture_space(cameras, points, distances.collect())
        };
        Ok(space.with(estimate.range, estimate.bounds))
    }
}

/// Splits views into a training and a test pool: views 0, 8, 16, … are for test. All are for training if there is only
/// one, or if `protocol` tests training views.
pub(crate) fn hold_out<T>(views: Vec<T>, protocol: &TestProtocol) -> (Vec<T>, Vec<T>) {
    let alone = views.len() == 1 || *protocol == TestProtocol::Training;
    let mut places = 0..views.len();
    views.into_iter().partition(|_| places.next().is_none_or(|i| alone || i % HOLD_OUT > 0))
}

/// Whether two image sizes have the same proportions, up to rounding.
pub(crate) fn same_proportions(a: (u32, u32), b: (u32, u32)) -> bool {
    let ratio = f64::from(a.0) * f64::from(b.1) / (f64::from(a.1) * f64::from(b.0));
    (ratio - 1.0).abs() <= SAME_PROPORTIONS
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::{DMat4, Vec3};
    use infonerf_scene::{Backdrop, Layout, Scene, SceneRequest, View, ViewSelection};

    use super::*;
    use crate::colmap::ColmapCamera;
    use crate::colmap::testing::{reconstruction, write_text};
    use crate::loaders::testing::*;

    fn cameras(count: usize) -> Vec<Camera> {
        infonerf_procedural::train_cameras(16)[..count].to_vec()
    }

    fn loaded(cameras: &[Camera]) -> Scene {
        load(photographs(cameras).path(), &request()).unwrap()
    }

    /// Checks that photographs in the file layout of NeRF's synthetic scenes load as in nerfstudio's layout.
    #[test]
    fn constants_of_a_data_set_apply_to_that_alone() {
        let around: Vec<Camera> = cameras(10).iter().map(|camera| moved(camera, |p| 0.95 * p)).collect();
        let guard = photographs(&around);
        let dir = guard.path();
        let as_capture = load(dir, &request()).unwrap();
        fs::rename(dir.join("transforms.json"), dir.join("transforms_train.json")).unwrap();
        let as_blender = load(dir, &request()).unwrap();
        assert_eq!((&as_blender.space, as_blender.test.len()), (&as_capture.space, as_capture.test.len()));
        assert_eq!(as_blender.backdrop, as_capture.backdrop);
        assert!(as_blender.space.near < 1.0 && as_blender.warnings[0].contains("estimated from the cameras"));
        assert!(as_blender.warnings[1].contains("every eighth training view is held out"), "{:?}", as_blender.warnings);
        let exact = dir.join("blender");
        blender(&exact, 8, 2);
        let published = load(&exact, &request()).unwrap();
        assert_eq!((published.space.near, published.space.far, published.warnings.len()), (2.0, 6.0, 0));
    }

    #[test]
    fn worlds_far_from_their_origin_keep_their_detail() {
        let far = DVec3::new(448_262.25, 4_649_776.5, 85.0);
        let near = loaded(&cameras(10));
        let scene = loaded(&cameras(10).iter().map(|camera| moved(camera, |p| p + far)).collect::<Vec<_>>());
        assert!(near.origin == DVec3::ZERO && near.warnings.is_empty());
        assert!(scene.origin.distance(far) < 10.0 && scene.warnings[0].contains("is taken off all coordinates"));
        let shift = scene.origin - far;
        for (moved, exact) in scene.train.iter().zip(&near.train) {
            let off = moved.camera.position_f64() + shift - exact.camera.position_f64();
            assert!(off.length() < 1e-8, "{off}");
        }
        assert!((scene.space.near - near.space.near).abs() < 0.01 && (scene.space.far - near.space.far).abs() < 0.05);
        // Exports add the origin.
        let x = crate::transforms(&scene)["frames"][0]["transform_matrix"][0][3].as_f64().unwrap();
        assert!((x - far.x - near.train[0].camera.position_f64().x).abs() < 1e-8);
    }

    #[test]
    fn cameras_far_from_all_others_are_left_out_and_named() {
        let exact = loaded(&cameras(26));
        for (index, times) in [(5, 10.0), (5, 100.0), (8, 10.0)] {
            let mut all = cameras(26);
            all[index] = moved(&all[index], |p| times * p);
            let scene = loaded(&all);
            assert!(scene.warnings[0].contains(&format!("images/p{index:02}")), "{:?}", scene.warnings);
            assert_eq!(scene.train.len() + scene.test.len(), 25);
            let known = |view: &&View| exact.train.iter().any(|other| (other.id, &other.name) == (view.id, &view.name));
            assert_eq!(scene.train.iter().filter(known).count(), scene.train.len(), "views keep their numbers");
            let (a, b) = (&scene.space, &exact.space);
            assert!((a.near / b.near - 1.0).abs() < 0.05 && (a.far / b.far - 1.0).abs() < 0.05, "{a:?}");
            assert!(a.centre.distance(b.centre) < 0.05 && (a.radius / b.radius - 1.0).abs() < 0.05, "{a:?}");
        }
        let mut few = cameras(5);
        few[2] = moved(&few[2], |p| 100.0 * p);
        let scene = loaded(&few);
        assert!(scene.train.len() == 4 && scene.warnings[0].ends_with("right?): images/p02"), "{:?}", scene.warnings);
    }

    #[test]
    fn images_of_all_sizes_make_one_scene() {
        let pose = |i: usize| cameras(10)[i].to_world;
        let upright = Camera::pinhole((12, 16), [22.0; 2], [6.0, 8.0], DMat4::IDENTITY);
        let lying = Camera::pinhole((16, 12), [22.0; 2], [8.0, 6.0], DMat4::IDENTITY);
        let all: Vec<Camera> = (0..10).map(|i| if i % 3 == 0 { &upright } else { &lying }.with_pose(pose(i))).collect();
        let scene = loaded(&all);
        assert_warns(&scene, 0, "images of several sizes (6 of 16×12, 4 of 12×16)");
        for view in scene.train.iter().chain(&scene.test) {
            let index: usize = view.name[8..].parse().unwrap();
            let own = &all[index];
            assert_eq!((view.camera.width, view.camera.height, view.image.width, view.image.height), (16, 16, 16, 16));
            let (left, top) = ((16 - own.width) / 2, (16 - own.height) / 2);
            let valid = view.valid.as_ref().unwrap();
            assert_eq!(valid.iter().filter(|valid| **valid).count(), 192);
            let shown = infonerf_procedural::render("knot", own).unwrap().rgba.to_f32().composite([1.0; 3]).rounded();
            for (x, y) in [(0, 0), (5, 7), (own.width - 1, own.height - 1)] {
                let (found, exact) = (view.image.get(left + x, top + y).unwrap(), shown.get(x, y).unwrap());
                assert!(found.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-6));
                assert!(valid[((top + y) * 16 + left + x) as usize]);
                let (a, b) = (own.ray(x as f32, y as f32), view.camera.ray((left + x) as f32, (top + y) as f32));
                assert!(a.direction.distance(b.direction) < 1e-6);
            }
        }
        assert_eq!(scene.space.layout, Layout::Object);
    }

    #[test]
    fn a_pixel_that_undistortion_cuts_off_does_not_matter() {
        let whole = Camera::pinhole((100, 100), [140.0; 2], [50.0; 2], DMat4::IDENTITY);
        let all: Vec<Camera> = cameras(4).iter().map(|camera| whole.with_pose(camera.to_world)).collect();
        let guard = photographs(&all);
        write_view(&guard.path().join("images/p02.png"), &Camera { height: 99, ..all[2].clone() });
        let scene = load(guard.path(), &request()).unwrap();
        let view = scene.train.iter().find(|view| view.name == "images/p02").unwrap();
        assert_same_rays(&view.camera, &all[2]);
        assert!(view.valid.as_ref().is_some_and(|valid| !valid[9900] && valid[0]));
    }

    #[test]
    fn images_and_cameras_are_turned_as_exif_states() {
        let lens = Camera::pinhole((16, 24), [30.0; 2], [7.0, 13.0], DMat4::IDENTITY);
        let all: Vec<Camera> = cameras(9).iter().map(|camera| lens.with_pose(camera.to_world)).collect();
        let upright = loaded(&all);
        let guard = photographs(&all);
        // JPEGs of a camera that was held upright; their pixels are stored rotated by 90°.
        for i in 0..all.len() {
            let from = guard.path().join(format!("images/p{i:02}.png"));
            let to = from.with_extension("jpg");
            image::open(&from).unwrap().rotate270().save(&to).unwrap();
            fs::remove_file(from).unwrap();
            set_orientation(&to, 6);
        }
        // Poses for upright images.
        let shown = load(guard.path(), &request()).unwrap();
        // Poses for the stored pixels, as COLMAP finds them.
        let stored: Vec<Camera> = all.iter().map(|camera| camera.turned(3)).collect();
        fs::remove_file(guard.path().join("transforms.json")).unwrap();
        let lens = &stored[0];
        let parameters = vec![lens.fx, lens.fy, lens.cx, lens.cy];
        let camera = ColmapCamera::new(guard.path(), "camera", 1, (lens.width, lens.height), parameters).unwrap();
        let all = reconstruction(camera, &stored, |i| format!("p{i:02}.jpg"));
        write_text(&guard.path().join("sparse/0"), &all);
        let turned = load(guard.path(), &request()).unwrap();
        let about_exif = |scene: &Scene| scene.warnings.iter().any(|warning| warning.contains("EXIF"));
        assert!(!about_exif(&shown) && !about_exif(&turned), "sizes tell {:?} {:?}", shown.warnings, turned.warnings);
        for ((a, b), exact) in shown.train.iter().zip(&turned.train).zip(&upright.train) {
            for view in [a, b] {
                assert_same_rays(&view.camera, &exact.camera);
                let apart = view.image.rgb.iter().zip(&exact.image.rgb).map(|(a, b)| (a[0] - b[0]).abs()).sum::<f32>();
                assert!(apart / 384.0 < 0.05, "{apart}");
            }
        }
        let third = guard.path().join("images/p03.jpg");
        image::open(&third).unwrap().save(&third).unwrap();
        set_orientation(&third, 2);
        assert_warns(
            &load(guard.path(), &request()).unwrap(),
            0,
            "1 of 9 images mirrored by EXIF data, whose cameras may not fit: p03",
        );
    }

    #[test]
    fn copies_of_training_photographs_are_not_tested() {
        let mut all = cameras(10);
        all.extend([all[8].clone(), all[3].clone()]);
        let guard = photographs(&all);
        let scene = load(guard.path(), &request()).unwrap();
        assert_eq!(scene.test.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["images/p00"]);
        let copy = "1 of 10 training views show the photograph of another one, with a camera of their own: images/p11.png of \
                    images/p03.png";
        assert_warns(&scene, 0, copy);
        assert_warns(&scene, 1, "images/p08.png is a copy of images/p10.png, which is trained on: it is not tested");
        // A copy with other tones is known by its camera, and is none if that is moved as between frames of a video.
        let path = guard.path().join("images/p10.png");
        image::open(&path).unwrap().brighten(20).save(&path).unwrap();
        assert_warns(&load(guard.path(), &request()).unwrap(), 1, "images/p08.png is a copy of images/p10.png");
        let x = (all[10].position_f64().x + 0.04).into();
        edit(&guard.path().join("transforms.json"), "/frames/10/transform_matrix/0/3", Some(x));
        assert_eq!(load(guard.path(), &request()).unwrap().test.len(), 2);
        // Views are chosen by the names of their images, too.
        let named = |names: &str| SceneRequest { train: names.parse().unwrap(), ..request() };
        let scene = load(guard.path(), &named("p06,images/p02,p05.png")).unwrap();
        let names: Vec<_> = scene.train.iter().map(|view| view.file.as_str()).collect();
        assert_eq!(names, ["images/p06.png", "images/p02.png", "images/p05.png"]);
        let text = message(guard.path(), &named("p06,p77"));
        assert!(text.contains("names of training images, such as images/p01, found `p77`"), "{text}");
        fs::rename(guard.path().join("images/p05.png"), guard.path().join("images/p05,p06.png")).unwrap();
        edit(&guard.path().join("transforms.json"), "/frames/5/file_path", Some("images/p05,p06.png".into()));
        assert_eq!(load(guard.path(), &named("p05,p06")).unwrap().train[0].file, "images/p05,p06.png");
        fs::rename(guard.path().join("images/p05,p06.png"), guard.path().join("p06.png")).unwrap();
        edit(&guard.path().join("transforms.json"), "/frames/5/file_path", Some("p06.png".into()));
        let text = message(guard.path(), &named("p06.png"));
        assert!(text.ends_with("such as p06, images/p06, found `p06.png`, which several have"), "{text}");
    }

    #[test]
    fn an_alpha_channel_that_hides_nothing_is_no_matte() {
        let cameras = infonerf_procedural::photographs("room", 16, 10);
        let guard = photographs_of("room", &cameras, &cameras, |i| format!("images/p{i:02}.png"));
        let plain = load(guard.path(), &request()).unwrap();
        let with_alpha = |alpha: u8| {
            for path in infonerf_scene::image::list_images(&guard.path().join("images")).unwrap() {
                let mut image = image::open(&path).unwrap().into_rgba8();
                image.get_pixel_mut(0, 0).0[3] = alpha;
                image.save(&path).unwrap();
            }
            (load(guard.path(), &request()).unwrap(), crate::info(guard.path()).unwrap().backdrop)
        };
        assert!(plain.backdrop == Backdrop::Unknown && with_alpha(255) == (plain, Some(Backdrop::Unknown)));
        let (cut, backdrop) = with_alpha(0);
        assert_eq!((cut.backdrop, backdrop), (Backdrop::Colour, Some(Backdrop::Colour)));
        let opaque = guard.path().join("images/p03.png");
        image::open(&opaque).unwrap().into_rgb8().save(&opaque).unwrap();
        assert_warns(&load(guard.path(), &request()).unwrap(), 0, "images with transparency: 9, without: 1, such as ");
    }

    #[test]
    fn missing_photographs_are_passed_over_unless_they_are_asked_for() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("toy");
        blender(&dir, 6, 3);
        fs::remove_file(dir.join("train/r_4.png")).unwrap();
        fs::remove_file(dir.join("test/r_1.png")).unwrap();
        let scene = load(&dir, &request()).unwrap();
        assert_eq!(scene.train.iter().map(|view| view.id).collect::<Vec<_>>(), [0, 1, 2, 3, 5]);
        assert_eq!(scene.test.iter().map(|view| view.id).collect::<Vec<_>>(), [0, 2]);
        assert!(scene.warnings[0].contains("r_4.png") && scene.warnings[1].contains("r_1.png"), "{:?}", scene.warnings);
        let asked = |id: usize| SceneRequest { train: ViewSelection::Ids { ids: vec![id] }, ..request() };
        assert!(message(&dir, &asked(4)).contains("r_4.png: not found"));
        // Images that are not chosen need not be there.
        fs::remove_file(dir.join("train/r_0.png")).unwrap();
        let scene = load(&dir, &asked(2)).unwrap();
        assert_eq!((scene.train[0].id, scene.all_train_cameras.len()), (2, 6));
        fs::copy(dir.join("transforms_train.json"), dir.join("transforms_test.json")).unwrap();
        fs::remove_dir_all(dir.join("train")).unwrap();
        assert!(message(&dir, &request()).contains("r_0.png: not found"));
    }

    #[test]
    fn points_far_out_do_not_move_the_box() {
        let around = infonerf_procedural::train_cameras(20);
        let point = |i: usize| Vec3::new((i as f32 * 0.37).sin(), (i as f32 * 0.91).cos(), (i as f32 * 0.53).sin());
        let near: Vec<Vec3> = (0..300).map(point).collect();
        let far: Vec<Vec3> = near.iter().copied().chain((0..30).map(|i| 2000.0 * point(i))).collect();
        let distances = |points: &[Vec3]| -> Vec<f32> {
            around.iter().flat_map(|camera| points.iter().map(|p| p.distance(camera.position()))).collect()
        };
        let exact = capture_space(&around, near.clone(), distances(&near));
        let found = capture_space(&around, far.clone(), distances(&far));
        assert!((found.far / exact.far - 1.0).abs() < 0.01 && found.bounds.size().distance(exact.bounds.size()) < 0.1);
    }

    #[test]
    fn every_eighth_is_held_out() {
        let (train, test) = hold_out((0..20).collect(), &TestProtocol::All);
        assert_eq!(test, [0, 8, 16]);
        assert_eq!(train.len(), 17);
        assert_eq!(hold_out(vec![7], &TestProtocol::All), (vec![7], vec![]));
        assert_eq!(hold_out(vec![7, 8], &TestProtocol::Training), (vec![7, 8], vec![]));
    }
}
