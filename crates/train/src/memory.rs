//! An estimate of the memory that a run needs, from its sizes alone: a run that cannot fit is refused before anything is loaded.

use infonerf_field::{FieldSpec, Footprint};
use infonerf_loss::Need;
use infonerf_scene::PixelCount;
use infonerf_schedule::{Fault, Moment};
use sysinfo::{CGroupLimits, MemoryRefreshKind, ProcessRefreshKind, ProcessesToUpdate, System, get_current_pid};

use crate::config::Config;
use crate::model::sees_images;

const FLOAT: u64 = 4;
/// Number of floats that a field keeps per parameter: itself and Adam's two moments.
const KEPT: u64 = 3;
/// Number of floats that a step adds per parameter: its gradient, and the copy that the optimizer changes.
const FLOATS_PER_STEP: u64 = 2;
/// Name of the part that is the scene's images.
const IMAGES: &str = "scene.size (the images)";

/// Memory, in bytes, of the parts of a run that are held at the same time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryPlan {
    parts: [(&'static str, u64); 6],
}

impl MemoryPlan {
    /// Returns the plan of `config` on scenes with `pixels` in all: `fields` fields share the images, and
    /// `side_by_side` of them are trained at the same time.
    pub fn new(config: &Config, pixels: PixelCount, fields: usize, side_by_side: usize) -> Self {
        let (fields, side_by_side) = (fields as u64, side_by_side.min(fields) as u64);
        let Footprint { parameters, per_sample } = config.field.footprint();
        let coarse = config.field.coarse().filter(|_| config.render.is_hierarchical());
        let parameters = parameters + coarse.map_or(0, |coarse| coarse.footprint().parameters);
        let averaged = u64::from(fields == 1 && config.train.weight_averaging > 0.0);
        let copies = fields * (KEPT + averaged) + side_by_side * FLOATS_PER_STEP;
        let loaded = pixels.train.saturating_add(pixels.test);
        // RGB at every size but the full one, and for fields that look at images.
        let smaller: f64 = config.train.downscale_factors().skip(1).map(|factor| f64::from(factor).powi(-2)).sum();
        let shown_to_fields = if sees_images(&config.field) { 1.0 } else { 0.0 };
        let copied = (pixels.train.saturating_mul(3 * FLOAT) as f64 * (smaller + shown_to_fields)) as u64;
        let occupancy = &config.render.occupancy;
        let cells = if occupancy.enabled { (occupancy.resolution as u64 * occupancy.refine as u64).pow(3) } else { 0 };
        let residuals = if config.render.residuals { fields.saturating_mul(pixels.train) } else { 0 };
        let activations = samples(config).saturating_mul(side_by_side * per_sample * FLOAT);
        let parts = [
            ("field (its parameters, their gradients and Adam's moments)", copies * parameters * FLOAT),
            ("train.rays and render.samples (the activations of a step)", activations),
            // RGB and alpha.
            (IMAGES, loaded.saturating_mul(4 * FLOAT)),
            ("scene.size (the images at smaller sizes, and as fields look at them)", copied),
            // Density, a flag and the state of a cell.
            ("render.occupancy.resolution (the grid)", fields * cells * (FLOAT + 1 + 2)),
            // RGB and distance.
            ("render.residuals (of the training images)", residuals.saturating_mul(4 * FLOAT)),
        ];
        Self { parts }
    }

    /// Returns the plan without the images, which are in memory already.
    #[must_use]
    pub fn with_images_loaded(mut self) -> Self {
        self.parts.iter_mut().filter(|(part, _)| *part == IMAGES).for_each(|(_, bytes)| *bytes = 0);
        self
    }

    /// Returns the bytes in all.
    pub fn total(&self) -> u64 {
        self.parts.iter().fold(0, |sum, (_, bytes)| sum.saturating_add(*bytes))
    }

    /// Refuses a plan that needs more memory than is available without swapping, if the system reports that.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn check_available(&self) -> Result<(), Fault> {
        available_memory().map_or(Ok(()), |available| self.check(available))
    }

    /// Refuses a plan that needs more than the `available` bytes.
    ///
    /// # Errors
    /// One line that names the largest part, what it needs and what there is.
    pub fn check(&self, available: u64) -> Result<(), Fault> {
        let total = self.total();
        if total <= available {
            return Ok(());
        }
        let (largest, bytes) = self.parts.iter().max_by_key(|(_, bytes)| *bytes).copied().unwrap_or(("the run", total));
        let expected = format!("sizes of a run that fits into the {} of memory that are available", gib(available));
        Err(Fault::new(largest, expected, format!("{} of {} in all", gib(bytes), gib(total))))
    }
}

