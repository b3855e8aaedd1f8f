/// Name and format of a quantity of a run. Metrics have one, and so have quantities that are measured elsewhere, such
/// as the time of training, so that one table can show both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Descriptor {
    /// Key in `results.json`, such as `lpips_vgg`.
    pub key: &'static str,
    /// Name in a heading, such as `LPIPS (VGG)`.
    pub name: &'static str,
    /// Unit, such as `dB`; empty if none.
    pub unit: &'static str,
    /// Number of decimals in tables.
    pub decimals: usize,
    /// Direction of better values.
    pub better: Better,
}

/// Direction of better values of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Better {
    /// Higher is better.
    Higher,
    /// Lower is better.
    Lower,
    /// Nearer to 1 is better.
    NearOne,
}

impl Descriptor {
    /// Returns the name with its unit and an arrow towards better values, such as `PSNR (dB) ↑`.
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

    /// Formats `value` with the decimals of tables.
    pub fn format(&self, value: f64) -> String {
        format!("{value:.*}", self.decimals)
    }

    /// Ranks `value` as shown, in units of the last decimal: smaller is better, equal is a tie.
    pub fn rank(&self, value: f64) -> f64 {
        let unit = 10f64.powi(self.decimals as i32);
        let shown = (self.format(value).parse::<f64>().expect("a formatted number") * unit).round();
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
    use crate::metric::select;

    #[test]
    fn values_are_formatted_and_ranked_as_shown() {
        let [psnr, sharpness] = ["psnr", "sharpness"].map(|key| select([key]).unwrap()[0].descriptor);
        let training = Descriptor { key: "", name: "Training", unit: "s", decimals: 1, better: Better::Lower };
        let headings = [psnr, training, sharpness].map(|descriptor| descriptor.heading());
        assert_eq!(headings, ["PSNR (dB) ↑", "Training (s) ↓", "Sharpness → 1"]);
        assert_eq!(psnr.format(19.996), "20.00");
        assert_eq!(psnr.rank(20.001), psnr.rank(20.004));
        assert!(psnr.rank(20.01) < psnr.rank(20.0));
        assert!(sharpness.rank(0.98) < sharpness.rank(1.03));
        assert!(sharpness.rank(1.02) < sharpness.rank(0.95));
        assert_eq!([29.96, 30.0].map(|seconds| training.rank(seconds)), [300.0; 2]);
        // Shown as 0.3, although ten times the number is rounded to 3.5.
        assert_eq!(training.rank(0.35), training.rank(0.3));
    }
}
