//! The paper's Figure A: how certain and how consistent the scene is along test rays.

use infonerf_field::Field;
use infonerf_loss::{EntropyConfig, KlConfig, masked_entropy};
use infonerf_ops::to_host;
use infonerf_render::{Noise, RenderRequest, Renderer, Stream, TrainedModel};
use infonerf_scene::{Ray, Scene, near_pose_about};
use infonerf_schedule::Moment;

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
    /// The mean over several fields; none for none.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let of = |value: fn(&Self) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Self { entropy_bits: of(|one| one.entropy_bits), gain: of(|one| one.gain) })
    }
}

/// On which rays [`information`] is measured, and how.
#[derive(Clone, Copy, Debug)]
pub struct InformationQuery<'a> {
    /// Distribution, mask and ε of the entropy.
    pub entropy: &'a EntropyConfig,
    /// Direction and ε of the gain.
    pub kl: &'a KlConfig,
    /// Largest rotation of a neighbour's camera about each axis, degrees.
    pub max_angle_deg: f64,
    /// How many rays.
    pub rays: usize,
    /// Decides rays and neighbours.
    pub seed: u64,
}

/// Measures entropy and information gain on random rays of the test views, without gradients; none for no rays.
///
/// Hidden and empty samples are treated as in training.
pub fn information<F: Field>(
    renderer: &Renderer,
    trained: &TrainedModel<F>,
    scene: &Scene,
    query: InformationQuery<'_>,
) -> Option<Information> {
    let InformationQuery { entropy, kl, rays: count, .. } = query;
    if count == 0 || scene.test.is_empty() {
        return None;
    }
    let (mut entropy_sum, mut gain_sum) = (0.0, 0.0);
    let sum = |values: Vec<f32>| values.into_iter().map(f64::from).sum::<f64>();
    let chunk = renderer.rays_at_once();
    for start in (0..count).step_by(chunk) {
        let pairs = (start..(start + chunk).min(count)).map(|i| pair(scene, &query, i));
        let (rays, near): (Vec<Ray>, Vec<Ray>) = pairs.unzip();
        let request = RenderRequest { color: false };
        let occupancy = trained.occupancy.as_ref();
        let output = renderer.render(&trained.model, &rays, request, None, occupancy, Moment::END).fine;
        entropy_sum += sum(to_host(masked_entropy(&output, entropy.distribution, entropy.mask, entropy.epsilon)));
        if output.segments().samples() > 0 {
            let near = renderer.along(&trained.model.fine, &output, &near, Moment::END);
            gain_sum += sum(to_host(kl.divergence(output.tau.clone(), near.tau, output.segments())));
        }
    }
    Some(Information { entropy_bits: entropy_sum / count as f64, gain: gain_sum / count as f64 })
}

/// The `i`th ray, and its neighbour.
fn pair(scene: &Scene, query: &InformationQuery<'_>, i: usize) -> (Ray, Ray) {
    let noise = Noise::new(query.seed, 0, Stream::InformationRays);
    let camera = &scene.test[noise.below(i, 0, scene.test.len())].camera;
    let mut rng = generator(Noise::new(query.seed, i as u64, Stream::InformationNeighbours));
    let near = near_pose_about(&camera.to_world, scene.space.centre.as_dvec3(), &mut rng, query.max_angle_deg);
    let x = noise.uniform(i, 1) * camera.width as f32;
    let y = noise.uniform(i, 2) * camera.height as f32;
    (camera.ray(x, y), camera.with_pose(near).ray(x, y))
}
