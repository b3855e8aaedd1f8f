//! Gaussians fitted to images, by gradient descent through the reference splatter.

use glam::{Vec2, Vec3};
use infonerf_scene::Camera;
use rayon::prelude::*;

use crate::splat::{DEGREE_0, DEGREE_1, Gaussian};
use crate::splatter::{MAX_ALPHA, Splats};

/// Number of parts of an image whose gradients are summed separately, fixed so that sums do not depend on the threads.
const BANDS: usize = 8;
/// Decay rates of Adam's moments (Kingma and Ba 2015).
const BETAS: (f32, f32) = (0.9, 0.99);
const EPSILON: f32 = 1e-12;
/// Learning rates of a spherical harmonic, an opacity's logit and a scale's logarithm, which decay to a tenth.
const RATES: (f32, f32, f32) = (0.04, 0.1, 0.02);
/// Maximum change of a logit and of the logarithm of a scale, which bounds parameters that few pixels determine.
const MAX_CHANGE: (f32, f32) = (8.0, 1.0);

/// Image to fit.
#[derive(Clone, Debug)]
pub struct SplatTarget {
    /// Camera of the image.
    pub camera: Camera,
    /// Display-encoded RGB of each pixel, row by row.
    pub image: Vec<[f32; 3]>,
}

/// Fits colours, opacities and scales of `gaussians` to `targets` by `steps` of Adam on the mean squared error, one
/// image per step in turn. Positions and rotations stay. The result does not depend on the number of threads.
///
/// # Panics
/// If an image does not have one colour per pixel.
pub fn refine(gaussians: &mut [Gaussian], targets: &[SplatTarget], background: [f32; 3], steps: usize) {
    if targets.is_empty() {
        return;
    }
    let start: Vec<Parameters> = gaussians.iter().map(parameters).collect();
    let mut adam = vec![[[0.0f32; COUNT]; 2]; gaussians.len()];
    // Neighbouring targets look alike: a stride coprime to their number visits all of them, and successive ones differ.
    let stride = (targets.len() * 5 / 13..).find(|&stride| gcd(stride, targets.len()) == 1).unwrap_or(1);
    for step in 0..steps {
        let (_, gradients) = loss(gaussians, &targets[step * stride % targets.len()], background);
        let decay = 0.1f32.powf(step as f32 / steps as f32);
        let correct = |beta: f32| 1.0 - beta.powi(step as i32 + 1);
        let (first, second) = (correct(BETAS.0), correct(BETAS.1));
        let each = gaussians.par_iter_mut().zip(&mut adam).zip(&start).zip(&gradients);
        each.for_each(|(((gaussian, [m, v]), start), gradient)| {
            let mut values = parameters(gaussian);
            for i in 0..COUNT {
                m[i] = BETAS.0 * m[i] + (1.0 - BETAS.0) * gradient[i];
                v[i] = BETAS.1 * v[i] + (1.0 - BETAS.1) * gradient[i] * gradient[i];
                let (rate, limit) = match i {
                    OPACITY => (RATES.1, MAX_CHANGE.0),
                    i if i < OPACITY => (RATES.0, f32::INFINITY),
                    _ => (RATES.2, MAX_CHANGE.1),
                };
                let moved = values[i] - decay * rate * (m[i] / first) / ((v[i] / second).sqrt() + EPSILON);
                values[i] = moved.clamp(start[i] - limit, start[i] + limit);
            }
            set(gaussian, &values);
        });
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Fitted parameters: 12 spherical harmonics, the logit of the opacity, the logarithms of the scales.
type Parameters = [f32; COUNT];
const COUNT: usize = 16;
const OPACITY: usize = 12;

fn parameters(gaussian: &Gaussian) -> Parameters {
    let mut values = [0.0; COUNT];
    values[..OPACITY].copy_from_slice(gaussian.sh.as_flattened());
    values[OPACITY] = (gaussian.opacity / (1.0 - gaussian.opacity)).ln();
    values[OPACITY + 1..].copy_from_slice(&gaussian.scale.to_array().map(f32::ln));
    values
}

fn set(gaussian: &mut Gaussian, values: &Parameters) {
    gaussian.sh.as_flattened_mut().copy_from_slice(&values[..OPACITY]);
    gaussian.opacity = 1.0 / (1.0 + (-values[OPACITY]).exp());
    gaussian.scale = Vec3::from_slice(&values[OPACITY + 1..]).exp();
}

/// Derivatives of the loss L by a splat's colour, its opacity, and the entries xx, xy and yy of its covariance Σ′.
#[derive(Clone, Copy, Default)]
struct Gradient {
    color: Vec3,
    opacity: f32,
    covariance: Vec3,
}

/// Returns the mean squared error L of an image of `gaussians`, and its gradient.
///
/// With `C = Σ T α c`, the residual's derivative `g = ∂L/∂C`, and the colour `B` behind a splat: `∂L/∂c = T α g` and
/// `∂L/∂α = T (c − B)·g`. As `α = o exp(−½ dᵀ Σ′⁻¹ d)`, `∂α/∂o = α/o` and `∂α/∂Σ′ = ½ α u uᵀ` with `u = Σ′⁻¹ d`; a
/// half-axis has `∂L/∂ ln s = 2 aᵀ (∂L/∂Σ′) a`.
fn loss(gaussians: &[Gaussian], target: &SplatTarget, background: [f32; 3]) -> (f64, Vec<Parameters>) {
    let splats = Splats::project(gaussians, &target.camera);
    assert_eq!(target.image.len(), target.camera.width as usize * splats.rows.len(), "a colour for every pixel");
    let of_band = |band: usize| {
        let mut gradients = vec![Gradient::default(); splats.list.len()];
        let rows = (band..splats.rows.len()).step_by(BANDS);
        let loss: f64 = rows.map(|y| backward(&splats, y, target, background, &mut gradients)).sum();
        (loss, gradients)
    };
    let bands: Vec<(f64, Vec<Gradient>)> = (0..BANDS).into_par_iter().map(of_band).collect();
    let mut all = vec![[0.0; COUNT]; gaussians.len()];
    for (number, splat) in splats.list.iter().enumerate() {
        let mut sum = Gradient::default();
        for (_, gradients) in &bands {
            sum.color += gradients[number].color;
            sum.opacity += gradients[number].opacity;
            sum.covariance += gradients[number].covariance;
        }
        let values = &mut all[splat.index];
        let d = splat.direction;
        let harmonics = [DEGREE_0, -DEGREE_1 * d.y, DEGREE_1 * d.z, -DEGREE_1 * d.x];
        for channel in 0..3 {
            // A colour that is cut off at 0 has no gradient.
            let by_color = if splat.color[channel] > 0.0 { sum.color[channel] } else { 0.0 };
            for (k, harmonic) in harmonics.iter().enumerate() {
                values[4 * channel + k] = by_color * harmonic;
            }
        }
        values[OPACITY] = sum.opacity * splat.opacity * (1.0 - splat.opacity);
        for (k, Vec2 { x, y }) in splat.axes.into_iter().enumerate() {
            values[OPACITY + 1 + k] = 2.0 * sum.covariance.dot(Vec3::new(x * x, 2.0 * x * y, y * y));
        }
    }
    (bands.iter().map(|(loss, _)| loss).sum(), all)
}

/// Adds the gradients of row `y`, and returns its part of the loss.
fn backward(splats: &Splats, y: usize, target: &SplatTarget, background: [f32; 3], gradients: &mut [Gradient]) -> f64 {
    let background = Vec3::from_array(background);
    let width = target.camera.width as usize;
    let scale = 1.0 / (3 * target.image.len()) as f32;
    let mut hits: Vec<(usize, usize, f32, f32)> = Vec::new();
    let mut colors = vec![Vec3::ZERO; width];
    let passes = splats.blend(y, |x, splat, alpha, passes| {
        colors[x] += passes * alpha * splats.list[splat].color;
        hits.push((x, splat, alpha, passes));
    });
    let wanted = target.image[y * width..][..width].iter();
    let shown = colors.iter().zip(passes).map(|(color, passes)| *color + passes * background);
    let residuals: Vec<Vec3> = shown.zip(wanted).map(|(shown, want)| shown - Vec3::from_array(*want)).collect();
    let mut behind = vec![background; width];
    for (x, number, alpha, passes) in hits.into_iter().rev() {
        let (splat, gradient) = (&splats.list[number], &mut gradients[number]);
        let by_pixel = 2.0 * scale * residuals[x];
        gradient.color += passes * alpha * by_pixel;
        if alpha < MAX_ALPHA {
            let by_alpha = passes * (splat.color - behind[x]).dot(by_pixel);
            let u = splat.whitened(splat.offset(x, y));
            gradient.opacity += by_alpha * alpha / splat.opacity;
            gradient.covariance += 0.5 * by_alpha * alpha * Vec3::new(u.x * u.x, u.x * u.y, u.y * u.y);
        }
        behind[x] = behind[x].lerp(splat.color, alpha);
    }
    residuals.iter().map(|residual| f64::from(scale * residual.length_squared())).sum()
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3, Quat};

    use super::*;
    use crate::splatter::splat_image;

    const BACKGROUND: [f32; 3] = [0.9, 0.8, 1.0];

    fn camera(x: f64) -> Camera {
        Camera::pinhole((16, 12), [30.0, 30.0], [8.0, 6.0], DMat4::from_translation(DVec3::new(x, 0.0, 4.0)))
    }

    /// Returns three gaussians that cover each other, and all of the image.
    fn gaussians() -> Vec<Gaussian> {
        let of = |k: usize| Gaussian {
            position: Vec3::new(0.3 * k as f32 - 0.3, 0.2, -0.4 * k as f32),
            scale: Vec3::new(1.3, 0.9 + 0.2 * k as f32, 0.3),
            rotation: Quat::from_rotation_y(0.4 * k as f32 - 0.3),
            opacity: 0.55 + 0.1 * k as f32,
            sh: [[0.2, 0.3, -0.1, 0.2], [-0.3 + 0.4 * k as f32, 0.1, 0.2, 0.0], [0.5, 0.0, -0.2, 0.3]],
        };
        (0..3).map(of).collect()
    }

    #[test]
    fn greatest_common_divisors_divide_both_numbers() {
        assert_eq!([(38, 100), (39, 100), (12, 18), (5, 0)].map(|(a, b)| gcd(a, b)), [2, 1, 6, 5]);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let target =
            SplatTarget { camera: camera(0.2), image: (0..192).map(|i| [0.3, 0.005 * i as f32, 0.6]).collect() };
        let mut gaussians = gaussians();
        // A channel far below 0 is cut off.
        gaussians[1].sh[0][0] = -5.0;
        let (_, gradients) = loss(&gaussians, &target, BACKGROUND);
        for (index, gradient) in gradients.iter().enumerate() {
            for i in 0..COUNT {
                let at = |by: f32| {
                    let (mut moved, mut values) = (gaussians.clone(), parameters(&gaussians[index]));
                    values[i] += by;
                    set(&mut moved[index], &values);
                    loss(&moved, &target, BACKGROUND).0
                };
                let step = 1e-2;
                let expected = (at(step) - at(-step)) / (2.0 * f64::from(step));
                let apart = (f64::from(gradient[i]) - expected).abs();
                assert!(apart < 2e-5 + 1e-2 * expected.abs(), "{index}, {i}: {} for {expected}", gradient[i]);
            }
        }
    }

    #[test]
    fn refining_recovers_changed_gaussians() {
        let truth = gaussians();
        let target = |x| SplatTarget { camera: camera(x), image: splat_image(&truth, &camera(x), BACKGROUND) };
        let targets = [-0.5, 0.0, 0.5].map(target);
        let mut found = truth;
        for gaussian in &mut found {
            (gaussian.opacity, gaussian.scale) = (0.9, 0.8 * gaussian.scale);
            gaussian.sh.as_flattened_mut().fill(0.0);
        }
        let error = |found: &[Gaussian]| targets.iter().map(|t| loss(found, t, BACKGROUND).0).sum::<f64>();
        let before = error(&found);
        let start = found.clone();
        refine(&mut found, &targets, BACKGROUND, 300);
        assert!(error(&found) < 0.01 * before, "{} of {before}", error(&found));
        assert!(found.iter().zip(&start).all(|(a, b)| (a.position, a.rotation) == (b.position, b.rotation)));
        refine(&mut found, &[], BACKGROUND, 10);
    }
}
