//! Axes: a range, its ticks and their labels. Unlike the drawing library's, these accept any range.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// Maximum magnitude of values that are drawn, so that differences of two of them cannot overflow.
const MAX_MAGNITUDE: f64 = 1e300;
const MIN_LOG: f64 = 1e-300;
const MAX_TICKS: i64 = 12;
/// Length of a logarithmic axis, in decades, below which it has evenly spaced ticks.
const NARROW: f64 = 0.7;

#[derive(Debug, Clone)]
pub(super) struct Scale {
    /// Lower end; both ends are in decades on a logarithmic axis.
    low: f64,
    high: f64,
    kind: ScaleKind,
}

#[derive(Debug, Clone)]
enum ScaleKind {
    Linear,
    Log,
    /// Names of categories; category `i` is at `i + ½`.
    Labels(Vec<String>),
}

/// Returns whether an axis, logarithmic with `log`, can show a value.
pub(super) fn drawable(value: f64, log: bool) -> bool {
    value.is_finite() && value.abs() <= MAX_MAGNITUDE && (!log || value >= MIN_LOG)
}

impl Scale {
    /// Returns a scale that contains `values`, with a margin of 4 % of their range at both ends.
    pub(super) fn around(values: impl Iterator<Item = f64>, log: bool) -> Self {
        let kind = if log { ScaleKind::Log } else { ScaleKind::Linear };
        let places = values.filter(|&value| drawable(value, log)).map(|value| kind.coordinate(value));
        let (low, high) =
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| (low.min(place), high.max(place)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let least = if log { 0.02 } else { 1e-9 * low.abs().max(high.abs()) };
        let half = if log { 0.05 } else { (0.05 * low.abs().max(high.abs())).max(0.5e-3) };
        let (low, high) = if high - low > least { (low, high) } else { (low - half, high + half) };
        let margin = 0.04 * (high - low);
        Self { low: low - margin, high: high + margin, kind }
    }

    pub(super) fn labels(labels: Vec<String>) -> Self {
        Self { low: 0.0, high: labels.len().max(1) as f64, kind: ScaleKind::Labels(labels) }
    }
}

impl ScaleKind {
    fn coordinate(&self, value: f64) -> f64 {
        if matches!(self, Self::Log) { value.max(MIN_LOG).log10() } else { value }
    }
}

/// Formats a tick with the decimals that distinguish it from the next, `step` away.
fn multiple(tick: f64, step: f64) -> String {
    let unit = if tick.abs() >= 1e4 { 10f64.powf(3.0 * (tick.abs().log10() / 3.0).floor()) } else { 1.0 };
    short(tick, (-(step / unit).log10()).ceil().clamp(0.0, 6.0) as usize)
}

/// Returns the distance of ticks over a span: 1, 2 or 5 times a power of ten, about six to an axis.
fn step(span: f64) -> f64 {
    let rough = span / 7.0;
    let power = 10f64.powf(rough.log10().floor());
    let multiple = [1.0, 2.0, 5.0].into_iter().find(|multiple| multiple * power >= 0.999 * rough);
    multiple.unwrap_or(10.0) * power
}

fn multiples(low: f64, high: f64, step: f64) -> Vec<f64> {
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last.min(first.saturating_add(MAX_TICKS))).map(|i| i as f64 * step).collect()
}

/// Formats `value` with a metric suffix from ten thousand upwards, in powers of ten when very small or large.
pub(super) fn short(value: f64, decimals: usize) -> String {
    let magnitude = value.abs();
    let suffixes = [(1e12, 1e12, "T"), (1e9, 1e9, "G"), (1e6, 1e6, "M"), (1e4, 1e3, "k")];
    match suffixes.into_iter().find(|&(from, _, _)| magnitude >= from) {
        _ if magnitude >= 1e15 || (magnitude > 0.0 && magnitude < 1e-3) => format!("{value:.0e}"),
        Some((_, unit, suffix)) => format!("{}{suffix}", trimmed(value / unit, decimals)),
        None => trimmed(value, decimals),
    }
}

