use rayon::prelude::*;

use crate::{MetricError, validate};

/// Side of the Gaussian window in pixels, and so the smallest image side that [`ssim`] accepts.
pub const SSIM_WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Structural similarity: mean over the three channels and over all windows that lie inside the image.
///
/// With Gaussian-weighted (11×11, σ = 1.5, population weights) means `μ`, variances `σ²` and covariance `σ_xy` of a
/// window,
///
/// `SSIM = (2 μ_x μ_y + C₁)(2 σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂))`, `C₁ = 0.01²`, `C₂ = 0.03²`
///
/// (Wang et al. 2004, data range 1). Equals scikit-image's `structural_similarity(gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, channel_axis=-1, data_range=1)`: that crops a border of 5 pixels before its mean, so
/// the padding of its filter never enters.
///
/// Images are row-major `[height × width]`. Works on several threads; the sum is taken in row order, so the value does
/// not depend on their number.
///
/// # Errors
/// [`MetricError::TooSmall`] when a side is below [`SSIM_WINDOW`]: no window fits, and no padding is invented.
/// [`MetricError::Length`] and [`MetricError::NonFinite`] as for [`crate::psnr`].
pub fn ssim(render: &[[f32; 3]], truth: &[[f32; 3]], width: usize, height: usize) -> Result<f64, MetricError> {
    if width < SSIM_WINDOW || height < SSIM_WINDOW {
        return Err(MetricError::TooSmall { metric: "SSIM", width, height, minimum: SSIM_WINDOW });
    }
    validate::sized_pair(render, truth, width, height)?;

    let kernel = gaussian();
    let (render, truth) = (render.as_flattened(), truth.as_flattened());
    let rows = height - SSIM_WINDOW + 1;
    let columns = width - SSIM_WINDOW + 1;
    let row_sums: Vec<f64> = (0..rows)
        .into_par_iter()
        .map_init(|| Moments::zeros(3 * width), |moments, row| row_sum(&kernel, render, truth, width, row, moments))
        .collect();
    Ok(row_sums.iter().sum::<f64>() / (3 * rows * columns) as f64)
}

/// Vertically filtered first and second moments of one row of windows, channels interleaved.
struct Moments {
    x: Vec<f64>,
    y: Vec<f64>,
    squares: Vec<f64>,
    xy: Vec<f64>,
}

impl Moments {
    fn zeros(length: usize) -> Self {
        let zeros = || vec![0.0; length];
        Self { x: zeros(), y: zeros(), squares: zeros(), xy: zeros() }
    }

    fn clear(&mut self) {
        for buffer in [&mut self.x, &mut self.y, &mut self.squares, &mut self.xy] {
            buffer.fill(0.0);
        }
    }
}

/// Sum of SSIM over the windows whose top row is `top`.
///
/// The vertical pass runs along whole interleaved rows and the horizontal pass in strides of three, so that all
/// channels go through together. Only `σ_x² + σ_y²` enters the formula, so the two squares share one filter.
fn row_sum(
    kernel: &[f64; SSIM_WINDOW],
    render: &[f32],
    truth: &[f32],
    width: usize,
    top: usize,
    moments: &mut Moments,
) -> f64 {
    let stride = 3 * width;
    moments.clear();
    for (offset, &weight) in kernel.iter().enumerate() {
        let span = (top + offset) * stride..(top + offset + 1) * stride;
        let sums = moments.x.iter_mut().zip(&mut moments.y).zip(&mut moments.squares).zip(&mut moments.xy);
        for ((((sum_x, sum_y), sum_squares), sum_xy), (&x, &y)) in
            sums.zip(render[span.clone()].iter().zip(&truth[span]))
        {
            let (x, y) = (f64::from(x), f64::from(y));
            *sum_x += weight * x;
            *sum_y += weight * y;
            *sum_squares += weight * (x * x + y * y);
            *sum_xy += weight * (x * y);
        }
    }

    let across = |row: &[f64], at: usize| -> f64 { kernel.iter().enumerate().map(|(k, g)| g * row[at + 3 * k]).sum() };
    (0..stride - 3 * (SSIM_WINDOW - 1))
        .map(|at| {
            let (mean_x, mean_y) = (across(&moments.x, at), across(&moments.y, at));
            let (product, means) = (mean_x * mean_y, mean_x * mean_x + mean_y * mean_y);
            let variances = across(&moments.squares, at) - means;
            let covariance = across(&moments.xy, at) - product;
            ((2.0 * product + C1) * (2.0 * covariance + C2)) / ((means + C1) * (variances + C2))
        })
        .sum()
}

/// Normalised one-dimensional Gaussian of [`SSIM_WINDOW`] taps.
fn gaussian() -> [f64; SSIM_WINDOW] {
    let centre = (SSIM_WINDOW / 2) as f64;
    let weights: [f64; SSIM_WINDOW] = std::array::from_fn(|i| (-0.5 * ((i as f64 - centre) / SIGMA).powi(2)).exp());
    let total: f64 = weights.iter().sum();
    weights.map(|weight| weight / total)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identical_images_are_one() {
        let image: Vec<[f32; 3]> = (0..11 * 12).map(|i| [i as f32 / 132.0, 0.2, 1.0]).collect();
        approx::assert_abs_diff_eq!(ssim(&image, &image, 12, 11).unwrap(), 1.0, epsilon = 1e-12);
    }

    #[test]
    fn flat_images_have_the_closed_form() {
        let value = ssim(&[[0.25; 3]; 121], &[[0.75; 3]; 121], 11, 11).unwrap();
        let expected = (2.0 * 0.25 * 0.75 + C1) / (0.25f64.powi(2) + 0.75f64.powi(2) + C1);
        approx::assert_abs_diff_eq!(value, expected, epsilon = 1e-12);
    }

    #[test]
    fn a_side_below_the_window_is_an_error() {
        let image = [[0.0; 3]; 10 * 40];
        let expected = MetricError::TooSmall { metric: "SSIM", width: 40, height: 10, minimum: 11 };
        assert_eq!(ssim(&image, &image, 40, 10), Err(expected));
    }
}
