//! Maps from the world to the space of a field: unbounded captures are mapped into a box.

mod choice;

pub use choice::SpaceChoice;

use burn::tensor::Tensor;
use glam::{Mat4, Vec2, Vec3};
use infonerf_ops::{is_gpu, to_host, upload};
use infonerf_scene::Ray;

/// Max coordinate `s` in warped space, about that of a bounded scene, so that densities have a similar scale.
const MAX_COORDINATE: f32 = 4.0;
/// Max distance, in units of the near depth (NDC) or of the radius (contraction).
const HORIZON: f32 = 1e4;

/// A map from points of the world to points at which a field is evaluated, and from distances `t` along a ray to the
/// coordinate `s` in which samples are evenly spaced.
#[derive(Clone, Debug, PartialEq)]
pub enum Warp {
    /// The world and its distances as they are: `s = t`.
    Identity,
    /// Normalised device coordinates of the mean training camera (NeRF, Appendix C):
    /// `(aₓ x/z, a_y y/z, 1 − 2n/z)` at depth z ≥ n, which maps an unbounded frustum into a box; `s = 4 (1 − n/t)`.
    Ndc {
        /// World to the camera's coordinates, OpenGL: it looks along −z.
        to_camera: Mat4,
        /// Focal lengths over half the image's width and height.
        scale: Vec2,
        /// Min depth n, scene units.
        near: f32,
    },
    /// Contraction (mip-NeRF 360, Barron et al. 2022, Eq. 10): with x from `centre` in units of `radius`, x where |x| ≤ 1,
    /// else `(2 − 1/|x|) x/|x|`, a ball of radius 2; `s = u` up to u = 2, then `4 − 4/u`, with `u = t/radius`.
    Contraction {
        /// The point that the cameras look at.
        centre: Vec3,
        /// Radius of the ball that is scaled only: the distance of the farthest camera, or a radius of the content.
        radius: f32,
    },
}

impl Warp {
    /// Whether the world is unchanged.
    pub fn is_identity(&self) -> bool {
        *self == Self::Identity
    }

    /// Returns the distance up to which rays are sampled in contraction, in place of the scene's far distance.
    pub(crate) fn horizon(&self) -> Option<f32> {
        if let Self::Contraction { radius, .. } = self { Some(radius * HORIZON) } else { None }
    }

    /// Returns the point at which a field is evaluated for the point `p` of the world.
    pub fn point(&self, p: Vec3) -> Vec3 {
        let x = match self {
            Self::Identity => p,
            Self::Ndc { to_camera, .. } => to_camera.transform_point3(p),
            Self::Contraction { centre, radius } => (p - *centre) / *radius,
        };
        self.curved(x.to_array().map(|x| [x])).map(|[x]| x).into()
    }

    /// Applies the nonlinear part of [`Self::point`] to `N` points in the axes of the mean camera, or in radii.
    #[inline]
    fn curved<const N: usize>(&self, [x, y, z]: [[f32; N]; 3]) -> [[f32; N]; 3] {
        match self {
            Self::Identity => [x, y, z],
            Self::Ndc { scale, near, .. } => {
                // Depths are clamped to at least half of `near`.
                let share = z.map(|z| 1.0 / (-z).max(0.5 * near));
                let across = |x: [f32; N], scale: f32| std::array::from_fn(|i| scale * x[i] * share[i]);
                [across(x, scale.x), across(y, scale.y), share.map(|share| 1.0 - 2.0 * near * share)]
            }
            Self::Contraction { .. } => {
                let factor: [f32; N] = std::array::from_fn(|i| {
                    let length = Vec3::new(x[i], y[i], z[i]).length();
                    let share = 1.0 / length;
                    if length <= 1.0 { 1.0 } else { (2.0 - share) * share }
                });
                [x, y, z].map(|axis| std::array::from_fn(|i| axis[i] * factor[i]))
            }
        }
    }