/// Formats `value` with `decimals` places, or with as many as the first digit of a number below one needs.
fn trimmed(value: f64, decimals: usize) -> String {
    let needed = if value != 0.0 && value.abs() < 1.0 { (-value.abs().log10()).ceil() as usize } else { 0 };
    format!("{value:.*}", decimals.max(needed))
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let position = ((self.kind.coordinate(*value) - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        from + (position * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        match &self.kind {
            ScaleKind::Labels(labels) => (0..labels.len()).map(|i| i as f64 + 0.5).collect(),
            ScaleKind::Log if self.high - self.low >= 2.0 => {
                let step = ((self.high - self.low) / 7.0).ceil();
                multiples(self.low, self.high, step).into_iter().map(|decade| 10f64.powf(decade)).collect()
            }
            ScaleKind::Log if self.high - self.low >= NARROW => {
                let decades = self.low.floor() as i32..=self.high.ceil() as i32;
                let candidates = decades.flat_map(|decade| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(decade)));
                candidates.filter(|tick| (self.low..=self.high).contains(&tick.log10())).collect()
            }
            ScaleKind::Linear | ScaleKind::Log => {
                let Range { start, end } = self.range();
                multiples(start, end, step(end - start))
            }
        }
    }

    fn range(&self) -> Range<f64> {
        let value = |place: f64| if matches!(self.kind, ScaleKind::Log) { 10f64.powf(place) } else { place };
        value(self.low)..value(self.high)
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, tick: &f64) -> String {
        match &self.kind {
            ScaleKind::Labels(labels) => labels.get(*tick as usize).cloned().unwrap_or_default(),
            ScaleKind::Log if self.high - self.low >= NARROW => short(*tick, 0),
            ScaleKind::Linear | ScaleKind::Log => {
                let Range { start, end } = self.range();
                multiple(*tick, step(end - start))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use plotters::coord::ranged1d::BoldPoints;
    use proptest::prelude::*;

    use super::*;

    fn labels(low: f64, high: f64, log: bool) -> Vec<String> {
        let scale = Scale::around([low, high].into_iter(), log);
        scale.key_points(BoldPoints(6)).into_iter().map(|tick| scale.format_ext(&tick)).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(0.0, 1000.0, false), ["0", "200", "400", "600", "800", "1000"]);
        assert_eq!(labels(15.0, 21.0, false), ["15", "16", "17", "18", "19", "20", "21"]);
        assert_eq!(labels(0.7, 0.82, false), ["0.70", "0.72", "0.74", "0.76", "0.78", "0.80", "0.82"]);
        assert_eq!(labels(0.0, 50_000.0, false), ["0", "10k", "20k", "30k", "40k", "50k"]);
        assert_eq!(labels(40.0, 60.0, true), ["40", "45", "50", "55", "60"]);
        assert_eq!(labels(3.9, 4.6, true), ["4.0", "4.2", "4.4", "4.6"]);
        assert_eq!(labels(10.0, 300.0, true), ["10", "20", "50", "100", "200"]);
        assert_eq!(labels(1e-4, 1.0, true), ["1e-4", "0.001", "0.01", "0.1", "1"]);
    }

    proptest! {
        #[test]
        fn any_values_have_few_finite_ticks(values in prop::collection::vec(prop::num::f64::ANY, 0..5), log in prop::bool::ANY) {
            let scale = Scale::around(values.iter().copied(), log);
            prop_assert!(scale.low < scale.high);
            let ticks = scale.key_points(BoldPoints(6));
            prop_assert!(ticks.len() <= 13, "{ticks:?}");
            for tick in ticks {
                prop_assert!(!scale.format_ext(&tick).is_empty());
                prop_assert!((0..=500).contains(&scale.map(&tick, (0, 500))));
            }
            for value in values {
                prop_assert!((0..=500).contains(&scale.map(&value, (0, 500))) || value.is_nan());
            }
        }
    }
}
