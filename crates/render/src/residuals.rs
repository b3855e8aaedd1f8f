//! Image-based rendering: residuals of the training views, which the field fails to fit, are added to pictures.

use std::sync::{Arc, OnceLock};

use glam::{Vec2, Vec3, Vec4};
use infonerf_scene::{Camera, Scene, View, bilinear};
use rayon::prelude::*;

use crate::image::RenderedImage;

const NEAREST: usize = 6;
/// θ₀ of [`Residuals`], radians.
const ANGLE: f32 = 0.03;
/// c of [`Residuals`]: a single photograph of weight c, at θ = 0.27, contributes half of its residual.
const PRIOR: f32 = 0.01;
/// ε of [`Residuals`]: relative difference of distances.
const TOLERANCE: f32 = 0.02;
/// Approximate number of pixels that decide which views are the nearest.
const PROBES: usize = 500;

/// Residuals of the training views, photograph minus the field's picture of it, to be added to pictures of new views.
///
/// A pixel of colour C, whose ray ends at the point x (at its expected distance), becomes `C + Σᵢ wᵢ rᵢ / (Σᵢ wᵢ + c)`.
/// rᵢ is the residual of training view i at the projection of x, and `wᵢ = (θ₀ / (θ₀ + θᵢ))² exp(−(dᵢ/ε)²)`. θᵢ is the
/// angle between the pixel's ray and view i's ray to x. dᵢ is the relative difference between the distance of x from
/// camera i and the distance that the field renders there: it is large where x is hidden from view i. Residuals are
/// interpolated bilinearly between valid pixels, distances between valid pixels whose rays hit something. Pixels whose
/// rays hit nothing are unchanged. The sum is an unstructured lumigraph (Buehler et al. 2001, without its penalty for
/// resolution) of what the field fails to fit: detail finer than its tables, gloss, exposure.
#[derive(Debug)]
pub struct Residuals {
    scene: Arc<Scene>,
    cameras: Vec<Camera>,
    sources: Vec<OnceLock<Source>>,
}

/// Residual of a training view, and the distance that the field renders, row-major. The last component of a pixel is 1; a
/// pixel without a residual or distance has only zeros.
#[derive(Debug)]
struct Source {
    residual: Vec<Vec4>,
    distance: Vec<Vec2>,
}

impl Residuals {
    /// Returns the residuals of `scene`'s training views, taken by `cameras` in the frame of the model. Each is
    /// computed, and then kept, when a picture first needs it.
    ///
    /// # Panics
    /// If views and cameras differ in number.
    pub fn new(scene: Arc<Scene>, cameras: Vec<Camera>) -> Self {
        assert_eq!(scene.train.len(), cameras.len(), "a camera for each view");
        let sources = cameras.iter().map(|_| OnceLock::new()).collect();
        Self { scene, cameras, sources }
    }

    /// Returns the residuals for pictures of `longest` pixels on their longest side: training views are rendered no larger.
    pub fn for_size(self: &Arc<Self>, longest: u32) -> Arc<Self> {
        if self.cameras.iter().all(|camera| camera.width.max(camera.height) <= longest) {
            return self.clone();
        }
        let train: Vec<View> = self.scene.train.iter().map(|view| view.resized(longest)).collect();
        let resized = |(camera, view): (&Camera, &View)| camera.resized(view.camera.width, view.camera.height);
        let cameras = self.cameras.iter().zip(&train).map(resized).collect();
        Arc::new(Self::new(Arc::new(Scene { train, ..self.scene.as_ref().clone() }), cameras))
    }

