use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::{Picture, check_size, check_sizes};

/// PSNR of whole images.
pub const PSNR: Metric = Metric {
    descriptor: Descriptor { key: "psnr", name: "PSNR", unit: "dB", decimals: 2, better: Better::Higher },
    definition: "−10 log₁₀ of the mean square error over pixels and channels",
    measure: Measure::View(|view| match view.valid {
        Some(valid) => psnr_masked(&view.render, &view.truth, valid),
        None => psnr(&view.render, &view.truth),
    }),
};

pub(super) const PSNR_MASKED: Metric = Metric {
    descriptor: Descriptor { key: "psnr_masked", name: "PSNR (masked)", ..PSNR.descriptor },
    definition: "PSNR over the pixels of the mask",
    measure: Measure::View(|view| psnr_masked(&view.render, &view.truth, view.mask()?)),
};

/// Computes the peak signal-to-noise ratio in decibels, data range 1.
///
/// `PSNR = −10 · log₁₀(MSE)`, with the mean square error over all pixels and the three channels together (Mildenhall
/// et al. 2020). Identical images give `+∞`, which a mean over views leaves out.
///
/// # Errors
/// If the sizes differ.
pub fn psnr(render: &Picture, truth: &Picture) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    Ok(decibels(render.pixels().iter().zip(truth.pixels())))
}

/// Computes [`psnr`] over the pixels inside `mask`.
///
/// # Errors
/// If sizes differ, or there are no such pixels.
pub fn psnr_masked(render: &Picture, truth: &Picture, mask: &Mask) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    check_size("mask", mask.size(), render.size())?;
    mask.check_inside()?;
    let pixels = render.pixels().iter().zip(truth.pixels()).zip(mask.inside());
    Ok(decibels(pixels.filter(|(_, inside)| **inside).map(|(pair, _)| pair)))
}

fn decibels<'a>(pixels: impl Iterator<Item = (&'a [f32; 3], &'a [f32; 3])>) -> f64 {
    let (sum, count) = pixels.fold((0.0, 0usize), |(sum, count), (a, b)| {
        let square = |channel: usize| (f64::from(a[channel]) - f64::from(b[channel])).powi(2);
        (sum + square(0) + square(1) + square(2), count + 3)
    });
    -10.0 * (sum / count as f64).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f32) -> Picture {
        Picture::new(vec![[value; 3]; 6], 3, 2).unwrap()
    }

    /// Checks an error of a tenth, everywhere or in a mask outside of which the error is larger.
    #[test]
    fn error_of_a_tenth_is_20_decibels() {
        let truth = flat(0.0);
        approx::assert_abs_diff_eq!(psnr(&flat(0.1), &truth).unwrap(), 20.0, epsilon = 1e-5);
        assert_eq!(psnr(&truth, &truth), Ok(f64::INFINITY));
        assert!(psnr(&truth, &truth.cropped([0..3, 0..1])).is_err());
        let render = truth.mapped(|index, _| if index < 2 { [0.1; 3] } else { [1.0; 3] });
        let mask = Mask::new((0..6).map(|index| index < 2).collect(), 3, 2).unwrap();
        approx::assert_abs_diff_eq!(psnr_masked(&render, &truth, &mask).unwrap(), 20.0, epsilon = 1e-5);
        let other = Mask::new(vec![true; 6], 2, 3).unwrap();
        let error = psnr_masked(&render, &truth, &other).unwrap_err().to_string();
        assert_eq!(error, "the mask has 2×3 pixels, the render 3×2");
    }
}
