//! Poses that contradict matches. Repeated structures cause them: a few false matches place a photograph on the wrong side of an
//! object, and other photographs follow it.

use std::cmp::Reverse;

use crate::bundle::Prior;
use crate::camera::{Pose, SimpleRadial};
use crate::mapper::Mapper;
use crate::matching::{Matches, root, tracks};
use crate::reconstruction::SparseModel;
use crate::sift::Features;
use crate::two_view::explains;

/// Share of a pair's matches below which the poses contradict the pair.
const EXPLAINED: f64 = 0.25;
/// Min ratio between the matches of a contradicted pair and those of a joining pair at which the joining pair is false.
/// Chosen on three selections of photographs of one cup.
const STRONGER: f64 = 1.5;

/// Maps photographs from those that have one of `poses`, and again without the pairs that are found to be false.
pub(crate) fn map_without_false_pairs(
    features: &[Features],
    mut agreed: Vec<Matches>,
    mut poses: Vec<Result<Pose, String>>,
    (mut lens, prior): (SimpleRadial, Prior),
    tolerance: f64,
) -> SparseModel {
    loop {
        let found = Mapper::new(&tracks(features, &agreed), poses, (lens, prior), tolerance, None).run();
        let (largest, false_pairs) = consistent_parts(&found, features, &agreed, tolerance);
        if false_pairs.is_empty() {
            return found;
        }
        agreed.retain(|pair| !false_pairs.contains(&(pair.a, pair.b)));
        lens = found.lens;
        let kept = |(i, pose): (usize, _)| if largest.contains(&i) { pose } else { Err(String::new()) };
        poses = found.poses.into_iter().enumerate().map(kept).collect();
    }
}

/// Joins photographs to parts by the pairs that their poses explain, the pair with most matches first. A pair is false, and joins
/// nothing, if the poses contradict a pair between the same two parts that has [`STRONGER`] times as many matches. `tolerance` is
/// that of reprojection errors, in pixels. Returns the photographs of the largest part, and the false pairs of photographs.
fn consistent_parts(
    model: &SparseModel,
    features: &[Features],
    agreed: &[Matches],
    tolerance: f64,
) -> (Vec<usize>, Vec<(usize, usize)>) {
    let explained = |pair: &Matches| -> Option<usize> {
        let poses = [model.poses[pair.a].as_ref().ok()?, model.poses[pair.b].as_ref().ok()?];
        let ray = |photograph: usize, feature: usize| model.lens.unproject(features[photograph].pixels[feature]);
        let rays = pair.pairs.iter().map(|&(i, j)| (ray(pair.a, i), ray(pair.b, j)));
        Some(rays.filter(|&rays| explains(poses, rays, 2.0 * tolerance / model.lens.focal)).count())
    };
    let counted = agreed.iter().filter_map(|pair| Some((pair, explained(pair)?)));
    let (contradicted, mut joining): (Vec<_>, Vec<_>) =
        counted.partition(|(pair, count)| (*count as f64) < EXPLAINED * pair.pairs.len() as f64);
    joining.sort_by_key(|(_, count)| Reverse(*count));
    let mut parent: Vec<usize> = (0..model.poses.len()).collect();
    let mut false_pairs = Vec::new();
    for (pair, count) in joining {
        let parts = [root(&mut parent, pair.a), root(&mut parent, pair.b)];
        let is_false = contradicted.iter().any(|(other, _)| {
            let between = [root(&mut parent, other.a), root(&mut parent, other.b)];
            (between == parts || between == [parts[1], parts[0]]) && other.pairs.len() as f64 >= STRONGER * count as f64
        });
        if is_false && parts[0] != parts[1] {
            false_pairs.push((pair.a, pair.b));
        } else {
            parent[parts[0]] = parts[1];
        }
    }
    let placed = (0..parent.len()).filter(|&i| model.poses[i].is_ok());
    let roots: Vec<(usize, usize)> = placed.map(|i| (i, root(&mut parent, i))).collect();
    let of = |part: usize| roots.iter().filter(|(_, root)| *root == part).map(|(i, _)| *i).collect::<Vec<_>>();
    let largest = roots.iter().map(|(_, root)| of(*root)).max_by_key(Vec::len).unwrap_or_default();
    (largest, false_pairs)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::bundle::Point;
    use crate::testing::world;

    /// Turns away the last two of six photographs, which match each other and the third. False matches join them to the first.
    #[test]
    fn pairs_that_stronger_ones_contradict_are_false() {
        let mut all = world(5, 6, 100);
        let pixels = |i: usize| all.points.iter().map(|point| point.seen[i].1).collect();
        let mut features = Vec::from_iter((0..6).map(|i| Features { pixels: pixels(i), ..Features::default() }));
        all.poses[4..].iter_mut().for_each(|pose| pose.rotation *= DMat3::from_rotation_y(2.5));
        let at_false_pose = |point: &Point| all.lens.project(all.poses[4].transform(point.position));
        features[4].pixels.extend(all.points.iter().filter_map(at_false_pose));
        assert_eq!(features[4].pixels.len(), 200);
        let pair = |a, b, count: usize| Matches { a, b, pairs: (0..count).map(|i| (i, i)).collect() };
        let parts = |count: usize| {
            let joining = Matches { a: 0, b: 4, pairs: (0..count).map(|i| (i, 100 + i)).collect() };
            let chain = [pair(0, 1, 90), pair(1, 2, 90), pair(2, 3, 90), pair(4, 5, 80), pair(2, 4, 60)];
            let agreed = [chain.as_slice(), &[joining]].concat();
            let poses = all.poses.iter().copied().map(Ok).collect();
            let model = SparseModel { lens: all.lens, poses, points: Vec::new() };
            consistent_parts(&model, &features, &agreed, 2.5)
        };
        assert_eq!(parts(25), (vec![0, 1, 2, 3], vec![(0, 4)]));
        // Two pairs of about as many matches decide nothing.
        assert_eq!(parts(45), ((0..6).collect(), vec![]));
    }
}