    /// Adds the residuals to `picture`, the field's picture of `camera`, except the residual of the training view of the
    /// file `left_out`. `render` renders the field's picture of a training view.
    pub(crate) fn add_to(
        &self,
        picture: &mut RenderedImage,
        camera: &Camera,
        left_out: Option<&str>,
        render: impl Fn(usize, &Camera) -> RenderedImage,
    ) {
        let source = |view: usize| {
            let camera = &self.cameras[view];
            (camera, self.sources[view].get_or_init(|| self.source(view, &render(view, camera))))
        };
        let sources: Vec<_> = self.nearest(picture, camera, left_out).into_iter().map(source).collect();
        let correction = |pixel: usize| {
            let (point, direction) = picture.point(camera, pixel)?;
            let (mut sum, mut total) = (Vec3::ZERO, 0.0);
            let seen = sources.iter().filter_map(|(camera, source)| source.at(camera, point, direction));
            seen.for_each(|(residual, weight)| (sum, total) = (sum + weight * residual, total + weight));
            Some(sum / (total + PRIOR))
        };
        let corrected = |(pixel, rgb): (usize, &[f32; 3])| Vec3::from(*rgb) + correction(pixel).unwrap_or_default();
        picture.rgb = picture.rgb.par_iter().enumerate().map(corrected).map(|rgb| rgb.to_array()).collect();
    }

    /// Returns the photographs with the largest sums of angular weights over pixels spread across the picture, except the
    /// one of the file `left_out`. Points that the field hides from a photograph count as well.
    fn nearest(&self, picture: &RenderedImage, camera: &Camera, left_out: Option<&str>) -> Vec<usize> {
        let pixels = picture.depth.len();
        // The step is odd: a step that divides the width, which is usually even, would visit only a few columns.
        let step = (pixels / PROBES) | 1;
        let hits: Vec<_> = (0..pixels).step_by(step).filter_map(|pixel| picture.point(camera, pixel)).collect();
        let score = |camera: &Camera| {
            let seen = hits.iter().filter(|(point, _)| seen_at(camera, *point).is_some());
            seen.map(|(point, direction)| angular_weight(camera, *point, *direction)).sum::<f32>()
        };
        let mut scores: Vec<(usize, f32)> = self.cameras.par_iter().map(score).enumerate().collect();
        scores.retain(|(view, _)| left_out.is_none_or(|file| self.scene.train[*view].file != file));
        scores.sort_by(|a, b| b.1.total_cmp(&a.1));
        scores.into_iter().take(NEAREST).filter(|(_, score)| *score > 0.0).map(|(view, _)| view).collect()
    }

    fn source(&self, view: usize, picture: &RenderedImage) -> Source {
        let view = &self.scene.train[view];
        let is_valid = |pixel: usize| view.valid.as_ref().is_none_or(|valid| valid[pixel]);
        let difference = |pixel: usize| Vec3::from_array(view.image.rgb[pixel]) - Vec3::from_array(picture.rgb[pixel]);
        let residual = |pixel| if is_valid(pixel) { difference(pixel).extend(1.0) } else { Vec4::ZERO };
        let hits = |pixel: usize| is_valid(pixel) && picture.depth[pixel].is_finite();
        let distance = |pixel| if hits(pixel) { Vec2::new(picture.depth[pixel], 1.0) } else { Vec2::ZERO };
        let pixels = 0..picture.rgb.len();
        Source { residual: pixels.clone().map(residual).collect(), distance: pixels.map(distance).collect() }
    }
}

impl Source {
    /// Returns the residual and weight of `point` on a ray along `direction`; `None` if `camera` does not see it.
    fn at(&self, camera: &Camera, point: Vec3, direction: Vec3) -> Option<(Vec3, f32)> {
        let (at, size) = (seen_at(camera, point)?, [camera.width as usize, camera.height as usize]);
        let seen = bilinear(size, at, |pixel| self.distance[pixel]);
        let distance = point.distance(camera.position());
        let apart = (seen.x / seen.y - distance) / (TOLERANCE * distance);
        let weight = angular_weight(camera, point, direction) * (-apart * apart).exp();
        // Without a distance `apart` is NaN, and so is the weight.
        (weight > 0.0).then(|| {
            let residual = bilinear(size, at, |pixel| self.residual[pixel]);
            (residual.truncate() / residual.w, weight)
        })
    }
}

