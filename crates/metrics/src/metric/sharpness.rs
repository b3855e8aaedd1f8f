use super::{Measure, Metric};
use crate::picture::check_sizes;
use crate::{Better, Descriptor, MetricError, Picture, luminance};

pub(super) const SHARPNESS: Metric = Metric {
    descriptor: Descriptor { key: "sharpness", name: "Sharpness", unit: "", decimals: 2, better: Better::NearOne },
    definition: "mean gradient magnitude of the render over that of the truth",
    measure: Measure::View(|view| sharpness(&view.render, &view.truth)),
};

/// Mean gradient magnitude of a render over that of the truth: 1 is as sharp as the truth, below 1 is blur, above 1 is
/// noise or ringing.
///
/// `sharpness = mean‖∇Y_render‖ / mean‖∇Y_truth‖` with [`mean_gradient`].
///
/// # Errors
/// [`MetricError::Size`]; [`MetricError::Flat`] when the truth has no gradient.
pub fn sharpness(render: &Picture, truth: &Picture) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    let reference = mean_gradient(truth);
    if reference == 0.0 { Err(MetricError::Flat) } else { Ok(mean_gradient(render) / reference) }
}

/// Mean over all pixels of `sqrt(Y_x² + Y_y²)`, in luma per pixel.
///
/// `Y_x` and `Y_y` are central differences `(Y[i+1] − Y[i−1]) / 2` inside and one-sided differences at the border (NumPy's
/// `gradient`); along a side of one pixel the derivative is 0. `Y` is [`luminance`].
pub fn mean_gradient(picture: &Picture) -> f64 {
    let [width, height] = picture.size();
    let luma = luminance(picture.pixels());
    let magnitude = |index: usize| {
        let (x, y) = (index % width, index / width);
        let dx = difference(x, width, |x| luma[y * width + x]);
        let dy = difference(y, height, |y| luma[y * width + x]);
        dx.hypot(dy)
    };
    (0..luma.len()).map(magnitude).sum::<f64>() / luma.len() as f64
}

/// Derivative at `at` of the `length` samples `value(0)`, `value(1)`, ….
fn difference(at: usize, length: usize, value: impl Fn(usize) -> f64) -> f64 {
    let (before, after) = (at.saturating_sub(1), (at + 1).min(length - 1));
    if before == after { 0.0 } else { (value(after) - value(before)) / (after - before) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(slope: f32) -> Picture {
        Picture::new((0..5 * 3).map(|i| [slope * (i % 5) as f32; 3]).collect(), 5, 3).unwrap()
    }

    #[test]
    fn a_ramp_has_its_slope_also_at_the_border() {
        approx::assert_abs_diff_eq!(mean_gradient(&ramp(0.1)), 0.1, epsilon = 1e-7);
    }

    #[test]
    fn half_the_slope_is_half_as_sharp() {
        approx::assert_abs_diff_eq!(sharpness(&ramp(0.1), &ramp(0.2)).unwrap(), 0.5, epsilon = 1e-6);
    }

    #[test]
    fn a_flat_truth_has_no_sharpness() {
        assert_eq!(sharpness(&ramp(0.1), &ramp(0.0)), Err(MetricError::Flat));
        let pixel = Picture::new(vec![[1.0; 3]], 1, 1).unwrap();
        assert_eq!(sharpness(&pixel, &pixel), Err(MetricError::Flat));
    }
}
