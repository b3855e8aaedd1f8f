//! Source images: the training views as the input of image-conditioned fields (PixelNeRF).

use glam::{DVec2, Vec3};
use infonerf_field::{SourceView, Sources};
use infonerf_render::{Noise, RandomStream};
use infonerf_scene::{Scene, View, bilinear};
use rand::seq::index::sample;

use crate::config::{Batch, TrainConfig};
use crate::pixels::generator;

/// Returns all training views of `scene` as sources; none if no field `sees` images.
pub(crate) fn all_sources(scene: &Scene, sees: bool) -> Sources {
    let views = scene.train.iter().filter(|_| sees).map(|view| source(view, scene.background)).collect();
    Sources { views, middle: scene.space.bounds.centre().to_array() }
}

/// Draws those of `all` sources that a field sees in a step whose pixels are of the view `target`.
pub(crate) fn draw_sources(all: &Sources, config: &TrainConfig, target: usize, noise: Noise) -> Sources {
    let views = &all.views;
    if views.is_empty() {
        return all.clone();
    }
    let hidden = config.batch == Batch::HeldOut && views.len() > 1;
    let shown: Vec<usize> = (0..views.len()).filter(|&view| !hidden || view != target).collect();
    let count = match config.sources {
        0 => shown.len(),
        most => 1 + noise.child(RandomStream::Count).below(0, 0, most.min(shown.len())),
    };
    let mut rng = generator(noise.child(RandomStream::View));
    let chosen = match count == shown.len() {
        true => shown,
        false => sample(&mut rng, shown.len(), count).into_iter().map(|index| shown[index]).collect(),
    };
    Sources { views: chosen.into_iter().map(|view| views[view].clone()).collect(), ..*all }
}

/// Converts a view into a source, without distortion.
fn source(view: &View, background: [f32; 3]) -> SourceView {
    let camera = &view.camera;
    let perspective = camera.lens.is_perspective();
    let to_camera = camera.to_world.inverse();
    SourceView {
        width: view.image.width as usize,
        height: view.image.height as usize,
        rgb: if perspective { view.image.rgb.clone() } else { undistorted(view, background) }.into(),
        focal: [camera.fx as f32, camera.fy as f32],
        centre: [camera.cx as f32, camera.cy as f32],
        to_camera: [0, 1, 2].map(|row| to_camera.row(row).as_vec4().to_array()),
    }
}

/// Resamples a view's image bilinearly without distortion; `background` beyond the lens, the nearest pixel beyond the border.
fn undistorted(view: &View, background: [f32; 3]) -> Vec<[f32; 3]> {
    let (camera, image) = (&view.camera, &view.image);
    let (focal, centre) = (DVec2::new(camera.fx, camera.fy), DVec2::new(camera.cx, camera.cy));
    let size = [image.width as usize, image.height as usize];
    let seen = |x: u32, y: u32| {
        let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
        let Some(bent) = camera.lens.distort((pixel - centre) / focal) else { return background };
        let at = (centre + focal * bent).as_vec2();
        bilinear(size, (at.x, at.y), |pixel| Vec3::from(image.rgb[pixel])).to_array()
    };
    (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y))).map(|(x, y)| seen(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use glam::DMat4;
    use infonerf_scene::{Camera, Image, Lens};

    use super::*;
    use crate::config::{Config, Preset};
    use crate::testing::knot;

    fn drawn(all: &Sources, batch: Batch, sources: usize, step: u64) -> Vec<usize> {
        let mut train = Config::from_table(Preset::Fast.table()).unwrap().train;
        (train.batch, train.sources) = (batch, sources);
        let views = draw_sources(all, &train, 1, Noise::new(0, step, RandomStream::Sources)).views;
        let index = |view: &SourceView| all.views.iter().position(|other| other.to_camera == view.to_camera).unwrap();
        views.iter().map(index).collect()
    }

    #[test]
    fn the_target_is_held_out_where_another_is_left() {
        let [one, four] = [1, 4].map(|count| all_sources(&knot(count, 4), true));
        assert_eq!(drawn(&four, Batch::Pixels, 0, 0), [0, 1, 2, 3]);
        assert_eq!(drawn(&four, Batch::HeldOut, 0, 0), [0, 2, 3]);
        assert_eq!(drawn(&one, Batch::HeldOut, 0, 0), [0]);
        // One to two views are drawn, each at most once.
        let draws: Vec<Vec<usize>> = (0..100).map(|step| drawn(&four, Batch::HeldOut, 2, step)).collect();
        for count in [1, 2] {
            assert!(draws.iter().any(|views| views.len() == count));
        }
        for views in draws {
            assert!(views.len() <= 2 && !views.contains(&1) && (views.len() < 2 || views[0] != views[1]));
        }
    }

    /// A photograph of a colour ramp is the ramp again, whatever lens it was taken through.
    #[test]
    fn lenses_are_undone() {
        let bent = Lens::radial_tangential([-0.2, 0.05, 0.0, 0.0], [0.01, -0.02]);
        for lens in [bent, Lens::fisheye([0.1, 0.0, 0.0, 0.0])] {
            let camera = Camera::pinhole((40, 30), [30.0, 32.0], [21.0, 14.0], DMat4::IDENTITY).with_lens(lens);
            let position = |i: usize| {
                let pixel = DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
                (pixel - DVec2::new(camera.cx, camera.cy)) / DVec2::new(camera.fx, camera.fy)
            };
            let ramp = |point: DVec2| [0.5 + 0.4 * point.x as f32, 0.5 + 0.4 * point.y as f32, 0.0];
            let rgb = (0..1200).map(|i| ramp(lens.undistort(position(i)).unwrap())).collect();
            let view = View::new(0, "a", camera.clone(), Image { width: 40, height: 30, rgb, alpha: None });
            let source = source(&view, [1.0; 3]);
            let inside = (0..1200).filter(|i| (4..36).contains(&(i % 40)) && (4..26).contains(&(i / 40)));
            for i in inside {
                let (found, expected) = (source.rgb[i], ramp(position(i)));
                assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 2e-3), "{lens} {i}: {found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn cameras_agree_with_the_scenes() {
        let scene = knot(4, 4);
        let source = source(&scene.train[0], scene.background);
        let point = [0.3f32, -0.2, 0.1];
        let [x, y, z] = source.to_camera.map(|r| r[0] * point[0] + r[1] * point[1] + r[2] * point[2] + r[3]);
        let expected = scene.train[0].camera.project(point.into()).unwrap();
        assert!((source.centre[0] - source.focal[0] * x / z - expected.x).abs() < 1e-4);
        assert!((source.centre[1] + source.focal[1] * y / z - expected.y).abs() < 1e-4);
    }
}
