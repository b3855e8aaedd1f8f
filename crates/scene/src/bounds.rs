use glam::Vec3;

use crate::ray::Ray;

/// An axis-aligned box, `min ≤ max` in each coordinate, in world units.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Aabb {
    /// Corner with the min coordinates.
    pub min: Vec3,
    /// Corner with the max coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// Returns the cube `centre ± half`.
    pub fn cube(centre: Vec3, half: f32) -> Self {
        let half = Vec3::splat(half.abs());
        Self { min: centre - half, max: centre + half }
    }

    /// Returns the smallest box that holds all `points`, or `None` where there are none.
    pub fn containing(points: impl IntoIterator<Item = Vec3>) -> Option<Self> {
        points
            .into_iter()
            .map(|p| Self { min: p, max: p })
            .reduce(|a, b| Self { min: a.min.min(b.min), max: a.max.max(b.max) })
    }

    /// Returns the middle of the box.
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Returns the edge lengths.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// Whether `p` lies inside or on the surface.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// Returns the part `(t_enter, t_exit)` of the ray, `0 ≤ t_enter ≤ t_exit`, that lies in the box.
    ///
    /// Slab method. From inside, `t_enter` is 0. A ray parallel to a slab is inside it or misses, and one that lies in
    /// a face counts as inside; neither result is ever NaN. A ray that only touches an edge or a corner gives an
    /// interval of length 0. `None` where the box is behind the ray, is missed, or the ray is not finite.
    pub fn intersect(&self, ray: &Ray) -> Option<(f32, f32)> {
        if !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return None;
        }
        let (mut enter, mut exit) = (0.0f32, f32::INFINITY);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            let (lo, hi) = (self.min[axis], self.max[axis]);
            if d == 0.0 {
                if o < lo || o > hi {
                    return None;
                }
                continue;
            }
            // No reciprocal: that of a subnormal `d` is infinite, and 0 · inf is NaN. 0 / d is 0 for every d ≠ 0.
            let (a, b) = ((lo - o) / d, (hi - o) / d);
            enter = enter.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        (enter <= exit && exit.is_finite()).then_some((enter, exit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn boxes_hold_points() {
        let found = Aabb::containing([[1.0, 5.0, 2.0], [3.0, 1.0, 2.0], [2.0, 2.0, 8.0]].map(Vec3::from)).unwrap();
        let at = Vec3::new;
        assert_eq!((found.centre(), found.size()), (at(2.0, 3.0, 5.0), at(2.0, 4.0, 6.0)));
        let held = [at(1.0, 5.0, 8.0), at(1.0, 5.0, 8.1), at(0.9, 5.0, 8.0)].map(|p| found.contains(p));
        assert_eq!(held, [true, false, false]);
        assert_eq!(Aabb::containing([]), None);
    }

    #[test]
    fn intervals_of_rays() {
        let forward = [1.0, 0.0, 0.0];
        for (origin, direction, expected) in [
            ([-3.0, 0.0, 0.0], forward, Some((2.0, 4.0))),
            ([0.5, 0.0, 0.0], forward, Some((0.0, 0.5))),
            ([3.0, 0.0, 0.0], forward, None),
            // Parallel to a slab, outside of it and in a face.
            ([-3.0, 1.5, 0.0], forward, None),
            ([-3.0, 1.5, 0.0], [1.0, -0.0, 0.0], None),
            ([-3.0, 1.0, 1.0], [1.0, 0.0, -0.0], Some((2.0, 4.0))),
            // Not finite.
            ([f32::NAN, 0.0, 0.0], forward, None),
            ([0.0; 3], [f32::INFINITY, 0.0, 0.0], None),
            ([0.0; 3], [0.0; 3], None),
        ] {
            let found = Aabb::cube(Vec3::ZERO, 1.0).intersect(&Ray::new(origin.into(), direction.into()));
            assert_eq!(found, expected, "{origin:?} {direction:?}");
        }
        let subnormal = Ray::new(Vec3::new(0.5, -1.0, -2.0), Vec3::new(1e-40, 1e-40, 1.0));
        let (a, b) = Aabb::cube(Vec3::ZERO, 1.0).intersect(&subnormal).expect("runs through the box from a face");
        assert!(a.is_finite() && b.is_finite());
    }

    proptest! {
        #[test]
        fn interval_ends_lie_on_the_box(
            o in prop::array::uniform3(-4.0f32..4.0),
            d in prop::array::uniform3(-1.0f32..1.0),
        ) {
            let d = Vec3::from(d);
            prop_assume!(d.length() > 1e-2);
            let ray = Ray::new(o.into(), d.normalize());
            if let Some((a, b)) = Aabb::cube(Vec3::ZERO, 1.0).intersect(&ray) {
                prop_assert!(0.0 <= a && a <= b);
                let grown = Aabb::cube(Vec3::ZERO, 1.0 + 1e-4);
                prop_assert!(grown.contains(ray.at(a)) && grown.contains(ray.at(b)));
                prop_assert!((ray.at(b).abs().max_element() - 1.0).abs() < 1e-4);
            } else {
                prop_assert!((0..800).all(|i| ray.at(i as f32 * 0.01).abs().max_element() >= 1.0 - 1e-4));
            }
        }
    }
}
