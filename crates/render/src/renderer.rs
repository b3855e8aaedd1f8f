use glam::Vec3;
use infonerf_field::{Extent, Field, FieldOutput, Points};
use infonerf_ops::{CompositeOver, additive_depth, composite_over, upload};
use infonerf_scene::{Aabb, Backdrop, Range, Scene, Space};
use infonerf_schedule::Moment;

use crate::config::{Compositing, RenderConfig};
use crate::model::Model;
use crate::noise::{Noise, RandomStream};
use crate::occupancy::OccupancyGrid;
use crate::output::{Passes, RenderOutput, RenderRequest, Samples};
use crate::rays::RayBatch;
use crate::sampler::{Coordinates, PlacedSamples, Skip};
use crate::warp::Warp;

/// Renderer of one scene: renders batches of rays.
#[derive(Clone, Debug)]
pub struct Renderer {
    pub(crate) config: RenderConfig,
    pub(crate) range: Range,
    pub(crate) near: f32,
    /// Max length of a ray, in coordinates ([`Warp::coordinate`]).
    pub(crate) longest: f32,
    /// Box to which rays are clipped; `None` if they are not clipped.
    pub(crate) clip: Option<Aabb>,
    pub(crate) warp: Warp,
    pub(crate) background: [f32; 3],
    pub(crate) backdrop: Backdrop,
}

/// Max number of samples at a time without gradients: 256 activations each take 64 MiB, half of WebGPU's guaranteed buffer size.
const SAMPLES_AT_ONCE: usize = 1 << 16;

impl Renderer {
    /// Makes a renderer for `scene`'s bounds and background.
    pub fn new(config: &RenderConfig, scene: &Scene) -> Self {
        let warp = Warp::of(scene, config.space);
        let Space { near, far, range, bounds, .. } = scene.space;
        let clip = (config.clip_to_bounds && warp.is_identity()).then_some(bounds);
        let unclipped = warp.coordinate(warp.horizon().unwrap_or(far)) - warp.coordinate(near);
        let longest = clip.map_or(unclipped, |bounds| bounds.size().length());
        let Scene { background, backdrop, .. } = *scene;
        Self { config: config.clone(), range, near, longest, clip, warp, background, backdrop }
    }

    /// Returns the number of rays to render at a time without gradients: as many as have 65,536 samples.
    pub fn rays_at_once(&self, at: Moment) -> usize {
        (SAMPLES_AT_ONCE / self.max_samples(at).max(1)).max(1)
    }

    /// Returns the map from the world into the box of fields and occupancy grids.
    pub fn warp(&self) -> &Warp {
        &self.warp
    }

    /// Returns a batch's background: random in training before an unknown backdrop, so that the field learns to be opaque.
    fn behind(&self, noise: Option<Noise>) -> [f32; 3] {
        match (self.backdrop, noise) {
            (Backdrop::Unknown, Some(noise)) => {
                let noise = noise.child(RandomStream::Background);
                [0, 1, 2].map(|channel| noise.uniform(0, channel))
            }
            _ => self.background,
        }
    }

