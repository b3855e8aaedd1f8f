use serde::{Deserialize, Serialize};

use crate::{MetricError, SSIM_WINDOW, gmsd, psnr, quantise_8bit, sharpness, ssim};

/// Every image metric of one test view, or their means over many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// [`crate::psnr`] in decibels.
    pub psnr: f64,
    /// [`crate::ssim`]; `None` for images smaller than its window.
    pub ssim: Option<f64>,
    /// [`crate::gmsd`].
    pub gmsd: f64,
    /// [`crate::sharpness`]; `None` where the truth is flat.
    pub sharpness: Option<f64>,
}

impl Comparison {
    /// Mean of each metric over test views; a view without a value is left out of that metric's mean. `None` for no
    /// views.
    ///
    /// PSNR is averaged in decibels, as in the literature, so one view reproduced exactly makes the mean infinite.
    #[must_use]
    pub fn mean(views: &[Self]) -> Option<Self> {
        let mean = |value: fn(&Self) -> Option<f64>| {
            let values: Vec<f64> = views.iter().filter_map(value).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        Some(Self {
            psnr: mean(|view| Some(view.psnr))?,
            ssim: mean(|view| view.ssim),
            gmsd: mean(|view| Some(view.gmsd))?,
            sharpness: mean(|view| view.sharpness),
        })
    }
}

/// The evaluation protocol for one view: both images through [`quantise_8bit`], then every metric.
///
/// Images are row-major `[height × width]`, already composited on the background.
///
/// # Errors
/// [`MetricError::Empty`], [`MetricError::Length`], [`MetricError::NonFinite`] as for [`crate::psnr`].
pub fn compare(
    render: &[[f32; 3]],
    truth: &[[f32; 3]],
    width: usize,
    height: usize,
) -> Result<Comparison, MetricError> {
    let (render, truth) = (quantise_8bit(render), quantise_8bit(truth));
    let window_fits = width >= SSIM_WINDOW && height >= SSIM_WINDOW;
    Ok(Comparison {
        psnr: psnr(&render, &truth)?,
        ssim: window_fits.then(|| ssim(&render, &truth, width, height)).transpose()?,
        gmsd: gmsd(&render, &truth, width, height)?,
        sharpness: sharpness(&render, &truth, width, height)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_below_half_a_step_vanish() {
        let truth = vec![[100.0 / 255.0; 3]; 144];
        let render = vec![[100.4 / 255.0; 3]; 144];
        let comparison = compare(&render, &truth, 12, 12).unwrap();
        assert_eq!(comparison.psnr, f64::INFINITY);
    }

    #[test]
    fn a_small_image_has_no_ssim() {
        let comparison = compare(&[[0.0; 3]; 4], &[[1.0; 3]; 4], 2, 2).unwrap();
        assert_eq!((comparison.psnr, comparison.ssim), (0.0, None));
    }

    #[test]
    fn means_leave_out_what_is_missing() {
        let one = Comparison { psnr: 10.0, ssim: Some(0.5), gmsd: 0.2, sharpness: None };
        let two = Comparison { psnr: 20.0, ssim: Some(0.7), gmsd: 0.4, sharpness: Some(0.9) };
        let mean = Comparison::mean(&[one, two]).unwrap();
        assert_eq!((mean.psnr, mean.sharpness), (15.0, Some(0.9)));
        approx::assert_abs_diff_eq!(mean.ssim.unwrap(), 0.6, epsilon = 1e-12);
        assert_eq!(Comparison::mean(&[]), None);
    }
}