    /// Prepares [`Self::point`] for many points of `ray`.
    pub(crate) fn along(&self, ray: &Ray) -> WarpedRay<'_> {
        let (origin, direction) = match self {
            Self::Identity => (ray.origin, ray.direction),
            Self::Ndc { to_camera, .. } => {
                (to_camera.transform_point3(ray.origin), to_camera.transform_vector3(ray.direction))
            }
            Self::Contraction { centre, radius } => ((ray.origin - *centre) / *radius, ray.direction / *radius),
        };
        WarpedRay { warp: self, origin, direction }
    }

    /// Maps each row by [`Self::point`], `[M, 3]`, differentiable.
    pub fn points(&self, p: Tensor<2>) -> Tensor<2> {
        let device = p.device();
        let row = |v: [f32; 3]| upload(v.to_vec(), [1, 3], &device);
        match self {
            Self::Identity => p,
            Self::Ndc { to_camera, scale, near } => {
                let [x, y, z, origin] = to_camera.to_cols_array_2d().map(|[x, y, z, _]| row([x, y, z]));
                // This is no product of matrices, whose factors a GPU may round.
                let [a, b, c] = [0, 1, 2].map(|axis| p.clone().narrow(1, axis, 1));
                let p = a * x + b * y + c * z + origin;
                let z = p.clone().narrow(1, 2, 1).neg().clamp_min(0.5 * near);
                let across = p.narrow(1, 0, 2) / z.clone();
                let across = across * upload(scale.to_array().to_vec(), [1, 2], &device);
                Tensor::cat(vec![across, z.recip() * (-2.0 * near) + 1.0], 1)
            }
            Self::Contraction { centre, radius } => {
                let x = (p - row(centre.to_array())) / *radius;
                let length = x.clone().square().sum_dim(1).clamp_min(1.0).sqrt();
                x * (length.clone().recip().neg() + 2.0) / length
            }
        }
    }

    /// Converts each coordinate by [`Self::distance`], `[M]`.
    pub(crate) fn distances(&self, s: Tensor<1>) -> Tensor<1> {
        let device = s.device();
        match self {
            Self::Ndc { .. } | Self::Contraction { .. } if !is_gpu(&device) => {
                let t: Vec<f32> = to_host(s).into_iter().map(|s| self.distance(s)).collect();
                let count = t.len();
                upload(t, [count], &device)
            }
            Self::Identity => s,
            Self::Ndc { near, .. } => (s.neg() / MAX_COORDINATE + 1.0).clamp_min(1.0 / HORIZON).recip() * *near,
            Self::Contraction { radius, .. } => {
                let far = (s.clone().neg() + MAX_COORDINATE).clamp_min(4.0 / HORIZON).recip() * 4.0;
                s.clone().mask_where(s.greater_elem(2.0), far) * *radius
            }
        }
    }

    /// Returns Jᵀ g of each row, `[M, 3]`, with the Jacobian J of [`Self::point`]: converts the `gradient` g with respect
    /// to mapped points `q` to the gradient with respect to points of the world.
    pub(crate) fn world_gradient(&self, q: &Tensor<2>, gradient: Tensor<2>) -> Tensor<2> {
        if self.is_identity() {
            return gradient;
        }
        let mapped = to_host(q.clone());
        let world = mapped.chunks_exact(3).flat_map(|q| self.world(Vec3::from_slice(q)).to_array()).collect();
        let world: Tensor<2> = upload(world, q.dims(), &q.device());
        let world = world.autodiff().require_grad();
        let gradients = (self.points(world.clone()) * gradient).sum().backward();
        world.grad(&gradients).expect("the world is mapped")
    }

    /// Returns the inverse of [`Self::point`], with distances clamped to the horizon.
    pub fn world(&self, q: Vec3) -> Vec3 {
        match self {
            Self::Identity => q,
            Self::Ndc { to_camera, scale, near } => {
                let z = 2.0 * near / (1.0 - q.z).max(2.0 / HORIZON);
                to_camera.inverse().transform_point3(Vec3::new(q.x * z / scale.x, q.y * z / scale.y, -z))
            }
            Self::Contraction { centre, radius } => {
                let length = q.length();
                let x = if length <= 1.0 { q } else { q / (length * (2.0 - length).max(1.0 / HORIZON)) };
                *centre + *radius * x
            }
        }
    }

    /// Returns the coordinate `s` at distance `t` along a ray.
    pub fn coordinate(&self, t: f32) -> f32 {
        match self {
            Self::Identity => t,
            Self::Ndc { near, .. } => MAX_COORDINATE * (1.0 - near / t.max(*near)),
            Self::Contraction { radius, .. } => {
                let u = t / radius;
                if u <= 2.0 { u } else { MAX_COORDINATE - 4.0 / u }
            }
        }
    }

    /// Returns ds/dt at distance `t`: a density σ per unit of the coordinate is `σ ds/dt` per scene unit.
    pub fn rate(&self, t: f32) -> f32 {
        match self {
            Self::Identity => 1.0,
            Self::Ndc { near, .. } => MAX_COORDINATE * near / t.max(*near).powi(2),
            Self::Contraction { radius, .. } => {
                let u = t / radius;
                if u <= 2.0 { 1.0 / radius } else { 4.0 / (u * u * radius) }
            }
        }
    }

    /// Returns the distance at coordinate `s`: the inverse of [`Self::coordinate`].
    pub fn distance(&self, s: f32) -> f32 {
        self.distances_at([s])[0]
    }

    #[inline]
    fn distances_at<const N: usize>(&self, s: [f32; N]) -> [f32; N] {
        match self {
            Self::Identity => s,
            Self::Ndc { near, .. } => s.map(|s| near / (1.0 - s / MAX_COORDINATE).max(1.0 / HORIZON)),
            Self::Contraction { radius, .. } => {
                s.map(|s| radius * if s <= 2.0 { s } else { 4.0 / (MAX_COORDINATE - s).max(4.0 / HORIZON) })
            }
        }
    }
}

