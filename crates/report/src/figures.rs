//! Charts that every report has, made from the records and the training events of the runs.

use std::collections::BTreeSet;

use crate::chart::{Bar, ChartFrame, Series, bar_chart, frontier_chart, line_chart};
use crate::error::ReportError;
use crate::events::{Events, StepEvent};
use crate::quantity::Quantity;
use crate::record::{Record, distinct};
use crate::table::{VariantGroup, groups};

const CURVE_POINTS: usize = 200;

/// Chart with its caption.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Stem of the file name, `plots/<name>.svg` next to `report.html`.
    pub name: String,
    /// Description for readers who cannot see the chart.
    pub title: String,
    /// SVG from a function of [`crate::chart`].
    pub svg: String,
    /// Text below the chart; may be empty.
    pub caption: String,
}

impl Figure {
    /// Makes a figure of the chart `svg`, which the title of its `frame` describes.
    pub fn new(name: impl Into<String>, frame: ChartFrame, svg: String, caption: &str) -> Self {
        Self { name: name.into(), title: frame.title, svg, caption: caption.into() }
    }
}

/// Draws bars of PSNR and ray entropy and the frontier of time against PSNR, over two variants or more.
pub(crate) fn comparison_figures<R: AsRef<Record>>(records: &[R]) -> Result<Vec<Figure>, ReportError> {
    let scenes = distinct(records, |record| record.scene.clone());
    let groups = groups(records.iter().map(AsRef::as_ref));
    if groups.len() < 2 {
        return Ok(Vec::new());
    }
    let over = if scenes.len() > 1 { format!("mean over {} scenes", scenes.len()) } else { scenes.join("") };
    let mut figures = Vec::new();
    for (quantity, name) in [(Quantity::PSNR, "psnr"), (Quantity::RAY_ENTROPY, "ray-entropy")] {
        let bar = |group: &VariantGroup| {
            let summary = group.cell(quantity, &scenes).summary?;
            Some(Bar { label: group.label.clone(), value: summary.mean, spread: summary.std })
        };
        let bars: Vec<Bar> = groups.iter().filter_map(bar).collect();
        if bars.len() > 1 {
            let frame = ChartFrame::new(&format!("{}, {over}", quantity.heading()), "", &quantity.heading());
            let svg = bar_chart(&frame, &bars)?;
            let spread = bars.iter().any(|bar| bar.spread.is_some());
            let caption = if spread { "Whiskers: standard deviation over seeds." } else { "" };
            figures.push(Figure::new(name, frame, svg, caption));
        }
    }
    let point = |group: &VariantGroup| {
        let seconds = group.mean(Quantity::TRAIN_SECONDS, &scenes).filter(|&seconds| seconds > 0.0)?;
        Some(Series { name: group.label.clone(), points: vec![(seconds, group.mean(Quantity::PSNR, &scenes)?)] })
    };
    let series: Vec<Series> = groups.iter().filter_map(point).collect();
    if series.len() > 1 {
        let title = format!("Training time against PSNR, {over}");
        let frame = ChartFrame { log_x: true, ..ChartFrame::new(&title, "training (s)", "PSNR (dB)") };
        let svg = frontier_chart(&frame, &series)?;
        let caption = "Up and left is better; the line is the best PSNR reached by each time.";
        figures.push(Figure::new("time-psnr", frame, svg, caption));
    }
    Ok(figures)
}

/// Draws curves of PSNR and loss of one scene's runs, each by its label, and of the terms of each run's objective.
pub(crate) fn curve_figures(scene: &str, runs: &[(String, Events)]) -> Result<Vec<Figure>, ReportError> {
    let series = |point: Point| runs.iter().filter_map(|(name, events)| curve(name, events, point)).collect();
    let psnr: Vec<Series> = series(&|step| Some((step.seconds?, step.psnr?)));
    let mut figures = Vec::new();
    let mut add = |name: String, frame: ChartFrame, series: &[Series], caption: &str| -> Result<(), ReportError> {
        let svg = line_chart(&frame, series)?;
        figures.push(Figure::new(format!("{scene}-{name}"), frame, svg, caption));
        Ok(())
    };
    if !psnr.is_empty() {
        let frame = ChartFrame::new(&format!("{scene}: PSNR on training rays"), "training (s)", "PSNR (dB)");
        let caption = "Where coarse-to-fine training goes on to larger images, the PSNR of its rays falls.";
        add("psnr".into(), frame, &psnr, caption)?;
    }
    let loss: Vec<Series> = series(&|step| Some((step.step, step.loss?)));
    if !loss.is_empty() {
        add("loss".into(), by_step(&format!("{scene}: training loss"), "loss", &loss), &loss, "")?;
    }
    for (label, events) in runs {
        let terms = terms(events);
        if terms.len() > 1 {
            let frame = by_step(&format!("{scene}: terms of the objective of {label}"), "value", &terms);
            add(format!("{label}-terms"), frame, &terms, "Values before their weights.")?;
        }
    }
    Ok(figures)
}

