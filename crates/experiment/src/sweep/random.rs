//! `--range dotted.key=[log:|int:]low:high`: where random settings are drawn from.

use anyhow::{Context, Result, bail};
use infonerf_train::config;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::keys::Key;

/// A key of the config and where its values are drawn from.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Range {
    pub(super) key: Key,
    pub(super) scale: Scale,
    low: f64,
    high: f64,
}

/// How values are spread over a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    /// Evenly.
    Linear,
    /// Their logarithms evenly.
    Log,
    /// Whole numbers, both ends included.
    Integer,
}

impl Range {
    pub(super) fn parse(text: &str) -> Result<Self> {
        let context = || format!("--range {text}");
        let fault =
            || format!("--range {text}: expected KEY=LOW:HIGH, KEY=log:LOW:HIGH or KEY=int:LOW:HIGH, LOW below HIGH");
        let (path, _) = config::parse_assignment(text).with_context(context)?;
        let (_, bounds) = text.split_once('=').with_context(fault)?;
        let (scale, bounds) = match bounds.trim().split_once(':').with_context(fault)? {
            ("log", rest) => (Scale::Log, rest),
            ("int", rest) => (Scale::Integer, rest),
            _ => (Scale::Linear, bounds.trim()),
        };
        let (low, high) = bounds.split_once(':').with_context(fault)?;
        let number =
            |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite()).with_context(fault);
        let (low, high) = (number(low)?, number(high)?);
        if low >= high {
            bail!("{}", fault());
        }
        if scale == Scale::Log && low <= 0.0 {
            bail!("--range {text}: expected ends above 0 for a logarithm, found {low}");
        }
        if scale == Scale::Integer && (low.fract() != 0.0 || high.fract() != 0.0) {
            bail!("--range {text}: expected whole numbers, found {low} and {high}");
        }
        Ok(Self { key: Key { flag: "--range", path }, scale, low, high })
    }

    /// The value at `share` ∈ [0, 1) of the way, with four digits, as written in a config.
    fn at(&self, share: f64) -> String {
        let (low, high) = (self.low, self.high);
        match self.scale {
            Scale::Linear => format!("{:.3e}", low + share * (high - low)),
            Scale::Log => format!("{:.3e}", low * (high / low).powf(share)),
            Scale::Integer => format!("{}", low + (share * (high - low + 1.0)).floor()),
        }
    }
}

/// `count` settings, each a value of every range. A draw depends on its number and `seed` only, so that a longer search
/// begins with the draws of a shorter one. Draws that repeat an earlier one are left out.
pub(super) fn draws(ranges: &[Range], count: u32, seed: u64) -> Vec<Vec<String>> {
    let mut draws: Vec<Vec<String>> = Vec::new();
    for number in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(number));
        let draw = ranges.iter().map(|range| range.at(rng.random())).collect();
        if !draws.contains(&draw) {
            draws.push(draw);
        }
    }
    draws
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_stay_in_range_and_longer_searches_begin_alike() {
        let ranges = ["a=log:1e-5:1e-1", "b=-2:3", "c=int:1:4"].map(|text| Range::parse(text).unwrap());
        let list = draws(&ranges, 200, 7);
        let number = |text: &String| text.parse::<f64>().unwrap();
        assert!(list.iter().all(|draw| (1e-5..=1e-1).contains(&number(&draw[0]))));
        assert!(list.iter().all(|draw| (-2.0..=3.0).contains(&number(&draw[1]))));
        assert!(list.iter().all(|draw| ["1", "2", "3", "4"].contains(&draw[2].as_str())));
        let below = list.iter().filter(|draw| number(&draw[0]) < 1e-3).count();
        assert!((70..130).contains(&below), "half of the logarithms are below the middle: {below} of 200");
        assert_eq!(draws(&ranges, 10, 7), list[..10]);
        assert_ne!(draws(&ranges, 10, 8), list[..10]);
    }

    #[test]
    fn repeated_draws_are_left_out() {
        let ranges = [Range::parse("a=int:1:3").unwrap()];
        assert_eq!(draws(&ranges, 100, 0).len(), 3);
    }

    #[test]
    fn bad_ranges() {
        let fault = |text: &str| format!("{:#}", Range::parse(text).unwrap_err());
        for text in ["a", "a=", "a=1", "a=1:", "a=2:1", "a=1:1", "a=x:y", "a=log:1", "a=nan:1", "a=0:inf"] {
            assert!(fault(text).contains(&format!("--range {text}")), "{}", fault(text));
        }
        assert!(fault("a=log:0:1").contains("above 0"));
        assert!(fault("a=int:0.5:2").contains("whole numbers"));
    }
}
