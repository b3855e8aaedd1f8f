use std::collections::BTreeMap;

use indexmap::IndexMap;

use crate::error::MetricError;
use crate::features::FeatureSet;
use crate::measured::{Measured, Note, Values};
use crate::metric::{METRICS, Measure, Metric};
use crate::networks::Networks;
use crate::protocol::Protocol;
use crate::view::{Pair, PreparedView};

/// Measures `pairs` with every metric.
///
/// # Errors
/// Errors of [`Evaluator::add`].
pub fn evaluate(pairs: &[Pair<'_>], networks: &Networks, protocol: &Protocol) -> Result<Measured, MetricError> {
    let mut evaluator = Evaluator::new(METRICS, networks, protocol);
    for pair in pairs {
        evaluator.add(*pair)?;
    }
    Ok(evaluator.finish())
}

/// Measures views one after another, so that only one is in memory at a time.
pub struct Evaluator<'a> {
    metrics: &'a [&'static Metric],
    networks: &'a Networks,
    protocol: &'a Protocol,
    views: Vec<Values>,
    /// First reason why a metric has no value for a view, by key.
    reasons: BTreeMap<&'static str, MetricError>,
    /// Features of renders and of truths by each extractor, by name.
    features: BTreeMap<&'static str, Result<[FeatureSet; 2], MetricError>>,
}

