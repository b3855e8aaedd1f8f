//! Annealing: detail that fades in over the run.

/// Returns the weight of each frequency at `detail` ∈ [0, 1]: 1 + L·`detail` − l, clamped to [0, 1], for frequency l of L
/// (FreeNeRF, Yang et al. 2023, Eq. 4). If `detail` is 1 the result is empty, which means 1 for all.
pub(crate) fn frequency_window(frequencies: usize, detail: f64) -> Vec<f32> {
    if detail >= 1.0 {
        return Vec::new();
    }
    let open = 1.0 + frequencies as f32 * detail as f32;
    (0..frequencies).map(|frequency| (open - frequency as f32).clamp(0.0, 1.0)).collect()
}

/// Returns the weights of `count` parts: 1 for the first `start`. The others fade in one by one as `detail` rises from 0 to 1.
pub(crate) fn part_weights(count: usize, start: f32, detail: f64) -> Vec<f32> {
    let there = start + (count as f32 - start).max(0.0) * detail as f32;
    (0..count).map(|part| (there - part as f32).clamp(0.0, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_opens_from_the_lowest_frequency() {
        assert!(frequency_window(4, 1.0).is_empty());
        assert_eq!(frequency_window(4, 0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(frequency_window(4, 0.375), [1.0, 1.0, 0.5, 0.0]);
    }

    #[test]
    fn parts_fade_in_one_after_another() {
        assert_eq!(part_weights(4, 1.0, 0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(part_weights(4, 1.0, 0.5), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(part_weights(4, 1.0, 1.0), [1.0; 4]);
        assert_eq!(part_weights(1, 2.0, 0.3), [1.0]);
    }
}
