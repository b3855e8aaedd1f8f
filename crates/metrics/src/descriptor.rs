/// How a number of a run is called and shown. Metrics have one, and so have numbers that are measured elsewhere, such as
/// the time of training, so that one table can show both:
///
/// ```
/// use infonerf_metrics::{Better, Descriptor, METRICS};
///
/// const TRAINING: Descriptor =
///     Descriptor { key: "train_seconds", name: "Training", unit: "s", decimals: 1, better: Better::Lower };
/// let columns: Vec<Descriptor> = METRICS.iter().map(|metric| metric.descriptor).chain([TRAINING]).collect();
/// assert_eq!(columns[0].heading(), "PSNR (dB) ↑");
/// assert_eq!(TRAINING.heading(), "Training (s) ↓");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Descriptor {
    /// Key in `results.json`, such as `lpips_vgg`.
    pub key: &'static str,
    /// Name in a heading, such as `LPIPS (VGG)`.
    pub name: &'static str,
    /// Unit, such as `dB`; empty where there is none.
    pub unit: &'static str,
    /// Decimals that are shown.
    pub decimals: usize,
    /// Which values are better.
    pub better: Better,
}

/// Which values are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// The higher, the better.
    Higher,
    /// The lower, the better.
    Lower,
    /// The nearer to 1, the better.
    NearOne,
}

impl Descriptor {
    /// Name with its unit and an arrow towards the better side, such as `PSNR (dB) ↑`.
    pub fn heading(&self) -> String {
        let arrow = match self.better {
            Better::Higher => "↑",
            Better::Lower => "↓",
            Better::NearOne => "→ 1",
        };
        match self.unit {
            "" => format!("{} {arrow}", self.name),
            unit => format!("{} ({unit}) {arrow}", self.name),
        }
    }

    /// `value` with the decimals that are shown.
    pub fn format(&self, value: f64) -> String {
        format!("{value:.*}", self.decimals)
    }

    /// `value` in units of the last decimal shown, as a distance from the best: smaller is better, equal is a tie.
    pub fn rank(&self, value: f64) -> f64 {
        let unit = 10f64.powi(self.decimals as i32);
        let shown = (value * unit).round();
        match self.better {
            Better::Higher => -shown,
            Better::Lower => shown,
            Better::NearOne => (shown - unit).abs(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PSNR: Descriptor = Descriptor { key: "psnr", name: "PSNR", unit: "dB", decimals: 2, better: Better::Higher };
    const SHARPNESS: Descriptor =
        Descriptor { key: "sharpness", name: "Sharpness", unit: "", decimals: 2, better: Better::NearOne };

    #[test]
    fn headings_have_unit_and_arrow() {
        assert_eq!(PSNR.heading(), "PSNR (dB) ↑");
        assert_eq!(SHARPNESS.heading(), "Sharpness → 1");
        assert_eq!(PSNR.format(19.996), "20.00");
    }

    #[test]
    fn what_looks_the_same_ranks_the_same() {
        assert_eq!(PSNR.rank(20.001), PSNR.rank(20.004));
        assert!(PSNR.rank(20.01) < PSNR.rank(20.0));
        assert!(SHARPNESS.rank(0.98) < SHARPNESS.rank(1.03));
        assert!(SHARPNESS.rank(1.02) < SHARPNESS.rank(0.95));
    }
}
