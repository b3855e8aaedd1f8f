//! Corrections of the training cameras, which are learnt with the field (BARF, Lin et al. 2021; NeRF−−, Wang et al. 2021).

use burn::module::{Module, Param};
use burn::tensor::{Device, Int, Tensor, TensorData};
use glam::{DMat3, DMat4, DQuat, DVec3};
use infonerf_ops::{from_host, rotate, to_host};
use infonerf_scene::{Camera, PixelAt, Ray};
use serde::{Deserialize, Serialize};

/// Which focal lengths are learnt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Focal {
    /// None: they stay as they are.
    #[default]
    Fixed,
    /// One factor for all views, of one camera.
    Shared,
    /// A factor for each view.
    Each,
}

/// A small rigid motion and, if asked for, a factor of the focal length per training view.
///
/// The camera with centre c, orientation R and focal length f becomes `c + s τ`, `exp([ω]×) R` and `f e^φ`, where
/// (ω, τ) ∈ ℝ⁶ is the view's, less the mean over all views, and s a length of the scene: ω in radians and τ as a share of s
/// are of one size. All begin at 0. Removing the mean fixes the frame (the gauge) of six of the seven motions that no
/// photograph can tell; the seventh, scale, is left to [`Self::prior`].
#[derive(Module, Debug)]
pub struct CameraRefinement {
    /// (ω, τ), `[V, 6]`.
    poses: Param<Tensor<2>>,
    /// φ, `[V]`, or `[1]` if it is shared.
    focal: Option<Param<Tensor<1>>>,
    #[module(skip)]
    scale: f32,
    #[module(skip)]
    gauge: bool,
}

/// Rays as tensors in an autodiff graph.
#[derive(Clone, Debug)]
pub struct TrackedRays {
    /// `[R, 3]`, scene units.
    pub origins: Tensor<2>,
    /// Unit vectors, `[R, 3]`.
    pub directions: Tensor<2>,
}

/// A bundle of rays to render: on the host, which places samples, and tracked where a gradient is to reach them.
#[derive(Clone, Copy, Debug)]
pub struct RayBundle<'a> {
    /// The rays.
    pub rays: &'a [Ray],
    /// The same as tensors.
    pub tracked: Option<&'a TrackedRays>,
}

impl<'a> From<&'a [Ray]> for RayBundle<'a> {
    fn from(rays: &'a [Ray]) -> Self {
        Self { rays, tracked: None }
    }
}

impl<'a> From<&'a Vec<Ray>> for RayBundle<'a> {
    fn from(rays: &'a Vec<Ray>) -> Self {
        rays.as_slice().into()
    }
}

impl<'a, const N: usize> From<&'a [Ray; N]> for RayBundle<'a> {
    fn from(rays: &'a [Ray; N]) -> Self {
        rays.as_slice().into()
    }
}

impl CameraRefinement {
    /// No correction yet of `views` cameras in a scene of the length `scale`.
    pub fn new(views: usize, scale: f32, focal: Focal, device: &Device) -> Self {
        let factors = match focal {
            Focal::Fixed => None,
            Focal::Shared => Some(1),
            Focal::Each => Some(views),
        };
        Self {
            poses: Param::from_data(TensorData::zeros::<f32, _>([views, 6]), device),
            focal: factors.map(|count| Param::from_data(TensorData::zeros::<f32, _>([count]), device)),
            scale,
            gauge: true,
        }
    }

    /// The correction of one camera in a frame that is known already, as of a test view.
    pub fn of_one(scale: f32, device: &Device) -> Self {
        Self { gauge: false, ..Self::new(1, scale, Focal::Fixed, device) }
    }

    /// (ω, τ) less their mean, `[V, 6]`.
    fn motions(&self) -> Tensor<2> {
        let poses = self.poses.val();
        if self.gauge { poses.clone() - poses.mean_dim(0) } else { poses }
    }

