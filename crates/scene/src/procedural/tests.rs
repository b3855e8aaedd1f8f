use super::*;
use crate::{SceneSource, TestProtocol, ViewSelection, load};

fn request(size: u32) -> SceneRequest {
    SceneRequest {
        train: ViewSelection::Seed { seed: 0, count: 4 },
        test: TestProtocol::First(2),
        image_size: Some(size),
        ..Default::default()
    }
}

fn scene(name: &str, size: u32) -> Scene {
    load(&SceneSource::Procedural(name.into()), &request(size)).unwrap()
}

/// The mean over pixels of `value`.
fn mean(view: &View, value: impl Fn(usize) -> f32) -> f32 {
    let n = view.image.rgb.len();
    (0..n).map(value).sum::<f32>() / n as f32
}

#[test]
fn names_are_those_that_load() {
    for name in NAMES {
        assert_eq!(scene(name, 8).train.len(), 4);
    }
    for name in ["tree", "random", "random-", "random-x", "random--1", "random-01", "random-99999999999999999999"] {
        let error = load(&SceneSource::Procedural(name.into()), &request(8)).unwrap_err().to_string();
        let expected =
            format!("unknown procedural scene `{name}`; expected one of castle, crane, knot, orrery, random-<seed>");
        assert_eq!(error, expected);
    }
}

#[test]
fn objects_lie_in_the_bounds_and_between_near_and_far() {
    for name in NAMES {
        let (lo, hi) = model(name).unwrap().bounds();
        assert!(BOUNDS.contains(lo.as_vec3()) && BOUNDS.contains(hi.as_vec3()), "{name} {lo} {hi}");
        for view in scene(name, 40).train {
            for &t in view.depth.as_ref().unwrap().iter().filter(|t| t.is_finite()) {
                assert!((NEAR..FAR).contains(&t));
            }
        }
    }
}

#[test]
fn images_have_an_object_with_detail_on_a_clear_background() {
    for name in NAMES {
        for view in scene(name, 64).train {
            let alpha = view.image.alpha.as_ref().unwrap();
            let cover = mean(&view, |i| alpha[i]);
            assert!((0.05..0.6).contains(&cover), "{name} {} covers {cover}", view.name);
            assert_eq!((alpha[0], alpha[63], alpha[64 * 64 - 1]), (0.0, 0.0, 0.0));
            let grey = |i: usize| view.image.rgb[i].iter().sum::<f32>() / 3.0;
            let detail = mean(&view, |i| if i > 0 { (grey(i) - grey(i - 1)).abs() } else { 0.0 });
            assert!(detail / cover > 0.05, "{name} is flat: {detail}");
        }
    }
}

#[test]
fn coverage_and_depth_agree() {
    for name in NAMES {
        for view in scene(name, 64).test {
            let (alpha, depth) = (view.image.alpha.as_ref().unwrap(), view.depth.as_ref().unwrap());
            let differ = (0..depth.len())
                .filter(|&i| (alpha[i] == 1.0 && depth[i].is_infinite()) || (alpha[i] == 0.0 && depth[i].is_finite()))
                .count();
            // A rod thinner than the sample spacing may pass between samples, and a hole likewise.
            assert!(differ * 100 < depth.len(), "{name}: {differ}");
        }
    }
}

#[test]
fn random_scenes_follow_from_their_seed_and_fit_every_camera() {
    assert_eq!(scene("random-7", 16), scene("random-7", 16));
    assert_ne!(scene("random-7", 16).train[0].image, scene("random-8", 16).train[0].image);
    for seed in 0..200 {
        let (lo, hi) = model(&format!("random-{seed}")).unwrap().bounds();
        assert!(BOUNDS.contains(lo.as_vec3()) && BOUNDS.contains(hi.as_vec3()), "{seed} {lo} {hi}");
    }
    for seed in 0..20 {
        for view in scene(&format!("random-{seed}"), 32).train {
            let alpha = view.image.alpha.as_ref().unwrap();
            let on_edge = |i: usize| [0, 31].contains(&(i % 32)) || [0, 31].contains(&(i / 32));
            assert!((0..alpha.len()).all(|i| !on_edge(i) || alpha[i] == 0.0), "{seed} {} is cropped", view.name);
            let cover = mean(&view, |i| alpha[i]);
            assert!((0.05..0.6).contains(&cover), "{seed} {} covers {cover}", view.name);
        }
    }
}