/// Returns the memory that is available without swapping, in bytes: of the machine, or of the control group of this
/// process (a container, a Slurm job) if that is less. `None` if the system does not report it.
pub fn available_memory() -> Option<u64> {
    let mut system = System::new();
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    let process = get_current_pid().ok().and_then(|id| {
        system.refresh_processes_specifics(ProcessesToUpdate::Some(&[id]), false, ProcessRefreshKind::nothing());
        system.process(id)
    });
    // A container may not see the path of its group, which is then at the root.
    let group = process.and_then(|process| process.cgroup_limits()).or_else(|| system.cgroup_limits());
    min_available(system.available_memory(), group)
}

/// Returns the minimum of what is free on the machine, 0 if unknown, and what its control group may still take.
fn min_available(machine: u64, group: Option<CGroupLimits>) -> Option<u64> {
    let machine = Some(machine).filter(|&bytes| bytes > 0);
    let group = group.map(|group| group.total_memory.saturating_sub(group.rss));
    machine.into_iter().chain(group).min()
}

fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1u64 << 30) as f64)
}

/// Returns the max number of samples at which a step evaluates fields, along all rays that the terms need. If it is set,
/// `train.target_samples` gives this number, scaled from seen rays to all rays, but no fewer than in the first step, when
/// no space is known to be empty. A coarse pass keeps activations along seen rays alone, as others have no gradient.
fn samples(config: &Config) -> u64 {
    let (train, render) = (&config.train, &config.render);
    let needs = config.loss.needs();
    let rays_of = |need: Need| match need {
        Need::Unseen | Need::UnseenNeighbours => train.unseen_rays as u64,
        Need::SeenNeighbours => train.rays as u64,
        Need::Picture { size } => u64::from(size).pow(2),
        Need::SeenColor | Need::Penalty(_) => 0,
    };
    let (seen, others) = (train.rays as u64, needs.into_iter().map(rays_of).sum::<u64>());
    let of_rays = |along: f64| {
        let coarse = if render.is_hierarchical() { seen.saturating_mul(along as u64) } else { 0 };
        let fine = (seen + others).saturating_mul(along as u64 + render.fine_samples as u64);
        coarse.saturating_add(fine)
    };
    match train.target_samples as u64 {
        0 => of_rays(render.samples.largest()),
        target => (target + target * others / seen.max(1)).max(of_rays(render.samples.at(Moment::START))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    const PIXELS: PixelCount = PixelCount { views: 4, train: 4 * 64, test: 64 };

    fn plan(settings: &[&str], side_by_side: usize) -> MemoryPlan {
        MemoryPlan::new(&Config::of(Preset::Fast, settings).unwrap(), PIXELS, side_by_side, side_by_side)
    }

    #[test]
    fn plan_agrees_with_sizes_by_hand() {
        let settings = ["field.resolutions=[64]", "field.channels=2", "train.downscale=2", "train.weight_averaging=0"];
        let small = ["train.rays=10", "train.target_samples=5000", "render.samples={from=100,to=200}"];
        let with = |more: &[&'static str]| [&settings[..], &small, more].concat();
        let tables = 3 * 2 * (64 * 64 + 64) * 5 * 4;
        // The grid of pictures is twice as fine as that of training.
        let field = tables + 5000 * 12 * 4 + 128 * 128 * 128 * 7;
        // Four training views and a test view as loaded, and RGB of the training views at half their size.
        let images = 64 * (5 * 4 + 3) * 4;
        let one = plan(&with(&[]), 1);
        assert_eq!(one.total(), field + images);
        assert!(one.check(one.total()).is_ok());
        assert_eq!(one.clone().with_images_loaded().total(), one.total() - 64 * 5 * 4 * 4);
        // Fields share the images.
        assert_eq!(plan(&with(&[]), 2).total(), 2 * field + images);
        // Weights of a single field are averaged, which keeps one more copy; residuals are those of each field.
        assert_eq!(plan(&with(&["train.weight_averaging=0.3"]), 1).total(), one.total() + tables / 5);
        assert_eq!(plan(&with(&["train.weight_averaging=0.3"]), 2).total(), 2 * field + images);
        assert_eq!(plan(&with(&["render.residuals=true"]), 2).total(), 2 * field + images + 2 * (4 * 64) * 4 * 4);
        // The first step skips nothing.
        assert_eq!(plan(&with(&["train.rays=100"]), 1).total(), one.total() + 5000 * 12 * 4);
    }

    /// Checks that the activations of every kind of ray count, and those of the coarse pass along seen rays.
    #[test]
    fn rays_of_all_kinds_count() {
        let samples = |settings: &[&str]| {
            let sizes = ["train.rays=10", "train.unseen_rays=5", "render.samples=64", "render.fine_samples=128"];
            let off = ["loss.entropy.weight=0", "loss.kl.weight=0"];
            samples(&Config::of(Preset::Paper, [&sizes[..], &off, settings].concat()).unwrap())
        };
        let (coarse, fine) = (64, 64 + 128);
        assert_eq!(samples(&[]), 10 * (coarse + fine));
        // Each pass has a network of its own.
        let field =
            |setting: &str| MemoryPlan::new(&Config::of(Preset::Paper, [setting]).unwrap(), PIXELS, 1, 1).parts[0].1;
        assert_eq!(field("render.fine_samples=128"), 2 * field("render.fine_samples=0"));
        let entropy = ["loss.entropy.weight=1e-3", "loss.entropy.rays=all"];
        assert_eq!(samples(&entropy), 10 * (coarse + fine) + 5 * fine);
        let both = [&entropy[..], &["loss.kl.weight=1e-3", "loss.kl.rays=all"]].concat();
        assert_eq!(samples(&both), 10 * (coarse + fine) + (5 + 10 + 5) * fine);
        let fast = ["render.fine_samples=0", "train.target_samples=5000", "render.samples=100"];
        assert_eq!(samples(&[&fast[..], &entropy].concat()), 5000 + 2500);
    }

    #[test]
    fn control_group_limits_the_machine() {
        let group = |total_memory, rss| Some(CGroupLimits { total_memory, rss, ..CGroupLimits::default() });
        let cases = [(0, None), (9, None), (0, group(4, 1)), (9, group(4, 1)), (2, group(4, 1)), (9, group(4, 5))];
        let found = cases.map(|(machine, group)| min_available(machine, group));
        assert_eq!(found, [None, Some(9), Some(3), Some(3), Some(2), Some(0)]);
        assert!(cfg!(not(target_os = "linux")) || available_memory().is_some_and(|bytes| bytes > 0));
    }

    #[test]
    fn refusal_names_the_largest_part() {
        let giant = plan(&["field.resolutions=[2048,2048,2048,2048,2048,2048,2048,2048]", "field.channels=16"], 1);
        let nerf = "field={kind='nerf',layers=8,width=4096,skip=4,position_frequencies=10,direction_frequencies=4,\
                    density='relu',detail=1.0}";
        let wide = plan(&["train.target_samples=100000000", nerf], 1);
        for (plan, start) in [(giant, "field (its parameters"), (wide, "train.rays and render.samples")] {
            let message = plan.check(16 << 30).unwrap_err().to_string();
            assert!(message.starts_with(start) && message.contains("16.0 GiB"), "{message}");
        }
    }
}
