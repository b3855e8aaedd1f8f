//! Features of several photographs that are one point.

use glam::DVec2;

use crate::sift::Features;

/// Photographs and the pixels in which they see one point, each photograph once.
pub(crate) type Track = Vec<(usize, DVec2)>;

/// The connected components of `matches` (two photographs, and pairs of their features). A photograph that sees one of
/// them in two places is left out of it.
pub(crate) fn tracks(features: &[Features], matches: &[(usize, usize, Vec<(usize, usize)>)]) -> Vec<Track> {
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
    for (a, b, pairs) in matches {
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
