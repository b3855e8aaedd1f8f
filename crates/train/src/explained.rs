//! Training pixels that the field explains already, of which steps need not see as many.

use infonerf_render::Noise;

use crate::config::ExplainedConfig;

/// Draws of a pixel before one is taken whatever its error.
pub(crate) const DRAWS: usize = 4;

/// The error of each training pixel when a step last met it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Explained {
    /// How much smaller the images are that the errors are of.
    factor: u32,
    /// Largest difference of a channel, view by view; +∞ where no step was yet.
    errors: Vec<f32>,
}

impl Explained {
    /// Forgets what it knows of images of another size.
    pub(crate) fn look_at(&mut self, factor: u32, pixels: usize) {
        if (self.factor, self.errors.len()) != (factor, pixels) {
            *self = Self { factor, errors: vec![f32::INFINITY; pixels] };
        }
    }

    /// The pixel for ray `ray`: `draw(k)` is the `k`th candidate, and one that is explained counts with probability
    /// `config.keep` only. Also returns how many were passed over.
    pub(crate) fn choose(
        &self,
        config: &ExplainedConfig,
        ray: usize,
        coin: Noise,
        draw: impl Fn(usize) -> usize,
    ) -> (usize, usize) {
        let taken = |k: &usize| {
            let error = self.errors.get(draw(*k)).copied().unwrap_or(f32::INFINITY);
            error >= config.error || coin.uniform(ray, *k) < config.keep
        };
        let passed = (0..DRAWS - 1).find(taken).unwrap_or(DRAWS - 1);
        (draw(passed), passed)
    }

    /// `count` of `candidates`, in their order: an explained one counts with probability `config.keep` only, unless there
    /// would be too few. Also returns how many were passed over.
    pub(crate) fn among(
        &self,
        config: &ExplainedConfig,
        coin: Noise,
        candidates: &[usize],
        count: usize,
    ) -> (Vec<usize>, usize) {
        let taken = |&(index, &place): &(usize, &usize)| {
            let error = self.errors.get(place).copied().unwrap_or(f32::INFINITY);
            error >= config.error || coin.uniform(index, 0) < config.keep
        };
        let (mut chosen, mut left): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
        for candidate in candidates.iter().enumerate() {
            if chosen.len() == count {
                break;
            }
            if taken(&candidate) { &mut chosen } else { &mut left }.push(*candidate.1);
        }
        let passed = left.len() - left.len().min(count - chosen.len());
        let missing = count - chosen.len();
        chosen.extend(left.into_iter().take(missing));
        (chosen, passed)
    }

    /// Remembers what a step found.
    pub(crate) fn remember(&mut self, pixels: &[usize], errors: impl Iterator<Item = f32>) {
        for (&pixel, error) in pixels.iter().zip(errors) {
            self.errors[pixel] = error;
        }
    }

    /// For a checkpoint.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let errors = self.errors.iter().flat_map(|error| error.to_le_bytes());
        self.factor.to_le_bytes().into_iter().chain(errors).collect()
    }

    /// From a checkpoint; none if the bytes are not whole numbers.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (numbers, []) = bytes.as_chunks::<4>() else { return None };
        let (factor, errors) = numbers.split_first()?;
        Some(Self {
            factor: u32::from_le_bytes(*factor),
            errors: errors.iter().map(|error| f32::from_le_bytes(*error)).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn explained_pixels_are_met_less() {
        const PIXELS: usize = 10;
        let config = ExplainedConfig { error: 0.1, keep: 0.25 };
        let mut explained = Explained::default();
        explained.look_at(2, PIXELS);
        explained.remember(&[0, 1, 2, 3, 4], [0.05; 5].into_iter());
        let (noise, coin) = (Noise::new(0, 0, 0), Noise::new(0, 0, 1));
        let rays = 100_000;
        let chosen: Vec<(usize, usize)> =
            (0..rays).map(|ray| explained.choose(&config, ray, coin, |k| noise.below(ray, k, PIXELS))).collect();
        // A draw is taken with probability 5/8: explained with 1/8, open with 1/2; the fourth is taken anyway.
        let passed = 3.0f64 / 8.0;
        let tries = 1.0 + passed + passed.powi(2);
        let expected = tries / 8.0 + passed.powi(3) / 2.0;
        let share = chosen.iter().filter(|(pixel, _)| *pixel < 5).count() as f64 / rays as f64;
        assert!((share - expected).abs() < 0.01, "{share} {expected}");
        let skipped = chosen.iter().map(|(_, passed)| passed).sum::<usize>() as f64 / rays as f64;
        assert!((skipped - passed * tries).abs() < 0.01, "{skipped}");

        // Of one image, each at most once: the open ones first, then as many explained ones as are missing.
        let none = ExplainedConfig { keep: 0.0, ..config };
        let order = [3, 7, 1, 9, 0, 5];
        assert_eq!(explained.among(&none, coin, &order, 2), (vec![7, 9], 2));
        assert_eq!(explained.among(&none, coin, &order, 5), (vec![7, 9, 5, 3, 1], 1));
        assert_eq!(explained.among(&none, coin, &order[..3], 3), (vec![7, 3, 1], 0));
        let all = ExplainedConfig { keep: 1.0, ..config };
        assert_eq!(explained.among(&all, coin, &order, 3), (vec![3, 7, 1], 0));

        let again = Explained::from_bytes(&explained.to_bytes()).unwrap();
        assert_eq!(again, explained);
        explained.look_at(1, 2 * PIXELS);
        assert!(explained.errors.iter().all(|error| error.is_infinite()));
    }
}
