//! Sweeps: the runs of an experiment, as they are or for every combination of the values of some keys.
//!
//! ```text
//! grids ─► plan (items) ─► execute (in this process, in processes, as Slurm's jobs) ─► records ─► table, figures, report
//! ```

pub(crate) mod figures;
mod grid;
pub(crate) mod manifest;
mod outcome;
mod prepare;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rayon::prelude::*;

use crate::plan::{About, Experiment, Outline, Selection};
use crate::run::Existing;
use crate::run_plan::RunPlan;
pub use grid::PAPER_SPACE;
use grid::{Grid, assignments, choices};
pub use manifest::run_item;
pub use outcome::{SweepFiles, collect, results};
pub use prepare::Prepared;

/// Runs that are tabulated together: those of an experiment, as they are or for every combination of the values of some keys.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Name, title and data of the experiment.
    pub about: About,
    /// Policy for runs that exist already.
    pub existing: Existing,
    grids: Vec<Grid>,
    /// Runs in the order of the tables: by scene, variant, values, seed.
    items: Vec<Item>,
}

#[derive(Clone, Debug)]
struct Item {
    plan: RunPlan,
    /// Name of the experiment's variant, without the values.
    variant: String,
    /// Index of the chosen value of each grid.
    choice: Vec<usize>,
}

/// Maximum length of a variant's name in bytes; folders allow 255.
const MAX_NAME: usize = 160;

impl From<Experiment> for Sweep {
    fn from(experiment: Experiment) -> Self {
        let item = |plan: RunPlan| Item { variant: plan.variant.clone(), plan, choice: Vec::new() };
        let items = experiment.runs.into_iter().map(item).collect();
        Self { about: experiment.about, existing: Existing::Continue, grids: Vec::new(), items }
    }
}

impl Sweep {
    /// Returns the runs of `experiment` for every combination of the values of `grids`, each `dotted.key=value,value,...`.
    ///
    /// # Errors
    /// One line that names the option and what was expected.
    pub fn plan(experiment: &str, grids: &[String], selection: &Selection) -> Result<Self> {
        let grids = Grid::parse_all(grids, &selection.set)?;
        let outline = Outline::read(experiment, selection)?;
        let (about, seeds) = (outline.about.clone().swept(), outline.selection.seeds.len());
        let runs_of = |(order, choice): (usize, Vec<usize>)| -> Result<Vec<_>> {
            let set = assignments(&grids, &choice);
            let runs = outline.runs(&set).with_context(|| format!("with {}", set.join(" ")))?;
            let item = |(index, plan): (usize, RunPlan)| {
                let variant = plan.variant.clone();
                let plan = RunPlan { experiment: about.name.clone(), variant: safe_name(&variant, &set), ..plan };
                // Consecutive runs differ in their seed alone.
                let place = (index / seeds, order, index % seeds);
                (place, Item { plan, variant, choice: choice.clone() })
            };
            Ok(runs.into_iter().enumerate().map(item).collect())
        };
        let items: Vec<Result<Vec<_>>> = choices(&grids)?.into_par_iter().enumerate().map(runs_of).collect();
        let mut items: Vec<_> = items.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        items.sort_by_key(|(place, _)| *place);
        let items = items.into_iter().map(|(_, item)| item).collect();
        Ok(Self { about, existing: Existing::Continue, grids, items })
    }

    /// Iterates over the runs, in the order of the tables.
    pub fn runs(&self) -> impl ExactSizeIterator<Item = &RunPlan> {
        self.items.iter().map(|item| &item.plan)
    }

    /// Returns the run of that index.
    pub fn run(&self, index: usize) -> &RunPlan {
        &self.items[index].plan
    }

    /// Returns the label of a run with its number, such as `[2/8] castle/nerf/seed0`.
    pub fn label(&self, index: usize) -> String {
        format!("[{}/{}] {}", index + 1, self.items.len(), self.run(index).label())
    }

    /// Returns the folder of the sweep's results below `out`.
    pub fn folder(&self, out: &Path) -> PathBuf {
        out.join(&self.about.name)
    }
}

/// Returns a variant's name with its values, such as `infonerf_loss.entropy.weight_1e-3`, of letters, digits and `._-`. If a value
/// has other characters or the name would be too long, a checksum keeps names apart.
fn safe_name(variant: &str, assignments: &[String]) -> String {
    let exact: String = assignments.iter().map(|assignment| format!("_{}", assignment.replacen('=', "_", 1))).collect();
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-') { c } else { '-' };
    let mut name: String = exact.chars().map(safe).collect();
    if name != exact || variant.len() + name.len() > MAX_NAME {
        name.truncate(MAX_NAME.saturating_sub(variant.len() + 9));
        name.push_str(&format!("-{}", &blake3::hash(exact.as_bytes()).to_hex()[..8]));
    }
    format!("{variant}{name}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_safe_and_different() {
        let name = |values: &[&str]| safe_name("infonerf", &values.iter().map(|&v| v.to_owned()).collect::<Vec<_>>());
        let expected = "infonerf_loss.entropy.weight_1e-3_train.rays_64";
        assert_eq!(name(&["loss.entropy.weight=1e-3", "train.rays=64"]), expected);
        let long = format!("a={}", "x".repeat(300));
        let names = ["a=[1, 2]", "a=[1; 2]", "a=[12]", &long].map(|value| name(&[value]));
        for (index, name) in names.iter().enumerate() {
            assert!(name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c)), "{name}");
            assert!(name.len() <= MAX_NAME + 9 && !names[..index].contains(name), "{name}");
        }
    }
}
