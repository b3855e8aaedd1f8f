//! Cameras of a scene, refined by `infonerf-sfm`.

use glam::{DMat3, DVec2, DVec3};
use infonerf_scene::{Camera, PoseError, Scene, View};
use infonerf_sfm::{Grey, Pose, Posed, Settings, Uncertainty, refine};

use crate::colmap::opengl;

/// How far given cameras are thought to be off: radians, shares of the mean distance from the scene's centre, and shares of
/// the focal length.
const TURN: f64 = 2.0 * std::f64::consts::PI / 180.0;
const SHIFT: f64 = 0.03;
const FOCAL: f64 = 0.05;

/// `scene` with training cameras as matches between the training photographs correct them: bundle adjustment that begins at
/// the given cameras and is weakly drawn to them ([`infonerf_sfm::refine`]), for all focal lengths one factor with `focal`.
/// No test view has a part in it.
///
/// The pull also fixes the frame: no similarity of all refined cameras would be nearer to the given ones, in these deviations.
/// A camera whose photograph shares too few points with others stays as it is, which [`Scene::warnings`] say. The given cameras
/// are kept in [`Scene::unrefined_cameras`].
#[must_use]
pub fn with_refined_cameras(mut scene: Scene, focal: bool) -> Scene {
    let given = scene.given_cameras();
    let count = given.len().max(1) as f64;
    let mean = |of: &dyn Fn(&Camera) -> f64| given.iter().map(of).sum::<f64>() / count;
    let centre = scene.space.centre.as_dvec3();
    let uncertainty = Uncertainty {
        turn: TURN,
        shift: SHIFT * mean(&|camera| camera.position_f64().distance(centre)).max(1e-6),
        focal: if focal { FOCAL } else { 0.0 },
    };
    let unproject: Vec<_> = scene.train.iter().map(|view| move |pixel| point_at_depth_one(view, pixel)).collect();
    let posed = scene.train.iter().zip(&unproject).map(|(view, unproject)| {
        let image = Grey::of_rgb(view.image.width as usize, view.image.height as usize, view.image.rgb.iter().copied());
        Posed { image, pose: pose(&view.camera), unproject }
    });
    let pixels = mean(&|camera| (camera.fx * camera.fy).sqrt());
    let found = refine(&posed.collect::<Vec<_>>(), pixels, uncertainty, &Settings::default());
    let stayed = |(view, pose): (&View, &Result<Pose, String>)| {
        pose.as_ref().err().map(|reason| format!("the camera of {} stays as given: {reason}", view.name))
    };
    let stayed: Vec<String> = scene.train.iter().zip(&found.poses).filter_map(stayed).collect();
    for (view, pose) in scene.train.iter_mut().zip(&found.poses) {
        if let Ok(pose) = pose {
            view.camera = refocused(&view.camera, found.focal, pose);
        }
    }
    let now: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
    let by = PoseError::of(&now, &given, centre);
    scene.warnings.push(format!(
        "{} of {} training cameras were refined by {} points that their photographs share: by {:.2}° and {:.2} % of their \
         distance",
        given.len() - stayed.len(),
        given.len(),
        found.points.len(),
        by.rotation_deg,
        by.translation_percent
    ));
    scene.warnings.extend(stayed);
    scene.unrefined_cameras = Some(given);
    scene
}

/// `(x, y) / z` of what a view sees at a pixel, if it is to be looked at.
fn point_at_depth_one(view: &View, pixel: DVec2) -> Option<DVec2> {
    let Camera { width, height, fx, fy, cx, cy, ref lens, .. } = view.camera;
    let [x, y] = [(pixel.x, width), (pixel.y, height)].map(|(v, size)| (v as usize).min(size as usize - 1));
    let valid = view.valid.as_ref().is_none_or(|valid| valid[y * width as usize + x]);
    lens.undistort(DVec2::new((pixel.x - cx) / fx, (pixel.y - cy) / fy)).filter(|_| valid)
}

/// From camera-to-world in OpenGL's axes to world-to-camera in those of computer vision.
fn pose(camera: &Camera) -> Pose {
    let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * camera.rotation().transpose();
    Pose { rotation, translation: -(rotation * camera.position_f64()) }
}

/// `camera` in another place, with focal lengths `factor` times as long.
fn refocused(camera: &Camera, factor: f64, pose: &Pose) -> Camera {
    let to_world = opengl(pose.rotation.transpose(), pose.centre());
    Camera { fx: factor * camera.fx, fy: factor * camera.fy, ..camera.with_pose(to_world) }
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{SceneRequest, TestProtocol, ViewSelection};

    use super::*;
    use crate::loaders::testing::shared_data;
    use crate::{SceneSource, load};

    /// The errors of given cameras and of refined ones, of which there are so many.
    fn errors(scene: Scene, focal: bool) -> (PoseError, PoseError, usize) {
        let centre = scene.space.centre.as_dvec3();
        let exact = scene.exact_cameras.clone().unwrap();
        let error = |scene: &Scene| {
            let cameras: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
            PoseError::of(&cameras, &exact, centre)
        };
        let before = error(&scene);
        let refined = with_refined_cameras(scene, focal);
        let stayed = refined.warnings.iter().filter(|line| line.contains("stays")).count();
        (before, error(&refined), exact.len() - stayed)
    }

    /// Prints the errors in the tables of docs/cameras.md.
    #[test]
    #[ignore = "needs published captures: INFONERF_DATA=DIR"]
    fn cameras_of_published_captures() {
        let told = std::env::var_os("INFONERF_LINES").is_some();
        let llff = |name: &str| (SceneSource::Folder { path: shared_data(&format!("nerf_llff_data/{name}")) }, false);
        let built_in = |name: &str| (SceneSource::Procedural(name.into()), true);
        let only = std::env::var("SCENES").unwrap_or_default();
        let size = std::env::var("SIZE").map_or(300, |s| s.parse().unwrap());
        let scenes = [
            llff("fern"),
            llff("flower"),
            llff("room"),
            built_in("bookshelf"),
            built_in("table"),
            built_in("room"),
            built_in("castle"),
            built_in("facade"),
            built_in("piano"),
        ];
        for (source, narrow) in scenes {
            if !format!("{source:?}").contains(&only) {
                continue;
            }
            for count in [4, 8] {
                let train = if narrow {
                    ViewSelection::Narrow { count, angle_deg: 40.0, seed: 0 }
                } else {
                    ViewSelection::Seed { seed: 0, count }
                };
                let request = SceneRequest {
                    train,
                    test: TestProtocol::First(1),
                    image_size: Some(size),
                    background: [1.0; 3],
                    ..Default::default()
                };
                let scene = match load(&source, &request) {
                    Ok(s) => s,
                    Err(e) => {
                        eprintln!("{source:?} {e}");
                        continue;
                    }
                };
                for (degrees, distance) in [(0.0, 0.0), (2.0, 0.03), (5.0, 0.03)] {
                    let started = std::time::Instant::now();
                    let disturbed = scene.clone().disturbed(degrees, distance, 0);
                    if told {
                        for w in with_refined_cameras(disturbed.clone(), false).warnings {
                            eprintln!("{w}");
                        }
                    }
                    let (before, after, moved) = errors(disturbed, false);
                    eprintln!(
                        "| {} | {count} | {degrees} | {moved} | {:.2} → {:.2} | {:.2} → {:.2} | {:.1}",
                        scene.name,
                        before.rotation_deg,
                        after.rotation_deg,
                        before.translation_percent,
                        after.translation_percent,
                        started.elapsed().as_secs_f64()
                    );
                }
            }
        }
    }
}
