//! Matches of similar features between photographs, and tracks of features that show one point.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use gemm::{Parallelism, gemm};
use glam::DVec2;
use rayon::prelude::*;

use crate::sift::{Features, LENGTH};

/// Min number of matches of a pair of photographs.
pub(crate) const MIN_MATCHES: usize = 20;
/// Max ratio of a match's distance to the second best one's.
const RATIO: f32 = 0.8;
/// Number of photographs up to which all pairs are matched.
const ALL_PAIRS: usize = 24;
/// Number of similar photographs with which each one of more is matched, and of photographs that follow it in order.
const NEIGHBOURS: usize = 12;
const FOLLOWING: usize = 2;
/// Number of features per photograph by which likely pairs are found.
const STRONGEST: usize = 600;
/// Number of rows of similarities that are held at the same time.
const BLOCK: usize = 512;

#[derive(Clone)]
pub(crate) struct Matches {
    pub(crate) a: usize,
    pub(crate) b: usize,
    /// Indices of features in `a` and in `b`.
    pub(crate) pairs: Vec<(usize, usize)>,
}

/// Returns the matches of each likely pair of photographs with at least [`MIN_MATCHES`] of them.
pub(crate) fn matches_of_pairs(features: &[Features]) -> Vec<Matches> {
    let pairs = likely_pairs(features).into_par_iter();
    let matched = pairs.map(|(a, b)| Matches { a, b, pairs: matches(&features[a], &features[b]) });
    matched.filter(|matches| matches.pairs.len() >= MIN_MATCHES).collect()
}

/// Returns the max number of pairs that are matched among `count` photographs.
pub fn max_matched_pairs(count: usize) -> usize {
    let all = count * count.saturating_sub(1) / 2;
    if count <= ALL_PAIRS { all } else { all.min(count * (NEIGHBOURS + FOLLOWING)) }
}

/// Returns the pairs of photographs that are matched: all pairs of few photographs. Otherwise each is matched with the
/// [`NEIGHBOURS`] whose strongest features match most, and with the next [`FOLLOWING`] in order.
fn likely_pairs(features: &[Features]) -> Vec<(usize, usize)> {
    let count = features.len();
    let all: Vec<(usize, usize)> = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    if count <= ALL_PAIRS {
        return all;
    }
    let strongest = |all: &Features| {
        let count = all.pixels.len().min(STRONGEST);
        Features { pixels: all.pixels[..count].to_vec(), descriptors: all.descriptors[..LENGTH * count].to_vec() }
    };
    let strongest: Vec<Features> = features.iter().map(strongest).collect();
    let alike: Vec<usize> = all.par_iter().map(|&(a, b)| matches(&strongest[a], &strongest[b]).len()).collect();
    let mut likely: BTreeSet<(usize, usize)> = all.iter().copied().filter(|(a, b)| b - a <= FOLLOWING).collect();
    for photograph in 0..count {
        let mut own: Vec<_> = all.iter().zip(&alike).filter(|((a, b), _)| [*a, *b].contains(&photograph)).collect();
        own.sort_by_key(|(_, alike)| Reverse(**alike));
        likely.extend(own.into_iter().take(NEIGHBOURS).map(|(pair, _)| *pair));
    }
    likely.into_iter().collect()
}

/// Returns the indices `(a, b)` of features that are each other's nearest, and pass the ratio test in both directions.
pub(crate) fn matches(a: &Features, b: &Features) -> Vec<(usize, usize)> {
    let (rows, columns) = (a.pixels.len(), b.pixels.len());
    let (mut to_b, mut to_a) = (vec![Best::NONE; rows], vec![Best::NONE; columns]);
    let mut similarity = vec![0f32; BLOCK.min(rows) * columns];
    for (block, descriptors) in a.descriptors.chunks(BLOCK * LENGTH).enumerate() {
        products(descriptors, &b.descriptors, &mut similarity);
        for (i, row) in similarity.chunks_exact(columns.max(1)).take(descriptors.len() / LENGTH).enumerate() {
            let i = block * BLOCK + i;
            for (j, &s) in row.iter().enumerate() {
                to_b[i].offer(s, j);
                to_a[j].offer(s, i);
            }
        }
    }
    let mutual = |(i, best): (usize, &Best)| {
        let j = best.chosen()?;
        (to_a[j].chosen()? == i).then_some((i, j))
    };
    to_b.iter().enumerate().filter_map(mutual).collect()
}

