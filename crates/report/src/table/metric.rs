use serde::Deserialize;

use crate::Record;

/// A number of a [`Record`] that a table can show. In files it is called as in `results.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// [`Record::psnr`].
    Psnr,
    /// [`Record::ssim`].
    Ssim,
    /// [`Record::lpips`].
    Lpips,
    /// [`Record::gmsd`].
    Gmsd,
    /// [`Record::sharpness`].
    Sharpness,
    /// [`Record::depth_rmse`].
    DepthRmse,
    /// [`Record::ray_entropy_bits`].
    #[serde(rename = "ray_entropy_bits")]
    RayEntropy,
    /// [`Record::information_gain`].
    InformationGain,
    /// [`Record::train_seconds`].
    TrainSeconds,
    /// [`Record::render_seconds_per_image`].
    #[serde(rename = "render_seconds_per_image")]
    RenderSeconds,
    /// [`Record::samples_total`] over [`Record::samples_evaluated`]; none when nothing was evaluated.
    SamplesSkipped,
    /// [`Record::peak_rss_bytes`] in MiB.
    PeakMemory,
}

/// Which values are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Better {
    Higher,
    Lower,
    NearOne,
}

impl Metric {
    /// How good a run is: image metrics, depth, and the paper's Figure A.
    pub const QUALITY: [Self; 8] = [
        Self::Psnr,
        Self::Ssim,
        Self::Lpips,
        Self::Gmsd,
        Self::Sharpness,
        Self::DepthRmse,
        Self::RayEntropy,
        Self::InformationGain,
    ];

    /// What a run costs: time, samples, memory.
    pub const COST: [Self; 4] = [Self::TrainSeconds, Self::RenderSeconds, Self::SamplesSkipped, Self::PeakMemory];

    /// Every metric, in the order of a report.
    pub const ALL: [Self; 12] = [
        Self::Psnr,
        Self::Ssim,
        Self::Lpips,
        Self::Gmsd,
        Self::Sharpness,
        Self::DepthRmse,
        Self::RayEntropy,
        Self::InformationGain,
        Self::TrainSeconds,
        Self::RenderSeconds,
        Self::SamplesSkipped,
        Self::PeakMemory,
    ];

    /// Value of a run; `None` where it was not computed.
    #[must_use]
    pub fn value(self, record: &Record) -> Option<f64> {
        let value = match self {
            Self::Psnr => record.psnr,
            Self::Ssim => record.ssim,
            Self::Lpips => record.lpips,
            Self::Gmsd => record.gmsd,
            Self::Sharpness => record.sharpness,
            Self::DepthRmse => record.depth_rmse,
            Self::RayEntropy => record.ray_entropy_bits,
            Self::InformationGain => record.information_gain,
            Self::TrainSeconds => Some(record.train_seconds),
            Self::RenderSeconds => Some(record.render_seconds_per_image),
            Self::SamplesSkipped => Some(record.samples_total as f64 / record.samples_evaluated as f64),
            Self::PeakMemory => record.peak_rss_bytes.map(|bytes| bytes as f64 / f64::from(1 << 20)),
        };
        value.filter(|value| value.is_finite())
    }

    /// Name with its unit and an arrow towards the better side, such as `PSNR (dB) ↑`.
    #[must_use]
    pub fn heading(self) -> &'static str {
        match self {
            Self::Psnr => "PSNR (dB) ↑",
            Self::Ssim => "SSIM ↑",
            Self::Lpips => "LPIPS ↓",
            Self::Gmsd => "GMSD ↓",
            Self::Sharpness => "Sharpness → 1",
            Self::DepthRmse => "Depth RMSE ↓",
            Self::RayEntropy => "Ray entropy (bits) ↓",
            Self::InformationGain => "Information gain ↓",
            Self::TrainSeconds => "Training (s) ↓",
            Self::RenderSeconds => "Render (s/image) ↓",
            Self::SamplesSkipped => "Samples skipped (×) ↑",
            Self::PeakMemory => "Peak memory (MiB) ↓",
        }
    }

    /// Decimals shown.
    #[must_use]
    pub fn decimals(self) -> usize {
        match self {
            Self::Psnr | Self::Sharpness | Self::RayEntropy | Self::RenderSeconds => 2,
            Self::Ssim | Self::Lpips | Self::Gmsd | Self::DepthRmse | Self::InformationGain => 3,
            Self::TrainSeconds | Self::SamplesSkipped => 1,
            Self::PeakMemory => 0,
        }
    }

    pub(crate) fn better(self) -> Better {
        match self {
            Self::Psnr | Self::Ssim | Self::SamplesSkipped => Better::Higher,
            Self::Sharpness => Better::NearOne,
            _ => Better::Lower,
        }
    }

    /// `value` in units of the last decimal shown, as a distance from the best: smaller is better, equal is a tie.
    pub(crate) fn rank(self, value: f64) -> f64 {
        let shown = (value * 10f64.powi(self.decimals() as i32)).round();
        match self.better() {
            Better::Higher => -shown,
            Better::Lower => shown,
            Better::NearOne => (shown - 10f64.powi(self.decimals() as i32)).abs(),
        }
    }
}