/// Returns the pixel of `camera` that shows `point`; `None` beyond the centres of its outermost pixels (up to rounding).
fn seen_at(camera: &Camera, point: Vec3) -> Option<(f32, f32)> {
    let at = camera.project(point)?;
    let inside = |at: f32, size: u32| (0.49..=size as f32 - 0.49).contains(&at);
    (inside(at.x, camera.width) && inside(at.y, camera.height)).then_some((at.x, at.y))
}

/// Returns (θ₀ / (θ₀ + θ))², θ between `direction` and the ray of `camera` to `point`.
fn angular_weight(camera: &Camera, point: Vec3, direction: Vec3) -> f32 {
    let angle = (point - camera.position()).angle_between(direction);
    (ANGLE / (ANGLE + angle)).powi(2)
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};
    use infonerf_scene::Image;

    use super::*;
    use crate::output::Counts;

    const SIZE: u32 = 48;
    const GREY: f32 = 0.5;

    /// A camera above the plane z = 0, which it looks down at.
    fn camera(x: f64) -> Camera {
        Camera::from_fov(SIZE, SIZE, 0.8, DMat4::from_translation(DVec3::new(x, 0.0, 2.0)))
    }

    /// Points of the plane that the camera's pixels see, with their distances.
    fn plane(camera: &Camera) -> impl Iterator<Item = (Vec3, f32)> {
        let pixels = (0..SIZE * SIZE).map(|i| ((i % SIZE) as f32 + 0.5, (i / SIZE) as f32 + 0.5));
        pixels.map(|(x, y)| {
            let ray = camera.ray(x, y);
            let distance = -ray.origin.z / ray.direction.z;
            (ray.origin + distance * ray.direction, distance)
        })
    }

    /// The field's picture: a grey plane whose distances are `factor` of the true ones.
    fn picture(camera: &Camera, factor: f32) -> RenderedImage {
        let depth: Vec<f32> = plane(camera).map(|(_, distance)| factor * distance).collect();
        let (rgb, acc) = (vec![[GREY; 3]; depth.len()], vec![1.0; depth.len()]);
        RenderedImage { width: SIZE, height: SIZE, rgb, depth, acc, counts: Counts::default() }
    }

    /// Difference between the colour of the plane and the field's grey.
    fn pattern(point: Vec3) -> f32 {
        0.2 * (5.0 * point.x).sin() * (4.0 * point.y).cos()
    }

    /// A scene with one photograph of the plane with the pattern on it.
    fn photographed() -> Scene {
        let camera = camera(0.0);
        let rgb = plane(&camera).map(|(point, _)| [GREY + pattern(point); 3]).collect();
        let image = Image { width: SIZE, height: SIZE, rgb, alpha: None };
        Scene { train: vec![View::new(0, "photograph", camera, image)], ..Scene::default() }
    }

    fn residuals(scene: &Scene) -> Residuals {
        Residuals::new(Arc::new(scene.clone()), scene.training_cameras())
    }

    /// Returns what the residuals of `scene` add to each pixel of the grey picture, and the photograph's pattern at the
    /// same point. The field renders `factor` times the photograph's true distances.
    fn added(scene: &Scene, at: &Camera, factor: f32) -> Vec<(f32, f32)> {
        let mut shown = picture(at, 1.0);
        shown.depth[0] = f32::INFINITY;
        residuals(scene).add_to(&mut shown, at, None, |_, camera| picture(camera, factor));
        assert_eq!(shown.rgb[0], [GREY; 3], "a ray that meets nothing");
        let patterns = plane(at).map(|(point, _)| pattern(point));
        shown.rgb.iter().map(|rgb| rgb[0] - GREY).zip(patterns).skip(1).collect()
    }

    #[test]
    fn residuals_follow_their_points_and_weigh_less_from_other_directions() {
        let photograph = camera(0.0);
        let inside = |at: f32| (0.49..=SIZE as f32 - 0.49).contains(&at);
        for (at, factor) in [(photograph.clone(), 1.0), (camera(0.2), 1.0), (camera(0.2), 1.01)] {
            let points: Vec<Vec3> = plane(&at).map(|(point, _)| point).skip(1).collect();
            let (mut seen, apart) = (0, (factor - 1.0) / TOLERANCE);
            for ((added, pattern), point) in added(&photographed(), &at, factor).into_iter().zip(points) {
                let angle = (point - at.position()).angle_between(point - photograph.position());
                let weight = (ANGLE / (ANGLE + angle)).powi(2) * (-apart * apart).exp();
                let is_seen = photograph.project(point).is_some_and(|at| inside(at.x) && inside(at.y));
                let expected = if is_seen { weight / (weight + PRIOR) * pattern } else { 0.0 };
                seen += usize::from(expected != 0.0);
                assert!((added - expected).abs() < 2e-3, "{added} {expected}");
            }
            assert!(seen > 1500, "{seen}");
        }
    }

    #[test]
    fn training_views_are_no_larger_than_the_picture() {
        let whole = Arc::new(residuals(&photographed()));
        assert!(Arc::ptr_eq(&whole.for_size(SIZE), &whole));
        let half = whole.for_size(SIZE / 2);
        assert_eq!(half.cameras[0], whole.cameras[0].resized(SIZE / 2, SIZE / 2));
        assert_eq!(half.scene.train[0].camera, half.cameras[0]);
    }

    #[test]
    fn hidden_and_invalid_pixels_add_nothing() {
        let mut scene = photographed();
        let unchanged = |scene: &Scene, factor| added(scene, &camera(0.1), factor).iter().all(|(by, _)| *by == 0.0);
        assert!(!unchanged(&scene, 1.0));
        assert!(unchanged(&scene, 0.8), "something before the plane hides it");
        scene.train[0].valid = Some(vec![false; (SIZE * SIZE) as usize].into());
        assert!(unchanged(&scene, 1.0), "pixels that do not count");
    }

    /// Checks a field that fills half of the photograph: residuals reach up to the edge, and the other half counts as not seen.
    #[test]
    fn residuals_reach_up_to_silhouettes() {
        let at = camera(0.004);
        let half = SIZE as usize / 2;
        let with_half_a_plane = |camera: &Camera| {
            let mut shown = picture(camera, 1.0);
            shown.depth.chunks_mut(SIZE as usize).for_each(|row| row[half..].fill(f32::INFINITY));
            shown
        };
        let mut shown = picture(&at, 1.0);
        residuals(&photographed()).add_to(&mut shown, &at, None, |_, camera| with_half_a_plane(camera));
        for (pixel, ((point, _), rgb)) in plane(&at).zip(&shown.rgb).enumerate() {
            let expected = if pixel % (SIZE as usize) < half { pattern(point) } else { 0.0 };
            assert!((rgb[0] - GREY - expected).abs() < 0.01, "{pixel}: {rgb:?} {expected}");
        }
    }

    /// Checks that a photograph that is compared with a picture adds nothing to it; another one from the same place does.
    #[test]
    fn left_out_photograph_adds_nothing() {
        let at = camera(0.0);
        let mut scene = photographed();
        let changed = |scene: &Scene| {
            let (mut shown, file) = (picture(&at, 1.0), scene.train[0].file.as_str());
            residuals(scene).add_to(&mut shown, &at, Some(file), |_, camera| picture(camera, 1.0));
            shown.rgb.iter().any(|rgb| *rgb != [GREY; 3])
        };
        assert!(!changed(&scene));
        scene.train.push(View { file: "other.png".into(), ..scene.train[0].clone() });
        assert!(changed(&scene));
    }

    #[test]
    fn only_the_nearest_views_are_rendered() {
        let mut scene = photographed();
        for i in 1..=NEAREST {
            let view = View { camera: camera(0.1 * i as f64), ..scene.train[0].clone() };
            scene.train.push(view);
        }
        let (residuals, at) = (residuals(&scene), camera(0.0));
        residuals.add_to(&mut picture(&at, 1.0), &at, None, |_, camera| picture(camera, 1.0));
        let looked_at: Vec<bool> = residuals.sources.iter().map(|source| source.get().is_some()).collect();
        assert!(looked_at[..NEAREST].iter().all(|&used| used) && !looked_at[NEAREST], "{looked_at:?}");
    }
}
