use glam::Vec3;
use kd_tree::KdTree;
use rayon::prelude::*;

/// Distance between two sets of points, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chamfer {
    /// Mean distance from a found point to the nearest true point.
    pub accuracy: f64,
    /// Mean distance from a true point to the nearest found point.
    pub completeness: f64,
}

impl Chamfer {
    /// Returns the chamfer distance of DTU's protocol: the mean of accuracy and completeness, which are not squared.
    pub fn mean(&self) -> f64 {
        0.5 * (self.accuracy + self.completeness)
    }
}

/// Measures the chamfer distance between `found` and `truth`; `None` if either is empty.
pub fn chamfer(found: &[Vec3], truth: &[Vec3]) -> Option<Chamfer> {
    Some(Chamfer { accuracy: mean_distance(found, truth)?, completeness: mean_distance(truth, found)? })
}

fn mean_distance(points: &[Vec3], targets: &[Vec3]) -> Option<f64> {
    let targets = targets.iter().map(|p| p.to_array()).collect();
    let tree: KdTree<[f32; 3]> = KdTree::build_by_ordered_float(targets);
    let nearest = |p: &Vec3| tree.nearest(&p.to_array()).map(|found| f64::from(found.squared_distance).sqrt());
    let distances: Option<Vec<f64>> = points.par_iter().map(nearest).collect();
    let distances = distances.filter(|distances| !distances.is_empty())?;
    Some(distances.iter().sum::<f64>() / distances.len() as f64)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Equal sets have distance 0 in any order, and the result is that of comparing every pair.
        #[test]
        fn distances_are_those_of_every_pair(
            points in prop::collection::vec(prop::array::uniform3(-2.0f32..2.0), 1..40),
            others in prop::collection::vec(prop::array::uniform3(-2.0f32..2.0), 1..40),
        ) {
            let [a, b] = [points, others].map(|points| points.into_iter().map(Vec3::from).collect::<Vec<_>>());
            let reversed: Vec<Vec3> = a.iter().rev().copied().collect();
            prop_assert_eq!(chamfer(&a, &reversed).unwrap(), Chamfer { accuracy: 0.0, completeness: 0.0 });
            let brute = |from: &[Vec3], to: &[Vec3]| {
                let nearest = |p: &Vec3| to.iter().map(|q| f64::from(p.distance(*q))).fold(f64::MAX, f64::min);
                from.iter().map(nearest).sum::<f64>() / from.len() as f64
            };
            let found = chamfer(&a, &b).unwrap();
            prop_assert!((found.accuracy - brute(&a, &b)).abs() < 1e-6);
            prop_assert!((found.completeness - brute(&b, &a)).abs() < 1e-6);
            prop_assert!((found.mean() - 0.5 * (brute(&a, &b) + brute(&b, &a))).abs() < 1e-6);
            prop_assert_eq!((chamfer(&[], &a), chamfer(&a, &[])), (None, None));
        }
    }
}
