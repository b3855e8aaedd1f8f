//! Check of near, far and a stated box against the distances of matched points.

use glam::DVec2;
use infonerf_scene::{Ray, Space};
use infonerf_sfm::ImageMatches;

use super::{MIN_MATCHES, Matched, Pixels, percent};
use crate::capture::StatedExtent;
use crate::capture::extent::quantile;

/// Min sine of the angle between the rays of a match from which a distance is measured: 1°.
const MIN_PARALLAX: f32 = 0.0175;
/// Share of measured points outside near, far and a stated box above which these are doubted, and the share outside stated
/// depths, which reconstructions leave a thousandth of their points out of.
const OUTSIDE: f64 = 0.8;
const OUTSIDE_STATED: f64 = 0.1;
/// Min ratio of a stated far depth to 99 % of the measured ones at which it is doubted.
const TOO_FAR: f32 = 20.0;

impl Matched<'_> {
    /// Returns the points that `explained` matches show: a ray to each, and the distance along it.
    fn points(&self, explained: &[Pixels]) -> Vec<(Ray, f32)> {
        let of_pair = |(pair, pixels): (&ImageMatches, &Pixels)| {
            let cameras = [&self.cameras[pair.a], &self.cameras[pair.b]];
            let apart = (cameras[1].position_f64() - cameras[0].position_f64()).as_vec3();
            let point = |&(in_a, in_b): &(DVec2, DVec2)| {
                let [a, b] = [(cameras[0], in_a), (cameras[1], in_b)].map(|(c, p)| c.ray(p.x as f32, p.y as f32));
                let normal = a.direction.cross(b.direction);
                let distance = apart.cross(b.direction).dot(normal) / normal.length_squared();
                (normal.length() >= MIN_PARALLAX).then_some((a, distance))
            };
            pixels.iter().filter_map(point).collect::<Vec<_>>()
        };
        self.matches.iter().zip(explained).flat_map(of_pair).collect()
    }

    /// Describes near, far and a stated box outside which many of the matched points lie, or a stated far depth far beyond them.
    pub(super) fn contradicted_extent(
        &self,
        explained: &[Pixels],
        space: &Space,
        stated: &StatedExtent,
    ) -> Option<String> {
        let (has_depths, has_box) = match stated {
            StatedExtent::Known(_) => (false, false),
            StatedExtent::Depths(..) => (true, false),
            StatedExtent::Estimated(known) => (known.range.is_some(), known.bounds.is_some()),
        };
        let points = self.points(explained);
        if points.len() < MIN_MATCHES {
            return None;
        }
        let share = |is_meant: &dyn Fn(&Ray, f32) -> bool| {
            points.iter().filter(|(ray, distance)| is_meant(ray, *distance)).count() as f64 / points.len() as f64
        };
        let depths = |ray: &Ray| space.range.along(ray).unwrap_or_default();
        let is_outside = |ray: &Ray, distance: f32| !(depths(ray).0..=depths(ray).1).contains(&distance);
        let is_off_box = |ray: &Ray, distance: f32| has_box && !space.bounds.contains(ray.at(distance));
        let Space { near, far, .. } = space;
        if has_depths && share(&|ray, distance| TOO_FAR * distance > depths(ray).1) < 0.01 {
            let text = "times as far away as 99 % of the matched points: is it right?";
            return Some(format!("far ({far:.3}) is more than {TOO_FAR} {text}"));
        }
        let (of_depths, max) = (share(&is_outside), if has_depths { OUTSIDE_STATED } else { OUTSIDE });
        let of_all = share(&|ray, distance| is_outside(ray, distance) || is_off_box(ray, distance));
        let found = [(of_depths, max, "near and far"), (of_all, OUTSIDE, "the box, near and far")];
        let (share, _, limits) = found.into_iter().find(|(share, max, _)| share > max)?;
        let mut distances: Vec<f32> = points.iter().map(|(_, distance)| *distance).collect();
        distances.sort_by(f32::total_cmp);
        let [from, to] = [0.1, 0.9].map(|share| quantile(&distances, share));
        let text = format!("of matched points lie outside {limits} ({near:.3} to {far:.3}), {from:.3} to {to:.3} away");
        Some(format!("{} {text}: are these and the poses in one unit?", percent(share)))
    }
}
