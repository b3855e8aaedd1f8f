use serde::{Deserialize, Serialize};

/// One run: an entry of `results.json`, keys in this order.
///
/// A metric that was not computed is `None`, written as `null`, and `notes` says why.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Record {
    /// Name of the experiment, as its configuration file is called.
    pub experiment: String,
    /// Scene.
    pub scene: String,
    /// Variant: what is compared, such as `nerf` and `infonerf`.
    pub variant: String,
    /// Seed of the run.
    pub seed: u64,
    /// Preset: `fast`, `paper` or `released`.
    pub preset: String,
    /// Device that trained it.
    pub device: String,
    /// Ids of the training views, in the order given.
    pub train_views: Vec<usize>,
    /// Which views the metrics are means over.
    pub test_views: TestViews,
    /// `[width, height]` in pixels, of training and test images.
    pub image_size: [usize; 2],
    /// Optimiser steps taken.
    pub iterations: u64,
    /// Wall clock of training alone, in seconds, without loading and evaluation.
    pub train_seconds: f64,
    /// Wall clock of one test image, in seconds.
    pub render_seconds_per_image: f64,
    /// Points along training rays before skipping.
    pub samples_total: u64,
    /// Points along training rays at which the field was evaluated.
    pub samples_evaluated: u64,
    /// Peak signal-to-noise ratio in decibels.
    pub psnr: Option<f64>,
    /// Structural similarity.
    pub ssim: Option<f64>,
    /// Learned perceptual distance.
    pub lpips: Option<f64>,
    /// Gradient magnitude similarity deviation.
    pub gmsd: Option<f64>,
    /// Mean image-gradient magnitude of the renders over the truth's.
    pub sharpness: Option<f64>,
    /// Root mean square error of depth in scene units, where the scene has exact depth.
    pub depth_rmse: Option<f64>,
    /// Mean entropy of the ray distribution on test rays, in bits (the paper's Figure A).
    pub ray_entropy_bits: Option<f64>,
    /// Mean information gain between test rays and their neighbours (the paper's Figure A).
    pub information_gain: Option<f64>,
    /// Peak resident memory of the process in bytes, where the system reports it.
    pub peak_rss_bytes: Option<u64>,
    /// True when the field went empty.
    pub collapsed: bool,
    /// Remarks, among them the reason for each metric that is `null`.
    pub notes: Vec<String>,
}

/// The views over which the metrics are means.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TestViews {
    /// `all`, or `every-8` for each eighth.
    pub protocol: String,
    /// How many.
    pub count: usize,
    /// Their ids.
    pub ids: Vec<usize>,
}

impl Record {
    /// The record with every metric that is NaN or infinite set to `None` and named in `notes`: JSON has no such
    /// numbers.
    #[must_use]
    pub fn representable(mut self) -> Self {
        let metrics = [
            ("psnr", &mut self.psnr),
            ("ssim", &mut self.ssim),
            ("lpips", &mut self.lpips),
            ("gmsd", &mut self.gmsd),
            ("sharpness", &mut self.sharpness),
            ("depth_rmse", &mut self.depth_rmse),
            ("ray_entropy_bits", &mut self.ray_entropy_bits),
            ("information_gain", &mut self.information_gain),
        ];
        for (name, metric) in metrics {
            if let Some(value) = metric.take_if(|value| !value.is_finite()) {
                self.notes.push(format!("{name} was {value} and is left out: JSON cannot hold it"));
            }
        }
        self
    }

    /// The first field that is not an optional metric and yet NaN or infinite.
    pub(crate) fn non_finite_field(&self) -> Option<(&'static str, f64)> {
        [("train_seconds", self.train_seconds), ("render_seconds_per_image", self.render_seconds_per_image)]
            .into_iter()
            .find(|(_, value)| !value.is_finite())
    }
}