/// A ray of the world whose points are mapped into the space of a field.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WarpedRay<'a> {
    pub(crate) warp: &'a Warp,
    /// Origin in the axes of the mean camera, or in radii from the centre.
    origin: Vec3,
    direction: Vec3,
}

impl WarpedRay<'_> {
    /// Returns the distances at the coordinates `s`, and the axes of [`Warp::point`] there; many at once use vector registers.
    #[inline]
    pub(crate) fn points<const N: usize>(&self, s: [f32; N]) -> ([f32; N], [[f32; N]; 3]) {
        let (t, o, d) = (self.warp.distances_at(s), self.origin, self.direction);
        (t, self.warp.curved([(o.x, d.x), (o.y, d.y), (o.z, d.z)].map(|(o, d)| t.map(|t| o + t * d))))
    }

    /// Returns an upper bound of |dq/ds| along each axis between two coordinates, q = [`Self::point`]; infinite without one.
    ///
    /// NDC: `dq/ds = (t/z)² (aₓ (d_z x₀ − dₓ z₀), a_y (d_z y₀ − d_y z₀), 2n d_z) / 4n` for a ray `x₀ + t d` in the mean
    /// camera's axes, of depth z; t/z is monotonic. Contraction: 1 where `s = u`. From u = 2 on `du/ds = u²/4` and
    /// `|dq/du| ≤ 1`. From u = c + 1 on `|dq/du|` falls faster than u² grows, with c the distance of the ray's origin
    /// from the centre in radii: the bound is `((1 + c)/2)²`.
    pub(crate) fn max_speed(&self, [near, far]: [f32; 2]) -> Vec3 {
        let (o, d) = (self.origin, self.direction);
        match self.warp {
            Warp::Identity => d.abs(),
            Warp::Ndc { scale, near: nearest, .. } => {
                let share = |s: f32| {
                    let t = self.warp.distance(s);
                    let z = -(o.z + t * d.z);
                    if z > 0.5 * nearest { (t / z).powi(2) } else { f32::INFINITY }
                };
                let along = scale.extend(2.0 * nearest) * Vec3::new(d.z * o.x - d.x * o.z, d.z * o.y - d.y * o.z, d.z);
                along.abs() * share(near).max(share(far)) / (4.0 * nearest)
            }
            Warp::Contraction { .. } => Vec3::splat((0.25 * (1.0 + o.length()).powi(2)).max(1.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};
    use infonerf_scene::{Camera, Layout, Range, Scene, Space};
    use proptest::prelude::*;

    use super::*;

    pub(super) fn forward() -> Scene {
        let camera = |x| Camera::from_fov(40, 30, 1.0, DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        let (near, far, layout) = (1.0, 100.0, Layout::Forward);
        let range = Range::Depth { near, far };
        let space = Space { layout, bounded: false, near, far, range, ..Space::default() };
        Scene { all_train_cameras: vec![camera(-0.1), camera(0.1)], space, ..Scene::default() }
    }

    fn warps() -> [Warp; 3] {
        let contraction = Warp::Contraction { centre: Vec3::X, radius: 3.0 };
        let mut close = forward();
        close.space.near = 0.5;
        [Warp::of(&close, SpaceChoice::Ndc), contraction, Warp::Identity]
    }

    /// Value and gradient, also within the ball that contraction only scales.
    #[test]
    fn tensors_are_warped_as_points_are() {
        use burn::tensor::Device;
        use infonerf_ops::upload_rows;

        let device = Device::flex().autodiff();
        let points = [[0.3, -0.2, -1.7], [0.1, 0.4, -9.0], [-2.0, 5.0, -30.0]];
        for warp in warps() {
            for axis in 0..3 {
                let p = upload_rows(points.as_flattened(), 3, &device).require_grad();
                let warped = warp.points(p.clone());
                let gradients = warped.clone().narrow(1, axis, 1).sum().backward();
                let gradient = to_host(p.grad(&gradients).unwrap());
                for (row, point) in points.into_iter().map(Vec3::from).enumerate() {
                    let value = to_host(warped.clone())[3 * row + axis];
                    assert!((value - warp.point(point)[axis]).abs() < 1e-5, "{warp:?} at {point}");
                    for along in 0..3 {
                        let step = Vec3::AXES[along] * 0.01;
                        let difference = warp.point(point + step)[axis] - warp.point(point - step)[axis];
                        let (derivative, want) = (gradient[3 * row + along], difference / 0.02);
                        assert!((derivative - want).abs() < 1e-3, "{warp:?} at {point}: {derivative} for {want}");
                    }
                }
            }
        }
    }

    #[test]
    fn ndc_brings_the_frustum_into_a_cube_and_contraction_what_is_far_within_two() {
        let ndc = Warp::of(&forward(), SpaceChoice::Auto);
        let contraction = Warp::Contraction { centre: Vec3::X, radius: 2.0 };
        let edge = 0.5f32.tan();
        for (warp, p, expected) in [
            (&ndc, Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.0, 0.0, -1.0)),
            (&ndc, Vec3::new(edge, 0.0, -1.0), Vec3::new(1.0, 0.0, -1.0)),
            (&ndc, Vec3::new(2.0 * edge, 1.5 * edge, -2.0), Vec3::new(1.0, 1.0, 0.0)),
            (&contraction, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.5, 0.0, 0.0)),
            (&contraction, Vec3::new(5.0, 0.0, 0.0), Vec3::new(1.5, 0.0, 0.0)),
        ] {
            assert!(warp.point(p).distance(expected) < 1e-5, "{p}: {}", warp.point(p));
        }
        assert!(contraction.point(Vec3::splat(1e9)).length() <= 2.0);
        let bounds = ndc.bounds(&forward());
        assert!(bounds.min.z >= -1.0 - 1e-5 && bounds.max.z <= 1.0, "{bounds:?}");
        assert!(bounds.min.x <= -1.0 && bounds.max.y >= 1.0, "{bounds:?}");
    }

    #[test]
    fn points_beyond_the_horizon_are_brought_there() {
        for warp in warps() {
            for q in [Vec3::splat(1.5), Vec3::new(0.1, 0.2, 3.0)] {
                assert!(warp.world(q).is_finite(), "{warp:?} {q}");
            }
        }
    }

    proptest! {
        /// `world` inverts `point`.
        #[test]
        fn world_inverts_point(x in -1.0f32..1.0, y in -1.0f32..1.0, z in 1.1f32..30.0) {
            let p = Vec3::new(x * z, y * z, -z);
            for warp in warps() {
                let found = warp.world(warp.point(p));
                prop_assert!(found.distance(p) < 2e-3 * p.length(), "{warp:?} {p}: {found}");
            }
        }

        /// No part of a ray moves through warped space faster than its bound.
        #[test]
        fn no_ray_is_faster_than_its_bound(
            (x, y, z) in (-0.4f32..0.4, -0.4f32..0.4, -0.4f32..0.4),
            across in -0.5f32..0.5,
            up in -0.5f32..0.5,
            away in 1.0f32..12.0,
        ) {
            let ahead = Ray::new(Vec3::new(x, y, z), Vec3::new(across, up, -1.0).normalize());
            let [inside, outside] = [1.0, away].map(|away| Ray::new(away * ahead.origin, ahead.direction));
            let ndc = Warp::of(&forward(), SpaceChoice::Ndc);
            let around = Warp::Contraction { centre: Vec3::X * 0.3, radius: 1.5 };
            for (warp, ray) in [(&ndc, ahead), (&around, inside), (&around, outside)] {
                let [near, far] = [1.5, 1e4].map(|t| warp.coordinate(t));
                let (bound, step) = (warp.along(&ray).max_speed([near, far]), (far - near) / 400.0);
                prop_assert!(bound.max_element() < 100.0, "{bound}");
                for i in 0..400 {
                    let [from, to] = [i, i + 1].map(|i| warp.point(ray.at(warp.distance(near + i as f32 * step))));
                    let speed = (to - from).abs() / step;
                    prop_assert!(speed.cmple(1.001 * bound + 1e-3).all(), "{warp:?} {ray:?} {i}: {speed} above {bound}");
                }
            }
        }

        /// Points along a prepared ray are those of the warp.
        #[test]
        fn a_prepared_ray_has_the_points_of_the_warp(x in -0.4f32..0.4, y in -0.4f32..0.4, s in 0.5f32..3.9) {
            let ray = Ray::new(Vec3::new(x, y, 0.2), Vec3::new(y, x, -1.0).normalize());
            for warp in warps() {
                let ([t], point) = warp.along(&ray).points([s]);
                let (found, expected) = (Vec3::from(point.map(|[x]| x)), warp.point(ray.at(warp.distance(s))));
                prop_assert_eq!(t, warp.distance(s));
                prop_assert!(found.distance(expected) < 1e-4 * (1.0 + expected.length()), "{:?} {}: {}", warp, s, found);
            }
        }

        /// The coordinate rises with the distance, and `distance` inverts it.
        #[test]
        fn coordinates_and_distances_agree(t in 1.0f32..1000.0, further in 1.01f32..2.0) {
            for warp in warps() {
                let s = warp.coordinate(t);
                prop_assert!(warp.coordinate(t * further) > s && warp.coordinate(0.0) >= 0.0);
                prop_assert!((warp.distance(s) / t - 1.0).abs() < 1e-3, "{warp:?} {t}: {}", warp.distance(s));
                let derivative = (warp.coordinate(1.01 * t) - s) / (0.01 * t);
                prop_assert!((derivative / warp.rate(1.005 * t) - 1.0).abs() < 0.02, "{warp:?} {t}: {derivative}");
            }
        }
    }
}
