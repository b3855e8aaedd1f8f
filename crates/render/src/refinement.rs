//! Corrections of the training cameras, which are learned with the field (BARF, Lin et al. 2021; NeRF−−, Wang et al. 2021).

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use infonerf_ops::{rotate, to_host, upload, upload_rows};
use infonerf_scene::{Camera, PixelAt, Scene};
use serde::{Deserialize, Serialize};

/// Focal lengths that are learned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Focal {
    /// No focal length is learned.
    #[default]
    Fixed,
    /// One factor for all views, which one camera took.
    Shared,
}

/// Rigid motion of each training view's camera and, if requested, one factor of all focal lengths.
///
/// The camera with centre c, orientation R and focal length f becomes `p + Q (c − p) + s τ`, `Q R` and `f e^φ`, where
/// `Q = exp([ω]×)`. (ω, τ) ∈ ℝ⁶ are the view's parameters minus their mean over all views, p is the scene's centre, and s the
/// mean distance of cameras from p. ω in radians and τ in units of s have similar magnitudes. All parameters start at 0.
/// Cameras turn about p: a turn about c changes the image nearly as a move of the camera does, and gradient descent would
/// separate the two slowly. Subtracting the mean fixes six of the seven degrees of freedom (the gauge) that no photograph
/// determines; [`Self::prior`] constrains the seventh, scale.
#[derive(Module, Debug)]
pub struct CameraRefinement {
    /// (ω, τ), `[V, 6]`.
    poses: Param<Tensor<2>>,
    /// φ, `[1]`, if it is learned.
    focal: Option<Param<Tensor<1>>>,
    #[module(skip)]
    pivot: Pivot,
    #[module(skip)]
    gauge: bool,
}

/// Origin and unit of the corrections of cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// Point p about which cameras turn.
    pub centre: Vec3,
    /// Length s of a unit of τ, scene units.
    pub scale: f32,
}

impl Pivot {
    /// Returns the centre of `scene`, and the mean distance of its training cameras from it.
    pub fn of(scene: &Scene) -> Self {
        let centre = scene.space.centre;
        let sum: f32 = scene.train.iter().map(|view| view.camera.position().distance(centre)).sum();
        Self { centre, scale: (sum / scene.train.len() as f32).max(1e-3) }
    }
}

impl CameraRefinement {
    /// Creates corrections of `views` cameras, all 0.
    pub fn new(views: usize, pivot: Pivot, focal: Focal, device: &Device) -> Self {
        let poses = Param::from_data(TensorData::zeros::<f32, _>([views, 6]), device);
        let phi = || Param::from_data(TensorData::zeros::<f32, _>([1]), device);
        let focal = (focal == Focal::Shared).then(phi);
        Self { poses, focal, pivot, gauge: true }
    }

    /// Creates the correction of one camera, such as a test view's, in a known frame: no mean is subtracted.
    pub fn single(pivot: Pivot, device: &Device) -> Self {
        Self { gauge: false, ..Self::new(1, pivot, Focal::Fixed, device) }
    }

    /// Returns (ω, τ) less their mean over the views, `[V, 6]`.
    fn motions(&self) -> Tensor<2> {
        let poses = self.poses.val();
        if self.gauge { poses.clone() - poses.mean_dim(0) } else { poses }
    }

    /// Returns the mean of |ω|² + |τ|² + φ² over the views, `[1]`: a penalty on the distance from the start.
    pub fn prior(&self) -> Tensor<1> {
        let motions = self.motions().square().sum_dim(1).mean();
        match &self.focal {
            Some(focal) => motions + focal.val().square().mean(),
            None => motions,
        }
    }

