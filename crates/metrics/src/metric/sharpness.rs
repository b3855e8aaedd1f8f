use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::picture::{Picture, check_sizes};

pub(super) const SHARPNESS: Metric = Metric {
    descriptor: Descriptor { key: "sharpness", name: "Sharpness", unit: "", decimals: 2, better: Better::NearOne },
    definition: "mean gradient magnitude of the render over that of the truth",
    measure: Measure::View(|view| sharpness(&view.render, &view.truth)),
};

/// Divides the mean gradient magnitude of a render by the truth's: 1 is as sharp, below 1 is blur, above 1 is noise or ringing.
///
/// `sharpness = mean‖∇Y_render‖ / mean‖∇Y_truth‖` with the luma `Y = 0.299 R + 0.587 G + 0.114 B` (ITU-R BT.601) and
/// `‖∇Y‖ = sqrt(Y_x² + Y_y²)`. `Y_x` and `Y_y` are central differences `(Y[i+1] − Y[i−1]) / 2` inside and one-sided
/// differences at the border (NumPy's `gradient`); along a side of one pixel the derivative is 0.
///
/// # Errors
/// If the sizes differ, or the truth has no gradient.
pub fn sharpness(render: &Picture, truth: &Picture) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    let reference = mean_gradient(truth);
    if reference == 0.0 { Err(MetricError::other("the truth is flat")) } else { Ok(mean_gradient(render) / reference) }
}

/// Computes the mean gradient magnitude over all pixels, in luma per pixel.
fn mean_gradient(picture: &Picture) -> f64 {
    let [width, height] = picture.size();
    let luma = |[r, g, b]: &[f32; 3]| 0.299 * f64::from(*r) + 0.587 * f64::from(*g) + 0.114 * f64::from(*b);
    let luma: Vec<f64> = picture.pixels().iter().map(luma).collect();
    let magnitude = |index: usize| {
        let (x, y) = (index % width, index / width);
        let dx = difference(x, width, |x| luma[y * width + x]);
        let dy = difference(y, height, |y| luma[y * width + x]);
        dx.hypot(dy)
    };
    (0..luma.len()).map(magnitude).sum::<f64>() / luma.len() as f64
}

/// Computes the derivative at `at` of the `length` samples `value(0)`, `value(1)`, ….
fn difference(at: usize, length: usize, value: impl Fn(usize) -> f64) -> f64 {
    let (before, after) = (at.saturating_sub(1), (at + 1).min(length - 1));
    if before == after { 0.0 } else { (value(after) - value(before)) / (after - before) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(step: f32) -> Picture {
        Picture::new((0..5 * 3).map(|i| [step * (i % 5) as f32; 3]).collect(), 5, 3).unwrap()
    }

    #[test]
    fn sharpness_is_the_ratio_of_mean_gradients() {
        approx::assert_abs_diff_eq!(mean_gradient(&ramp(0.1)), 0.1, epsilon = 1e-7);
        approx::assert_abs_diff_eq!(sharpness(&ramp(0.1), &ramp(0.2)).unwrap(), 0.5, epsilon = 1e-6);
        let pixel = Picture::new(vec![[1.0; 3]], 1, 1).unwrap();
        for (render, flat) in [(ramp(0.1), ramp(0.0)), (pixel.clone(), pixel)] {
            assert_eq!(sharpness(&render, &flat), Err(MetricError::other("the truth is flat")));
        }
    }
}
