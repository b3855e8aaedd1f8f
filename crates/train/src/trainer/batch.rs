//! Batches of steps: pixels, the groups of rays through them, and the colours that they show.

use std::sync::Arc;

use glam::DMat4;
use infonerf_field::Field;
use infonerf_loss::{Need, Target};
use infonerf_ops::upload;
use infonerf_render::{CameraRefinement, Model, Noise, RandomStream, RayBatch};
use infonerf_scene::ViewRegion;
use infonerf_schedule::Moment;

use crate::config::{Config, NeighbourSampling};
use crate::images::SeenPixels;
use crate::pixels::{Pixels, UnseenViews, rotation};
use crate::training_scene::TrainingScene;

/// Pixels and poses of a step. The trainer draws them, or is given them by [`Trainer::step_on`](crate::Trainer::step_on).
#[derive(Clone, Debug)]
pub struct StepBatch {
    /// Index of the scene.
    pub scene: usize,
    /// Pixels of training images.
    pub seen: SeenPixels,
    /// Pixels of an unseen pose, if a term needs them.
    pub unseen: Option<Pixels>,
    /// The rotation that takes cameras to those of neighbouring rays.
    pub rotation: DMat4,
}

#[derive(Debug)]
pub(super) struct Batches {
    pub(super) scenes: Arc<[TrainingScene]>,
    pub(super) seed: u64,
}

impl Batches {
    /// Draws the batch of the step at `at`: `seen` pixels and, if a term `needs` them, `unseen` ones. Unseen poses are near the
    /// training cameras, as far as `cameras` corrects them.
    pub(super) fn draw(
        &self,
        config: &Config,
        [seen, unseen]: [usize; 2],
        at: Moment,
        cameras: Option<&CameraRefinement>,
    ) -> StepBatch {
        let noise = |stream| Noise::new(self.seed, at.step as u64, stream);
        let train = &config.train;
        let index = noise(RandomStream::TrainingScene).below(0, 0, self.scenes.len());
        let scene = &self.scenes[index];
        let images = scene.images.at(train, at);
        let draw_unseen = || {
            let learned = cameras.map(|cameras| ViewRegion::new(&cameras.apply(&scene.images.cameras)));
            let views = UnseenViews { region: learned.as_ref().unwrap_or(&scene.region), ..scene.unseen(train) };
            views.pixels(unseen, images.pixel_width(), at.step, noise(RandomStream::UnseenRays))
        };
        StepBatch {
            scene: index,
            seen: scene.images.draw(train, seen, at, noise(RandomStream::SeenRays)),
            unseen: scene.needs(at).contains(&Need::Unseen).then(draw_unseen),
            rotation: rotation(&train.neighbours, noise(RandomStream::Neighbours)),
        }
    }
}

/// Part that a group of rays has in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    Seen,
    Unseen,
    SeenNeighbours,
    UnseenNeighbours,
}

/// Distances of the samples along a group of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Distances {
    /// Placed for the group.
    Own,
    /// Shared with the group of this role.
    OfPartner(Role),
}

#[derive(Clone, Debug)]
pub(super) struct RayGroup {
    pub(super) role: Role,
    pub(super) rays: RayBatch,
    pub(super) distances: Distances,
}

impl StepBatch {
    /// Returns the rays of training images, and those of the batch that are needed, in the order in which they are
    /// rendered: groups come after their partners. Rays of cameras that `model` corrects are in its graph.
    pub(super) fn ray_groups<F: Field>(
        &self,
        config: &Config,
        scene: &TrainingScene,
        model: &Model<F>,
        needs: &[Need],
        noise: impl Fn(RandomStream) -> Noise,
    ) -> Vec<RayGroup> {
        let device = model.fine.device();
        let group = |role, rays, stream| RayGroup {
            role,
            rays: scene.renderer.rays(rays, &device).jittered(noise(stream).child(RandomStream::Samples)),
            distances: Distances::Own,
        };
        let given = &self.seen.pixels;
        let corrected = model.cameras.as_ref().map(|cameras| given.seen_by(cameras.apply(&given.cameras).into()));
        let pixels = corrected.as_ref().unwrap_or(given);
        let mut seen = group(Role::Seen, pixels.rays(), RandomStream::SeenRays);
        seen.rays = seen.rays.with_pixels(given.at.clone());
        if let Some(cameras) = &model.cameras {
            seen.rays = seen.rays.tracked(cameras.rays(&given.cameras, &given.at));
        }
        let mut groups = vec![seen];
        let unseen = self.unseen.as_ref().filter(|_| needs.contains(&Need::Unseen));
        groups.extend(unseen.map(|unseen| group(Role::Unseen, unseen.rays(), RandomStream::UnseenRays)));

        let neighbours = &config.train.neighbours;
        let near = [
            (Need::SeenNeighbours, Role::SeenNeighbours, Role::Seen, Some(pixels)),
            (Need::UnseenNeighbours, Role::UnseenNeighbours, Role::Unseen, unseen),
        ];
        for (need, role, partner, pixels) in near {
            let Some(pixels) = pixels.filter(|_| needs.contains(&need)) else { continue };
            let rays = pixels.neighbours(self.rotation, neighbours, &scene.region);
            let near = group(role, rays, RandomStream::Neighbours);
            groups.push(match neighbours.sampling {
                NeighbourSampling::Own => near,
                NeighbourSampling::Partner => RayGroup { distances: Distances::OfPartner(partner), ..near },
            });
        }
        groups
    }

    /// Returns the colours of the seen pixels, on the device of `model`.
    pub(super) fn target<F: Field>(&self, scene: &TrainingScene, model: &Model<F>) -> Target {
        let SeenPixels { rgb, pixels, .. } = &self.seen;
        Target {
            rgb: upload(rgb.as_flattened().to_vec(), [rgb.len(), 3], &model.fine.device()),
            on_host: rgb.clone(),
            pixels: pixels.at.clone(),
            background: scene.scene.background,
        }
    }
}
