//! Depth maps against the exact depth of a procedural scene.

use std::sync::{Arc, LazyLock};

use infonerf_scene::{Range, Scene, SceneRequest, TestProtocol, ViewSelection};
use infonerf_stereo::{DepthMap, StereoSettings, depth_maps};

static ROOM: LazyLock<Scene> = LazyLock::new(|| {
    let (train, test) = (ViewSelection::Named { name: "regnerf-3".into() }, TestProtocol::Training);
    let request = SceneRequest { train, test, image_size: Some(128), ..SceneRequest::default() };
    infonerf_procedural::load("room", &request).unwrap()
});

static MAPS: LazyLock<Vec<DepthMap>> = LazyLock::new(|| maps(&ROOM));

fn maps(scene: &Scene) -> Vec<DepthMap> {
    depth_maps(scene, &StereoSettings::default())
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
    for (view, map) in MAPS.iter().enumerate() {
        let errors = errors(&ROOM, view, map);
        let share = |part: f32| errors[(part * errors.len() as f32) as usize];
        assert!(errors.len() * 3 > map.disparity.len(), "{} of {}", errors.len(), map.disparity.len());
        assert!(share(0.5) < 0.5, "median {}", share(0.5));
        assert!(share(0.8) < 2.0, "four fifths within {}", share(0.8));
    }
}

#[test]
fn larger_images_refine_the_depths_of_smaller_ones() {
    let of = |refined_size| depth_maps(&ROOM, &StereoSettings { size: 64, refined_size, ..StereoSettings::default() });
    for ((coarse, refined), view) in of(None).iter().zip(of(Some(128))).zip(&ROOM.train) {
        let exact = view.depth.as_ref().unwrap();
        let mean_error = |map: &DepthMap| {
            let at = |i: usize| map.at(&view.camera, (i % 128) as f32 + 0.5, (i / 128) as f32 + 0.5);
            let error = |i: usize| at(i).map(|(disparity, _)| (disparity * exact[i] - 1.0).abs().min(0.1));
            let errors: Vec<f32> = (0..exact.len()).filter_map(error).collect();
            (errors.iter().sum::<f32>() / errors.len() as f32, errors.len())
        };
        let ((before, few), (after, more)) = (mean_error(coarse), mean_error(&refined));
        assert!(after < 0.9 * before && more >= few, "{before} of {few}, {after} of {more}");
    }
}

/// Widens near and far, which are estimated in many captures.
#[test]
fn near_and_far_may_be_far_off() {
    let mut scene = ROOM.clone();
    scene.space.range = Range::Distance { near: scene.space.near / 20.0, far: 10.0 * scene.space.far };
    for (view, (map, narrow)) in maps(&scene).iter().zip(&*MAPS).enumerate() {
        let errors = errors(&scene, view, map);
        assert!(errors[errors.len() / 2] < 0.5, "median {}", errors[errors.len() / 2]);
        assert!(map.matched() * 2 > narrow.matched(), "{} and {}", map.matched(), narrow.matched());
        assert!(map.step[0] < 3.0 * narrow.step[0], "{} and {}", map.step[0], narrow.step[0]);
    }
}

/// Fills the lower half of each image with noise that a mask leaves out.
#[test]
fn pixels_that_are_not_valid_are_not_matched() {
    let mut masked = ROOM.clone();
    for view in &mut masked.train {
        let half = view.image.rgb.len() / 2;
        for (i, pixel) in Arc::make_mut(&mut view.image).rgb.iter_mut().enumerate().skip(half) {
            *pixel = [(i * i % 97) as f32 / 97.0; 3];
        }
        view.valid = Some((0..2 * half).map(|i| i < half).collect());
    }
    for (view, (map, whole)) in maps(&masked).iter().zip(&*MAPS).enumerate() {
        let half = map.disparity.len() / 2;
        assert!(map.disparity[half..].iter().all(|disparity| disparity.is_nan()));
        let upper = whole.disparity[..half].iter().filter(|disparity| disparity.is_finite()).count();
        assert!(map.matched() * 3 > upper, "{} and {upper}", map.matched());
        let errors = errors(&masked, view, map);
        assert!(errors[errors.len() / 2] < 0.7, "median {}", errors[errors.len() / 2]);
    }
}

#[test]
fn a_view_without_another_has_an_empty_map_of_the_size_of_the_settings() {
    let mut scene = ROOM.clone();
    scene.train.truncate(1);
    let map = &depth_maps(&scene, &StereoSettings { size: 64, ..StereoSettings::default() })[0];
    assert_eq!((map.width, map.height, map.matched()), (64, 64, 0));
}
