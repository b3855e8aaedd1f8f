use crate::{MetricError, luminance, validate};

/// Mean image-gradient magnitude of a render over that of the truth: 1 is as sharp as the truth, below 1 is blur,
/// above 1 is noise or ringing.
///
/// `sharpness = mean‖∇Y_render‖ / mean‖∇Y_truth‖` with [`mean_gradient`]. `None` when the truth is flat.
///
/// # Errors
/// [`MetricError::Empty`], [`MetricError::Length`], [`MetricError::NonFinite`] as for [`crate::psnr`].
pub fn sharpness(
    render: &[[f32; 3]],
    truth: &[[f32; 3]],
    width: usize,
    height: usize,
) -> Result<Option<f64>, MetricError> {
    validate::sized_pair(render, truth, width, height)?;
    let reference = mean_gradient(truth, width, height)?;
    if reference == 0.0 {
        return Ok(None);
    }
    Ok(Some(mean_gradient(render, width, height)? / reference))
}

/// Mean over all pixels of `sqrt(Y_x² + Y_y²)`, in luma per pixel.
///
/// `Y_x` and `Y_y` are central differences `(Y[i+1] − Y[i−1]) / 2` inside and one-sided differences at the border
/// (NumPy's
/// `gradient`); along a side of one pixel the derivative is 0. `Y` is [`luminance`].
///
/// # Errors
/// [`MetricError::Empty`] and [`MetricError::Length`]. A pixel that is not finite gives NaN.
pub fn mean_gradient(pixels: &[[f32; 3]], width: usize, height: usize) -> Result<f64, MetricError> {
    validate::size("image", pixels.len(), width, height)?;
    if pixels.is_empty() {
        return Err(MetricError::Empty { what: "image" });
    }
    let luma = luminance(pixels);
    let magnitude = |index: usize| {
        let (x, y) = (index % width, index / width);
        let dx = difference(x, width, |x| luma[y * width + x]);
        let dy = difference(y, height, |y| luma[y * width + x]);
        dx.hypot(dy)
    };
    Ok((0..luma.len()).map(magnitude).sum::<f64>() / luma.len() as f64)
}

/// Derivative at `at` of the `length` samples `value(0)`, `value(1)`, ….
fn difference(at: usize, length: usize, value: impl Fn(usize) -> f64) -> f64 {
    let (before, after) = (at.saturating_sub(1), (at + 1).min(length - 1));
    if before == after { 0.0 } else { (value(after) - value(before)) / (after - before) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(slope: f32) -> Vec<[f32; 3]> {
        (0..5 * 3).map(|i| [slope * (i % 5) as f32; 3]).collect()
    }

    #[test]
    fn a_ramp_has_its_slope_also_at_the_border() {
        approx::assert_abs_diff_eq!(mean_gradient(&ramp(0.1), 5, 3).unwrap(), 0.1, epsilon = 1e-7);
    }

    #[test]
    fn half_the_slope_is_half_as_sharp() {
        let value = sharpness(&ramp(0.1), &ramp(0.2), 5, 3).unwrap().unwrap();
        approx::assert_abs_diff_eq!(value, 0.5, epsilon = 1e-6);
    }

    #[test]
    fn a_flat_truth_has_no_sharpness() {
        assert_eq!(sharpness(&ramp(0.1), &ramp(0.0), 5, 3), Ok(None));
        assert_eq!(sharpness(&[[1.0; 3]], &[[0.0; 3]], 1, 1), Ok(None));
    }
}
