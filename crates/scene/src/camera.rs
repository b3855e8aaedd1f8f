use glam::{DMat3, DMat4, DVec2, DVec3, Vec2, Vec3};

use crate::lens::Lens;
use crate::ray::Ray;

/// A camera: intrinsics in pixels, a lens and an OpenGL camera-to-world pose.
///
/// The camera looks along its −z axis with +y up and +x right; pixel `(i, j)` has its centre at `(i + 0.5, j + 0.5)`,
/// row 0 at the top. A pixel position `(x, y)` and a camera-space point `(X, Y, Z)`, `Z < 0`, are related by `x = cx +
/// fx · u`, `y = cy + fy · v`, where the lens takes `(X / −Z, −Y / −Z)` to `(u, v)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Horizontal focal length in pixels.
    pub fx: f64,
    /// Vertical focal length in pixels.
    pub fy: f64,
    /// Principal point, pixels from the left edge.
    pub cx: f64,
    /// Principal point, pixels from the top edge.
    pub cy: f64,
    /// Camera-to-world transform: rotation and translation, no scale.
    pub to_world: DMat4,
    /// Lens distortion, in units of the focal length.
    pub lens: Lens,
}

impl Camera {
    /// Returns a camera with square pixels and a centred principal point.
    ///
    /// `fov_x` is the horizontal field of view in radians: `fx = 0.5 · width / tan(0.5 · fov_x)`.
    pub fn from_fov(width: u32, height: u32, fov_x: f64, to_world: DMat4) -> Self {
        let f = 0.5 * f64::from(width) / (0.5 * fov_x).tan();
        Self::pinhole((width, height), [f, f], [0.5 * f64::from(width), 0.5 * f64::from(height)], to_world)
    }

    /// Returns a camera without distortion, from focal lengths and principal point in pixels.
    pub fn pinhole(size: (u32, u32), focal: [f64; 2], centre: [f64; 2], to_world: DMat4) -> Self {
        let ((width, height), [fx, fy], [cx, cy]) = (size, focal, centre);
        Self { width, height, fx, fy, cx, cy, to_world, lens: Lens::PERSPECTIVE }
    }

    /// Returns the camera with its lens replaced.
    pub fn with_lens(&self, lens: Lens) -> Self {
        Self { lens, ..self.clone() }
    }

