//! Region in which a field is baked.

use glam::Vec3;
use infonerf_render::{RenderConfig, Warp};
use infonerf_scene::{Aabb, Scene};

use crate::shader::clips;

/// Maximum distance from a scene's centre that is baked if rays are not clipped, in halves of its box's longest side.
const MAX_REACH: f32 = 3.0;
/// Minimum share of the light that a density absorbs across the whole box; a lower density counts as empty.
const MIN_SHARE: f32 = 0.02;

/// Part of the field's space that can be occupied.
#[derive(Debug)]
pub(super) struct Domain {
    /// Bounding box of the domain.
    pub(super) bounds: Aabb,
    /// Centre of the domain's bounding ball.
    centre: Vec3,
    radius: f32,
    /// Longest side of the box that the field is made for, along which voxels are counted.
    pub(super) side: f32,
}

impl Domain {
    /// Returns the scene's box if rays are clipped to it; otherwise also the region that the training cameras see beyond it,
    /// between near and far, within three times the box. In warped space it is the box or ball that the warp maps to.
    pub(super) fn of(scene: &Scene, config: &RenderConfig, warp: &Warp) -> Self {
        let bounds = warp.bounds(scene);
        let (centre, side) = (bounds.centre(), bounds.size().max_element());
        let corner = 0.5 * bounds.size().length();
        let box_alone = Self { bounds, centre, radius: corner, side };
        match warp {
            Warp::Contraction { .. } => Self { radius: 0.5 * side, ..box_alone },
            Warp::Identity if !clips(config, warp) => {
                let radius = reach(scene, centre).min(0.5 * MAX_REACH * side).max(corner);
                Self { bounds: Aabb::cube(centre, radius), radius, ..box_alone }
            }
            Warp::Identity | Warp::Ndc { .. } => box_alone,
        }
    }

    /// Returns whether `p` is in the domain, or at most `margin` away from it.
    pub(super) fn holds(&self, p: Vec3, margin: f32) -> bool {
        let margins = Vec3::splat(margin);
        let bounds = Aabb { min: self.bounds.min - margins, max: self.bounds.max + margins };
        bounds.contains(p) && self.centre.distance(p) <= self.radius + margin
    }

    /// Returns the density below which space counts as empty.
    pub(super) fn least_density(&self) -> f32 {
        MIN_SHARE / self.side
    }
}

/// Returns the maximum distance from `centre` of the ends, at near and far, of the training cameras' outermost rays.
fn reach(scene: &Scene, centre: Vec3) -> f32 {
    let cameras = scene.all_train_cameras.iter().chain(scene.train.iter().map(|view| &view.camera));
    let ends = cameras.flat_map(|camera| {
        let (width, height) = (camera.width as f32, camera.height as f32);
        let pixels = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height), (0.5 * width, 0.5 * height)];
        let rays = pixels.map(|(x, y)| camera.ray(x, y));
        rays.into_iter().filter_map(|ray| scene.interval(&ray).map(|(near, far)| [ray.at(near), ray.at(far)]))
    });
    ends.flatten().map(|end| end.distance(centre)).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use infonerf_render::SpaceChoice;
    use infonerf_scene::{Camera, Range};
    use infonerf_train::{Config, Preset};

    use super::*;

    #[test]
    fn domain_holds_everything_that_rays_can_meet() {
        let at = |x| glam::DMat4::from_translation(glam::DVec3::new(x, 0.0, 4.0));
        let all_train_cameras = [0.0, 0.5].map(|x| Camera::from_fov(8, 8, 0.5, at(x))).to_vec();
        let scene = Scene { all_train_cameras, ..Scene::default() };
        let mut config = Config::from_table(Preset::Fast.table()).unwrap().render;
        let cut = Domain::of(&scene, &config, &Warp::Identity);
        assert_eq!((cut.bounds, cut.side), (scene.space.bounds, 3.0));
        assert!(cut.holds(Vec3::splat(1.5), 0.0) && !cut.holds(Vec3::X * 1.6, 0.05) && cut.holds(Vec3::X * 1.6, 0.2));
        config.clip_to_bounds = false;
        // Without clipping, the domain reaches to the far ends of rays at the corners of pictures.
        let whole = Domain::of(&scene, &config, &Warp::Identity);
        assert!(whole.radius > 2.6 && whole.radius < 3.2 && whole.side == 3.0, "{whole:?}");
        assert!(whole.holds(Vec3::Z * 2.5, 0.0) && !whole.holds(Vec3::splat(2.0), 0.0));
        let mut far = scene.clone();
        far.space.range = Range::Distance { near: 2.0, far: 1000.0 };
        assert_eq!(Domain::of(&far, &config, &Warp::Identity).radius, 4.5);
        let warp = Warp::of(&scene, SpaceChoice::Contraction);
        let ball = Domain::of(&scene, &config, &warp);
        assert!(ball.holds(Vec3::X * 1.99, 0.0) && !ball.holds(Vec3::splat(1.5), 0.0), "{ball:?}");
    }
}
