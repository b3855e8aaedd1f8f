use crate::{MetricError, validate};

/// Peak signal-to-noise ratio in decibels, data range 1.
///
/// `PSNR = −10 · log₁₀(MSE)`, with the mean square error over all pixels and the three channels together (Mildenhall
/// et al. 2020). Identical images give `+∞`. The protocol rounds both images to 8 bits first: see [`crate::compare`].
///
/// # Errors
/// [`MetricError::Empty`], [`MetricError::Length`] when the images differ in length, [`MetricError::NonFinite`].
pub fn psnr(render: &[[f32; 3]], truth: &[[f32; 3]]) -> Result<f64, MetricError> {
    validate::pair(render, truth)?;
    let squares: f64 = render
        .as_flattened()
        .iter()
        .zip(truth.as_flattened())
        .map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))
        .sum();
    let mse = squares / (3 * truth.len()) as f64;
    Ok(-10.0 * mse.log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_off_everywhere_is_twenty_decibels() {
        let value = psnr(&[[0.1; 3]; 4], &[[0.0; 3]; 4]).unwrap();
        approx::assert_abs_diff_eq!(value, 20.0, epsilon = 1e-5);
    }

    #[test]
    fn identical_images_are_infinite() {
        assert_eq!(psnr(&[[0.3; 3]; 2], &[[0.3; 3]; 2]), Ok(f64::INFINITY));
    }

    #[test]
    fn bad_input_is_an_error() {
        assert_eq!(psnr(&[], &[]), Err(MetricError::Empty { what: "truth" }));
        let length = MetricError::Length { what: "render", found: 1, expected: 2 };
        assert_eq!(psnr(&[[0.0; 3]], &[[0.0; 3]; 2]), Err(length));
        let nan = MetricError::NonFinite { what: "render", index: 1 };
        assert_eq!(psnr(&[[0.0; 3], [0.0, f32::NAN, 0.0]], &[[0.0; 3]; 2]), Err(nan));
    }
}
