use infonerf_scene::{TestProtocol, ViewSelection};

use super::*;
use crate::cameras::TRAIN_VIEWS;

fn request(size: u32) -> SceneRequest {
    SceneRequest {
        train: ViewSelection::Seed { seed: 0, count: 4 },
        test: TestProtocol::First(2),
        image_size: Some(size),
        ..Default::default()
    }
}

fn scene(name: &str, size: u32) -> Scene {
    load(name, &request(size)).unwrap()
}

#[test]
fn names_are_those_that_load() {
    for name in NAMES {
        assert_eq!(scene(name, 8).train.len(), 4);
    }
    assert_eq!(NAMES[..4], CLASSICS, "the first come first");
    for name in ["tree", "random", "random-", "random-x", "random--1", "random-01", "random-99999999999999999999"] {
        let known = "castle, crane, knot, orrery, aquarium, birdcage, bookshelf, chessman, facade, kettle, piano, \
                     porcelain, room, table, figure, random-<seed>";
        let error = load(name, &request(8)).unwrap_err().to_string();
        assert_eq!(error, format!("unknown procedural scene `{name}`; expected one of {known}"));
    }
}

#[test]
fn objects_lie_in_the_bounds_and_between_near_and_far() {
    for name in NAMES {
        let (near, far, bounds) = extent(name).unwrap();
        let model = model(name).unwrap();
        let corners = model.bounds();
        assert!(corners.iter().all(|corner| bounds.contains(corner.as_vec3())), "{name} {corners:?}");
        let scene = scene(name, 8);
        assert_eq!((scene.space.near, scene.space.far, scene.space.bounds), (near, far, bounds));
        if !CAPTURES.contains(&name) {
            assert_eq!((near, far, bounds), (NEAR, FAR, BOUNDS));
        }
        let (train, test) = cameras(name, 24).unwrap();
        for camera in train.iter().chain(&test) {
            for t in render::fronts(&model, camera).0.into_iter().filter(|t| t.is_finite()) {
                assert!((near..far).contains(&t), "{name}: {t}");
            }
        }
    }
}

#[test]
fn coverage_mask_and_depth_agree() {
    for name in NAMES.into_iter().filter(|name| !CAPTURES.contains(name)) {
        for view in scene(name, 64).test {
            let hit: Vec<bool> = view.depth.unwrap().iter().map(|t| t.is_finite()).collect();
            assert_eq!(object_mask(name, &view.camera).unwrap(), hit);
            let pixels = hit.iter().zip(view.image.alpha.as_ref().unwrap());
            let differ = pixels.filter(|(hit, alpha)| **alpha == if **hit { 0.0 } else { 1.0 }).count();
            // A rod thinner than the sample spacing may pass between samples, and a hole likewise.
            assert!(differ * 100 < hit.len(), "{name}: {differ}");
        }
    }
}

#[test]
fn surface_points_are_what_the_training_cameras_see() {
    let points = surface_points("castle", 16).unwrap();
    let depths = train_cameras(16).into_iter().map(|camera| render("castle", &camera).unwrap().depth);
    let seen: Vec<f32> = depths.flatten().filter(|depth| depth.is_finite()).collect();
    assert_eq!(points.len(), seen.len());
    assert!(points.iter().all(|&p| BOUNDS.contains(p)));
    // From the side of each point that faces away from the rest of the scene the same surface is met.
    let model = model("castle").unwrap();
    let met = points.iter().filter(|p| {
        let p = p.as_dvec3();
        let outward = p.normalize();
        let line = model.line(p + 4.0 * outward, -outward);
        let (t, _) = through::half_hidden_distance(&model, &line).expect("the ray ends at the surface at the latest");
        t * model.scale <= 4.0 + 1e-3
    });
    assert_eq!(met.count(), points.len());
    assert!(surface_points("tree", 16).is_err());
}

#[test]
fn random_scenes_follow_from_their_seed_and_fit_every_camera() {
    assert_eq!(scene("random-7", 16), scene("random-7", 16));
    assert_ne!(scene("random-7", 16).train[0].image, scene("random-8", 16).train[0].image);
    for seed in 0..200 {
        let corners = model(&format!("random-{seed}")).unwrap().bounds();
        assert!(corners.iter().all(|corner| BOUNDS.contains(corner.as_vec3())), "{seed} {corners:?}");
    }
    for seed in 0..20 {
        for view in scene(&format!("random-{seed}"), 32).train {
            let alpha = view.image.alpha.as_ref().unwrap();
            let on_edge = |i: usize| [0, 31].contains(&(i % 32)) || [0, 31].contains(&(i / 32));
            assert!((0..alpha.len()).all(|i| !on_edge(i) || alpha[i] == 0.0), "{seed} {} is cropped", view.name);
            let cover = alpha.iter().sum::<f32>() / alpha.len() as f32;
            assert!((0.05..0.6).contains(&cover), "{seed} {} covers {cover}", view.name);
        }
    }
}