    /// Returns the corrected `cameras`.
    ///
    /// # Panics
    /// If `cameras` and views differ in number.
    pub fn apply(&self, cameras: &[Camera]) -> Vec<Camera> {
        let motions = to_host(self.motions());
        assert_eq!(motions.len(), 6 * cameras.len(), "one correction per camera");
        let corrected = |(camera, motion): (&Camera, &[f32])| {
            let [turn, shift] = [0, 3].map(|i| DVec3::from_array([0, 1, 2].map(|axis| f64::from(motion[i + axis]))));
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(turn));
            let centre = self.pivot.centre.as_dvec3();
            let position = centre + turn * (camera.position_f64() - centre) + f64::from(self.pivot.scale) * shift;
            camera.with_pose(DMat4::from_translation(position) * DMat4::from_mat3(turn * camera.rotation()))
        };
        self.refocused(cameras).iter().zip(motions.chunks_exact(6)).map(corrected).collect()
    }

    fn refocused(&self, cameras: &[Camera]) -> Vec<Camera> {
        let Some(focal) = &self.focal else { return cameras.to_vec() };
        let phi = f64::from(to_host(focal.val())[0]);
        cameras.iter().map(|camera| zoomed(camera, phi)).collect()
    }

    /// Returns the origins and unit directions, `[R, 3]` each, of the rays of pixels `at` of the corrected `cameras`,
    /// differentiable in the corrections ([`RayBatch::tracked`](crate::RayBatch::tracked)).
    ///
    /// A rigid motion does not involve the lens. The derivative of a ray with respect to the focal length is computed on
    /// the host, by central differences in `f64` of [`Camera::ray_f64`], which includes the lens.
    pub fn rays(&self, cameras: &[Camera], at: &[PixelAt]) -> [Tensor<2>; 2] {
        let device = self.poses.val().device();
        let views = upload(at.iter().map(|pixel| pixel.view as i32).collect(), [at.len()], &device);
        let cameras = self.refocused(cameras);
        let rows = |of: &dyn Fn(&PixelAt) -> DVec3| {
            let numbers: Vec<f32> = at.iter().flat_map(|pixel| of(pixel).as_vec3().to_array()).collect();
            upload_rows(&numbers, 3, &device)
        };
        let direction = |camera: &Camera, pixel: &PixelAt| camera.ray_f64(pixel.x.into(), pixel.y.into()).1;
        let mut directions = rows(&|pixel| direction(&cameras[pixel.view], pixel));
        if let Some(focal) = &self.focal {
            const STEP: f64 = 1e-4;
            let derivative = rows(&|pixel| {
                let [more, less] = [STEP, -STEP].map(|by| direction(&zoomed(&cameras[pixel.view], by), pixel));
                (more - less) / (2.0 * STEP)
            });
            let focal = focal.val().expand([at.len()]);
            let change = focal.clone() - focal.detach();
            directions = directions + derivative * change.unsqueeze_dim(1);
        }
        let motions = self.motions().select(0, views);
        let [turns, shifts] = [0, 3].map(|first| motions.clone().narrow(1, first, 3));
        let Pivot { centre, scale } = self.pivot;
        let arms = rows(&|pixel| cameras[pixel.view].position_f64() - centre.as_dvec3());
        let centre = upload(centre.to_array().to_vec(), [1, 3], &device);
        [rotate(arms, turns.clone()) + shifts * scale + centre, rotate(directions, turns)]
    }
}