    /// Returns the ray through the continuous pixel position `(x, y)`, with unit direction and the pixel's cone.
    ///
    /// At depth `z` a pixel is `z/f` wide with `f = √(fx · fy)` times the lens's magnification there, and the cone's radius
    /// is `2/√12` of that, so that its variance in x and y is that of the pixel (mip-NeRF, Sec. 3.1). Depth along a unit
    /// ray is `z = t · cos θ`.
    ///
    /// Where the lens cannot be inverted ([`Camera::covers`] is false), this is the ray at the edge of the invertible domain.
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        let (origin, direction) = self.ray_f64(f64::from(x), f64::from(y));
        let cosine = direction.dot(self.forward_f64());
        let local = self.rotation().transpose() * direction;
        let magnification = self.lens.magnification(DVec3::new(local.x, -local.y, -local.z));
        let radius = 2.0 / 12f64.sqrt() / (self.fx * self.fy).sqrt() * cosine.abs() / magnification;
        Ray { origin: origin.as_vec3(), direction: direction.as_vec3(), radius: radius as f32, cosine: cosine as f32 }
    }

    /// Returns [`Camera::ray`] in double precision: origin and unit direction.
    pub fn ray_f64(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let (u, v) = ((x - self.cx) / self.fx, (self.cy - y) / self.fy);
        let local = if self.lens.is_perspective() {
            DVec3::new(u, v, -1.0)
        } else {
            let direction = self.lens.nearest_direction(DVec2::new(u, -v));
            DVec3::new(direction.x, -direction.y, -direction.z)
        };
        (self.position_f64(), (self.rotation() * local).normalize())
    }

    /// Whether the lens can be inverted at the continuous pixel position `(x, y)`, so that its ray is known.
    pub fn covers(&self, x: f64, y: f64) -> bool {
        let image = DVec2::new((x - self.cx) / self.fx, (y - self.cy) / self.fy);
        self.lens.is_perspective() || self.lens.unproject(image).is_some()
    }

    /// Returns the continuous pixel position of a world point. `None` if it is not in front of the camera, or outside
    /// the invertible domain of its lens. The position may lie outside the image.
    pub fn project(&self, p: Vec3) -> Option<Vec2> {
        self.project_f64(p.as_dvec3()).map(|p| p.as_vec2())
    }

    /// Returns [`Camera::project`] in double precision.
    pub fn project_f64(&self, p: DVec3) -> Option<DVec2> {
        let local = self.rotation().transpose() * (p - self.position_f64());
        let image = self.lens.project(DVec3::new(local.x, -local.y, -local.z))?;
        Some(DVec2::new(self.cx + self.fx * image.x, self.cy + self.fy * image.y))
    }

    /// Returns the optical centre in world coordinates.
    pub fn position(&self) -> Vec3 {
        self.position_f64().as_vec3()
    }

    /// Returns the unit viewing direction in world coordinates.
    pub fn forward(&self) -> Vec3 {
        self.forward_f64().as_vec3()
    }

    /// Scales the camera to an image of `width × height` pixels; focal lengths and principal point scale with each side.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        let (fx, fy, cx, cy) = (self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy);
        Self { width, height, fx, fy, cx, cy, ..self.clone() }
    }

    /// Returns a camera with these intrinsics at the camera-to-world pose `to_world`.
    pub fn with_pose(&self, to_world: DMat4) -> Self {
        Self { to_world, ..self.clone() }
    }

    /// Returns the camera for its image turned clockwise by 90° `quarters` times: every pixel keeps its ray.
    ///
    /// A quarter turn takes pixel `(x, y)` to `(height − y, x)`; what was up points right.
    pub fn turned(&self, quarters: u8) -> Self {
        (0..quarters % 4).fold(self.clone(), |camera, _| {
            let m = camera.to_world;
            Self {
                width: camera.height,
                height: camera.width,
                fx: camera.fy,
                fy: camera.fx,
                cx: f64::from(camera.height) - camera.cy,
                cy: camera.cx,
                to_world: DMat4::from_cols(m.y_axis, -m.x_axis, m.z_axis, m.w_axis),
                lens: camera.lens.turned(),
            }
        })
    }

    /// Returns the camera for its image in the middle of a canvas of `width × height` pixels.
    pub fn framed(&self, width: u32, height: u32) -> Self {
        let margin = |side: u32, own: u32| ((i64::from(side) - i64::from(own)) / 2) as f64;
        let (cx, cy) = (self.cx + margin(width, self.width), self.cy + margin(height, self.height));
        Self { width, height, cx, cy, ..self.clone() }
    }

    /// Returns the camera's axes in the world, as columns: right, up and back.
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_mat4(self.to_world)
    }

    /// Returns [`Camera::position`] in `f64`.
    pub fn position_f64(&self) -> DVec3 {
        self.to_world.w_axis.truncate()
    }

    /// Returns [`Camera::forward`] in `f64`.
    pub fn forward_f64(&self) -> DVec3 {
        -self.to_world.z_axis.truncate()
    }
}