    /// Mean of |ω|² + |τ|² + φ² over the views, `[1]`: the pull towards the start.
    pub fn prior(&self) -> Tensor<1> {
        let motions = self.motions().square().sum_dim(1).mean();
        match &self.focal {
            Some(focal) => motions + focal.val().square().mean(),
            None => motions,
        }
    }

    /// The corrected `cameras`.
    ///
    /// # Panics
    /// If they are not as many as the views.
    pub fn apply(&self, cameras: &[Camera]) -> Vec<Camera> {
        let motions = to_host(self.motions());
        assert_eq!(motions.len(), 6 * cameras.len(), "one correction per camera");
        let refocused = self.refocused(cameras);
        let corrected = refocused.iter().zip(motions.chunks_exact(6)).map(|(camera, motion)| {
            let [turn, shift] = [0, 3].map(|i| DVec3::from_array([0, 1, 2].map(|axis| f64::from(motion[i + axis]))));
            let rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * camera.rotation();
            let position = camera.position_f64() + f64::from(self.scale) * shift;
            camera.with_pose(DMat4::from_translation(position) * DMat4::from_mat3(rotation))
        });
        corrected.collect()
    }

    /// The cameras with their focal lengths corrected alone.
    fn refocused(&self, cameras: &[Camera]) -> Vec<Camera> {
        let Some(focal) = &self.focal else { return cameras.to_vec() };
        let factors = to_host(focal.val());
        let of_view = |(view, camera): (usize, &Camera)| zoomed(camera, f64::from(factors[view % factors.len()]));
        cameras.iter().enumerate().map(of_view).collect()
    }

    /// The rays of pixels `at` of the corrected `cameras`, differentiable in the corrections.
    ///
    /// A lens has no part in a rigid motion. By the focal length a ray is differentiated on the host, by central differences
    /// in `f64` of [`Camera::ray_f64`], through whatever lens there is.
    pub fn rays(&self, cameras: &[Camera], at: &[PixelAt]) -> TrackedRays {
        let device = self.poses.val().device();
        let views: Vec<i32> = at.iter().map(|pixel| pixel.view as i32).collect();
        let views = Tensor::<1, Int>::from_data(TensorData::new(views, [at.len()]), &device);
        let cameras = self.refocused(cameras);
        let rows = |of: &dyn Fn(&PixelAt) -> DVec3| {
            let numbers: Vec<f32> = at.iter().flat_map(|pixel| of(pixel).as_vec3().to_array()).collect();
            from_host(&numbers, 3, &device)
        };
        let direction = |camera: &Camera, pixel: &PixelAt| camera.ray_f64(pixel.x.into(), pixel.y.into()).1;
        let mut directions = rows(&|pixel| direction(&cameras[pixel.view], pixel));
        if let Some(focal) = &self.focal {
            const STEP: f64 = 1e-4;
            let slope = rows(&|pixel| {
                let [more, less] = [STEP, -STEP].map(|by| direction(&zoomed(&cameras[pixel.view], by), pixel));
                (more - less) / (2.0 * STEP)
            });
            let focal = focal.val();
            let focal = if focal.dims()[0] == 1 { focal.expand([at.len()]) } else { focal.select(0, views.clone()) };
            let change = focal.clone() - focal.detach();
            directions = directions + slope * change.unsqueeze_dim(1);
        }
        let motions = self.motions().select(0, views);
        let origins = rows(&|pixel| cameras[pixel.view].position_f64());
        TrackedRays {
            origins: origins + motions.clone().narrow(1, 3, 3) * self.scale,
            directions: rotate(directions, motions.narrow(1, 0, 3)),
        }
    }
}

/// The camera with focal lengths e^φ times as long.
fn zoomed(camera: &Camera, phi: f64) -> Camera {
    Camera { fx: camera.fx * phi.exp(), fy: camera.fy * phi.exp(), ..camera.clone() }
}
