//! Cameras of a scene, refined by `infonerf-sfm`.

use infonerf_scene::{Camera, PoseError, Scene};
use infonerf_sfm::{Uncertainty, refine};

use crate::colmap::opengl;

/// Standard deviations of given cameras: angle in radians, position divided by the mean distance from the scene's
/// centre, and logarithm of the focal length.
const TURN: f64 = 2.0 * std::f64::consts::PI / 180.0;
const SHIFT: f64 = 0.03;
const FOCAL: f64 = 0.05;
/// Max ratio of the given cameras' median error to the refined ones' at which the given ones are kept.
const AS_GOOD: f64 = 1.25;
/// Median error in pixels above which given cameras are not only inexact.
const ABSURD: f64 = 50.0;

/// Refines the training cameras of `scene` by matches between the training photographs: bundle adjustment that starts
/// at the given cameras and is weakly pulled towards them ([`infonerf_sfm::refine`]), with one factor for all focal
/// lengths if `focal`. No test view is used.
///
/// The pull also fixes the frame: no similarity of all refined cameras would be nearer to the given ones, in these
/// deviations. A camera whose photograph shares too few points with others is kept. All are kept if the given ones
/// explain the shared points about as well. [`Scene::notes`] and [`Scene::warnings`] report what was done. The given
/// cameras are kept in [`Scene::unrefined_cameras`].
pub fn with_refined_cameras(mut scene: Scene, focal: bool) -> Scene {
    let given = scene.given_cameras();
    let mean = |of: &dyn Fn(&Camera) -> f64| given.iter().map(of).sum::<f64>() / given.len().max(1) as f64;
    let centre = scene.space.centre.as_dvec3();
    let shift = SHIFT * mean(&|camera| camera.position_f64().distance(centre)).max(1e-6);
    let uncertainty = Uncertainty { turn: TURN, shift, focal: if focal { FOCAL } else { 0.0 } };
    let found = refine(&scene.train, mean(&|camera| (camera.fx * camera.fy).sqrt()), uncertainty);
    let [before, after] = found.errors;
    let shared = format!("{} points that the photographs share are off by a median of", found.points.len());
    if found.poses.iter().all(Result::is_err) {
        scene.warnings.push("training cameras stay as given: their photographs share too few points".into());
    } else if before <= AS_GOOD * after {
        scene.notes.push(format!(
            "training cameras stay as given: {shared} {before:.3} pixels, with refined cameras {after:.3}"
        ));
    } else {
        let refocus = |camera: &mut Camera| (camera.fx, camera.fy) = (found.focal * camera.fx, found.focal * camera.fy);
        for (view, pose) in scene.train.iter_mut().zip(&found.poses) {
            match pose {
                Ok(pose) => {
                    view.camera = view.camera.with_pose(opengl(pose.rotation.transpose(), pose.centre()));
                    refocus(&mut view.camera);
                }
                Err(reason) => scene.warnings.push(format!("the camera of {} stays as given: {reason}", view.name)),
            }
        }
        // All cameras share the lens, so the factor applies to cameras of other views too.
        scene.test.iter_mut().map(|view| &mut view.camera).chain(&mut scene.all_train_cameras).for_each(refocus);
        let by = PoseError::of(&scene.training_cameras(), &given, centre);
        scene.notes.push(format!(
            "training cameras were refined by {:.2}° and {:.2} % of their distance: {shared} {after:.2} pixels, before \
             {before:.2}",
            by.rotation_deg, by.translation_percent
        ));
        if before > ABSURD {
            let far = "the given cameras were far from what the photographs share: `infonerf scene check` looks for \
                       another convention of the poses";
            scene.warnings.push(far.into());
        }
    }
    scene.unrefined_cameras = Some(given);
    scene
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{Lens, SceneRequest, TestProtocol, ViewSelection};

    use super::*;
    use crate::loaders::testing::{assert_warns, shared_data};
    use crate::source::{SceneSource, load};

    fn error(scene: &Scene) -> PoseError {
        PoseError::of(&scene.training_cameras(), scene.exact_cameras.as_ref().unwrap(), scene.space.centre.as_dvec3())
    }

    fn scene(source: &SceneSource, train: ViewSelection, size: u32) -> Scene {
        let test = TestProtocol::First(1);
        load(source, &SceneRequest { train, test, image_size: Some(size), ..Default::default() }).unwrap()
    }

    /// Checks that refinement uses the lens: a distortion that the images do not have gives worse cameras.
    #[test]
    fn cameras_of_a_built_in_scene_are_refined() {
        let train = ViewSelection::Narrow { count: 4, angle_deg: 40.0, seed: 0 };
        let exact = scene(&SceneSource::Procedural("castle".into()), train, 252);
        let scene = exact.clone().disturbed(2.0, 0.03, 0);
        let refined = with_refined_cameras(scene.clone(), false);
        let (before, after) = (error(&scene), error(&refined));
        assert!(after.rotation_deg < 0.4 * before.rotation_deg, "{before:?} {after:?}");
        assert!(after.translation_percent < 0.4 * before.translation_percent, "{before:?} {after:?}");
        assert_eq!(refined.unrefined_cameras.as_ref(), Some(&scene.given_cameras()));
        assert!(refined.notes[0].starts_with("training cameras were refined by "), "{:?}", refined.notes);
        let kept = with_refined_cameras(exact.clone(), false);
        assert!(kept.notes[0].starts_with("training cameras stay as given: "), "{:?}", kept.notes);
        assert_eq!(kept.warnings, exact.warnings, "good news is no warning");
        assert!(kept.train.iter().zip(&exact.train).all(|(kept, exact)| kept.camera == exact.camera));
        let mut bent = scene.clone();
        let lens = Lens::radial_tangential([0.4, 0.0, 0.0, 0.0], [0.0; 2]);
        bent.train.iter_mut().for_each(|view| view.camera = view.camera.with_lens(lens));
        let bent = error(&with_refined_cameras(bent, false));
        assert!(bent.rotation_deg > 1.5 * after.rotation_deg, "{after:?} {bent:?}");
    }

    #[test]
    fn cameras_without_matches_stay() {
        let ids = ViewSelection::Ids { ids: vec![0, 1] };
        let scene = scene(&SceneSource::Procedural("knot".into()), ids, 24).disturbed(2.0, 0.03, 0);
        let refined = with_refined_cameras(scene.clone(), false);
        assert_eq!(refined.given_cameras(), scene.given_cameras());
        assert_eq!(error(&refined), error(&scene));
        assert_warns(&refined, refined.warnings.len() - 1, "their photographs share too few points");
    }

    /// Prints the table of errors in docs/cameras.md: of published captures, and of views of built-in scenes within 40°.
    #[test]
    #[ignore = "needs published captures: INFONERF_DATA=DIR"]
    fn errors_of_refined_cameras() {
        let captures = ["fern", "flower", "room"];
        let built_in = ["bookshelf", "facade", "table", "castle", "knot"];
        eprintln!("| scene | views | disturbed by | rotation, degrees | translation, % | what was done |");
        eprintln!("|{}", "---|".repeat(6));
        for name in captures.into_iter().chain(built_in) {
            for count in [4, 8] {
                let scene = if captures.contains(&name) {
                    let path = shared_data(&format!("nerf_llff_data/{name}"));
                    scene(&SceneSource::Folder { path }, ViewSelection::Seed { seed: 0, count }, 504)
                } else {
                    let train = ViewSelection::Narrow { count, angle_deg: 40.0, seed: 0 };
                    scene(&SceneSource::Procedural(name.into()), train, 400)
                };
                for degrees in [0.0, 2.0, 5.0] {
                    let distance = if degrees > 0.0 { 0.03 } else { 0.0 };
                    let scene = scene.clone().disturbed(degrees, distance, 0);
                    let refined = with_refined_cameras(scene.clone(), false);
                    let (before, after) = (error(&scene), error(&refined));
                    let turn = format!("{:.2} → {:.2}", before.rotation_deg, after.rotation_deg);
                    let shift = format!("{:.2} → {:.2}", before.translation_percent, after.translation_percent);
                    let (percent, done) = (100.0 * distance, refined.notes.last().or(refined.warnings.last()).unwrap());
                    eprintln!("| {name} | {count} | {degrees}°, {percent} % | {turn} | {shift} | {done} |");
                }
            }
        }
    }
}