/// Computes `out = a · bᵀ`, row-major.
#[allow(unsafe_code, reason = "gemm takes pointers; lengths and strides are those of the slices")]
fn products(a: &[f32], b: &[f32], out: &mut [f32]) {
    let (m, n, k) = (a.len() / LENGTH, b.len() / LENGTH, LENGTH);
    assert!(out.len() >= m * n);
    let (out, a, b) = (out.as_mut_ptr(), a.as_ptr(), b.as_ptr());
    // Strides from column to column, and from row to row.
    let (one, row, of_out, serial) = (1, LENGTH as isize, n as isize, Parallelism::None);
    // SAFETY: `a` has m · k, `b` n · k and `out` at least m · n elements, which the strides stay within.
    unsafe {
        gemm(m, n, k, out, one, of_out, false, a, one, row, b, row, one, 0.0, 1.0, false, false, false, serial);
    }
}

/// Two largest similarities so far, and the index of the feature with the largest.
#[derive(Clone, Copy)]
struct Best {
    first: f32,
    second: f32,
    index: usize,
}

impl Best {
    const NONE: Self = Self { first: -1.0, second: -1.0, index: 0 };

    fn offer(&mut self, similarity: f32, index: usize) {
        if similarity > self.first {
            (self.second, self.first, self.index) = (self.first, similarity, index);
        } else if similarity > self.second {
            self.second = similarity;
        }
    }

    /// Returns the best feature if its distance is below [`RATIO`] times the second's; unit vectors have d² = 2 - 2 s.
    fn chosen(&self) -> Option<usize> {
        (1.0 - self.first < RATIO * RATIO * (1.0 - self.second)).then_some(self.index)
    }
}

/// Photographs and the pixels in which they see one point, each photograph once.
pub(crate) type Track = Vec<(usize, DVec2)>;

/// Returns the connected components of `matches` as tracks, without photographs that see the track at two pixels.
pub(crate) fn tracks<'m>(features: &[Features], matches: impl IntoIterator<Item = &'m Matches>) -> Vec<Track> {
    let mut first = vec![0];
    for (i, all) in features.iter().enumerate() {
        first.push(first[i] + all.pixels.len());
    }
    let mut parent: Vec<usize> = (0..first[features.len()]).collect();
    let mut join = |a: usize, b: usize| {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b)] = a.min(b);
    };
    for (i, all) in features.iter().enumerate() {
        // Features at one pixel differ only in orientation.
        let same = (1..all.pixels.len()).filter(|&k| all.pixels[k] == all.pixels[k - 1]);
        same.for_each(|k| join(first[i] + k, first[i] + k - 1));
    }
    for Matches { a, b, pairs } in matches {
        pairs.iter().for_each(|(i, j)| join(first[*a] + i, first[*b] + j));
    }
    let mut tracks = vec![Track::new(); parent.len()];
    for (i, all) in features.iter().enumerate() {
        for (k, pixel) in all.pixels.iter().enumerate() {
            let track = &mut tracks[root(&mut parent, first[i] + k)];
            if !track.contains(&(i, *pixel)) {
                track.push((i, *pixel));
            }
        }
    }
    for track in &mut tracks {
        let photographs: Vec<usize> = track.iter().map(|(i, _)| *i).collect();
        track.retain(|(i, _)| photographs.iter().filter(|p| *p == i).count() == 1);
    }
    tracks.retain(|track| track.len() > 1);
    tracks
}

