//! Choice of a scene's warp, by its extent and its cameras.

use glam::{DMat3, DMat4, Vec2, Vec3};
use infonerf_scene::{Aabb, Camera, Layout, Range, Ray, Scene, Space};
use serde::{Deserialize, Serialize};

use super::Warp;

/// Choice of the [`Warp`] of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SpaceChoice {
    /// Chosen by the scene: the world if it is bounded, NDC if the cameras face forward, else contraction.
    #[default]
    Auto,
    /// World coordinates as they are, in the scene's box.
    Box,
    /// Normalised device coordinates.
    Ndc,
    /// Contraction.
    Contraction,
    /// Chosen as by `auto`, but contraction only scales the ball about the centre that holds three quarters of the
    /// surface points, at most out to the cameras: fields are finest there.
    Content,
}

/// Share of the surface points that the ball of [`SpaceChoice::Content`] holds.
const CONTENT_SHARE: f32 = 0.75;

impl Warp {
    /// Returns the warp of `scene`: contraction in place of NDC if the cameras have none ([`Self::has_ndc`]).
    pub fn of(scene: &Scene, space: SpaceChoice) -> Self {
        let space = match (space, scene.space.layout) {
            (SpaceChoice::Auto | SpaceChoice::Content, _) if scene.space.bounded => SpaceChoice::Box,
            (SpaceChoice::Auto | SpaceChoice::Content, Layout::Forward) => SpaceChoice::Ndc,
            (SpaceChoice::Auto, Layout::Object | Layout::Inside) => SpaceChoice::Contraction,
            (chosen, _) => chosen,
        };
        match (space, mean_camera(scene)) {
            (SpaceChoice::Ndc, Some(camera)) => Self::Ndc {
                to_camera: camera.to_world.inverse().as_mat4(),
                scale: 2.0 * Vec2::new(camera.fx as f32 / camera.width as f32, camera.fy as f32 / camera.height as f32),
                near: scene.space.near.max(1e-3 * scene.space.far),
            },
            (SpaceChoice::Contraction | SpaceChoice::Content | SpaceChoice::Ndc, _) => match scene.space.range {
                Range::Sphere { centre, radius } => Self::Contraction { centre, radius },
                _ if space == SpaceChoice::Content => {
                    Self::Contraction { centre: scene.space.centre, radius: content_radius(&scene.space) }
                }
                _ => Self::Contraction { centre: scene.space.centre, radius: scene.space.radius },
            },
            (SpaceChoice::Box | SpaceChoice::Auto, _) => Self::Identity,
        }
    }

    /// Whether all cameras of `scene` face within 90° of their mean direction, as normalised device coordinates need.
    pub fn has_ndc(scene: &Scene) -> bool {
        mean_camera(scene).is_some()
    }

    /// Returns a box that holds [`Self::point`] of everything that the training cameras of `scene` see.
    pub fn bounds(&self, scene: &Scene) -> Aabb {
        match self {
            Self::Identity => scene.space.bounds,
            Self::Contraction { .. } => Aabb::cube(Vec3::ZERO, 2.0),
            Self::Ndc { .. } => {
                let ends = |ray: Ray| scene.interval(&ray).map(|(near, far)| [ray.at(near), ray.at(far)]);
                let corners = cameras(scene).flat_map(|camera| {
                    let (width, height) = (camera.width as f32, camera.height as f32);
                    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
                    corners.into_iter().filter_map(move |(x, y)| ends(camera.ray(x, y)))
                });
                let seen = Aabb::containing(corners.flatten().map(|p| self.point(p)));
                seen.unwrap_or(Aabb::cube(Vec3::ZERO, 1.0))
            }
        }
    }
}

/// Returns the radius of the ball that holds [`CONTENT_SHARE`] of the surface points, at most the cameras' radius; without
/// points, that.
fn content_radius(space: &Space) -> f32 {
    let mut distances: Vec<f32> = space.points.iter().map(|p| p.distance(space.centre)).collect();
    let Some(last) = distances.len().checked_sub(1) else { return space.radius };
    let (_, distance, _) = distances.select_nth_unstable_by((CONTENT_SHARE * last as f32) as usize, f32::total_cmp);
    distance.clamp(1e-3 * space.radius, space.radius)
}

fn cameras(scene: &Scene) -> impl Iterator<Item = &Camera> {
    scene.all_train_cameras.iter().chain(scene.train.iter().map(|view| &view.camera))
}

/// Returns the first camera, moved to the mean position and direction of all; `None` if any faces away from that direction.
fn mean_camera(scene: &Scene) -> Option<Camera> {
    let first = cameras(scene).next()?;
    let count = cameras(scene).count() as f64;
    let sum = cameras(scene).fold(DMat4::ZERO, |sum, camera| sum + camera.to_world);
    let [place, back] = [sum.w_axis, sum.z_axis].map(|axis| axis.truncate() / count);
    let back = back.try_normalize()?;
    // A camera that faces away sees nothing in front of the mean camera.
    if cameras(scene).any(|camera| camera.to_world.z_axis.truncate().dot(back) <= 0.0) {
        return None;
    }
    let right = sum.y_axis.truncate().cross(back).try_normalize()?;
    let axes = DMat3::from_cols(right, back.cross(right), back);
    Some(first.with_pose(DMat4::from_translation(place) * DMat4::from_mat3(axes)))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::warp::tests::forward;

    #[test]
    fn automatic_warp_follows_the_layout() {
        assert!(Warp::of(&Scene::default(), SpaceChoice::Auto).is_identity());
        assert!(matches!(Warp::of(&forward(), SpaceChoice::Auto), Warp::Ndc { .. }));
        let mut around = forward();
        around.space.layout = Layout::Object;
        assert!(matches!(Warp::of(&around, SpaceChoice::Auto), Warp::Contraction { .. }));
        assert!(Warp::of(&around, SpaceChoice::Box).is_identity());
        let radius_of = |scene: &Scene| match Warp::of(scene, SpaceChoice::Content) {
            Warp::Contraction { radius, .. } => radius,
            other => panic!("{other:?}"),
        };
        assert_eq!(radius_of(&around), around.space.radius, "there are no points");
        around.space.points = (0..9).map(|i| around.space.centre + Vec3::Y * 0.25 * i as f32).collect();
        assert_eq!(radius_of(&around), 1.5, "three quarters of nine points");
        let Space { centre, radius, .. } = around.space;
        assert_eq!(Warp::of(&around, SpaceChoice::Auto), Warp::Contraction { centre, radius });
        around.space.radius = 1.0;
        assert_eq!(radius_of(&around), 1.0);
        around.space.range = Range::Sphere { centre: Vec3::X, radius: 0.5 };
        assert_eq!(Warp::of(&around, SpaceChoice::Auto), Warp::Contraction { centre: Vec3::X, radius: 0.5 });
    }

    #[test]
    fn ndc_are_those_of_the_mean_camera_of_cameras_that_face_its_way() {
        let mut scene = forward();
        let first = scene.all_train_cameras[0].clone();
        let placed = |x| first.with_pose(DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        scene.all_train_cameras = vec![placed(0.1), placed(0.5)];
        let Warp::Ndc { to_camera, .. } = Warp::of(&scene, SpaceChoice::Ndc) else { panic!("they face forward") };
        let seen = to_camera.transform_point3(Vec3::new(0.3, 0.0, -1.0));
        assert!(seen.abs_diff_eq(Vec3::NEG_Z, 1e-6), "{seen}");
        scene.all_train_cameras.push(first.with_pose(DMat4::from_rotation_y(std::f64::consts::PI)));
        assert!(!Warp::has_ndc(&scene));
    }
}
