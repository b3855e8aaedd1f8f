use std::ops::Range;

use glam::{Mat3, Vec2, Vec3};
use infonerf_scene::Camera;
use rayon::prelude::*;

use crate::splat::Gaussian;

/// Minimum distance to the camera in standard deviations. Nearer gaussians are left out, since the projection is linearised.
const MIN_DISTANCE: f32 = 3.0;
/// Addition to the projected variances, pixels², so that no gaussian falls between pixels.
const MIN_VARIANCE: f32 = 0.3;
/// Maximum opacity of a gaussian at a pixel. Opacities below `MIN_ALPHA` are not blended.
pub(crate) const MAX_ALPHA: f32 = 0.99;
const MIN_ALPHA: f32 = 1.0 / 255.0;
/// Transmittance below which nothing more is blended.
const DONE: f32 = 1e-4;

/// Renders the image of `gaussians` that `camera` sees, row-major, by EWA splatting as in 3DGS (Kerbl et al. 2023, Sec.
/// 4 and 6): front to back, `α = min(0.99, opacity · exp(−½ dᵀ Σ′⁻¹ d))` with the projected covariance `Σ′ = J W Σ Wᵀ
/// Jᵀ + 0.3 I`, on a background. The camera's lens is ignored. The splatter is a reference: exact rather than fast.
pub fn splat_image(gaussians: &[Gaussian], camera: &Camera, background: [f32; 3]) -> Vec<[f32; 3]> {
    let splats = Splats::project(gaussians, camera);
    let background = Vec3::from_array(background);
    let row = |y| {
        let mut colors = vec![Vec3::ZERO; splats.width];
        let passes = splats.blend(y, |x, splat, alpha, passes| colors[x] += passes * alpha * splats.list[splat].color);
        colors.into_iter().zip(passes).map(move |(color, passes)| (color + passes * background).to_array())
    };
    (0..splats.rows.len()).into_par_iter().flat_map_iter(row).collect()
}

/// Gaussians projected into a camera, front to back.
pub(crate) struct Splats {
    pub(crate) list: Vec<Splat>,
    /// Indices in `list` of the splats that reach each row of the image, front to back.
    pub(crate) rows: Vec<Vec<u32>>,
    width: usize,
}

impl Splats {
    pub(crate) fn project(gaussians: &[Gaussian], camera: &Camera) -> Self {
        let project = |(index, gaussian)| Splat::of(index, gaussian, camera);
        let mut list: Vec<Splat> = gaussians.par_iter().enumerate().filter_map(project).collect();
        list.par_sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
        let mut rows = vec![Vec::new(); camera.height as usize];
        for (number, splat) in (0..).zip(&list) {
            for y in pixels(splat.centre.y, splat.reach.y, rows.len()) {
                rows[y].push(number);
            }
        }
        Self { list, rows, width: camera.width as usize }
    }

    /// Blends row `y` front to back. Calls `visit(x, splat, α, T)` for each contribution, where T is the transmittance
    /// before it; returns the transmittance of each pixel behind all of them.
    pub(crate) fn blend(&self, y: usize, mut visit: impl FnMut(usize, usize, f32, f32)) -> Vec<f32> {
        let mut passes = vec![1.0; self.width];
        for &number in &self.rows[y] {
            let splat = &self.list[number as usize];
            for x in pixels(splat.centre.x, splat.reach.x, self.width) {
                let alpha = splat.alpha(splat.offset(x, y));
                if passes[x] > DONE && alpha >= MIN_ALPHA {
                    visit(x, number as usize, alpha, passes[x]);
                    passes[x] *= 1.0 - alpha;
                }
            }
        }
        passes
    }
}

/// Returns the pixels of a row or column of `count` whose centres are at most `reach` from `centre`.
fn pixels(centre: f32, reach: f32, count: usize) -> Range<usize> {
    let end = ((centre + reach + 0.5).floor().max(0.0) as usize).min(count);
    ((centre - reach - 0.5).ceil().max(0.0) as usize).min(end)..end
}

/// Gaussian projected into an image.
pub(crate) struct Splat {
    /// Index of the gaussian.
    pub(crate) index: usize,
    /// Centre, pixels.
    centre: Vec2,
    /// Half the size of the box in which the splat is visible, pixels.
    reach: Vec2,
    /// Half-axes in the image: Σ′ = Σ a aᵀ + 0.3 I. Pixels.
    pub(crate) axes: [Vec2; 3],
    /// Entries xx, xy and yy of Σ′⁻¹, 1/pixel².
    conic: Vec3,
    pub(crate) opacity: f32,
    pub(crate) color: Vec3,
    /// Direction from the eye, of unit length.
    pub(crate) direction: Vec3,
    /// Distance along the viewing axis.
    depth: f32,
}

