//! Pictures of gaussians, as viewers of 3DGS show them.

use glam::{Mat3, Vec2, Vec3};
use infonerf_scene::Camera;
use rayon::prelude::*;

use crate::Gaussian;

/// Nearer to the camera than this many of its own standard deviations a gaussian is left out: the projection is linearised
/// about its centre.
const NEAREST: f32 = 3.0;
/// Pixels² that the projected variance is widened by, so that no gaussian falls between pixels.
const WIDENED: f32 = 0.3;
/// A gaussian stops at most this share of the light, and less than the second is left out.
const MOST_ALPHA: f32 = 0.99;
const LEAST_ALPHA: f32 = 1.0 / 255.0;
/// Transmittance below which a pixel is done.
const DONE: f32 = 1e-4;

/// The picture of `gaussians` that `camera` sees, row-major, by EWA splatting as 3DGS does it (Kerbl et al. 2023, Sec. 4 and 6):
/// front to back, `α = min(0.99, opacity · exp(−½ dᵀ Σ′⁻¹ d))` with the projected covariance
/// `Σ′ = J W Σ Wᵀ Jᵀ + 0.3 I`, on a background. A lens is left out of account; for checks, not for speed.
pub fn splat_picture(gaussians: &[Gaussian], camera: &Camera, background: [f32; 3]) -> Vec<[f32; 3]> {
    let mut splats: Vec<Splat> = gaussians.par_iter().filter_map(|gaussian| Splat::of(gaussian, camera)).collect();
    splats.par_sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let width = camera.width as usize;
    let row = |y: usize| {
        let mut pixels = vec![(Vec3::ZERO, 1.0f32); width];
        for splat in splats.iter().filter(|splat| (splat.centre.y - y as f32 - 0.5).abs() <= splat.reach.y) {
            let columns = (splat.centre.x - splat.reach.x).max(0.0) as usize
                ..((splat.centre.x + splat.reach.x).ceil().max(0.0) as usize).min(width);
            for x in columns {
                let (color, passes) = &mut pixels[x];
                let alpha = splat.alpha(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                if *passes > DONE && alpha >= LEAST_ALPHA {
                    *color += *passes * alpha * splat.color;
                    *passes *= 1.0 - alpha;
                }
            }
        }
        let background = Vec3::from_array(background);
        pixels.into_iter().map(move |(color, passes)| (color + passes * background).to_array())
    };
    (0..camera.height as usize).into_par_iter().flat_map_iter(row).collect()
}

/// A gaussian in a picture.
struct Splat {
    /// Pixels.
    centre: Vec2,
    /// Half the size of the box in which it shows, pixels.
    reach: Vec2,
    /// Σ′⁻¹: its entries xx, xy and yy, 1/pixel².
    conic: Vec3,
    opacity: f32,
    color: Vec3,
    /// Distance along the viewing axis.
    depth: f32,
}

impl Splat {
    /// The projection of a gaussian; none behind the camera or too near.
    fn of(gaussian: &Gaussian, camera: &Camera) -> Option<Self> {
        // x right, y down, z forward.
        let rotation = Mat3::from_mat4(camera.to_world.as_mat4()) * Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let eye = camera.position();
        let p = rotation.transpose() * (gaussian.position - eye);
        if p.z <= NEAREST * gaussian.scale.max_element() {
            return None;
        }
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|value| value as f32);
        // Half-axes in the camera's coordinates, and in the picture by the derivative of the projection.
        let axes = rotation.transpose() * Mat3::from_quat(gaussian.rotation) * Mat3::from_diagonal(gaussian.scale);
        let flat = |v: Vec3| Vec2::new(fx * (v.x - v.z * p.x / p.z), fy * (v.y - v.z * p.y / p.z)) / p.z;
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis].map(flat);
        let sum = |entry: fn(Vec2) -> f32| axes.iter().map(|&axis| entry(axis)).sum::<f32>();
        let (xx, xy, yy) = (sum(|a| a.x * a.x) + WIDENED, sum(|a| a.x * a.y), sum(|a| a.y * a.y) + WIDENED);
        let determinant = xx * yy - xy * xy;
        // Beyond this many standard deviations it stops too little.
        let deviations = (2.0 * (gaussian.opacity / LEAST_ALPHA).ln().max(0.0)).sqrt();
        Some(Self {
            centre: Vec2::new(cx + fx * p.x / p.z, cy + fy * p.y / p.z),
            reach: deviations * Vec2::new(xx.sqrt(), yy.sqrt()),
            conic: Vec3::new(yy, -xy, xx) / determinant,
            opacity: gaussian.opacity,
            color: gaussian.color((gaussian.position - eye).normalize_or_zero()),
            depth: p.z,
        })
    }

    fn alpha(&self, pixel: Vec2) -> f32 {
        let d = pixel - self.centre;
        let square = self.conic.x * d.x * d.x + 2.0 * self.conic.y * d.x * d.y + self.conic.z * d.y * d.y;
        (self.opacity * (-0.5 * square).exp()).min(MOST_ALPHA)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3, Quat};

    use super::*;

    /// Looks along −z from (0, 0, 4); a scene unit at the origin is 20 pixels wide.
    fn camera() -> Camera {
        Camera::pinhole((40, 30), [80.0, 80.0], [20.0, 15.0], DMat4::from_translation(DVec3::Z * 4.0))
    }

    /// Red 1, green and blue 0, from all sides.
    fn gaussian(position: Vec3, scale: Vec3, opacity: f32) -> Gaussian {
        let channel = |value: f32| [(value - 0.5) / 0.282_094_8, 0.0, 0.0, 0.0];
        let sh = [channel(1.0), channel(0.0), channel(0.0)];
        Gaussian { position, scale, rotation: Quat::IDENTITY, opacity, sh }
    }

    #[test]
    fn a_gaussian_has_its_size_and_place() {
        // Centre at pixel (30, 15) − ½, standard deviations 6 and 2 pixels.
        let one = gaussian(Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.3, 0.1, 0.01), 0.8);
        let picture = splat_picture(&[one], &camera(), [0.0; 3]);
        for (x, y) in [(30, 15), (24, 15), (30, 11), (35, 17)] {
            let (dx, dy) = (x as f32 + 0.5 - 30.0, y as f32 + 0.5 - 15.0);
            let expected = 0.8 * (-0.5 * (dx * dx / 36.3 + dy * dy / 4.3)).exp();
            let found = picture[y * 40 + x];
            assert!((found[0] - expected).abs() < 2e-3 && found[1] == 0.0, "{x} {y}: {found:?} for {expected}");
        }
        assert_eq!(picture[2 * 40 + 3], [0.0; 3]);
    }

    #[test]
    fn the_nearer_one_hides_the_other() {
        let near = gaussian(Vec3::Z, Vec3::splat(0.5), 0.99);
        let blue =
            Gaussian { sh: [near.sh[1], near.sh[1], near.sh[0]], ..gaussian(Vec3::ZERO, Vec3::splat(0.5), 0.99) };
        for order in [[near, blue], [blue, near]] {
            let [red, _, blue] = splat_picture(&order, &camera(), [1.0; 3])[15 * 40 + 20];
            assert!(red > 0.95 && blue < 0.05, "{red} {blue}");
        }
        // Behind the camera there is nothing.
        let behind = gaussian(Vec3::Z * 5.0, Vec3::splat(0.1), 0.99);
        assert!(splat_picture(&[behind], &camera(), [0.25; 3]).iter().all(|pixel| *pixel == [0.25; 3]));
    }
}