/// Checks that a point of one view is seen by another one at its own depth, or hidden there by something nearer.
#[test]
fn depth_is_consistent_between_views() {
    for name in NAMES {
        let model = model(name).unwrap();
        if model.is_translucent {
            // The depth of translucent matter depends on the direction of the ray.
            continue;
        }
        let (cameras, _) = cameras(name, 48).unwrap();
        let a = &cameras[if cameras.len() == TRAIN_VIEWS { 26 } else { 3 }];
        let apart = |c: &&Camera| (c.position().angle_between(a.position()) - 0.8).abs();
        let b = cameras.iter().min_by(|c, d| apart(c).total_cmp(&apart(d))).unwrap();
        let depth = render::fronts(&model, a).0;
        let mut agree = 0;
        for (i, &t) in depth.iter().enumerate().filter(|(_, t)| t.is_finite()) {
            let ray = a.ray((i % 48) as f32 + 0.5, (i / 48) as f32 + 0.5);
            let p = ray.at(t);
            let pixel = b.project(p).unwrap();
            // Trace b's own ray through exactly that point.
            let (origin, direction) = b.ray_f64(f64::from(pixel.x), f64::from(pixel.y));
            let line = model.line(origin, direction);
            let seen = through::half_hidden_distance(&model, &line).map_or(f64::INFINITY, |(t, _)| t * model.scale);
            let distance = f64::from(p.distance(b.position()));
            // Grazing rays slide off the silhouette by rounding: leave those out.
            let towards = a.ray_f64((i % 48) as f64 + 0.5, (i / 48) as f64 + 0.5).1;
            let (hit, _) = model.nearest(&model.line(a.position_f64(), towards), 0.0).unwrap();
            if hit.normal.dot(line.direction).abs() > 0.1 {
                assert!(seen < distance + 1e-3, "{name}: {seen} beyond {distance}");
                agree += usize::from((seen - distance).abs() < 1e-3);
            }
        }
        let least = if name == "chessman" { 20 } else { 50 };
        assert!(agree > least, "{name}: only {agree} points are seen from both");
    }
}

#[test]
fn captures_fill_every_pixel_and_know_their_subject() {
    for name in CAPTURES {
        let request = SceneRequest { train: ViewSelection::All, test: TestProtocol::All, ..request(24) };
        let scene = load(name, &request).unwrap();
        assert_eq!((scene.train.len(), scene.test.len()), (30, 10));
        let other = SceneRequest { background: [0.0, 1.0, 0.0], ..request };
        let again = load(name, &other).unwrap();
        assert!(scene.train[0].image == again.train[0].image, "{name} depends on the background");
        for view in scene.train.iter().chain(&scene.test) {
            assert_eq!(view.image.alpha, None);
            assert!(view.depth.as_ref().unwrap().iter().all(|t| t.is_finite()), "{name} {}", view.name);
            assert!(render(name, &view.camera).unwrap().rgba.pixels.iter().all(|p| p[3] == 255));
            let mask = object_mask(name, &view.camera).unwrap();
            let share = mask.iter().filter(|&&m| m).count() as f32 / mask.len() as f32;
            assert!((0.08..0.6).contains(&share), "{name} {}: {share}", view.name);
        }
    }
}

