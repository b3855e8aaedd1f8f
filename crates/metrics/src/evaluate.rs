use std::collections::BTreeMap;

use indexmap::IndexMap;

use crate::metric::Measure;
use crate::{Features, METRICS, Measured, Metric, MetricError, Networks, Note, Pair, Protocol, Values, View};

/// Measures `pairs` with every metric.
///
/// ```
/// use infonerf_metrics::{Networks, Pair, Picture, Protocol, evaluate};
///
/// let truth = Picture::new(vec![[0.4; 3]; 16 * 16], 16, 16)?;
/// let render = Picture::new(vec![[0.6; 3]; 16 * 16], 16, 16)?;
/// let measured = evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &Protocol::default())?;
/// assert!(measured.set["psnr"].is_some_and(|psnr| (psnr - 13.98).abs() < 0.01));
/// assert_eq!(measured.set["lpips_vgg"], None);
/// assert!(measured.notes.iter().any(|note| note.to_string().contains("infonerf weights fetch lpips-vgg")));
/// # Ok::<(), infonerf_metrics::MetricError>(())
/// ```
///
/// # Errors
/// As [`Evaluator::add`].
pub fn evaluate(pairs: &[Pair<'_>], networks: &Networks, protocol: &Protocol) -> Result<Measured, MetricError> {
    let mut evaluator = Evaluator::new(METRICS, networks, protocol);
    for pair in pairs {
        evaluator.add(*pair)?;
    }
    Ok(evaluator.finish())
}

/// Measures views one after another, so that pictures need not be in memory together.
pub struct Evaluator<'a> {
    metrics: &'a [&'static Metric],
    networks: &'a Networks,
    protocol: &'a Protocol,
    views: Vec<Values>,
    /// Why a metric has no value for a view, by key: the first reason.
    reasons: BTreeMap<&'static str, MetricError>,
    /// What each extractor makes of renders and of truths, by name.
    features: BTreeMap<&'static str, Result<[Features; 2], MetricError>>,
}

impl<'a> Evaluator<'a> {
    /// Measures `metrics`: all of [`METRICS`], or some that were [selected](crate::select).
    #[must_use]
    pub fn new(metrics: &'a [&'static Metric], networks: &'a Networks, protocol: &'a Protocol) -> Self {
        let mut features = BTreeMap::new();
        for metric in metrics {
            if let Measure::Set(network, _) = metric.measure {
                features.insert(network, networks.extractor(network).map(|_| <[Features; 2]>::default()));
            }
        }
        Self { metrics, networks, protocol, views: Vec::new(), reasons: BTreeMap::new(), features }
    }

    /// Measures one more view and gives its values; a metric that cannot be computed for it has none.
    ///
    /// # Errors
    /// As [`View::new`], if render and truth do not fit each other.
    pub fn add(&mut self, pair: Pair<'_>) -> Result<&Values, MetricError> {
        let view = View::new(pair, self.protocol)?;
        let mut values = Values::new();
        let mut measured = MeasuredView { view: &view, networks: self.networks, values: BTreeMap::new() };
        for metric in self.metrics.iter().filter(|metric| !matches!(metric.measure, Measure::Set(..))) {
            let value = measured.value(metric);
            if let Err(reason) = &value {
                self.reasons.entry(metric.key()).or_insert_with(|| reason.clone());
            }
            values.insert(metric.key().to_owned(), value.ok());
        }
        for (network, features) in &mut self.features {
            let Ok(sets) = features else { continue };
            if let Err(reason) = describe(&view, self.networks, network, sets) {
                *features = Err(reason);
            }
        }
        self.views.push(values);
        Ok(&self.views[self.views.len() - 1])
    }

    /// The values of all views and of the set.
    pub fn finish(self) -> Measured {
        let mut set = Values::new();
        // Metrics that have no value for the same reason share a note.
        let mut notes: IndexMap<String, Vec<String>> = IndexMap::new();
        for metric in self.metrics {
            let (value, note) = match metric.measure {
                Measure::View(_) | Measure::Distance(..) | Measure::Values(..) => self.mean(metric.key()),
                Measure::Set(network, measure) => {
                    let features = self.features[network].as_ref().map_err(MetricError::clone);
                    match features.and_then(|[renders, truths]| measure(renders, truths)) {
                        Ok(value) => (Some(value), None),
                        Err(reason) => (None, Some(reason.to_string())),
                    }
                }
            };
            set.insert(metric.key().to_owned(), value);
            if let Some(reason) = note {
                notes.entry(reason).or_default().push(metric.key().to_owned());
            }
        }
        let notes = notes.into_iter().map(|(reason, metrics)| Note { metrics, reason }).collect();
        Measured { views: self.views, set, notes }
    }

    /// Mean over the views that have a value, and a note if some have none.
    fn mean(&self, key: &str) -> (Option<f64>, Option<String>) {
        let values: Vec<f64> = self.views.iter().filter_map(|view| view[key]).collect();
        let mean = (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let note = match (mean, self.reasons.get(key)) {
            (Some(_), None) => None,
            (Some(_), Some(reason)) => {
                Some(format!("mean over {} of {} views, for the others: {reason}", values.len(), self.views.len()))
            }
            (None, Some(reason)) => Some(reason.to_string()),
            (None, None) => Some("no views".to_owned()),
        };
        (mean, note)
    }
}