/// Returns the camera with focal lengths e^φ times as long.
fn zoomed(camera: &Camera, phi: f64) -> Camera {
    Camera { fx: camera.fx * phi.exp(), fy: camera.fy * phi.exp(), ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{Lens, look_along};

    use super::*;

    const PIVOT: Pivot = Pivot { centre: Vec3::new(0.2, -0.1, 0.3), scale: 3.0 };

    fn cameras(lens: Lens) -> Vec<Camera> {
        let camera = |p| Camera::pinhole((40, 30), [45.0, 47.0], [21.0, 14.0], look_along(p, -p, DVec3::Z));
        let at = [DVec3::new(1.0, -3.0, 2.0), DVec3::new(-2.0, 2.5, 1.0), DVec3::new(0.5, 3.0, 2.0)];
        at.map(|p| camera(p).with_lens(lens)).to_vec()
    }

    fn refinement(poses: &[f32], phi: f32) -> CameraRefinement {
        let device = Device::flex().autodiff();
        let start = CameraRefinement::new(3, PIVOT, Focal::Shared, &device);
        let focal = Tensor::from_floats([phi], &device);
        CameraRefinement {
            poses: start.poses.map(|_| upload_rows(poses, 6, &device).require_grad()),
            focal: start.focal.map(|param| param.map(|_| focal.require_grad())),
            ..start
        }
    }

    /// Returns `count` irregular values in [−`size`, `size`].
    fn numbers(count: usize, size: f32) -> Vec<f32> {
        (1..=count).map(|i| size * (2.0 * (i as f32 * 0.618_034).fract() - 1.0)).collect()
    }

    /// Compares all corrections at once, through lenses with and without distortion: values with the corrected cameras on
    /// the host, gradients with central differences in `f64`.
    #[test]
    fn rays_and_their_gradients_match_the_corrected_cameras() {
        let fisheye = Lens::fisheye([0.05, -0.01, 0.0, 0.0]);
        for lens in [Lens::PERSPECTIVE, Lens::radial_tangential([-0.2, 0.05, 0.0, 0.0], [1e-3, 2e-3]), fisheye] {
            let cameras = cameras(lens);
            let at = [(0, 3.0, 4.0), (1, 35.5, 20.0), (2, 20.0, 28.0), (0, 30.0, 9.5)];
            let at = at.map(|(view, x, y)| PixelAt { view, x, y });
            for size in [0.0, 0.1] {
                let (poses, phi) = (numbers(18, size), 0.5 * size);
                let learned = refinement(&poses, phi);
                let (found, factor) = (&learned.apply(&cameras)[1], f64::from(phi).exp());
                assert_eq!([found.fx, found.fy], [cameras[1].fx * factor, cameras[1].fy * factor]);
                let weights = numbers(24, 1.0);
                let loss = |poses: &[f32], phi: f32| -> f64 {
                    let corrected = refinement(poses, phi).apply(&cameras);
                    let rays = at.iter().map(|p| corrected[p.view].ray_f64(p.x.into(), p.y.into()));
                    let numbers = rays.flat_map(|(o, d)| [o.to_array(), d.to_array()].concat());
                    numbers.zip(&weights).map(|(x, weight)| x * f64::from(*weight)).sum()
                };
                let all = Tensor::cat(learned.rays(&cameras, &at).to_vec(), 1);
                let total = (all * upload_rows(&weights, 6, &Device::flex().autodiff())).sum();
                let value = f64::from(total.clone().into_scalar::<f32>());
                approx::assert_abs_diff_eq!(value, loss(&poses, phi), epsilon = 1e-5);
                let gradients = total.backward();
                let of_poses = to_host(learned.poses.val().grad(&gradients).unwrap());
                let of_focal = to_host(learned.focal.as_ref().unwrap().val().grad(&gradients).unwrap());
                for (index, found) in of_poses.into_iter().chain(of_focal).enumerate() {
                    let nudged = |by: f32| {
                        let mut all = [poses.as_slice(), &[phi]].concat();
                        all[index] += by;
                        loss(&all[..18], all[18])
                    };
                    let want = (nudged(0.004) - nudged(-0.004)) / 0.008;
                    assert!((f64::from(found) - want).abs() < 2e-4, "{lens} {size} {index}: {found} for {want}");
                }
            }
        }
    }

    /// Checks that a motion common to all cameras, which only changes the frame, corrects none; that of a single camera does.
    #[test]
    fn a_common_motion_is_no_correction() {
        let cameras = cameras(Lens::PERSPECTIVE);
        let motion = [0.3, -0.2, 0.1, 0.5, 0.4, -0.3];
        let moved = refinement(&motion.repeat(3), 0.0);
        for (found, camera) in moved.apply(&cameras).iter().zip(&cameras) {
            assert!(found.ray_f64(11.0, 7.0).1.distance(camera.ray_f64(11.0, 7.0).1) < 1e-6);
            assert!(found.position_f64().distance(camera.position_f64()) < 1e-6);
        }
        assert!(to_host(moved.prior())[0] < 1e-12);
        // Two opposite motions, whose squares sum to 0.64 each, among three views.
        let opposed = [motion, motion.map(|x| -x), [0.0; 6]].concat();
        let prior = to_host(refinement(&opposed, 0.2).prior())[0];
        approx::assert_relative_eq!(prior, 2.0 * 0.64 / 3.0 + 0.04, max_relative = 1e-5);
        let single = CameraRefinement::single(PIVOT, &Device::flex());
        let poses = single.poses.map(|_| upload_rows(&motion, 6, &Device::flex()));
        let found = CameraRefinement { poses, ..single }.apply(&cameras[..1]);
        assert!(found[0].position_f64().distance(cameras[0].position_f64()) > 1.0);
    }
}
