//! What a sweep sets: every combination of grid values, with each random draw.

use anyhow::{Context, Result, bail};

use super::grid::Grid;
use super::keys::refuse_overlaps;
use super::options::SweepOptions;
use super::random::{Range, draws};

/// More settings than this are taken for a mistake.
pub(super) const MOST: usize = 100_000;

/// The keys that a sweep sets.
#[derive(Clone, Debug, Default)]
pub(super) struct Space {
    pub(super) grids: Vec<Grid>,
    pub(super) ranges: Vec<Range>,
    /// Values of the ranges, one draw after another.
    pub(super) draws: Vec<Vec<String>>,
}

/// One choice of values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Setting {
    /// For each grid, which of its values.
    pub(super) choice: Vec<usize>,
    /// Which of the draws.
    pub(super) draw: Option<usize>,
}

impl Space {
    pub(super) fn parse(options: &SweepOptions) -> Result<Self> {
        let grids = options.grids.iter().map(|text| Grid::parse(text)).collect::<Result<Vec<_>>>()?;
        let ranges = options.ranges.iter().map(|text| Range::parse(text)).collect::<Result<Vec<_>>>()?;
        let keys = grids.iter().map(|grid| &grid.key).chain(ranges.iter().map(|range| &range.key));
        refuse_overlaps(keys, &options.selection.set)?;
        let draws = draws(&ranges, options.random, options.random_seed);
        Ok(Self { grids, ranges, draws })
    }

    /// Every setting, draw by draw, the last grid's values changing fastest.
    pub(super) fn settings(&self) -> Result<Vec<Setting>> {
        let rounds = self.draws.len().max(1);
        let count = self.grids.iter().try_fold(rounds, |count, grid| count.checked_mul(grid.values.len()));
        if count.is_none_or(|count| count > MOST) {
            bail!("--grid: expected at most {MOST} settings");
        }
        let mut choices = vec![Vec::new()];
        for grid in &self.grids {
            let longer = |choice: Vec<usize>| (0..grid.values.len()).map(move |i| [&choice[..], &[i]].concat());
            choices = choices.into_iter().flat_map(longer).collect();
        }
        let draws = (0..rounds).map(|draw| (draw < self.draws.len()).then_some(draw));
        let with = |draw| choices.iter().map(move |choice| Setting { choice: choice.clone(), draw });
        Ok(draws.flat_map(with).collect())
    }

    /// `key=value` of each key.
    pub(super) fn assignments(&self, setting: &Setting) -> Result<Vec<String>> {
        let drawn = match setting.draw {
            Some(draw) => self.draws.get(draw).context("no such draw")?.as_slice(),
            None => &[],
        };
        let grids = self.grids.iter().zip(&setting.choice).map(|(grid, &index)| grid.assignment(index));
        let ranges = self.ranges.iter().zip(drawn).map(|(range, value)| format!("{}={value}", range.key));
        Ok(ranges.chain(grids).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn combinations() {
        let grids = ["a=1,2", "b=3,4,5"].map(|text| Grid::parse(text).unwrap()).to_vec();
        let mut space = Space { grids, ..Space::default() };
        let all = space.settings().unwrap();
        assert_eq!((all.len(), &all[1].choice[..], &all[3].choice[..]), (6, &[0, 1][..], &[1, 0][..]));
        assert_eq!(space.assignments(&all[3]).unwrap(), ["a=2", "b=3"]);
        space.ranges = vec![Range::parse("c=0:1").unwrap()];
        space.draws = vec![vec!["0.1".into()], vec!["0.2".into()]];
        let all = space.settings().unwrap();
        assert_eq!((all.len(), all[0].draw, all[11].draw), (12, Some(0), Some(1)));
        assert_eq!(space.assignments(&all[6]).unwrap(), ["c=0.2", "a=1", "b=3"]);
        assert_eq!(Space::default().settings().unwrap(), [Setting::default()]);
    }
}
