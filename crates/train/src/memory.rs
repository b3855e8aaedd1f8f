//! How much memory a run needs, from its sizes alone: one that cannot fit is refused before it begins.

use infonerf_field::{FieldSpec, Footprint};
use infonerf_scene::PixelCount;

use crate::{Config, TrainError};

/// Bytes of an `f32`.
const FLOAT: u64 = 4;
/// A parameter, its gradient, Adam's two moments, and the copy that an optimiser step is made on.
const COPIES: u64 = 5;
/// Floats of a pixel of a test view: RGB and alpha.
const TEST_PIXEL: u64 = 4;
/// Floats of a pixel of a training view: the same, RGBA as batches are drawn from, and RGB as a field sees it that looks at
/// photographs.
const TRAIN_PIXEL: u64 = TEST_PIXEL + 4 + 3;

/// Least memory of a run's parts, in bytes: what is certain to be held at the same time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryPlan {
    parts: [(&'static str, u64); 4],
}

impl MemoryPlan {
    /// The plan of `config` on a scene with so many pixels, so many fields being trained side by side.
    pub fn new(config: &Config, pixels: PixelCount, side_by_side: usize) -> Self {
        let side_by_side = side_by_side as u64;
        let networks = if config.render.is_hierarchical() && !config.field.shares_passes() { 2 } else { 1 };
        let Footprint { parameters, per_sample } = config.field.footprint();
        let images = pixels.train.saturating_mul(TRAIN_PIXEL).saturating_add(pixels.test.saturating_mul(TEST_PIXEL));
        let occupancy = if config.render.occupancy.enabled { cube(config.render.occupancy.resolution) * 6 } else { 0 };
        Self {
            parts: [
                (
                    "field (its parameters, their gradients and Adam's moments)",
                    side_by_side * networks * parameters * COPIES * FLOAT,
                ),
                (
                    "train.rays and render.samples (the activations of a step)",
                    side_by_side * samples(config) * per_sample * FLOAT,
                ),
                ("scene.size (the images)", images.saturating_mul(FLOAT)),
                ("render.occupancy.resolution (the grid)", side_by_side * occupancy),
            ],
        }
    }

    /// Bytes in all.
    pub fn total(&self) -> u64 {
        self.parts.iter().fold(0, |sum, (_, bytes)| sum.saturating_add(*bytes))
    }

    /// Refuses a plan that needs more memory than can be had without swapping, where the system tells.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn check_available(&self) -> Result<(), TrainError> {
        available().map_or(Ok(()), |available| self.check(available))
    }

    /// Refuses a plan that needs more than the `available` bytes.
    ///
    /// # Errors
    /// One line that names the largest part, what it needs and what there is.
    pub fn check(&self, available: u64) -> Result<(), TrainError> {
        let total = self.total();
        if total <= available {
            return Ok(());
        }
        let (largest, bytes) = self.parts.iter().max_by_key(|(_, bytes)| *bytes).copied().unwrap_or(("the run", total));
        let cause = format!(
            "expected sizes that fit into the {} of memory that are available: this run needs at least {}, of which this {}",
            gib(available),
            gib(total),
            gib(bytes)
        );
        Err(TrainError::config(largest, cause))
    }
}

/// Memory that can be had without swapping, in bytes, where the system tells.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

fn cube(side: usize) -> u64 {
    (side as u64).saturating_pow(3)
}

fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1u64 << 30) as f64)
}

/// Samples that a step asks a field for, at most as many as it aims for where it aims for a number.
fn samples(config: &Config) -> u64 {
    let train = &config.train;
    let along = config.render.samples.largest() as u64 + config.render.fine_samples as u64;
    if train.target_samples > 0 { train.target_samples as u64 } else { train.rays as u64 * along }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Preset, config};

    fn plan(settings: &[&str]) -> MemoryPlan {
        plan_of(settings, 1)
    }

    fn plan_of(settings: &[&str], side_by_side: usize) -> MemoryPlan {
        let pixels = PixelCount { train: 4 * 64, test: 64 };
        let mut table = Preset::Fast.table();
        settings.iter().for_each(|setting| config::assign(&mut table, setting).unwrap());
        MemoryPlan::new(&Config::from_table(table).unwrap(), pixels, side_by_side)
    }

    #[test]
    fn sizes_by_hand() {
        let settings = ["field.resolutions=[64]", "field.channels=2", "train.target_samples=1000"];
        let tables = 3 * 2 * (64 * 64 + 64) * 5 * 4;
        let field = tables + 1000 * 12 * 4 + 64 * 64 * 64 * 6;
        let images = 64 * (4 * 11 + 4) * 4;
        let plan = plan(&settings);
        assert_eq!(plan.total(), field + images);
        assert!(plan.check(plan.total()).is_ok());
        assert_eq!(plan_of(&settings, 2).total(), 2 * field + images);
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let giant = plan(&["field.resolutions=[2048,2048,2048,2048,2048,2048,2048,2048]", "field.channels=16"]);
        let message = giant.check(16 << 30).unwrap_err().to_string();
        assert!(message.starts_with("field (its parameters") && message.contains("16.0 GiB"), "{message}");
        let wide = plan(&[
            "train.target_samples=100000000",
            "field={kind=\"nerf\",layers=8,width=4096,skip=4,position_frequencies=10,direction_frequencies=4,density=\"relu\",detail=1.0}",
        ]);
        let message = wide.check(16 << 30).unwrap_err().to_string();
        assert!(message.starts_with("train.rays and render.samples"), "{message}");
    }
}
