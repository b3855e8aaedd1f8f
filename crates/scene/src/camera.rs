//! Pinhole cameras.

use glam::{DMat3, DMat4, DVec3, DVec4, Vec2, Vec3};

use crate::Ray;

/// A pinhole camera: intrinsics in pixels and an OpenGL camera-to-world pose.
///
/// The camera looks along its −z axis with +y up and +x right; pixel `(i, j)` has its centre at
/// `(i + 0.5, j + 0.5)`, row 0 at the top. A pixel position `(x, y)` and a camera-space point
/// `(X, Y, Z)`, `Z < 0`, are related by
/// `x = cx + fx · X / −Z`, `y = cy − fy · Y / −Z`.
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
}

impl Camera {
    /// A camera with square pixels and a centred principal point.
    ///
    /// `fov_x` is the horizontal field of view in radians: `fx = 0.5 · width / tan(0.5 · fov_x)`.
    pub fn from_fov(width: u32, height: u32, fov_x: f64, to_world: DMat4) -> Self {
        let f = 0.5 * f64::from(width) / (0.5 * fov_x).tan();
        let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
        Self { width, height, fx: f, fy: f, cx, cy, to_world }
    }

    /// The ray through the continuous pixel position `(x, y)`, with unit direction and the cone of a pixel.
    ///
    /// At depth `z` a pixel is `z/f` wide with `f = √(fx · fy)`, and the cone's radius there is `2/√12` of that, so that its
    /// variance in x and y is that of the pixel (mip-NeRF, Sec. 3.1). Depth along a unit ray is `z = t · cos θ`.
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        let (origin, direction) = self.ray_f64(f64::from(x), f64::from(y));
        let radius = 2.0 / 12f64.sqrt() / (self.fx * self.fy).sqrt() * direction.dot(self.forward_f64());
        Ray { origin: origin.as_vec3(), direction: direction.as_vec3(), radius: radius as f32 }
    }

    /// [`Camera::ray`] in double precision: origin and unit direction.
    pub fn ray_f64(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let local = DVec3::new((x - self.cx) / self.fx, (self.cy - y) / self.fy, -1.0);
        let direction = (self.rotation() * local).normalize();
        (self.to_world.w_axis.truncate(), direction)
    }

    /// The continuous pixel position of a world point, or `None` where it is not in front of the
    /// camera. The position may lie outside the image.
    pub fn project(&self, p: Vec3) -> Option<Vec2> {
        let local = self.rotation().transpose() * (p.as_dvec3() - self.position_f64());
        let depth = -local.z;
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let x = self.cx + self.fx * local.x / depth;
        let y = self.cy - self.fy * local.y / depth;
        Some(Vec2::new(x as f32, y as f32))
    }

    /// The optical centre in world coordinates.
    pub fn position(&self) -> Vec3 {
        self.position_f64().as_vec3()
    }

    /// The unit viewing direction in world coordinates.
    pub fn forward(&self) -> Vec3 {
        self.forward_f64().as_vec3()
    }

    /// The same camera for an image of another size; focal lengths and principal point scale with
    /// width and height.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            to_world: self.to_world,
        }
    }

    /// The same intrinsics at another camera-to-world pose.
    pub fn with_pose(&self, to_world: DMat4) -> Self {
        Self { to_world, ..self.clone() }
    }

    pub(crate) fn rotation(&self) -> DMat3 {
        DMat3::from_mat4(self.to_world)
    }

    pub(crate) fn position_f64(&self) -> DVec3 {
        self.to_world.w_axis.truncate()
    }

    pub(crate) fn forward_f64(&self) -> DVec3 {
        -self.to_world.z_axis.truncate()
    }
}

/// The camera-to-world pose at `position` that looks along `forward`, its y axis as near to `up` as
/// can be. Any `up` will do: one parallel to `forward` is replaced by a coordinate axis.
pub(crate) fn look_along(position: DVec3, forward: DVec3, up: DVec3) -> DMat4 {
    let back = -forward.normalize_or(DVec3::NEG_Z);
    let right = [up, DVec3::Z, DVec3::Y, DVec3::X]
        .iter()
        .map(|u| u.cross(back))
        .find(|r| r.length_squared() > 1e-12)
        .map_or(DVec3::X, |r| r.normalize());
    let true_up = back.cross(right);
    DMat4::from_cols(
        right.extend(0.0),
        true_up.extend(0.0),
        back.extend(0.0),
        DVec4::new(position.x, position.y, position.z, 1.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> Camera {
        let pose = look_along(DVec3::new(1.0, -3.0, 2.0), DVec3::new(-0.3, 1.0, -0.6), DVec3::Z);
        Camera::from_fov(40, 30, 0.7, pose)
    }

    #[test]
    fn image_centre_looks_forward() {
        let camera = camera();
        let ray = camera.ray(20.0, 15.0);
        assert!((ray.direction - camera.forward()).length() < 1e-6);
        assert_eq!(ray.origin, camera.position());
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

    #[test]
    fn resizing_keeps_the_rays() {
        let (a, b) = (camera(), camera().resized(80, 60));
        let (a, b) = (a.ray(13.0, 7.0), b.ray(26.0, 14.0));
        assert!((a.direction - b.direction).length() < 1e-6);
        assert!((a.radius - b.widened(2.0).radius).abs() < 1e-7 * a.radius, "a pixel of half the width, half the cone");
    }

    /// The released mip-NeRF takes the distance between neighbouring pixels' directions of depth 1.
    #[test]
    fn cones_are_as_wide_as_pixels() {
        let camera = Camera::from_fov(40, 30, 0.7, DMat4::IDENTITY);
        for (x, y) in [(20.0, 15.0), (0.5, 29.5)] {
            let at_depth_one = |x: f32| {
                let direction = camera.ray(x, y).direction;
                direction / direction.dot(camera.forward())
            };
            let width = (at_depth_one(x + 1.0) - at_depth_one(x)).length();
            let expected = width * 2.0 / 12f32.sqrt() / at_depth_one(x).length();
            assert!((camera.ray(x, y).radius / expected - 1.0).abs() < 1e-4);
        }
    }

    proptest! {
        #[test]
        fn projection_inverts_the_ray(x in 0.0f32..40.0, y in 0.0f32..30.0, t in 0.1f32..50.0) {
            let camera = camera();
            let ray = camera.ray(x, y);
            prop_assert!((ray.direction.length() - 1.0).abs() < 1e-6);
            let p = camera.project(ray.at(t)).expect("in front of the camera");
            prop_assert!((p.x - x).abs() < 1e-2 && (p.y - y).abs() < 1e-2);
        }
    }
}
