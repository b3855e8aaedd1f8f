//! Entropy and information gain along test rays (the paper's Figure A).

use infonerf_field::Field;
use infonerf_ops::to_host;
use infonerf_render::{Noise, RandomStream, RenderRequest, Renderer, TrainedModel};
use infonerf_scene::{Ray, Scene, ViewRegion, near_pose};

use crate::config::Config;
use crate::pixels::generator;

/// Entropy and information gain along test rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information {
    /// Mean ray entropy in bits; rays that are masked out count as 0, as in the loss.
    pub entropy_bits: f64,
    /// Mean divergence in nats between test rays and their neighbours.
    pub gain: f64,
}

impl Information {
    /// Returns the mean over several fields; `None` without fields.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let of = |value: fn(&Self) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Self { entropy_bits: of(|one| one.entropy_bits), gain: of(|one| one.gain) })
    }
}

/// Measures entropy and information gain, as the loss terms of `config` define them, on `eval.information_rays` rays of the test
/// views, without gradients; `None` without rays, or once `go_on`, which is called before each bundle of rays, returns false.
///
/// Rays, and the rotation of each neighbour's camera, are drawn by `seed`. Hidden and empty samples are treated as in training.
pub fn information<F: Field>(
    renderer: &Renderer,
    trained: &TrainedModel<F>,
    scene: &Scene,
    config: &Config,
    seed: u64,
    go_on: &mut dyn FnMut() -> bool,
) -> Option<Information> {
    let (loss, neighbours, count) = (&config.loss, &config.train.neighbours, config.eval.information_rays);
    if count == 0 || scene.test.is_empty() {
        return None;
    }
    let centre = neighbours.about.of(&ViewRegion::new(&scene.training_cameras()));
    let noise = Noise::new(seed, 0, RandomStream::InformationRays);
    let pair = |i: usize| {
        let camera = trained.camera(&scene.test[noise.below(i, 0, scene.test.len())].camera);
        let mut rng = generator(Noise::new(seed, i as u64, RandomStream::InformationNeighbours));
        let near = near_pose(&camera.to_world, centre, &mut rng, neighbours.max_angle_deg);
        let (x, y) = (noise.uniform(i, 1) * camera.width as f32, noise.uniform(i, 2) * camera.height as f32);
        (camera.ray(x, y), camera.with_pose(near).ray(x, y))
    };
    let (mut entropy_sum, mut gain_sum) = (0.0, 0.0);
    let sum = |values: Vec<f32>| values.into_iter().map(f64::from).sum::<f64>();
    let chunk = renderer.rays_at_once(trained.at);
    for start in (0..count).step_by(chunk) {
        if !go_on() {
            return None;
        }
        let (rays, near): (Vec<Ray>, Vec<Ray>) = (start..(start + chunk).min(count)).map(pair).unzip();
        let request = RenderRequest { color: false, hidden: false };
        let occupancy = trained.occupancy.as_ref();
        let device = trained.model.fine.device();
        let [rays, near] = [rays, near].map(|rays| renderer.rays(rays, &device));
        let output = renderer.render(&trained.model, &rays, request, occupancy, trained.at).fine;
        let near = renderer.along(&trained.model.fine, &output, &near, trained.at);
        entropy_sum += sum(to_host(loss.entropy.of_rays(&output)));
        gain_sum += sum(to_host(loss.kl.of_rays(&output, &near)));
    }
    Some(Information { entropy_bits: entropy_sum / count as f64, gain: gain_sum / count as f64 })
}
