use rayon::prelude::*;

use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::picture::{Picture, check_sizes};
use crate::protocol::{Ssim, SsimWindow};

/// SSIM of whole images.
pub const SSIM: Metric = Metric {
    descriptor: Descriptor { key: "ssim", name: "SSIM", unit: "", decimals: 3, better: Better::Higher },
    definition: "mean over channels and over the windows inside the picture (Wang et al. 2004); by default Gaussian, 11×11, σ 1.5, C₁ = 0.01², C₂ = 0.03²",
    measure: Measure::View(|view| ssim(&view.render, &view.truth, view.protocol.ssim)),
};

pub(super) const SSIM_MASKED: Metric = Metric {
    descriptor: Descriptor { key: "ssim_masked", name: "SSIM (masked)", ..SSIM.descriptor },
    definition: "SSIM of the masked pictures",
    measure: Measure::View(|view| view.masked().and_then(|(render, truth)| ssim(render, truth, view.protocol.ssim))),
};

/// Computes structural similarity: the mean over the three channels and over all windows that lie inside the image.
///
/// With means `μ`, variances `σ²` and covariance `σ_xy` of a window and `L` the data range,
///
/// `SSIM = (2 μ_x μ_y + C₁)(2 σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂))`, `C₁ = (0.01 L)²`, `C₂ = (0.03 L)²`
///
/// (Wang et al. 2004). [`SsimWindow::Gaussian11`] equals scikit-image's `structural_similarity(gaussian_weights=True,
/// sigma=1.5, use_sample_covariance=False)`, [`SsimWindow::Uniform7`] its default; both with `channel_axis=-1` and
/// `data_range=L`.
///
/// Works on several threads; the sum is taken in row order, so the value does not depend on their number.
///
/// # Errors
/// If the sizes differ, or no window fits, as nothing is padded.
pub fn ssim(render: &Picture, truth: &Picture, options: Ssim) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    let window = SsimKernel::new(options);
    let side = window.kernel.len();
    let [width, height] = truth.size();
    if width < side || height < side {
        return Err(MetricError::other(format!("both sides need at least {side} pixels, got {width}×{height}")));
    }
    let (columns, rows) = (width - side + 1, height - side + 1);
    let row_sums: Vec<[f64; 3]> = (0..rows).into_par_iter().map(|row| window.row_sum(render, truth, row)).collect();
    let windows = (rows * columns) as f64;
    let channel = |channel: usize| row_sums.iter().map(|sums| sums[channel]).sum::<f64>() / windows;
    Ok([0, 1, 2].map(channel).iter().sum::<f64>() / 3.0)
}

struct SsimKernel {
    /// Weights along one side, with sum 1.
    kernel: Vec<f64>,
    /// Factor from population covariance to the covariance in use.
    covariance_scale: f64,
    c1: f64,
    c2: f64,
}

impl SsimKernel {
    fn new(options: Ssim) -> Self {
        let (kernel, covariance_scale) = match options.window {
            SsimWindow::Gaussian11 => (gaussian(11, 1.5), 1.0),
            SsimWindow::Uniform7 => (vec![1.0 / 7.0; 7], 49.0 / 48.0),
        };
        let constant = |k: f64| (k * options.data_range).powi(2);
        Self { kernel, covariance_scale, c1: constant(0.01), c2: constant(0.03) }
    }

    /// Sums SSIM over the windows whose top row is `top`, per channel.
    ///
    /// The filter is separable: first down the columns, then along the row. Only `σ_x² + σ_y²` enters the formula, so the
    /// two squares share one filter.
    fn row_sum(&self, render: &Picture, truth: &Picture, top: usize) -> [f64; 3] {
        let stride = 3 * truth.size()[0];
        let (render, truth) = (render.pixels().as_flattened(), truth.pixels().as_flattened());
        let mut columns = vec![[0.0; 4]; stride];
        for (offset, &weight) in self.kernel.iter().enumerate() {
            let row = (top + offset) * stride..(top + offset + 1) * stride;
            for ((moments, &x), &y) in columns.iter_mut().zip(&render[row.clone()]).zip(&truth[row]) {
                let (x, y) = (f64::from(x), f64::from(y));
                add_weighted(moments, weight, [x, y, x * x + y * y, x * y]);
            }
        }
        let mut sums = [0.0; 3];
        for at in 0..stride - 3 * (self.kernel.len() - 1) {
            let mut moments = [0.0; 4];
            for (&weight, &column) in self.kernel.iter().zip(columns[at..].iter().step_by(3)) {
                add_weighted(&mut moments, weight, column);
            }
            let [mean_x, mean_y, squares, xy] = moments;
            let (product, means) = (mean_x * mean_y, mean_x * mean_x + mean_y * mean_y);
            let variances = self.covariance_scale * (squares - means);
            let covariance = self.covariance_scale * (xy - product);
            let contrast = (2.0 * covariance + self.c2) / (variances + self.c2);
            sums[at % 3] += contrast * (2.0 * product + self.c1) / (means + self.c1);
        }
        sums
    }
}

fn add_weighted(sums: &mut [f64; 4], weight: f64, values: [f64; 4]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

fn gaussian(taps: usize, sigma: f64) -> Vec<f64> {
    let centre = (taps / 2) as f64;
    let weights: Vec<f64> = (0..taps).map(|i| (-0.5 * ((i as f64 - centre) / sigma).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / total).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Protocol;

    #[test]
    fn images_below_the_window_are_refused() {
        for (width, height) in [(40, 10), (10, 40)] {
            let picture = Picture::new(vec![[0.0; 3]; width * height], width, height).unwrap();
            let expected = MetricError::other(format!("both sides need at least 11 pixels, got {width}×{height}"));
            assert_eq!(ssim(&picture, &picture, Protocol::INFONERF.ssim), Err(expected));
            assert!(ssim(&picture, &picture, Ssim { window: SsimWindow::Uniform7, data_range: 1.0 }).is_ok());
        }
    }
}
