//! Selection rules that depend on camera positions.

use rand::Rng;
use rand::seq::{SliceRandom, index};

use crate::camera::Camera;
use crate::poses::view_directions;

/// Number of random sets that [`wide`] tries.
const TRIES: usize = 256;

/// Selects views by greedy farthest-point sampling of camera positions. `1 ≤ count ≤ cameras.len()`.
pub(super) fn farthest_point(cameras: &[Camera], count: usize, rng: &mut impl Rng) -> Vec<usize> {
    let mut chosen = vec![rng.random_range(0..cameras.len())];
    let mut nearest = vec![f64::INFINITY; cameras.len()];
    while chosen.len() < count {
        let last = chosen[chosen.len() - 1];
        for (distance, camera) in nearest.iter_mut().zip(cameras) {
            *distance = distance.min(camera.position_f64().distance_squared(cameras[last].position_f64()));
        }
        // Less than any distance, so that a view is chosen once.
        nearest[last] = f64::NEG_INFINITY;
        chosen.extend((0..cameras.len()).max_by(|&i, &j| nearest[i].total_cmp(&nearest[j])));
    }
    chosen
}

/// Returns the set with the max of the min pairwise angle among [`TRIES`] random sets.
pub(super) fn wide(cameras: &[Camera], count: usize, rng: &mut impl Rng) -> Vec<usize> {
    let directions = view_directions(cameras);
    let greatest_cosine = |set: &Vec<usize>| {
        let pairs = set.iter().enumerate().flat_map(|(k, &i)| set[..k].iter().map(move |&j| (i, j)));
        pairs.map(|(i, j)| directions[i].dot(directions[j])).fold(-1.0, f64::max)
    };
    (0..TRIES)
        .map(|_| index::sample(rng, cameras.len(), count).into_vec())
        .min_by(|a, b| greatest_cosine(a).total_cmp(&greatest_cosine(b)))
        .unwrap_or_default()
}

/// Returns the first set found of `count` views that are pairwise within `angle` radians. Anchors are tried in random
/// order. Each is completed greedily by its neighbours in random order, else in order of nearness.
pub(super) fn narrow(cameras: &[Camera], count: usize, angle: f64, rng: &mut impl Rng) -> Option<Vec<usize>> {
    let directions = view_directions(cameras);
    // Beyond π every pair is within the angle.
    let cosine = angle.min(std::f64::consts::PI).cos() - 1e-12;
    let complete = |anchor: usize, order: &[usize]| {
        let mut set = vec![anchor];
        for &i in order {
            let fits = |&j: &usize| directions[i].dot(directions[j]) >= cosine;
            if set.len() < count && !set.contains(&i) && set.iter().all(fits) {
                set.push(i);
            }
        }
        (set.len() == count).then_some(set)
    };
    let mut anchors: Vec<usize> = (0..cameras.len()).collect();
    anchors.shuffle(rng);
    let mut random = anchors.clone();
    random.shuffle(rng);
    anchors.iter().find_map(|&anchor| {
        let mut near = random.clone();
        let to_anchor = |k: usize| directions[k].dot(directions[anchor]);
        near.sort_by(|&i, &j| to_anchor(j).total_cmp(&to_anchor(i)));
        complete(anchor, &random).or_else(|| complete(anchor, &near))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::train_cameras;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn widest_and_closest(cameras: &[Camera], ids: &[usize]) -> (f64, f64) {
        let d = view_directions(cameras);
        let pairs = ids.iter().enumerate().flat_map(|(k, &i)| ids[..k].iter().map(move |&j| (i, j)));
        let angles = pairs.map(|(i, j)| d[i].dot(d[j]).clamp(-1.0, 1.0).acos().to_degrees());
        angles.fold((0.0, 180.0), |(most, least), angle| (angle.max(most), angle.min(least)))
    }

    #[test]
    fn narrow_stays_within_the_angle() {
        let cameras = train_cameras();
        for seed in 0..10 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let ids = narrow(&cameras, 4, 30f64.to_radians(), &mut rng).unwrap();
            assert!(widest_and_closest(&cameras, &ids).0 <= 30.0 + 1e-6);
        }
    }

    #[test]
    fn wide_and_farthest_point_keep_apart() {
        let cameras = train_cameras();
        for seed in 0..10 {
            let rng = &mut ChaCha8Rng::seed_from_u64(seed);
            assert!(widest_and_closest(&cameras, &wide(&cameras, 4, rng)).1 > 60.0);
            assert!(widest_and_closest(&cameras, &farthest_point(&cameras, 4, rng)).1 > 60.0);
        }
    }

    #[test]
    fn identical_cameras_do_not_loop() {
        let cameras = vec![train_cameras()[0].clone(); 5];
        let rng = &mut ChaCha8Rng::seed_from_u64(0);
        assert_eq!(farthest_point(&cameras, 5, rng).len(), 5);
        assert_eq!(wide(&cameras, 5, rng).len(), 5);
        assert_eq!(narrow(&cameras, 5, 0.1, rng).map(|s| s.len()), Some(5));
    }
}