/// A point seen in one view, at its depth, is seen by the other at its own depth or hidden there by
/// something nearer: never is the other's surface beyond the point.
#[test]
fn depth_is_consistent_between_views() {
    for name in NAMES {
        let model = model(name).unwrap();
        let cameras = train_cameras(48);
        let (a, b) = (&cameras[26], &cameras[86]);
        let depth = render::depth(&model, a);
        let mut agree = 0;
        for (i, &t) in depth.iter().enumerate().filter(|(_, t)| t.is_finite()) {
            let ray = a.ray((i % 48) as f32 + 0.5, (i / 48) as f32 + 0.5);
            let p = ray.at(t);
            let pixel = b.project(p).unwrap();
            // Trace b's own ray through exactly that point.
            let line = b.ray_f64(f64::from(pixel.x), f64::from(pixel.y));
            let line = model.line(line.0, line.1);
            let seen = model.nearest(&line).map_or(f64::INFINITY, |(hit, _)| hit.t * model.scale());
            let distance = f64::from(p.distance(b.position()));
            // Grazing rays slide off the silhouette by rounding: leave those out.
            let (hit, _) = model
                .nearest(&model.line(a.position_f64(), a.ray_f64((i % 48) as f64 + 0.5, (i / 48) as f64 + 0.5).1))
                .unwrap();
            if hit.normal.dot(line.direction).abs() > 0.1 {
                assert!(seen < distance + 1e-3, "{name}: {seen} beyond {distance}");
                agree += usize::from((seen - distance).abs() < 1e-3);
            }
        }
        assert!(agree > 50, "{name}: only {agree} points are seen from both");
    }
}

#[test]
fn highlights_move_with_the_view() {
    // A mirror ball shows different colours from different sides.
    let model = model("knot").unwrap();
    let mut colours = Vec::new();
    for camera in &train_cameras(8)[..8] {
        let line = camera.ray_f64(4.0, 4.0);
        let line = model.line(line.0, line.1);
        colours.extend(shade::radiance(&model, &line, 0));
    }
    colours.dedup_by(|a, b| a.distance(*b) < 1e-3);
    assert!(colours.len() > 4);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| scene("castle", 32))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn cameras_are_a_hemisphere_that_looks_at_the_origin() {
    let (train, test) = (train_cameras(200), test_cameras(200));
    assert_eq!((train.len(), test.len()), (100, 200));
    for camera in train.iter().chain(&test) {
        assert!((camera.position().length() - 4.0311).abs() < 1e-3 && camera.position().z > 0.1);
        let centre = camera.project(Vec3::ZERO).unwrap();
        assert!((centre - glam::Vec2::splat(100.0)).length() < 1e-3);
        assert!((camera.fx - 100.0 / (0.6911112f64 / 2.0).tan()).abs() < 1e-6);
    }
    assert_ne!(train[0], train[1]);
}

#[test]
fn no_image_is_cropped() {
    let size = 48;
    for name in NAMES {
        let model = model(name).unwrap();
        for camera in train_cameras(size).iter().chain(test_cameras(size).iter().step_by(5)) {
            let depth = render::depth(&model, camera);
            let n = size as usize;
            let edge = |i: usize| [i, i + (n - 1) * n, i * n, i * n + n - 1];
            let open = (0..n).flat_map(edge).all(|i| depth[i].is_infinite());
            assert!(open, "{name} touches the border from {}", camera.position());
        }
    }
}

#[test]
fn the_published_view_sets_are_spread() {
    let cameras = train_cameras(8);
    for seed in 0..5 {
        let ids = ViewSelection::Seed { seed, count: 4 }.select(&cameras).unwrap();
        for (k, &i) in ids.iter().enumerate() {
            for &j in &ids[..k] {
                let angle = cameras[i].position().angle_between(cameras[j].position());
                assert!(angle.to_degrees() > 46.0, "seed {seed}: {i} and {j}");
            }
        }
    }
}
