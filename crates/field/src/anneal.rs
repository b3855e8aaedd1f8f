/// Weight of each octave when training is `progress` of the way: 0 above the octave that is being faded in, 1 below
/// (FreeNeRF). Empty, for all 1, where `anneal`, the share of training that this takes, is 0.
pub(crate) fn anneal_window(octaves: usize, anneal: f32, progress: f32) -> Vec<f32> {
    if anneal <= 0.0 {
        return Vec::new();
    }
    let open = 1.0 + octaves as f32 * progress / anneal;
    (0..octaves).map(|octave| (open - octave as f32).clamp(0.0, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_opens_from_the_lowest_octave() {
        assert!(anneal_window(4, 0.0, 0.0).is_empty());
        assert_eq!(anneal_window(4, 0.5, 0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(anneal_window(4, 0.5, 0.1875), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(anneal_window(4, 0.5, 0.5), [1.0; 4]);
    }
}