/// Checks what a pane over nothing hides, how a wall looks through a pane, and how water hides by its thickness.
#[test]
fn light_from_behind_passes_glass_and_water() {
    use convex::Convex;
    use glam::DVec3;
    let red = model::matt(DVec3::new(0.8, 0.0, 0.0));
    let blue = model::Material { reflectance: 0.0, ..model::glass(DVec3::new(0.0, 0.0, 0.8), 0.25) };
    let line = |y: f64| convex::HalfLine { origin: DVec3::new(3.0, y, 0.0), direction: DVec3::NEG_X };
    let mut scene = Builder::default();
    // From y 0 to 2 a wall, from −2 to 1 a pane before it; below y = −2 water two units thick.
    scene.solid(Convex::block(DVec3::new(-1.0, 1.0, 0.0), DVec3::new(0.2, 2.0, 2.0)), red);
    scene.solid(Convex::block(DVec3::new(1.0, -0.5, 0.0), DVec3::new(0.2, 3.0, 2.0)), blue);
    scene.fill(Convex::block(DVec3::new(0.0, -3.0, 0.0), DVec3::new(2.0, 1.0, 2.0)), DVec3::ONE, 0.9);
    let model = scene.build(1.0, 0.0);
    let see = |y: f64| through::light(&model, &line(y), 0);
    let both_sides = 1.0 - 0.75 * 0.75;
    // The pane casts no shadow on the wall: where it is seen through it, only the pane's hiding dims it.
    let (wall, pane, through) = (see(1.5), see(-0.5), see(0.5));
    assert_eq!((wall.1, through.1), (1.0, 1.0));
    assert!((pane.1 - both_sides).abs() < 0.02, "{pane:?}");
    assert!(through.0.z > wall.0.z + 0.01 && through.0.x < wall.0.x && through.0.x > 0.4 * wall.0.x);
    let water = see(-3.0);
    assert!((water.1 - (1.0 - (-1.8f64).exp())).abs() < 1e-9 && (water.0.x - water.1).abs() < 1e-9);
    assert_eq!(see(-5.0), (DVec3::ZERO, 0.0));
    // Depth is where half is hidden: the wall behind the pane, ln 2 / 0.9 deep in the water, nowhere on the pane.
    let depth = |y: f64| through::half_hidden_distance(&model, &line(y)).map(|(t, _)| t);
    assert!((depth(0.5).unwrap() - 3.9).abs() < 1e-9 && depth(-0.5).is_none());
    assert!((depth(-3.0).unwrap() - (2.0 + 2f64.ln() / 0.9)).abs() < 1e-9);
}

#[test]
fn renders_do_not_depend_on_the_number_of_threads() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| NAMES.map(|name| scene(name, 16)))
    };
    for (one, three) in with(1).iter().zip(&with(3)) {
        assert!(one == three, "{}", one.name);
    }
}

#[test]
fn cameras_are_a_hemisphere_that_looks_at_the_origin() {
    let (train, test) = cameras("kettle", 200).unwrap();
    assert!(train != train_cameras(200) && cameras("tree", 8).is_err() && extent("tree").is_err());
    assert_eq!(cameras("castle", 200).unwrap(), (train_cameras(200), test.clone()));
    assert_eq!((train.len(), test.len()), (100, 200));
    for camera in train.iter().chain(&test) {
        assert!((camera.position().length() - 4.0311).abs() < 1e-3 && camera.position().z > 0.1);
        assert!((camera.project(Vec3::ZERO).unwrap() - glam::Vec2::splat(100.0)).length() < 1e-3);
        assert!((camera.fx - 100.0 / (0.6911112f64 / 2.0).tan()).abs() < 1e-6);
    }
    assert_ne!(train[0], train[1]);
    assert_eq!(scene("kettle", 8).all_train_cameras, cameras("kettle", 8).unwrap().0);
}

/// Checks that published renders of the scenes do not change. The fingerprints depend on the mathematical library.
#[cfg(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu"))]
#[test]
fn no_scene_ever_changes() {
    let expected = [
        ("castle", 14049021463521838936),
        ("crane", 10313091132694606161),
        ("knot", 16872614610471715021),
        ("orrery", 9336174511608281722),
        ("aquarium", 6220580250391387891),
        ("birdcage", 6190838695205342629),
        ("bookshelf", 13540235391921829298),
        ("chessman", 410042099755037048),
        ("facade", 6563102476638745646),
        ("kettle", 8758703834003078399),
        ("piano", 58774377495796905),
        ("porcelain", 4856971958237315784),
        ("room", 14095690379075018603),
        ("table", 6196731059544862262),
        ("figure", 16627656258440197442),
        ("random-0", 14589615429340700797),
        ("random-7", 18318855451968460935),
    ];
    let found = NAMES.into_iter().chain(["random-0", "random-7"]).map(|name| {
        let (cameras, _) = cameras(name, 48).unwrap();
        let even = [0, 1, 2, 3].map(|k| k * cameras.len() / 4);
        let chosen = if cameras.len() == TRAIN_VIEWS { [26, 86, 2, 55] } else { even };
        let pixels = chosen.map(|i| render(name, &cameras[i]).unwrap().rgba.pixels);
        (name, cameras::fingerprint(&pixels.concat().concat()))
    });
    assert_eq!(found.collect::<Vec<_>>(), expected);
}