/// Returns the camera-to-world pose at `position` that looks along `forward`, its y axis as near to `up` as
/// can be. An `up` parallel to `forward` is replaced by a coordinate axis.
pub fn look_along(position: DVec3, forward: DVec3, up: DVec3) -> DMat4 {
    let back = -forward.normalize_or(DVec3::NEG_Z);
    let right = [up, DVec3::Z, DVec3::Y, DVec3::X]
        .iter()
        .map(|u| u.cross(back))
        .find(|r| r.length_squared() > 1e-12)
        .map_or(DVec3::X, |r| r.normalize());
    let true_up = back.cross(right);
    DMat4::from_cols(right.extend(0.0), true_up.extend(0.0), back.extend(0.0), position.extend(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let pose = look_along(DVec3::new(1.0, -3.0, 2.0), DVec3::new(-0.3, 1.0, -0.6), DVec3::Z);
        Camera::from_fov(40, 30, 0.7, pose)
    }

    #[test]
    fn turned_framed_and_resized_cameras_keep_their_rays() {
        let mut camera = camera().with_lens(Lens::radial_tangential([0.05, -0.02, 0.0, 0.0], [1e-3, -2e-3]));
        (camera.fy, camera.cx, camera.cy) = (1.1 * camera.fx, 18.0, 16.5);
        let apart = |a: Ray, b: Ray| a.direction.distance(b.direction) + a.origin.distance(b.origin);
        for (x, y) in [(0.0, 0.0), (31.0, 4.0), (12.5, 29.0)] {
            let (ray, quarter) = (camera.ray(x, y), camera.turned(1));
            assert_eq!((quarter.width, quarter.height), (30, 40));
            assert!(apart(quarter.ray(30.0 - y, x), ray) < 1e-6);
            assert!(apart(camera.turned(3).ray(y, 40.0 - x), ray) < 1e-6);
            assert!(apart(camera.turned(2).ray(40.0 - x, 30.0 - y), ray) < 1e-6);
            assert!(apart(camera.framed(45, 30).ray(x + 2.0, y), ray) < 1e-6);
            let half = camera.resized(80, 60).ray(2.0 * x, 2.0 * y);
            assert!(apart(half, ray) < 1e-6 && (half.widened(2.0).radius / ray.radius - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn axes_are_opengl() {
        let camera = Camera::from_fov(2, 2, std::f64::consts::FRAC_PI_2, DMat4::IDENTITY);
        // fov 90°: half-width 1 px at focal length 1 px.
        let d = camera.ray(2.0, 0.0).direction;
        assert!((d - Vec3::new(1.0, 1.0, -1.0).normalize()).length() < 1e-6);
        assert_eq!(camera.project(Vec3::new(0.0, 0.0, 1.0)), None);
    }

    #[test]
    fn up_parallel_to_forward_still_gives_a_rotation() {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let pose = look_along(DVec3::ZERO, axis, axis);
            assert!((DMat3::from_mat4(pose).determinant() - 1.0).abs() < 1e-12);
        }
    }

    /// Checks cones against the released mip-NeRF: the distance between adjacent pixels' directions of depth 1.
    #[test]
    fn cones_are_as_wide_as_pixels() {
        let camera = Camera::from_fov(40, 30, 0.7, DMat4::IDENTITY);
        for (x, y) in [(20.0, 15.0), (0.5, 29.5)] {
            let at_depth_one = |x: f32| camera.ray(x, y).direction / camera.ray(x, y).cosine;
            let width = (at_depth_one(x + 1.0) - at_depth_one(x)).length();
            let expected = width * 2.0 / 12f32.sqrt() / at_depth_one(x).length();
            assert!((camera.ray(x, y).radius / expected - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn rays_of_a_lens_project_back() {
        for lens in [
            Lens::PERSPECTIVE,
            Lens::radial_tangential([-0.2, 0.05, 0.0, 0.0], [1e-3, 2e-3]),
            Lens::rational([0.3, 0.1, 0.0, 0.2, 0.1, 0.0], [0.0; 2]),
            Lens::fisheye([0.05, -0.01, 0.0, 0.0]),
        ] {
            let camera = camera().with_lens(lens);
            for (x, y) in [(0.0, 0.0), (20.0, 15.0), (39.5, 0.5), (3.25, 29.0)] {
                let (origin, direction) = camera.ray_f64(x, y);
                let back = camera.project_f64(origin + 7.0 * direction).unwrap();
                assert!((back - DVec2::new(x, y)).length() < 1e-9 && camera.covers(x, y), "{lens} {back}");
                let ray = camera.ray(x as f32, y as f32);
                assert!((f64::from(ray.cosine) - direction.dot(camera.forward_f64())).abs() < 1e-6);
                // Geometric mean of the distances to the next pixel in both directions.
                let width = |dx: f64, dy: f64| (camera.ray_f64(x + dx, y + dy).1 - direction) / 1e-3;
                let area = width(1e-3, 0.0).cross(width(0.0, 1e-3)).length().sqrt();
                let ratio = f64::from(ray.radius) * 12f64.sqrt() / 2.0 / area;
                assert!((0.8..1.25).contains(&ratio), "{lens} {ratio}");
            }
            assert_eq!(camera.resized(80, 60).lens, lens);
        }
        let narrow = camera().with_lens(Lens::radial_tangential([-5.0, 0.0, 0.0, 0.0], [0.0; 2]));
        assert!(narrow.covers(20.0, 15.0) && !narrow.covers(0.0, 0.0));
        assert!(narrow.ray(0.0, 0.0).direction.is_finite());
    }
}
