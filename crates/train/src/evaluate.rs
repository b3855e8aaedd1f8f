//! The final evaluation, on test views only.

use std::sync::Arc;
use std::time::Instant;

use infonerf_field::Field;
use infonerf_metrics::{Depths, Evaluator, METRICS, Mask, Measured, Metric, Networks, Pair, Picture, Protocol, Values};
use infonerf_render::{RenderedImage, Renderer, TrainedModel, render_tested};
use infonerf_scene::View;

use crate::error::TrainError;

/// Mean opacity below which a picture counts as empty.
const EMPTY_PICTURE: f64 = 1e-3;

/// One test view, rendered and measured.
#[derive(Clone, Debug)]
pub struct TestView {
    /// The picture.
    pub image: RenderedImage,
    /// Each metric by its key; `None` if it could not be computed.
    pub values: Values,
    /// Wall-clock time of rendering alone, seconds.
    pub seconds: f64,
}

impl TestView {
    /// Returns the metric of this key; `None` if it could not be computed.
    pub fn value(&self, key: &str) -> Option<f64> {
        self.values.get(key).copied().flatten()
    }

    /// Whether the picture is empty.
    pub fn shows_nothing(&self) -> bool {
        self.opacity() < EMPTY_PICTURE
    }

    fn opacity(&self) -> f64 {
        self.image.acc.iter().copied().map(f64::from).sum::<f64>() / self.image.acc.len() as f64
    }
}

/// Renders test views and measures them, one after another.
pub struct Evaluation<'a> {
    evaluator: Evaluator<'a>,
    views: usize,
    seconds: f64,
    opacity: f64,
    shows_nothing: bool,
}

/// Results of an [`Evaluation`].
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Metrics of each view and of all.
    pub measured: Measured,
    /// Mean wall-clock time of rendering a picture, seconds.
    pub seconds_per_image: f64,
    /// Mean opacity of the pictures.
    pub opacity: f64,
    /// Whether all pictures are empty, as of a field that is too faint to be seen.
    pub shows_nothing: bool,
}

impl<'a> Evaluation<'a> {
    /// Starts an evaluation by every metric for which there is a network, under `protocol`.
    pub fn new(networks: &'a Networks, protocol: &'a Protocol) -> Self {
        Self::of(METRICS, networks, protocol)
    }

    /// Starts an evaluation by `metrics` alone.
    pub fn of(metrics: &'a [&'static Metric], networks: &'a Networks, protocol: &'a Protocol) -> Self {
        let evaluator = Evaluator::new(metrics, networks, protocol);
        Self { evaluator, views: 0, seconds: 0.0, opacity: 0.0, shows_nothing: true }
    }

    /// Renders `view`, the mean of the members' pictures, and compares it with its photograph, whose own residual is left
    /// out of the picture ([`render_tested`]).
    ///
    /// # Errors
    /// If a render is not finite.
    pub fn add<F: Field>(
        &mut self,
        renderer: &Renderer,
        members: &[TrainedModel<F>],
        view: &View,
    ) -> Result<TestView, TrainError> {
        let start = Instant::now();
        let image = render_tested(renderer, members, view);
        let seconds = start.elapsed().as_secs_f64();
        let render = Picture::new(image.rgb.clone(), image.width as usize, image.height as usize)?;
        let truth = Picture::new(view.image.rgb.clone(), view.image.width as usize, view.image.height as usize)?;
        let depths = view.depth.as_ref().map(|truth| Depths { render: &image.depth, truth });
        let [width, height] = render.size();
        let mask = |of: &Option<Arc<[bool]>>| of.as_ref().map(|of| Mask::new(of.to_vec(), width, height)).transpose();
        let (mask, valid) = (mask(&view.mask)?, mask(&view.valid)?);
        let pair = Pair { depths, mask: mask.as_ref(), valid: valid.as_ref(), ..Pair::new(&render, &truth) };
        let values = self.evaluator.add(pair)?.clone();
        let view = TestView { image, values, seconds };
        self.views += 1;
        self.seconds += seconds;
        self.opacity += view.opacity();
        self.shows_nothing &= view.shows_nothing();
        Ok(view)
    }

    /// Returns the means; `None` without views.
    pub fn finish(self) -> Option<Evaluated> {
        (self.views > 0).then(|| Evaluated {
            measured: self.evaluator.finish(),
            seconds_per_image: self.seconds / self.views as f64,
            opacity: self.opacity / self.views as f64,
            shows_nothing: self.shows_nothing,
        })
    }
}

/// Renders one view, and measures it with every metric that needs no network.
///
/// # Errors
/// As [`Evaluation::add`].
pub fn evaluate_view<F: Field>(
    renderer: &Renderer,
    members: &[TrainedModel<F>],
    view: &View,
) -> Result<TestView, TrainError> {
    Evaluation::new(&Networks::none(), &Protocol::default()).add(renderer, members, view)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_less_than_a_thousandth_opacity_are_empty() {
        let shown = |acc: Vec<f32>| {
            let image = RenderedImage { acc, ..RenderedImage::default() };
            TestView { image, values: Values::new(), seconds: 0.0 }
        };
        let is_empty = |acc: [f32; 2]| shown(acc.to_vec()).shows_nothing();
        assert_eq!([[0.0, 0.0019], [0.0, 0.0021], [0.5, 0.0]].map(is_empty), [true, false, false]);
        // In `f32` the mean over 800² pixels would be 0.298.
        assert!((shown(vec![0.3; 640_000]).opacity() - 0.3).abs() < 1e-6);
    }
}
