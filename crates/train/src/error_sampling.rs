//! Error-driven sampling of training pixels: see [`ErrorSamplingConfig`].

use infonerf_render::Noise;

use crate::config::ErrorSamplingConfig;

/// The error of each training pixel when a step last drew it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PixelErrors {
    /// Factor by which the images of the errors are smaller than at full size.
    factor: u32,
    /// Largest difference of a channel, view by view; +∞ where no step was yet.
    errors: Vec<f32>,
}

impl PixelErrors {
    /// Maximum number of draws of a pixel; the last one is taken whatever its error.
    pub(crate) const DRAWS: usize = 4;

    /// Resets the errors if the images' size (factor and number of all pixels) has changed.
    pub(crate) fn resize(&mut self, (factor, pixels): (u32, usize)) {
        if (self.factor, self.errors.len()) != (factor, pixels) {
            *self = Self { factor, errors: vec![f32::INFINITY; pixels] };
        }
    }

    /// Chooses the pixel for ray `ray`: `draw(k)` is the `k`th candidate, and a well-fitted one is accepted with probability
    /// `config.keep` only. Also returns how many were rejected.
    pub(crate) fn choose(
        &self,
        config: &ErrorSamplingConfig,
        ray: usize,
        acceptance: Noise,
        draw: impl Fn(usize) -> usize,
    ) -> (usize, usize) {
        let accepted = |k: &usize| !self.is_fitted(config, draw(*k)) || acceptance.uniform(ray, *k) < config.keep;
        let rejected = (0..Self::DRAWS - 1).find(accepted).unwrap_or(Self::DRAWS - 1);
        (draw(rejected), rejected)
    }

    /// Chooses `count` of `candidates`, in their order: a well-fitted one is accepted with probability `config.keep` only, unless
    /// there would be too few. Also returns how many were rejected.
    pub(crate) fn among(
        &self,
        config: &ErrorSamplingConfig,
        acceptance: Noise,
        candidates: &[usize],
        count: usize,
    ) -> (Vec<usize>, u64) {
        let (mut chosen, mut left): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
        for (draw, &index) in candidates.iter().enumerate() {
            if chosen.len() == count {
                break;
            }
            let accepted = !self.is_fitted(config, index) || acceptance.uniform(draw, 0) < config.keep;
            if accepted { &mut chosen } else { &mut left }.push(index);
        }
        let missing = count - chosen.len();
        let rejected = left.len().saturating_sub(missing) as u64;
        chosen.extend(left.into_iter().take(missing));
        (chosen, rejected)
    }

    pub(crate) fn remember(&mut self, indices: &[usize], errors: impl Iterator<Item = f32>) {
        for (&index, error) in indices.iter().zip(errors) {
            self.errors[index] = error;
        }
    }

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let errors = self.errors.iter().flat_map(|error| error.to_le_bytes());
        self.factor.to_le_bytes().into_iter().chain(errors).collect()
    }

    /// Decodes the errors of a checkpoint; `None` if the length is no multiple of 4.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (numbers, []) = bytes.as_chunks::<4>() else { return None };
        let (factor, errors) = numbers.split_first()?;
        Some(Self {
            factor: u32::from_le_bytes(*factor),
            errors: errors.iter().map(|error| f32::from_le_bytes(*error)).collect(),
        })
    }

    fn is_fitted(&self, config: &ErrorSamplingConfig, index: usize) -> bool {
        self.errors.get(index).is_some_and(|error| *error < config.threshold)
    }
}

#[cfg(test)]
mod tests {
    use infonerf_render::RandomStream;

    use super::*;

    #[test]
    fn well_fitted_pixels_are_sampled_less_often() {
        const PIXELS: usize = 10;
        let config = ErrorSamplingConfig { threshold: 0.1, keep: 0.25 };
        let mut errors = PixelErrors::default();
        errors.resize((2, PIXELS));
        errors.remember(&[0, 1, 2, 3, 4], [0.05; 5].into_iter());
        let [draws, acceptance] =
            [RandomStream::Column, RandomStream::Acceptance].map(|stream| Noise::new(0, 0, stream));
        let rays = 100_000;
        let chosen: Vec<(usize, usize)> =
            (0..rays).map(|ray| errors.choose(&config, ray, acceptance, |k| draws.below(ray, k, PIXELS))).collect();
        // A draw is accepted with probability 5/8: fitted with 1/8, other with 1/2; the fourth is taken anyway.
        let rejected = 3.0f64 / 8.0;
        let tries = 1.0 + rejected + rejected.powi(2);
        let expected = tries / 8.0 + rejected.powi(3) / 2.0;
        let share = chosen.iter().filter(|(pixel, _)| *pixel < 5).count() as f64 / rays as f64;
        assert!((share - expected).abs() < 0.01, "{share} {expected}");
        let mean = chosen.iter().map(|(_, rejected)| rejected).sum::<usize>() as f64 / rays as f64;
        assert!((mean - rejected * tries).abs() < 0.01, "{mean}");
    }

    /// Pixels of one image are drawn at most once: the others first, then as many well-fitted ones as are missing.
    #[test]
    fn one_image_is_drawn_without_repetition() {
        let mut errors = PixelErrors::default();
        errors.resize((1, 10));
        errors.remember(&[0, 1, 2, 3, 4], [0.05; 5].into_iter());
        let none = ErrorSamplingConfig { threshold: 0.1, keep: 0.0 };
        let acceptance = Noise::new(0, 0, RandomStream::Acceptance);
        let order = [3, 7, 1, 9, 0, 5];
        assert_eq!(errors.among(&none, acceptance, &order, 2), (vec![7, 9], 2));
        assert_eq!(errors.among(&none, acceptance, &order, 5), (vec![7, 9, 5, 3, 1], 1));
        assert_eq!(errors.among(&none, acceptance, &order[..3], 3), (vec![7, 3, 1], 0));
        let all = ErrorSamplingConfig { keep: 1.0, ..none };
        assert_eq!(errors.among(&all, acceptance, &order, 3), (vec![3, 7, 1], 0));
    }

    #[test]
    fn a_checkpoint_keeps_them_and_another_size_does_not() {
        let mut errors = PixelErrors::default();
        errors.resize((2, 3));
        errors.remember(&[1], [0.5].into_iter());
        assert_eq!(PixelErrors::from_bytes(&errors.to_bytes()).unwrap(), errors);
        assert_eq!(PixelErrors::from_bytes(&[1, 2, 3]), None);
        errors.resize((1, 6));
        assert!(errors.errors.iter().all(|error| error.is_infinite()));
    }
}
