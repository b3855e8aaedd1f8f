//! Intrinsics that no camera has.

use infonerf_scene::Camera;

use super::sizes::long_side;

/// Plausible principal points divided by the image side (`CENTRAL`), and plausible ratios fy / fx (`SQUARE`).
const CENTRAL: std::ops::RangeInclusive<f64> = 0.3..=0.7;
const SQUARE: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Plausible focal lengths divided by the longer side of the image: fields of view from 5° to 118°.
const FOCAL_LENGTHS: std::ops::RangeInclusive<f64> = 0.3..=11.5;

/// Describes implausible focal lengths, principal points, ratios fy / fx and proportions.
pub(crate) fn implausible(names: &[&str], cameras: &[Camera]) -> Vec<String> {
    let first = |is_odd: &dyn Fn(&Camera) -> bool| cameras.iter().position(is_odd).map(|i| (names[i], &cameras[i]));
    let over_longer = |c: &Camera| (c.fx * c.fy).sqrt() / long_side(c);
    let focal = first(&|c| c.lens.is_perspective() && !FOCAL_LENGTHS.contains(&over_longer(c))).map(|(name, c)| {
        let doubt = "image widths: is it in pixels, and for images of this size?";
        format!("the focal length of {name} is {:.2} {doubt}", over_longer(c))
    });
    let middle = |c: &Camera| [c.cx / f64::from(c.width), c.cy / f64::from(c.height)];
    let centre = first(&|c| !middle(c).iter().all(|share| CENTRAL.contains(share))).map(|(name, c)| {
        let [x, y] = middle(c);
        let place = format!("is at {x:.2} of the width and {y:.2} of the height");
        format!("the principal point of {name} {place}: is it for images of this size?")
    });
    let ratio = first(&|c| !SQUARE.contains(&(c.fy / c.fx))).map(|(name, c)| {
        format!("the focal lengths of {name} differ by a factor of {:.2}: are its pixels not square?", c.fy / c.fx)
    });
    let wide = first(&|c| c.lens.is_perspective() && c.width == 2 * c.height).map(|(name, _)| {
        format!("{name} is twice as wide as high: is it a panorama? Only views cut out of panoramas are read")
    });
    [focal, centre, ratio, wide].into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;

    #[test]
    fn implausible_intrinsics_are_named() {
        let camera = Camera::pinhole((100, 80), [90.0; 2], [50.0, 40.0], DMat4::IDENTITY);
        let doubts = |other: Camera| implausible(&["a", "b"], &[camera.clone(), other]);
        assert_eq!(doubts(camera.clone()), [""; 0]);
        for (other, said) in [
            (Camera { fx: 3.0, fy: 3.0, ..camera.clone() }, "the focal length of b is 0.03 image widths"),
            (Camera { cx: 0.0, ..camera.clone() }, "the principal point of b is at 0.00 of the width and 0.50"),
            (Camera { fy: 180.0, ..camera.clone() }, "the focal lengths of b differ by a factor of 2.00"),
            (Camera { width: 160, cx: 80.0, ..camera.clone() }, "b is twice as wide as high: is it a panorama?"),
        ] {
            let found = doubts(other);
            assert!(found.len() == 1 && found[0].starts_with(said), "{found:?}");
        }
    }
}
