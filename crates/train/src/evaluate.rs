//! What is measured in the end, on test views only.

use burn::tensor::Tensor;
use infonerf_loss::{GainConfig, HitMask, HitRule, entropy_loss, gain_loss};
use infonerf_metrics::{Comparison, compare, depth_rmse};
use infonerf_render::{Learned, Model, Noise, OccupancyGrid, RenderedImage, Renderer, Want, render_image};
use infonerf_scene::{Ray, Scene, View, near_pose};

use crate::TrainError;
use crate::batch::generator;

/// One test view, rendered and compared.
#[derive(Clone, Debug)]
pub struct TestView {
    /// The picture.
    pub image: RenderedImage,
    /// Image metrics, on 8-bit images.
    pub comparison: Comparison,
    /// Depth error where the scene has exact depth, scene units.
    pub depth_rmse: Option<f64>,
    /// Wall clock of rendering alone.
    pub seconds: f64,
}

/// Means over test views.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Image metrics.
    pub comparison: Comparison,
    /// Depth error.
    pub depth_rmse: Option<f64>,
    /// Wall clock of one image.
    pub seconds: f64,
}

impl Evaluation {
    /// Means over `views`; none for no views.
    pub fn mean(views: &[TestView]) -> Option<Self> {
        let comparisons: Vec<Comparison> = views.iter().map(|view| view.comparison).collect();
        let depths: Vec<f64> = views.iter().filter_map(|view| view.depth_rmse).collect();
        Some(Self {
            comparison: Comparison::mean(&comparisons)?,
            depth_rmse: (!depths.is_empty()).then(|| depths.iter().sum::<f64>() / depths.len() as f64),
            seconds: views.iter().map(|view| view.seconds).sum::<f64>() / views.len() as f64,
        })
    }
}

/// A picture with less opacity than this shows nothing.
const EMPTY_PICTURE: f32 = 1e-3;

/// Whether all pictures are empty: of a field so faint that nothing of it is left, though training went on to the end.
pub fn show_nothing(views: &[TestView]) -> bool {
    let is_empty = |view: &TestView| view.image.acc.iter().sum::<f32>() < EMPTY_PICTURE * view.image.acc.len() as f32;
    !views.is_empty() && views.iter().all(is_empty)
}

/// Renders `view`, the mean of the members' pictures, and compares it with the truth.
///
/// # Errors
/// If a render is not finite.
pub fn evaluate_view(renderer: &Renderer, members: &[Learned], view: &View) -> Result<TestView, TrainError> {
    let start = std::time::Instant::now();
    let image = render_image(renderer, members, &view.camera);
    let seconds = start.elapsed().as_secs_f64();
    let comparison = compare(&image.rgb, &view.image.rgb, image.width as usize, image.height as usize)?;
    let depth_rmse = match &view.depth {
        Some(truth) => {
            // A ray that misses what is there is wrong by the whole distance: it is not left out.
            let depth: Vec<f32> = image.depth.iter().map(|&d| if d.is_finite() { d } else { 0.0 }).collect();
            depth_rmse(&depth, truth)?
        }
        None => None,
    };
    Ok(TestView { image, comparison, depth_rmse, seconds })
}

/// The paper's Figure A: how certain and how consistent the scene is along test rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information {
    /// Mean ray entropy in bits; rays that hit nothing count as 0, as in the loss.
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
    /// Direction, angle and ε of the gain.
    pub gain: &'a GainConfig,
    /// ε of the entropy.
    pub epsilon: f32,
    /// How many rays.
    pub rays: usize,
    /// Decides rays and neighbours.
    pub seed: u64,
}

/// Measures entropy and information gain on random rays of the test views, without gradients; none for no rays.
///
/// Hidden and empty samples are treated as in training.
pub fn information(
    renderer: &Renderer,
    model: &Model,
    occupancy: Option<&OccupancyGrid>,
    scene: &Scene,
    query: InformationQuery<'_>,
) -> Option<Information> {
    let InformationQuery { gain, epsilon, rays: count, seed } = query;
    const CHUNK: usize = 1024;
    if count == 0 || scene.test.is_empty() {
        return None;
    }
    let noise = Noise::new(seed, 0, 99);
    let (mut entropy_sum, mut gain_sum) = (0.0, 0.0);
    let number = |tensor: Tensor<1>| f64::from(tensor.into_scalar::<f32>());
    for start in (0..count).step_by(CHUNK) {
        let indices = start..(start + CHUNK).min(count);
        let pairs: Vec<(Ray, Ray)> = indices
            .clone()
            .map(|i| {
                let camera = &scene.test[noise.below(i, 0, scene.test.len())].camera;
                let near =
                    near_pose(&camera.to_world, &mut generator(Noise::new(seed, i as u64, 98)), gain.max_angle_deg);
                let x = noise.uniform(i, 1) * camera.width as f32;
                let y = noise.uniform(i, 2) * camera.height as f32;
                (camera.ray(x, y), camera.with_pose(near).ray(x, y))
            })
            .collect();
        let (rays, near): (Vec<Ray>, Vec<Ray>) = pairs.into_iter().unzip();
        let want = Want { color: false, entropy: Some(epsilon) };
        let (_, level) = renderer.render(model, &rays, want, None, occupancy, 1.0);
        let mask = HitMask { rule: HitRule::Acc, threshold: 0.1 };
        entropy_sum += number(entropy_loss(&level.composite, mask));
        if level.samples.segments.samples() > 0 {
            let tau = renderer.optical_depth_along(&model.fine, &level, &near, 1.0);
            gain_sum += number(gain_loss(level.tau.clone(), tau, &level.samples.segments, gain)) * rays.len() as f64;
        }
    }
    Some(Information { entropy_bits: entropy_sum / count as f64, gain: gain_sum / count as f64 })
}
