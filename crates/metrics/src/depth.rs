use crate::MetricError;

/// Root mean square error of depth, in the unit of the scene, over the pixels whose true depth is finite.
///
/// `RMSE = sqrt(Σ_i m_i (d_i − d*_i)² / Σ_i m_i)`, `m_i = 1` where the truth `d*_i` is finite: loaders store `+∞` (or
/// NaN) where a ray hits nothing. `None` when no true depth is finite.
///
/// # Errors
/// [`MetricError::Length`] when the maps differ in length; [`MetricError::NonFinite`] when a prediction is not finite
/// where the truth is.
pub fn depth_rmse(prediction: &[f32], truth: &[f32]) -> Result<Option<f64>, MetricError> {
    if prediction.len() != truth.len() {
        return Err(MetricError::Length { what: "depth", found: prediction.len(), expected: truth.len() });
    }
    let (mut squares, mut count) = (0.0, 0usize);
    for (index, (&d, &t)) in prediction.iter().zip(truth).enumerate().filter(|(_, (_, t))| t.is_finite()) {
        if !d.is_finite() {
            return Err(MetricError::NonFinite { what: "depth", index });
        }
        squares += (f64::from(d) - f64::from(t)).powi(2);
        count += 1;
    }
    Ok((count > 0).then(|| (squares / count as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_finite_truth_counts() {
        let truth = [1.0, f32::INFINITY, 3.0, f32::NAN];
        let value = depth_rmse(&[4.0, 9.0, 7.0, f32::NAN], &truth).unwrap().unwrap();
        approx::assert_abs_diff_eq!(value, 12.5f64.sqrt(), epsilon = 1e-12);
    }

    #[test]
    fn no_finite_truth_has_no_error() {
        assert_eq!(depth_rmse(&[1.0], &[f32::INFINITY]), Ok(None));
        assert_eq!(depth_rmse(&[], &[]), Ok(None));
    }

    #[test]
    fn a_prediction_that_is_not_finite_is_an_error() {
        let expected = MetricError::NonFinite { what: "depth", index: 1 };
        assert_eq!(depth_rmse(&[1.0, f32::NAN], &[1.0, 2.0]), Err(expected));
    }
}
