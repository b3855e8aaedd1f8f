//! Depth maps against the exact depth of a procedural scene.

use infonerf_procedural::load;
use infonerf_scene::{Range, Scene, SceneRequest, ViewSelection};
use infonerf_stereo::{DepthMap, StereoSettings, depth_maps};

fn room() -> Scene {
    let train = ViewSelection::Named { name: "regnerf-3".into() };
    load("room", &SceneRequest { train, image_size: Some(128), ..SceneRequest::default() }).unwrap()
}

/// Returns the errors of the map's disparities in steps between planes, sorted.
fn errors(scene: &Scene, view: usize, map: &DepthMap) -> Vec<f32> {
    let exact = scene.train[view].depth.as_ref().unwrap();
    let error = |i: usize| (map.disparity[i] - 1.0 / exact[i]).abs() / map.step[i];
    let mut errors: Vec<f32> = (0..exact.len()).filter(|&i| map.disparity[i].is_finite()).map(error).collect();
    errors.sort_by(f32::total_cmp);
    errors
}

#[test]
fn matched_pixels_are_where_they_are() {
    let scene = room();
    for (view, map) in depth_maps(&scene, &StereoSettings::default()).iter().enumerate() {
        let errors = errors(&scene, view, map);
        let share = |part: f32| errors[(part * errors.len() as f32) as usize];
        assert!(errors.len() * 3 > map.disparity.len(), "{} of {}", errors.len(), map.disparity.len());
        assert!(share(0.5) < 0.5, "median {}", share(0.5));
        assert!(share(0.8) < 2.0, "four fifths within {}", share(0.8));
    }
}

/// Widens near and far, which are estimated in many captures.
#[test]
fn near_and_far_may_be_far_off() {
    let mut scene = room();
    let narrow = depth_maps(&scene, &StereoSettings::default());
    scene.space.range = Range::Distance { near: scene.space.near / 20.0, far: 10.0 * scene.space.far };
    for (view, map) in depth_maps(&scene, &StereoSettings::default()).iter().enumerate() {
        let errors = errors(&scene, view, map);
        assert!(errors[errors.len() / 2] < 0.5, "median {}", errors[errors.len() / 2]);
        assert!(map.matched() * 2 > narrow[view].matched(), "{} and {}", map.matched(), narrow[view].matched());
        assert!(map.step[0] < 3.0 * narrow[view].step[0], "{} and {}", map.step[0], narrow[view].step[0]);
    }
}

/// Checks that a map of a smaller image is indexed by pixels of the larger one.
#[test]
fn maps_are_asked_in_pixels_of_the_view() {
    let scene = room();
    let map = &depth_maps(&scene, &StereoSettings { size: 64, ..StereoSettings::default() })[0];
    assert_eq!(map.width.max(map.height), 64);
    let camera = &scene.train[0].camera;
    let i = map.disparity.iter().position(|disparity| disparity.is_finite()).unwrap();
    let (column, row) = ((i % map.width) as f32, (i / map.width) as f32);
    assert_eq!(map.at(camera, 2.0 * column + 0.5, 2.0 * row + 1.5), Some((map.disparity[i], map.step[i])));
}

/// Fills the lower half of each image with noise that a mask leaves out.
#[test]
fn pixels_that_are_not_valid_are_not_matched() {
    let scene = room();
    let mut masked = scene.clone();
    for view in &mut masked.train {
        let half = view.image.rgb.len() / 2;
        for (i, pixel) in std::sync::Arc::make_mut(&mut view.image).rgb.iter_mut().enumerate().skip(half) {
            *pixel = [(i * i % 97) as f32 / 97.0; 3];
        }
        view.valid = Some((0..2 * half).map(|i| i < half).collect());
    }
    let [whole, maps] = [&scene, &masked].map(|scene| depth_maps(scene, &StereoSettings::default()));
    for (view, (map, whole)) in maps.iter().zip(&whole).enumerate() {
        let half = map.disparity.len() / 2;
        assert!(map.disparity[half..].iter().all(|disparity| disparity.is_nan()));
        let upper = whole.disparity[..half].iter().filter(|disparity| disparity.is_finite()).count();
        assert!(map.matched() * 3 > upper, "{} and {upper}", map.matched());
        let errors = errors(&masked, view, map);
        assert!(errors[errors.len() / 2] < 0.7, "median {}", errors[errors.len() / 2]);
    }
}

#[test]
fn a_view_without_another_has_no_depth() {
    let mut scene = room();
    scene.train.truncate(1);
    assert_eq!(depth_maps(&scene, &StereoSettings::default())[0].matched(), 0);
}
