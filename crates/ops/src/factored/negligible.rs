//! Samples that a backward pass skips, as their gradients hardly count.
//!
//! Many samples of a scene that is nearly learnt lie in empty space or behind a surface. The gradient of a parameter is
//! Σ_s J_sᵀ g_s, where g_s is the gradient of the loss with respect to the outputs of sample s, before their activations. Without
//! the samples of the smallest g_s its error is at most `share` · Σ_s |g_s| · max ‖J_s‖. A threshold on weights would bound
//! nothing, as the entropy of a ray has gradients where nothing is seen.

/// The smallest |g_s| that is kept, given those of all samples: smaller ones add up to at most `share` of the sum.
///
/// Zeros are never kept, whatever the share; numbers that are not finite always are. Sizes are told apart by their exponent and
/// the first three bits of the mantissa, so that one pass will do.
pub(super) fn least_kept(sizes: &[f32], share: f32) -> f32 {
    const SHIFT: u32 = 20;
    let mut sums = vec![0f64; 1 << (32 - SHIFT)];
    for size in sizes {
        sums[(size.to_bits() >> SHIFT) as usize] += f64::from(*size);
    }
    let most = f64::from(share) * sums.iter().sum::<f64>();
    let mut below = 0.0;
    for (bin, sum) in sums.into_iter().enumerate() {
        below += sum;
        // A sum that is not finite may not be left out either.
        if sum != 0.0 && !(below <= most && most.is_finite()) {
            return f32::from_bits(((bin as u32) << SHIFT).max(1));
        }
    }
    f32::INFINITY
}

/// Whether a sample of this size is kept, given the [least](least_kept).
pub(super) fn is_kept(size: f32, least: f32) -> bool {
    size.is_nan() || size >= least
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(sizes: &[f32], share: f32) -> Vec<f32> {
        let least = least_kept(sizes, share);
        sizes.iter().copied().filter(|size| is_kept(*size, least)).collect()
    }

    #[test]
    fn what_is_left_out_is_at_most_a_share() {
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
    fn without_a_share_only_nothing_is_left_out() {
        let tiny = f32::from_bits(1);
        assert_eq!(kept(&[0.0, 1.0, tiny, 0.0], 0.0), [1.0, tiny]);
        assert!(kept(&[0.0; 3], 0.5).is_empty());
    }

    #[test]
    fn what_is_not_finite_is_kept() {
        assert_eq!(kept(&[1e-9, f32::INFINITY, 0.0], 0.1), [1e-9, f32::INFINITY]);
        let [tiny, nan] = kept(&[1e-9, f32::NAN], 0.1)[..] else { panic!("both are kept") };
        assert!(tiny == 1e-9 && nan.is_nan());
    }
}
