//! Choice of the samples that a backward pass skips, because their gradients are negligible.
//!
//! Many samples of a scene that is nearly learned lie in empty space or behind a surface. The gradient of a parameter is
//! Σ_s J_sᵀ g_s, where g_s is the gradient of the loss with respect to the outputs of sample s, before their activations.
//! Omitting the samples with the smallest g_s changes it by at most `share` · Σ_s |g_s| · max ‖J_s‖. A threshold on
//! compositing weights would give no bound, as the entropy of a ray also has gradients where weights are 0.

/// Returns the smallest |g_s| that is kept, given the |g_s| of all samples: smaller ones add up to at most `share` of the sum.
///
/// Zeros are never kept, whatever the share; values that are not finite always are. Sizes are grouped by their exponent and
/// the first three bits of the mantissa, so that one pass is enough.
pub(super) fn min_kept(sizes: &[f32], share: f32) -> f32 {
    const SHIFT: u32 = 20;
    let mut sums = vec![0f64; 1 << (32 - SHIFT)];
    for size in sizes {
        sums[(size.to_bits() >> SHIFT) as usize] += f64::from(*size);
    }
    let max_sum = f64::from(share) * sums.iter().sum::<f64>();
    let mut below = 0.0;
    for (bin, sum) in sums.into_iter().enumerate() {
        below += sum;
        // A sum that is not finite may not be left out either.
        if sum != 0.0 && !(below <= max_sum && max_sum.is_finite()) {
            return f32::from_bits(((bin as u32) << SHIFT).max(1));
        }
    }
    f32::INFINITY
}

/// Returns whether a sample of this size is kept, given the [smallest](min_kept) size.
pub(super) fn is_kept(size: f32, min: f32) -> bool {
    size.is_nan() || size >= min
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(sizes: &[f32], share: f32) -> Vec<f32> {
        let min = min_kept(sizes, share);
        sizes.iter().copied().filter(|size| is_kept(*size, min)).collect()
    }

    #[test]
    fn omitted_gradients_add_up_to_at_most_the_share() {
        let sizes: Vec<f32> = (0..1000).map(|i| ((i * 619) % 1000) as f32 * 1e-3).map(|x| x.powi(12)).collect();
        let sum = |sizes: &[f32]| sizes.iter().map(|size| f64::from(*size)).sum::<f64>();
        for share in [1e-6, 1e-3, 0.1] {
            let kept = kept(&sizes, share);
            let left_out = sum(&sizes) - sum(&kept);
            let most = f64::from(share) * sum(&sizes);
            assert!(left_out <= most * (1.0 + 1e-12) && left_out > 0.5 * most, "{share}: {left_out} of {most}");
            assert!(kept.len() < sizes.len());
        }
    }

    #[test]
    fn zeros_alone_are_omitted_without_a_share_and_values_that_are_not_finite_are_kept() {
        let tiny = f32::from_bits(1);
        assert_eq!(kept(&[0.0, 1.0, tiny, 0.0], 0.0), [1.0, tiny]);
        assert!(kept(&[0.0; 3], 0.5).is_empty());
        assert_eq!(kept(&[1e-9, f32::INFINITY, 0.0], 0.1), [1e-9, f32::INFINITY]);
        let [tiny, nan] = kept(&[1e-9, f32::NAN], 0.1)[..] else { panic!("both are kept") };
        assert!(tiny == 1e-9 && nan.is_nan());
    }
}