    /// Renders `rays`. Fields are evaluated at the moment `at` of the run. Without colour, a coarse pass has no gradient.
    pub fn render<F: Field>(
        &self,
        model: &Model<F>,
        rays: &RayBatch,
        request: RenderRequest,
        occupancy: Option<&OccupancyGrid>,
        at: Moment,
    ) -> Passes {
        let background = self.behind(rays.jitter);
        let skips_hidden = !request.hidden && self.config.hidden_depth > 0.0;
        let hidden_depth = if skips_hidden { self.config.hidden_depth } else { f32::INFINITY };
        let skip = Skip { grid: occupancy, hidden_depth };
        let evaluate = |field: &F, samples: Samples, points: &Points| {
            self.evaluate(field, samples, points, request, background, at)
        };
        if self.config.marches() {
            let placed = self.place_uniform(rays, skip, at, &model.fine.device());
            return Passes { coarse: None, fine: evaluate(&model.fine, placed.samples, &placed.points) };
        }
        let is_hierarchical = self.config.is_hierarchical();
        if rays.hits().next().is_none() {
            let empty = || RenderOutput::empty(Samples::none(rays.len(), &model.fine.device()), request, background);
            return Passes { coarse: is_hierarchical.then(empty), fine: empty() };
        }
        let first = self.first_coordinates(rays, at);
        let pass = |field: &F, coordinates: &Coordinates| {
            let PlacedSamples { samples, points, kept } = self.place(rays, coordinates, skip, &field.device());
            (evaluate(field, samples, &points), kept)
        };
        if !is_hierarchical {
            return Passes { coarse: None, fine: pass(&model.fine, &first).0 };
        }
        let field = model.coarse.as_ref().unwrap_or(&model.fine);
        let (coarse, kept) = if request.color { pass(field, &first) } else { pass(&field.valid(), &first) };
        let fine = self.fine_coordinates(rays, &first, kept.as_deref(), &coarse.tau);
        Passes { coarse: Some(coarse), fine: pass(&model.fine, &fine).0 }
    }

    /// Evaluates the density of `field` along `rays` at the distances of `output`, so that samples are paired one by one.
    pub fn along<F: Field>(&self, field: &F, output: &RenderOutput, rays: &RayBatch, at: Moment) -> RenderOutput {
        let points = rays.points(&output.samples, self.warp(), &field.device());
        let request = RenderRequest { color: false, hidden: true };
        self.evaluate(field, output.samples.clone(), &points, request, self.background, at)
    }

    fn evaluate<F: Field>(
        &self,
        field: &F,
        samples: Samples,
        points: &Points,
        request: RenderRequest,
        background: [f32; 3],
        at: Moment,
    ) -> RenderOutput {
        if samples.segments.samples() == 0 {
            return RenderOutput::empty(samples, request, background);
        }
        let sampled = field.evaluate(points, request.color, at);
        let tau = sampled.sigma * samples.delta.clone();
        let tau = match self.config.compositing {
            Compositing::Exponential => tau,
            Compositing::Additive => additive_depth(tau, &samples.segments),
        };
        let distances = samples.distance.clone();
        let CompositeOver { color, depth, acc } =
            composite_over(tau.clone(), sampled.color, distances, background, &samples.segments);
        RenderOutput { samples, tau, color, depth, acc, background }
    }
}

/// Evaluates the density of `field`, and colour if `color` is true, at `positions`, three values per point. The points
/// lie on no ray, and each represents a region of size `extent`. They are seen along +z, or along `directions`, one per
/// point, which cones need.
pub fn evaluate_at<F: Field>(
    field: &F,
    positions: Vec<f32>,
    directions: Option<&[Vec3]>,
    extent: Extent,
    color: bool,
    at: Moment,
) -> FieldOutput {
    let (device, count) = (field.device(), positions.len() / 3);
    let points = Points::scattered(upload(positions, [count, 3], &device), extent);
    let Some(directions) = directions else { return field.evaluate(&points, color, at) };
    let directions = upload(directions.iter().flat_map(|v| v.to_array()).collect(), [count, 3], &device);
    field.evaluate(&points.seen_along(directions), color, at)
}

#[cfg(test)]
mod tests {
    use infonerf_ops::sampling::Placement;

    use super::*;
    use crate::image::tests::config;

    #[test]
    fn only_training_before_an_unknown_backdrop_has_random_backgrounds() {
        let scene = |backdrop| Scene { backdrop, ..Scene::default() };
        let [known, unknown] = [Backdrop::Colour, Backdrop::Unknown]
            .map(|backdrop| Renderer::new(&config(Placement::Mid), &scene(backdrop)));
        let noise = |step| Some(Noise::new(0, step, RandomStream::SeenRays));
        assert_eq!([known.behind(noise(0)), known.behind(None), unknown.behind(None)], [[1.0; 3]; 3]);
        let [first, second] = [0, 1].map(|step| unknown.behind(noise(step)));
        assert!(first != second && first[0] != first[1], "{first:?}, {second:?}");
    }
}