/// A view and what has been measured of it, each once.
struct MeasuredView<'a> {
    view: &'a View<'a>,
    networks: &'a Networks,
    values: BTreeMap<&'static str, Result<f64, MetricError>>,
}

impl MeasuredView<'_> {
    /// The view's value of `metric`.
    ///
    /// # Panics
    /// For a metric of sets, which views have no value of.
    fn value(&mut self, metric: &Metric) -> Result<f64, MetricError> {
        if let Some(known) = self.values.get(metric.key()) {
            return known.clone();
        }
        let value = match metric.measure {
            Measure::View(measure) => measure(self.view),
            Measure::Distance(network, measure) => {
                self.networks.distance(network).and_then(|network| measure(self.view, network))
            }
            Measure::Values(metrics, measure) => {
                let values: Result<Vec<f64>, MetricError> = metrics.iter().map(|metric| self.value(metric)).collect();
                values.map(|values| measure(&values))
            }
            Measure::Set(..) => unreachable!("{} is of a set", metric.key()),
        };
        self.values.insert(metric.key(), value.clone());
        value
    }
}

/// Adds what the extractor `network` makes of a view to its sets of renders and of truths.
fn describe(
    view: &View<'_>,
    networks: &Networks,
    network: &'static str,
    [renders, truths]: &mut [Features; 2],
) -> Result<(), MetricError> {
    let pictures = [&view.render, &view.truth];
    let rows = networks.extractor(network)?.features(&pictures, view.protocol).map_err(MetricError::Network)?;
    let [render, truth] = rows.as_slice() else {
        return Err(MetricError::Length { what: "features", found: rows.len(), expected: pictures.len() });
    };
    renders.push(render)?;
    truths.push(truth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Depths, Mask, Picture, PictureDistance, select};

    fn flat(value: f32) -> Picture {
        Picture::new(vec![[value; 3]; 144], 12, 12).unwrap()
    }

    /// Difference of the upper left pixels; it cannot look at black.
    struct Corner;

    impl PictureDistance for Corner {
        fn distance(&self, render: &Picture, truth: &Picture, _: &Protocol) -> Result<f64, String> {
            let [a, b] = [render, truth].map(|picture| f64::from(picture.pixels()[0][0]));
            if b == 0.0 { Err("too dark".to_owned()) } else { Ok((a - b).abs()) }
        }
    }

    fn reason<'a>(measured: &'a Measured, key: &str) -> Option<&'a str> {
        let note = measured.notes.iter().find(|note| note.metrics.iter().any(|metric| metric == key));
        note.map(|note| note.reason.as_str())
    }

    #[test]
    fn a_set_has_every_metric_in_order_and_a_note_for_each_null() {
        let (render, truth) = (flat(0.6), flat(0.5));
        let measured = evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &Protocol::default()).unwrap();
        let keys: Vec<&str> = METRICS.iter().map(|metric| metric.key()).collect();
        assert_eq!(measured.set.keys().collect::<Vec<_>>(), keys);
        for (key, value) in &measured.set {
            assert_eq!(value.is_none(), reason(&measured, key).is_some(), "{key}");
        }
        assert_eq!(reason(&measured, "psnr_masked"), Some("no mask"));
        assert_eq!(reason(&measured, "sharpness"), Some("the truth is flat"));
        assert_eq!(reason(&measured, "silhouette_iou"), reason(&measured, "depth_error"));
    }

    #[test]
    fn no_views_have_no_values() {
        let measured = evaluate(&[], &Networks::none(), &Protocol::default()).unwrap();
        assert!(measured.set.values().all(Option::is_none));
        assert_eq!(reason(&measured, "psnr"), Some("no views"));
    }

    #[test]
    fn differences_below_half_a_step_vanish() {
        let (render, truth) = (flat(100.4 / 255.0), flat(100.0 / 255.0));
        let psnr = |eight_bit| {
            let protocol = Protocol { eight_bit, ..Protocol::default() };
            evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &protocol).unwrap().set["psnr"].unwrap()
        };
        assert_eq!(psnr(true), f64::INFINITY);
        assert!(psnr(false).is_finite());
    }

    #[test]
    fn means_leave_out_what_is_missing_and_say_so() {
        let networks = Networks::none().with_distance("lpips-alex", Box::new(Corner));
        let (dark, grey, bright) = (flat(0.0), flat(0.4), flat(1.0));
        let pairs = [Pair::new(&bright, &grey), Pair::new(&grey, &dark), Pair::new(&grey, &bright)];
        let measured = evaluate(&pairs, &networks, &Protocol::default()).unwrap();
        assert_eq!(measured.views[1]["lpips_alex"], None);
        approx::assert_abs_diff_eq!(measured.set["lpips_alex"].unwrap(), 0.6, epsilon = 1e-6);
        let expected = "mean over 2 of 3 views, for the others: too dark";
        assert_eq!(reason(&measured, "lpips_alex"), Some(expected));
    }

    #[test]
    fn masked_metrics_see_the_masked_pictures() {
        let networks = Networks::none().with_distance("lpips-vgg", Box::new(Corner));
        let (render, truth) = (flat(0.2), flat(0.5));
        let mask = Mask::new((0..144).map(|i| i > 0).collect(), 12, 12).unwrap();
        let depths = Some(Depths { render: &[1.0; 144], truth: &[3.0; 144] });
        let pair = Pair { mask: Some(&mask), depths, ..Pair::new(&render, &truth) };
        let set = evaluate(&[pair], &networks, &Protocol::default()).unwrap().set;
        assert_eq!((set["lpips_vgg_masked"], set["depth_error"]), (Some(0.0), Some(2.0)));
        assert!(set["lpips_vgg"].unwrap() > 0.29);
    }

    #[test]
    fn only_what_was_selected_is_measured() {
        let metrics = select(["ssim", "psnr"]).unwrap();
        let (networks, protocol) = (Networks::none(), Protocol::default());
        let mut evaluator = Evaluator::new(&metrics, &networks, &protocol);
        let values = evaluator.add(Pair::new(&flat(0.1), &flat(0.2))).unwrap().clone();
        let measured = evaluator.finish();
        assert_eq!((measured.set.len(), measured.notes.len()), (2, 0));
        assert_eq!(measured.set, values);
    }
}
