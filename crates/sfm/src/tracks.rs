//! Features of several photographs that are one point.

use glam::DVec2;

use crate::matching::Matches;
use crate::sift::Features;

/// Photographs and the pixels in which they see one point, each photograph once.
pub(crate) type Track = Vec<(usize, DVec2)>;

/// Returns the connected components of `matches`, a track each. A photograph that would see the point of a track at two
/// pixels is left out of that track.
pub(crate) fn tracks(features: &[Features], matches: &[Matches]) -> Vec<Track> {
    let mut first = vec![0];
    first.extend(features.iter().scan(0, |sum, f| {
        *sum += f.pixels.len();
        Some(*sum)
    }));
    let mut parent: Vec<usize> = (0..first[features.len()]).collect();
    let mut join = |a: usize, b: usize| {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b)] = a.min(b);
    };
    for (i, all) in features.iter().enumerate() {
        // Features that differ in their orientation alone.
        (1..all.pixels.len())
            .filter(|&k| all.pixels[k] == all.pixels[k - 1])
            .for_each(|k| join(first[i] + k, first[i] + k - 1));
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

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_are_chained_and_ambiguous_photographs_left_out() {
        let at = |x: f64| DVec2::new(x, 0.0);
        let photograph =
            |pixels: &[f64]| Features { pixels: pixels.iter().map(|x| at(*x)).collect(), ..Default::default() };
        // The first two features of the third photograph differ in orientation alone.
        let features = [photograph(&[1.0, 2.0]), photograph(&[3.0, 4.0]), photograph(&[5.0, 5.0, 6.0])];
        let matched = |a, b, pairs: [(usize, usize); 2]| Matches { a, b, pairs: pairs.to_vec() };
        let matches =
            [matched(0, 1, [(0, 0), (1, 1)]), matched(1, 2, [(0, 0), (1, 2)]), matched(0, 2, [(0, 1), (1, 0)])];
        let joined = tracks(&features, &matches[..2]);
        let all = vec![vec![(0, at(1.0)), (1, at(3.0)), (2, at(5.0))], vec![(0, at(2.0)), (1, at(4.0)), (2, at(6.0))]];
        assert_eq!(joined, all);
        // The last match makes one of the two, in which every photograph is ambiguous.
        assert!(tracks(&features, &matches).is_empty());
    }
}