/// Returns a curve of each term of a run's objective, without the steps at which the term is exactly 0: not active yet.
fn terms(events: &Events) -> Vec<Series> {
    let names: BTreeSet<&String> = events.steps.iter().flat_map(|step| step.losses.keys()).collect();
    let value = |step: &StepEvent, name: &String| step.losses.get(name).copied().filter(|value| *value != 0.0);
    let term = |name: &String| curve(name, events, &|step| Some((step.step, value(step, name)?)));
    names.into_iter().filter_map(term).collect()
}

/// Function that returns the point of a curve at a step; `None` if the step has no point.
type Point<'a> = &'a dyn Fn(&StepEvent) -> Option<(f64, f64)>;

/// Returns a curve of a run; `None` if the curve has fewer than two points.
fn curve(name: &str, events: &Events, point: Point) -> Option<Series> {
    let points = averaged(&events.steps.iter().filter_map(point).collect::<Vec<_>>());
    (points.len() > 1).then(|| Series { name: name.to_owned(), points })
}

/// Returns the frame of curves by step, logarithmic if all values are positive.
fn by_step(title: &str, y: &str, series: &[Series]) -> ChartFrame {
    let log = series.iter().flat_map(|series| &series.points).all(|point| point.1 > 0.0);
    ChartFrame { log_y: log, ..ChartFrame::new(title, "step", y) }
}

/// Reduces a curve to at most [`CURVE_POINTS`] points, each the mean of an equal number of neighbouring points.
fn averaged(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let size = points.len().div_ceil(CURVE_POINTS).max(1);
    let mean = |chunk: &[(f64, f64)]| {
        let count = chunk.len() as f64;
        (chunk.iter().map(|p| p.0).sum::<f64>() / count, chunk.iter().map(|p| p.1).sum::<f64>() / count)
    };
    points.chunks(size).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::two_by_two;

    #[test]
    fn charts_compare_two_variants_or_more() {
        let names: Vec<String> = comparison_figures(&two_by_two()).unwrap().into_iter().map(|f| f.name).collect();
        assert_eq!(names, ["psnr", "time-psnr"]);
        assert!(comparison_figures(&two_by_two()[..4]).unwrap().is_empty());
        assert!(comparison_figures::<Record>(&[]).unwrap().is_empty());
    }

    #[test]
    fn long_curves_are_averaged() {
        let points: Vec<(f64, f64)> = (0..1000).map(|i| (f64::from(i), 1.0)).collect();
        let curve = averaged(&points);
        assert_eq!((curve.len(), curve[0]), (200, (2.0, 1.0)));
    }

    #[test]
    fn negative_terms_have_their_curve() {
        let losses = |tv| [("rgb".to_owned(), 0.01), ("tv".to_owned(), tv)].into();
        let step = |(step, tv)| StepEvent { step, losses: losses(tv), ..StepEvent::default() };
        let steps = [(1.0, 0.0), (2.0, 0.5), (3.0, -0.5), (4.0, -2.0)].map(step).to_vec();
        let figures = curve_figures("lego", &[("nerf".into(), Events { steps, skipped: 0 })]).unwrap();
        let [figure] = figures.as_slice() else { panic!("{figures:?}") };
        // Markers: four of rgb, and three of tv, which is not on in the first step.
        assert_eq!(figure.svg.matches("<circle").count(), 4 + 3);
        assert!(figure.svg.contains("-1.5") && figure.svg.contains("tv"), "{}", figure.svg);
        let series = [0.5, -0.5, 0.0].map(|y| Series { name: String::new(), points: vec![(1.0, 0.5), (2.0, y)] });
        assert_eq!(series.map(|of| by_step("", "", &[of]).log_y), [true, false, false]);
    }
}
