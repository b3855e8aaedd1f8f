//! Which runs a sweep has: settings × scenes × variants × seeds.

use std::collections::HashMap;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;

use super::options::SweepOptions;
use super::setting::{MOST, Setting, Space};
use crate::plan::Outline;
use crate::{About, Experiment, RunPlan};

/// A sweep, ready to run.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Its experiment.
    pub about: About,
    pub(super) space: Space,
    /// At each rung of successive halving, one of this many settings continues.
    pub halving: Option<u32>,
    /// Whether its runs that are there already are removed when it is prepared, whatever their config.
    pub overwrites: bool,
    /// In the order of the tables: by scene, variant, values, seed.
    pub(super) items: Vec<Item>,
    /// Notices for the user before it runs.
    pub notices: Vec<String>,
}

/// One run of a sweep.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub(super) plan: RunPlan,
    /// The experiment's variant.
    pub(super) variant: String,
    pub(super) setting: Setting,
}

/// Bytes of a variant's name; folders allow 255.
const LONGEST_NAME: usize = 160;

impl Sweep {
    /// The runs of an experiment as they are.
    pub fn of(experiment: Experiment) -> Self {
        let item = |plan: RunPlan| Item { variant: plan.variant.clone(), plan, setting: Setting::default() };
        let items = experiment.runs.into_iter().map(item).collect();
        Self {
            about: experiment.about,
            space: Space::default(),
            halving: None,
            overwrites: false,
            items,
            notices: Vec::new(),
        }
    }

    /// The runs of the experiment called `experiment` for every combination of values.
    ///
    /// # Errors
    /// One line that names the option and what was expected.
    pub fn plan(experiment: &str, options: &SweepOptions) -> Result<Self> {
        let space = Space::parse(options)?;
        let outline = Outline::read(experiment, &options.selection)?;
        let about = outline.about.clone().swept();
        let runs_of = |(order, setting): (usize, Setting)| -> Result<Vec<_>> {
            let assignments = space.assignments(&setting)?;
            let runs = outline.runs(&assignments).with_context(|| format!("with {}", assignments.join(" ")))?;
            let item = |(index, plan): (usize, RunPlan)| {
                let variant = plan.variant.clone();
                let plan =
                    RunPlan { experiment: about.name.clone(), variant: safe_name(&variant, &assignments), ..plan };
                let place = (index / outline.seeds(), order, index % outline.seeds());
                (place, Item { plan, variant, setting: setting.clone() })
            };
            Ok(runs.into_iter().enumerate().map(item).collect())
        };
        // The first setting tells how many runs there are, and most faults, before all are made.
        let settings = space.settings()?;
        let of_one = match settings.first() {
            Some(first) => runs_of((0, first.clone()))?.len(),
            None => 0,
        };
        if of_one.saturating_mul(settings.len()) > MOST {
            bail!("--grid: expected at most {MOST} runs");
        }
        let items: Vec<Result<Vec<_>>> = settings.into_par_iter().enumerate().map(runs_of).collect();
        let mut items: Vec<_> = items.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        items.sort_by_key(|(place, _)| *place);
        let mut items: Vec<Item> = items.into_iter().map(|(_, item)| item).collect();
        let mut notices = leave_out_repetitions(&space, &mut items)?;
        let repeated = options.random as usize - space.draws.len();
        if repeated > 0 {
            notices.push(format!("{repeated} of the random settings repeat earlier ones and are left out"));
        }
        Ok(Self { about, space, halving: options.halving, overwrites: false, items, notices })
    }

    /// Its runs, in the order of the tables.
    pub fn runs(&self) -> impl Iterator<Item = &RunPlan> {
        self.items.iter().map(|item| &item.plan)
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there are no runs.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }
}

/// A variant's name with its values, such as `infonerf_loss.entropy.weight_1e-3`, of letters, digits and `._-`.
///
/// Where a value has other characters or the name would be too long, a checksum keeps names apart.
fn safe_name(variant: &str, assignments: &[String]) -> String {
    let exact: String = assignments.iter().map(|assignment| format!("_{}", assignment.replacen('=', "_", 1))).collect();
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-') { c } else { '-' };
    let mut name: String = exact.chars().map(safe).collect();
    if name != exact || variant.len() + name.len() > LONGEST_NAME {
        name.truncate(LONGEST_NAME.saturating_sub(variant.len() + 9));
        name.push_str(&format!("-{}", &blake3::hash(exact.as_bytes()).to_hex()[..8]));
    }
    format!("{variant}{name}")
}

/// Refuses values that mean the same, and leaves out a variant that the values make into another.
fn leave_out_repetitions(space: &Space, items: &mut Vec<Item>) -> Result<Vec<String>> {
    let Some(first) = items.first().map(|item| item.plan.clone()) else { return Ok(Vec::new()) };
    let first = items.par_iter().filter(|item| item.plan.scene == first.scene && item.plan.seed == first.seed);
    let texts: Vec<Result<(String, String)>> =
        first.map(|item| Ok((item.variant.clone(), serde_json::to_string(&item.plan.config)?))).collect();
    let mut variants: Vec<(String, Vec<String>)> = Vec::new();
    for text in texts {
        let (variant, config) = text?;
        match variants.last_mut().filter(|(last, _)| *last == variant) {
            Some((_, configs)) => configs.push(config),
            None => variants.push((variant, vec![config])),
        }
    }
    let mut notices = Vec::new();
    let mut known: HashMap<Vec<String>, String> = HashMap::new();
    for (variant, configs) in variants {
        refuse_equal(space, items, &variant, &configs)?;
        match known.get(&configs) {
            Some(other) => {
                items.retain(|item| item.variant != variant);
                notices.push(format!("variant {variant} is left out: with these values it is the same as {other}"));
            }
            None => drop(known.insert(configs, variant)),
        }
    }
    Ok(notices)
}

fn refuse_equal(space: &Space, items: &[Item], variant: &str, configs: &[String]) -> Result<()> {
    let mut seen: HashMap<&str, usize> = HashMap::new();
    let settings = space.settings()?;
    let described = |index: usize| settings.get(index).map_or(Ok(Vec::new()), |setting| space.assignments(setting));
    for (index, config) in configs.iter().enumerate() {
        if let Some(other) = seen.insert(config, index) {
            let (a, b) = (described(other)?.join(" "), described(index)?.join(" "));
            bail!("--grid: {a} and {b} give the same run of variant {variant} (one of {} runs)", items.len());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_safe_and_different() {
        let name = |values: &[&str]| safe_name("infonerf", &values.iter().map(|&v| v.to_owned()).collect::<Vec<_>>());
        assert_eq!(
            name(&["loss.entropy.weight=1e-3", "train.rays=64"]),
            "infonerf_loss.entropy.weight_1e-3_train.rays_64"
        );
        let names =
            [name(&["a=[1, 2]"]), name(&["a=[1; 2]"]), name(&["a=[12]"]), name(&[&format!("a={}", "x".repeat(300))])];
        for (index, name) in names.iter().enumerate() {
            assert!(name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c)), "{name}");
            assert!(name.len() <= LONGEST_NAME + 9 && !names[..index].contains(name), "{name}");
        }
    }
}