impl Splat {
    /// Projects a gaussian; `None` behind the camera or too near.
    fn of(index: usize, gaussian: &Gaussian, camera: &Camera) -> Option<Self> {
        // x right, y down, z forward.
        let rotation = Mat3::from_mat4(camera.to_world.as_mat4()) * Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let eye = camera.position();
        let p = rotation.transpose() * (gaussian.position - eye);
        if p.z <= MIN_DISTANCE * gaussian.scale.max_element() {
            return None;
        }
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|value| value as f32);
        // Half-axes in the camera's coordinates, and in the image by the derivative of the projection.
        let axes = rotation.transpose() * Mat3::from_quat(gaussian.rotation) * Mat3::from_diagonal(gaussian.scale);
        let flat = |v: Vec3| Vec2::new(fx * (v.x - v.z * p.x / p.z), fy * (v.y - v.z * p.y / p.z)) / p.z;
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis].map(flat);
        let sum = |entry: fn(Vec2) -> f32| axes.iter().map(|&axis| entry(axis)).sum::<f32>();
        let (xx, xy, yy) = (sum(|a| a.x * a.x) + MIN_VARIANCE, sum(|a| a.x * a.y), sum(|a| a.y * a.y) + MIN_VARIANCE);
        let determinant = xx * yy - xy * xy;
        // Beyond this number of standard deviations, the opacity is below `MIN_ALPHA`.
        let deviations = (2.0 * (gaussian.opacity / MIN_ALPHA).ln().max(0.0)).sqrt();
        let direction = (gaussian.position - eye).normalize_or_zero();
        Some(Self {
            index,
            centre: Vec2::new(cx + fx * p.x / p.z, cy + fy * p.y / p.z),
            reach: deviations * Vec2::new(xx.sqrt(), yy.sqrt()),
            axes,
            conic: Vec3::new(yy, -xy, xx) / determinant,
            opacity: gaussian.opacity,
            color: gaussian.color(direction),
            direction,
            depth: p.z,
        })
    }

    /// Returns the pixel's centre relative to the centre of the splat.
    pub(crate) fn offset(&self, x: usize, y: usize) -> Vec2 {
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.centre
    }

    /// Returns Σ′⁻¹ d.
    pub(crate) fn whitened(&self, d: Vec2) -> Vec2 {
        let Vec3 { x: xx, y: xy, z: yy } = self.conic;
        Vec2::new(xx * d.x + xy * d.y, xy * d.x + yy * d.y)
    }

    fn alpha(&self, d: Vec2) -> f32 {
        (self.opacity * (-0.5 * d.dot(self.whitened(d))).exp()).min(MAX_ALPHA)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3, Quat};

    use super::*;

    /// Returns a camera that looks along −z from (0, 0, 4); a scene unit at the origin is 20 pixels wide.
    fn camera() -> Camera {
        Camera::pinhole((40, 30), [80.0, 80.0], [20.0, 15.0], DMat4::from_translation(DVec3::Z * 4.0))
    }

    /// Returns a gaussian of red 1, green and blue 0 from all sides.
    fn gaussian(position: Vec3, scale: Vec3, opacity: f32) -> Gaussian {
        let sh = [1.0, 0.0, 0.0].map(|value| [(value - 0.5) / 0.282_094_8, 0.0, 0.0, 0.0]);
        Gaussian { position, scale, rotation: Quat::IDENTITY, opacity, sh }
    }

    #[test]
    fn a_gaussian_has_its_size_and_place() {
        // Centre at pixel (30, 15) − ½, standard deviations 6 and 2 pixels.
        let one = gaussian(Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.3, 0.1, 0.01), 0.8);
        let image = splat_image(&[one], &camera(), [0.0; 3]);
        for (x, y) in [(30, 15), (24, 15), (30, 11), (35, 17), (18, 15)] {
            let (dx, dy) = (x as f32 + 0.5 - 30.0, y as f32 + 0.5 - 15.0);
            let expected = 0.8 * (-0.5 * (dx * dx / 36.3 + dy * dy / 4.3)).exp();
            let found = image[y * 40 + x];
            assert!((found[0] - expected).abs() < 2e-3 && found[1] == 0.0, "{x} {y}: {found:?} for {expected}");
        }
        assert_eq!(image[2 * 40 + 3], [0.0; 3]);
    }

    /// Compares a turned gaussian aside from the middle with its covariance, mapped by finite differences of the projection.
    #[test]
    fn a_turned_gaussian_has_the_covariance_of_its_projection() {
        let (place, scale) = (Vec3::new(0.3, -0.25, 0.5), Vec3::new(0.3, 0.1, 0.2));
        let rotation = Quat::from_rotation_z(0.6) * Quat::from_rotation_x(0.9);
        let one = Gaussian { rotation, ..gaussian(place, scale, 0.8) };
        let image = splat_image(&[one], &camera(), [0.0; 3]);
        let project = |p: Vec3| camera().project(p).unwrap();
        let axes = Vec3::AXES.map(|axis| {
            let half = 1e-2 * (rotation * (scale * axis));
            (project(place + half) - project(place - half)) / 2e-2
        });
        let entry = |of: fn(Vec2) -> f32| axes.into_iter().map(of).sum::<f32>();
        let (xx, xy, yy) = (entry(|a| a.x * a.x) + 0.3, entry(|a| a.x * a.y), entry(|a| a.y * a.y) + 0.3);
        for (x, y) in [(26, 20), (22, 16), (31, 24), (24, 24)] {
            let d = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - project(place);
            let square = (yy * d.x * d.x - 2.0 * xy * d.x * d.y + xx * d.y * d.y) / (xx * yy - xy * xy);
            let (expected, [found, ..]) = (0.8 * (-0.5 * square).exp(), image[y * 40 + x]);
            assert!(expected > 0.02 && (found - expected).abs() < 2e-3, "{x} {y}: {found} for {expected}");
        }
    }

    #[test]
    fn the_nearer_one_hides_the_other() {
        let near = gaussian(Vec3::Z, Vec3::splat(0.5), 0.99);
        let blue = Gaussian { position: Vec3::ZERO, sh: [near.sh[1], near.sh[1], near.sh[0]], ..near };
        for order in [[near, blue], [blue, near]] {
            let [red, _, blue] = splat_image(&order, &camera(), [1.0; 3])[15 * 40 + 20];
            assert!(red > 0.95 && blue < 0.05, "{red} {blue}");
        }
        // A gaussian behind the camera is not visible.
        let behind = gaussian(Vec3::Z * 5.0, Vec3::splat(0.1), 0.99);
        assert!(splat_image(&[behind], &camera(), [0.25; 3]).iter().all(|pixel| *pixel == [0.25; 3]));
    }
}