impl<'a> Evaluator<'a> {
    /// Prepares to measure `metrics`: all of [`METRICS`], or a [selection](crate::select).
    pub fn new(metrics: &'a [&'static Metric], networks: &'a Networks, protocol: &'a Protocol) -> Self {
        let empty = |metric: &&Metric| match metric.measure {
            Measure::Set(network, _) => Some((network, networks.extractor(network).map(|_| Default::default()))),
            _ => None,
        };
        let features = metrics.iter().filter_map(empty).collect();
        Self { metrics, networks, protocol, views: Vec::new(), reasons: BTreeMap::new(), features }
    }

    /// Measures one more view and returns its values; a metric that cannot be computed has none. A view without a valid
    /// pixel has no values, and is left out of the sets that FID and KID compare.
    ///
    /// # Errors
    /// If the sizes of render, truth, masks and depth maps differ.
    pub fn add(&mut self, pair: Pair<'_>) -> Result<&Values, MetricError> {
        let view = match PreparedView::new(pair, self.protocol) {
            Err(reason) if reason != MetricError::NothingValid => return Err(reason),
            view => view,
        };
        let mut values = Values::new();
        let mut computed = BTreeMap::new();
        for metric in self.metrics.iter().filter(|metric| !matches!(metric.measure, Measure::Set(..))) {
            let view = view.as_ref().map_err(MetricError::clone);
            let value = view.and_then(|view| view_value(metric, view, self.networks, &mut computed));
            if let Err(reason) = &value {
                self.reasons.entry(metric.key()).or_insert_with(|| reason.clone());
            }
            values.insert(metric.key().to_owned(), value.ok());
        }
        for (network, features) in &mut self.features {
            if let (Ok(sets), Ok(view)) = (&mut *features, &view)
                && let Err(reason) = add_features(view, self.networks, network, sets)
            {
                *features = Err(reason);
            }
        }
        self.views.push(values);
        Ok(&self.views[self.views.len() - 1])
    }

    /// Returns the values of all views and of the set.
    pub fn finish(self) -> Measured {
        let mut set = Values::new();
        // Metrics that have no value for the same reason share a note.
        let mut notes: IndexMap<String, Vec<String>> = IndexMap::new();
        for metric in self.metrics {
            let (value, note) = match metric.measure {
                Measure::View(_) | Measure::Distance(..) | Measure::Values(..) => self.mean(metric.key()),
                Measure::Set(network, measure) => {
                    let features = self.features[network].as_ref().map_err(MetricError::clone);
                    let value = features.and_then(|[renders, truths]| measure(renders, truths));
                    (value.as_ref().ok().copied(), value.err().map(|reason| reason.to_string()))
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

    /// Computes the mean over the views that have a finite value, and a note if some have none.
    ///
    /// An infinite value (PSNR of identical images) would hide all others: it is left out, unless all views have one.
    fn mean(&self, key: &str) -> (Option<f64>, Option<String>) {
        let mut values: Vec<f64> = self.views.iter().filter_map(|view| view[key]).collect();
        let is_infinite = |value: &f64| value.is_infinite();
        let mut reasons: Vec<String> = self.reasons.get(key).map(ToString::to_string).into_iter().collect();
        if values.iter().any(is_infinite) && !values.iter().all(is_infinite) {
            values.retain(|value| value.is_finite());
            reasons.push("render and truth are identical, which has no finite value".to_owned());
        }
        let reasons = reasons.join("; ");
        if values.is_empty() {
            return (None, Some(if reasons.is_empty() { "no views".to_owned() } else { reasons }));
        }
        let of = format!("mean over {} of {} views, for the others: ", values.len(), self.views.len());
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (Some(mean), (!reasons.is_empty()).then(|| of + &reasons))
    }
}

/// Computes the value of `metric` for a view; `computed` holds values by key, so that each is computed once.
fn view_value(
    metric: &Metric,
    view: &PreparedView<'_>,
    networks: &Networks,
    computed: &mut BTreeMap<&'static str, Result<f64, MetricError>>,
) -> Result<f64, MetricError> {
    if let Some(known) = computed.get(metric.key()) {
        return known.clone();
    }
    let value = match metric.measure {
        Measure::View(measure) => measure(view),
        Measure::Distance(network, measure) => networks.distance(network).and_then(|network| measure(view, network)),
        Measure::Values(metrics, measure) => {
            let values = metrics.iter().map(|metric| view_value(metric, view, networks, computed));
            values.collect::<Result<Vec<f64>, MetricError>>().map(|values| measure(&values))
        }
        Measure::Set(..) => unreachable!("{} is a metric of sets", metric.key()),
    };
    computed.insert(metric.key(), value.clone());
    value
}

/// Adds the features of a view by the extractor `network` to the sets of renders and of truths.
fn add_features(
    view: &PreparedView<'_>,
    networks: &Networks,
    network: &'static str,
    [renders, truths]: &mut [FeatureSet; 2],
) -> Result<(), MetricError> {
    let pictures = [&view.render, &view.truth];
    let rows = networks.extractor(network)?(&pictures);
    let [render, truth] = rows.as_slice() else {
        return Err(MetricError::length("features", rows.len(), pictures.len()));
    };
    renders.push(render)?;
    truths.push(truth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::Mask;
    use crate::picture::Picture;
    use crate::view::Depths;

    fn flat(value: f32) -> Picture {
        Picture::new(vec![[value; 3]; 144], 12, 12).unwrap()
    }

    fn corner_distance(render: &Picture, truth: &Picture, _: &Protocol) -> Result<f64, String> {
        let [a, b] = [render, truth].map(|picture| f64::from(picture.pixels()[0][0]));
        if b == 0.0 { Err("too dark".to_owned()) } else { Ok((a - b).abs()) }
    }

    fn reason<'a>(measured: &'a Measured, key: &str) -> Option<&'a str> {
        let note = measured.notes.iter().find(|note| note.metrics.iter().any(|metric| metric == key));
        note.map(|note| note.reason.as_str())
    }

    #[test]
    fn sets_have_every_metric_in_order_and_a_note_for_each_missing_value() {
        let (render, truth) = (flat(0.6), flat(0.5));
        let measured = evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &Protocol::default()).unwrap();
        assert!(measured.set.keys().eq(METRICS.iter().map(|metric| metric.key())));
        for (key, value) in &measured.set {
            assert_eq!(value.is_none(), reason(&measured, key).is_some(), "{key}");
        }
        assert_eq!(reason(&measured, "psnr_masked"), Some("no mask"));
        assert_eq!(reason(&measured, "sharpness"), Some("the truth is flat"));
        assert_eq!(reason(&measured, "silhouette_iou"), reason(&measured, "depth_error"));
        let empty = evaluate(&[], &Networks::none(), &Protocol::default()).unwrap();
        assert!(empty.set.values().all(Option::is_none));
        assert_eq!(reason(&empty, "psnr"), Some("no views"));
    }

    #[test]
    fn rounding_removes_differences_below_half_a_step() {
        let (render, truth) = (flat(100.4 / 255.0), flat(100.0 / 255.0));
        let psnr = |eight_bit| {
            let protocol = Protocol { eight_bit, ..Protocol::default() };
            evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &protocol).unwrap().set["psnr"].unwrap()
        };
        assert_eq!(psnr(true), f64::INFINITY);
        assert!(psnr(false).is_finite());
    }

    #[test]
    fn means_leave_out_missing_and_infinite_values_with_a_note() {
        let mut networks = Networks::none();
        networks.distances.insert("lpips-alex", Box::new(corner_distance));
        let (dark, grey, bright) = (flat(0.0), flat(0.4), flat(1.0));
        let pairs = [Pair::new(&bright, &grey), Pair::new(&grey, &dark), Pair::new(&grey, &grey)];
        let measured = evaluate(&pairs, &networks, &Protocol::default()).unwrap();
        assert_eq!((measured.views[1]["lpips_alex"], measured.views[2]["psnr"]), (None, Some(f64::INFINITY)));
        approx::assert_abs_diff_eq!(measured.set["lpips_alex"].unwrap(), 0.3, epsilon = 1e-6);
        let psnr = [0, 1].map(|view| measured.views[view]["psnr"].unwrap()).iter().sum::<f64>() / 2.0;
        assert_eq!(measured.set["psnr"], Some(psnr));
        assert_eq!(reason(&measured, "lpips_alex"), Some("mean over 2 of 3 views, for the others: too dark"));
        let note = "mean over 2 of 3 views, for the others: render and truth are identical, which has no finite value";
        assert_eq!(reason(&measured, "psnr"), Some(note));
        let identical = evaluate(&pairs[2..], &networks, &Protocol::default()).unwrap();
        assert_eq!(identical.set["psnr"], Some(f64::INFINITY));
    }

    #[test]
    fn view_without_a_valid_pixel_is_left_out() {
        let mut networks = Networks::none();
        let corner = |picture: &&Picture| vec![picture.pixels()[0][0]];
        let corners = move |pictures: &[&Picture]| -> Vec<Vec<f32>> { pictures.iter().map(corner).collect() };
        networks.extractors.insert("inception-fid", Box::new(corners));
        let [dark, grey, light, bright] = [0.2, 0.4, 0.6, 1.0].map(flat);
        let none = Mask::new(vec![false; 144], 12, 12).unwrap();
        let left_out = Pair { valid: Some(&none), ..Pair::new(&bright, &dark) };
        let pairs = [left_out, Pair::new(&dark, &light), Pair::new(&grey, &bright)];
        let measured = evaluate(&pairs, &networks, &Protocol::default()).unwrap();
        assert!(measured.views[0].values().all(Option::is_none));
        let psnr = [1, 2].map(|view| measured.views[view]["psnr"].unwrap()).iter().sum::<f64>() / 2.0;
        assert_eq!(measured.set["psnr"], Some(psnr));
        let expected = "mean over 2 of 3 views, for the others: no valid pixel to compare";
        assert_eq!(reason(&measured, "psnr"), Some(expected));
        // Features 0.2 and 0.4 of renders, 0.6 and 1 of truths: (0.8 − 0.3)² + (√0.08 − √0.02)².
        approx::assert_abs_diff_eq!(measured.set["fid"].unwrap(), 0.27, epsilon = 1e-6);
        let single = evaluate(&pairs[..2], &networks, &Protocol::default()).unwrap();
        assert_eq!(reason(&single, "fid"), Some("needs at least 2 images, got 1"));
    }

    #[test]
    fn masked_metrics_use_the_masked_images() {
        let mut networks = Networks::none();
        networks.distances.insert("lpips-vgg", Box::new(corner_distance));
        let (render, truth) = (flat(0.2), flat(0.5));
        let mask = Mask::new((0..144).map(|i| i > 0).collect(), 12, 12).unwrap();
        let depths = Some(Depths { render: &[1.0; 144], truth: &[3.0; 144] });
        let pair = Pair { mask: Some(&mask), depths, ..Pair::new(&render, &truth) };
        let set = evaluate(&[pair], &networks, &Protocol::default()).unwrap().set;
        assert_eq!((set["lpips_vgg_masked"], set["depth_error"]), (Some(0.0), Some(2.0)));
        let [psnr, ssim, lpips] = ["psnr", "ssim", "lpips_vgg"].map(|key| set[key].unwrap());
        approx::assert_abs_diff_eq!(lpips, 77.0 / 255.0, epsilon = 1e-6);
        assert_eq!(set["average"], Some(crate::metric::average(psnr, ssim, lpips)));
    }
}
