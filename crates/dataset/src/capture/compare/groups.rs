//! Groups of photographs whose poses fit each other.

use std::collections::BTreeMap;

use super::{MIN_MATCHES, Matched, Pixels, percent};
use crate::capture::extent::quantile;
use crate::capture::join_names;

/// Min number of matches with one other photograph to judge a photograph alone, more than repeated structures give, and the share
/// of explained matches below which its pose, or the poses of a group, are doubted.
const PHOTOGRAPH_MIN_MATCHES: usize = 40;
const PHOTOGRAPH_EXPLAINED: f64 = 0.3;
/// A photograph with fewer than `FOREIGN` matches is doubted if the median photograph has at least `USUAL` ones.
const FOREIGN: usize = 10;
const USUAL: usize = 100;
/// Photographs are joined to a group if more than this share of their matches is explained.
const JOINED: f64 = 0.6;
/// Min share of all matches that are explained within two groups whose poses do not fit each other, and min ratio of the matches
/// between these groups to those within: far views of symmetrical objects have some false matches.
const GROUPED: f64 = 0.25;
const CONTACT: f64 = 0.02;

/// Doubts about poses that do not fit each other.
pub(super) struct Misfits {
    /// A line for each group whose poses do not fit those of the largest group.
    pub groups: Vec<String>,
    /// A line for each single photograph that does not fit the largest group, or has hardly any matches.
    pub photographs: Vec<String>,
}

impl Matched<'_> {
    /// Joins photographs to groups within which matches are explained, the pair with most explained matches first. Returns the
    /// first member of each photograph's group.
    fn grouped(&self, explained: &[Pixels]) -> Vec<usize> {
        let mut group: Vec<usize> = (0..self.chosen.len()).collect();
        loop {
            let mut weights = BTreeMap::<[usize; 2], f64>::new();
            for (pair, explained) in self.matches.iter().zip(explained) {
                let [a, b] = [group[pair.a], group[pair.b]];
                let weight = explained.len() as f64 - JOINED * pair.pixels.len() as f64;
                *weights.entry([a.min(b), a.max(b)]).or_default() += weight;
            }
            let joined = weights.into_iter().filter(|([a, b], weight)| a != b && *weight > 0.0);
            let Some(([a, b], _)) = joined.max_by(|a, b| a.1.total_cmp(&b.1)) else { return group };
            group.iter_mut().filter(|other| **other == b).for_each(|other| *other = a);
        }
    }

    /// Compares each group of photographs, and each single one that is in none, with the largest group.
    pub(super) fn misfits(&self, explained: &[Pixels]) -> Misfits {
        let group = self.grouped(explained);
        // Numbers of explained matches and of all matches in the pairs for which `is_meant`.
        let sums = |is_meant: &dyn Fn(usize, usize) -> bool| {
            let meant = self.matches.iter().zip(explained).filter(|(pair, _)| is_meant(pair.a, pair.b));
            meant.fold((0, 0), |(sum, all), (pair, explained)| (sum + explained.len(), all + pair.pixels.len()))
        };
        let mut counts: Vec<usize> = (0..group.len()).map(|i| sums(&|a, b| a == i || b == i).1).collect();
        counts.sort_unstable();
        let is_usual = counts.len() == self.frames.len() && quantile(&counts, 0.5) >= USUAL;
        let members = |of: usize| (0..group.len()).filter(|&i| group[i] == of).collect::<Vec<_>>();
        let names = |of: usize| join_names(members(of).into_iter().map(|i| self.name(i)));
        let first = (0..group.len()).rev().max_by_key(|&i| members(i).len()).unwrap_or(0);
        let mut misfits = Misfits { groups: Vec::new(), photographs: Vec::new() };
        for other in (0..group.len()).filter(|&i| group[i] == i && i != first) {
            let both = |a: usize, b: usize| [a, b].iter().all(|&i| [first, other].contains(&group[i]));
            let (fit, between) = sums(&|a, b| both(a, b) && group[a] != group[b]);
            let (right, within) = sums(&|a, b| both(a, b) && group[a] == group[b]);
            let [share, own] = [fit as f64 / between as f64, right as f64 / within as f64];
            let is_single = members(other).len() == 1;
            let of_other = self.matches.iter().filter(|p| both(p.a, p.b) && (p.a == other || p.b == other));
            let most = of_other.map(|pair| pair.pixels.len()).max().unwrap_or(0);
            let is_group = between as f64 >= CONTACT * within as f64 && right as f64 >= GROUPED * self.count as f64;
            let text = format!("{} of {between} matches", percent(share));
            if is_single && is_usual && between < FOREIGN {
                let text = "has hardly any matches with the other photographs: does it belong to this scene?";
                misfits.photographs.push(format!("{} {text}", names(other)));
            } else if is_single && share < PHOTOGRAPH_EXPLAINED && most >= PHOTOGRAPH_MIN_MATCHES {
                let text = format!("explains {text} with other photographs: is its pose right?");
                misfits.photographs.push(format!("the camera of {} {text}", names(other)));
            } else if !is_single && is_group && share < PHOTOGRAPH_EXPLAINED && between >= MIN_MATCHES {
                let text = format!("they explain {text} between the two groups, {} of those within", percent(own));
                let [first, other] = [first, other].map(names);
                misfits.groups.push(format!("the poses of {first} and of {other} do not fit each other: {text}"));
            }
        }
        misfits
    }
}