/// Returns the representative of the set of `i`, and shortens the path to it.
pub(crate) fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sift::features;
    use infonerf_scene::image::GreyImage;

    /// Draws blobs of all sizes, with centres mapped by `to_picture` and radii multiplied by `scale`.
    fn picture(to_picture: impl Fn(DVec2) -> DVec2, scale: f64) -> GreyImage {
        let side = 320;
        let mut values = vec![0.5f64; side * side];
        for i in 0..260 {
            let hash = |k: f64| ((i as f64 * 12.9898 + k * 78.233).sin() * 43758.5453).fract().abs();
            let centre = to_picture(DVec2::new(hash(1.0), hash(2.0)) * 300.0);
            let (radius, height) = (scale * (2.0 + 7.0 * hash(3.0)), hash(4.0) - 0.5);
            for (at, value) in values.iter_mut().enumerate() {
                let pixel = DVec2::new((at % side) as f64, (at / side) as f64) + 0.5;
                *value += height * (-pixel.distance_squared(centre) / (2.0 * radius * radius)).exp();
            }
        }
        GreyImage { width: side, height: side, values: values.into_iter().map(|v| v.clamp(0.0, 1.0) as f32).collect() }
    }

    #[test]
    fn features_of_a_turned_and_scaled_picture_match() {
        let turned = |p: DVec2| DVec2::from_angle(0.6).rotate(p - 150.0) * 0.8 + 160.0;
        let (a, b) = (features(&picture(|p| p, 1.0), None, 2000), features(&picture(turned, 0.8), None, 2000));
        let pairs = matches(&a, &b);
        let near = pairs.iter().filter(|(i, j)| turned(a.pixels[*i]).distance(b.pixels[*j]) < 1.0).count();
        assert!(pairs.len() > 60 && near * 100 > pairs.len() * 90, "{near} of {}", pairs.len());
        let both = [picture(|p| p, 1.0), picture(turned, 0.8)];
        let kept = crate::two_view::verified_matches(&both, &[320.0; 2], 2000).remove(0).pixels;
        let good = kept.iter().filter(|(a, b)| turned(*a).distance(*b) < 1.0).count();
        assert!(good == near && kept.len() < pairs.len(), "{good} of {} agree with a relative pose", kept.len());
        assert!(matches(&a, &Default::default()).is_empty() && matches(&Default::default(), &a).is_empty());
        let blank = GreyImage { width: 40, height: 3, values: vec![0.5; 120] };
        assert_eq!(features(&blank, None, 10).pixels.len(), 0);
    }

    #[test]
    fn matches_are_chained_and_ambiguous_photographs_left_out() {
        let at = |x: f64| DVec2::new(x, 0.0);
        let photograph =
            |pixels: &[f64]| Features { pixels: pixels.iter().map(|x| at(*x)).collect(), ..Default::default() };
        // The first two features of the third photograph differ only in orientation.
        let features = [photograph(&[1.0, 2.0]), photograph(&[3.0, 4.0]), photograph(&[5.0, 5.0, 6.0])];
        let matched = |a, b, pairs: [(usize, usize); 2]| Matches { a, b, pairs: pairs.to_vec() };
        let matches =
            [matched(0, 1, [(0, 0), (1, 1)]), matched(1, 2, [(0, 0), (1, 2)]), matched(0, 2, [(0, 1), (1, 0)])];
        let joined = tracks(&features, &matches[..2]);
        let all = vec![vec![(0, at(1.0)), (1, at(3.0)), (2, at(5.0))], vec![(0, at(2.0)), (1, at(4.0)), (2, at(6.0))]];
        assert_eq!(joined, all);
        // The last matches join both tracks into one, in which every photograph is ambiguous.
        assert!(tracks(&features, &matches).is_empty());
    }

    /// Arranges thirty photographs in a circle; each shares features with those up to four places away.
    #[test]
    fn likely_pairs_are_those_that_look_alike() {
        let random = |i: usize, k: usize| (((i * LENGTH + k) as f64 * 12.9898).sin() * 43758.5453).fract() as f32;
        let photograph = |at: usize| {
            let places = (0..5).flat_map(|near| (0..40).map(move |k| (at + near) % 30 * 40 + k));
            let unit = |i: usize| {
                let values: Vec<f32> = (0..LENGTH).map(|k| random(i, k)).collect();
                let length = values.iter().map(|v| v * v).sum::<f32>().sqrt();
                values.into_iter().map(move |v| v / length)
            };
            let descriptors: Vec<f32> = places.flat_map(unit).collect();
            Features { pixels: vec![DVec2::ZERO; descriptors.len() / LENGTH], descriptors }
        };
        let all: Vec<Features> = (0..30).map(photograph).collect();
        let mut whole = Features::default();
        for Features { pixels, descriptors } in all.iter().step_by(5) {
            whole.pixels.extend(pixels);
            whole.descriptors.extend(descriptors);
        }
        assert_eq!(matches(&whole, &whole), (0..6 * 200).map(|i| (i, i)).collect::<Vec<_>>());
        assert_eq!(likely_pairs(&all[..ALL_PAIRS]).len(), max_matched_pairs(ALL_PAIRS));
        assert_eq!([0, 1, 4, 24, 25, 100].map(max_matched_pairs), [0, 0, 6, 276, 300, 1400]);
        let likely = likely_pairs(&all);
        assert!(likely.len() <= max_matched_pairs(30), "{}", likely.len());
        for (a, b) in (0..30).flat_map(|a| (1..4).map(move |next| (a, (a + next) % 30))) {
            assert!(likely.contains(&(a.min(b), a.max(b))), "{a} {b}");
        }
    }
}
