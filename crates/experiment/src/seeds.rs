use std::ops::RangeInclusive;

/// Seeds of one range, at most.
const MAX_SEEDS: u64 = 10_000;

/// Parses a seed, or a range of seeds such as `0..4`, both ends included.
///
/// # Errors
/// What was expected, if it is neither.
pub fn parse_seeds(text: &str) -> Result<RangeInclusive<u64>, String> {
    let fault = || format!("expected a seed such as 3, or seeds such as 0..4, found `{text}`");
    let number = |text: &str| text.trim().parse::<u64>().map_err(|_| fault());
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let (first, last) = (number(first)?, number(last)?);
    if first <= last && last - first < MAX_SEEDS { Ok(first..=last) } else { Err(fault()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds() {
        assert_eq!(parse_seeds("3").unwrap(), 3..=3);
        assert_eq!(parse_seeds("0..4").unwrap(), 0..=4);
        for text in ["", "..", "4..0", "-1", "0..", "1.5", "0..1000000000"] {
            assert!(parse_seeds(text).is_err(), "{text}");
        }
    }
}
