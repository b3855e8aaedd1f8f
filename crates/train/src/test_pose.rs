//! The pose of a test view, fitted to its photograph before it is measured.

use std::borrow::Cow;

use burn::module::Module;
use burn::optim::{GradientsParams, ModuleOptimizer};
use infonerf_field::Field;
use infonerf_loss::{Norm, photometric_loss};
use infonerf_ops::{adam::Adam, upload};
use infonerf_render::{
    CameraRefinement, ModelFrame, Noise, Pivot, RandomStream, RenderRequest, Renderer, TrainedModel,
};
use infonerf_scene::{PixelAt, Ray, Similarity, View};

const RAYS: usize = 512;
/// Adam's learning rate at the first step; it falls linearly to 0.
const RATE: f64 = 2e-3;

/// Optimizes the pose of `view` for `steps` Adam steps with each member's field fixed (BARF, Lin et al. 2021, Sec. 4), and
/// returns the members with the frames in which they show the view. A pose begins where the alignment of the training cameras
/// puts it, and stays as it is once `go_on`, which is called before each step, returns false.
///
/// The error of pictures then excludes that of poses. The view's image determines six values; a new view has no image.
pub fn fit_test_poses<'a, F: Field>(
    renderer: &Renderer,
    members: &'a [TrainedModel<F>],
    view: &View,
    pivot: Pivot,
    steps: usize,
    go_on: &mut dyn FnMut() -> bool,
) -> Cow<'a, [TrainedModel<F>]> {
    if steps == 0 {
        return Cow::Borrowed(members);
    }
    members.iter().map(|member| fit_test_pose(renderer, member, view, pivot, steps, go_on)).collect()
}

fn fit_test_pose<F: Field>(
    renderer: &Renderer,
    trained: &TrainedModel<F>,
    view: &View,
    pivot: Pivot,
    steps: usize,
    go_on: &mut dyn FnMut() -> bool,
) -> TrainedModel<F> {
    let start = trained.camera(&view.camera);
    let cameras = [start.clone()];
    let model = trained.model.clone().train().no_grad();
    let device = model.fine.device();
    let mut refinement = CameraRefinement::single(pivot, &device);
    let mut optimizer = ModuleOptimizer::from(Adam::default());
    let image = &view.image;
    let usable = |index: &usize| view.valid.as_ref().is_none_or(|valid| valid[*index]);
    let pixels: Vec<usize> = (0..image.rgb.len()).filter(usable).collect();
    // A view without a valid pixel keeps its pose.
    let steps = if pixels.is_empty() { 0 } else { steps };
    for step in 0..steps {
        if !go_on() {
            break;
        }
        let noise = Noise::new(view.id as u64, step as u64, RandomStream::SeenRays);
        let drawn: Vec<usize> = (0..RAYS).map(|ray| pixels[noise.below(ray, 0, pixels.len())]).collect();
        let stride = image.width as usize;
        let position = |&i: &usize| PixelAt { view: 0, x: (i % stride) as f32 + 0.5, y: (i / stride) as f32 + 0.5 };
        let at: Vec<PixelAt> = drawn.iter().map(position).collect();
        let camera = refinement.apply(&cameras).remove(0);
        let rays: Vec<Ray> = at.iter().map(|pixel| camera.ray(pixel.x, pixel.y)).collect();
        let rays = renderer.rays(rays, &device).tracked(refinement.rays(&cameras, &at));
        let request = RenderRequest { color: true, hidden: true };
        let passes = renderer.render(&model, &rays, request, trained.occupancy.as_ref(), trained.at);
        let shown: Vec<f32> = drawn.iter().flat_map(|&index| image.rgb[index]).collect();
        let target = upload(shown, [RAYS, 3], &device);
        let loss = photometric_loss(passes.fine.color.expect("colour was asked for"), target, Norm::Mean);
        if !loss.is_tracked() {
            // No ray meets an occupied cell.
            continue;
        }
        let gradients = GradientsParams::from_grads(loss.backward(), &refinement);
        let rate = RATE * (1.0 - step as f64 / steps as f64);
        refinement = optimizer.step(rate, refinement, gradients);
    }
    let fitted = refinement.apply(&cameras).remove(0);
    let (scale, zoom) = trained.frame.map_or((1.0, 1.0), |frame| (frame.similarity.scale, frame.zoom));
    let rotation = fitted.rotation() * view.camera.rotation().transpose();
    let translation = fitted.position_f64() - scale * (rotation * view.camera.position_f64());
    let similarity = Similarity { rotation, scale, translation };
    TrainedModel { frame: Some(ModelFrame { similarity, zoom }), ..trained.clone() }
}
