//! What training photographs show beyond a field's pictures of them, added to new pictures.

use std::sync::{Arc, OnceLock};

use glam::Vec3;
use infonerf_scene::{Camera, Scene};
use rayon::prelude::*;

use crate::RenderedImage;

/// Photographs that a picture takes residuals from: those nearest to it, which see most of it.
const NEAREST: usize = 6;
/// θ₀: the angle between two rays to a point at which a photograph counts a quarter, radians.
const ANGLE: f32 = 0.03;
/// c: a photograph alone counts a half where its weight is this, which it is at 0.27 rad.
const PRIOR: f32 = 0.01;
/// ε: the relative difference of distances from which a point is taken to be hidden.
const TOLERANCE: f32 = 0.02;
/// Columns and rows between the pixels that choose the nearest photographs.
const STRIDE: usize = 16;

/// The training photographs' residuals: photograph less picture of the field.
///
/// A pixel that the field shows in colour C at distance t, at the point x, becomes `C + Σ wᵢ rᵢ / (Σ wᵢ + c)`, where rᵢ is
/// the residual of photograph i where it sees x, and `wᵢ = (θ₀ / (θ₀ + θᵢ))² exp(−(dᵢ/ε)²)`: θᵢ is the angle at x between
/// the pixel's ray and photograph i's, and dᵢ the relative difference between x's distance from i and the distance that the
/// field has there, which tells whether i sees x. This is image-based rendering (the unstructured lumigraph of Buehler et
/// al. 2001, without its penalty of resolution) of what the field leaves over: detail finer than its tables, gloss, exposure.
/// Rays that meet nothing stay as they are.
///
/// All cameras are in the frame of the model.
#[derive(Debug)]
pub struct Residuals {
    scene: Arc<Scene>,
    cameras: Vec<Camera>,
    sources: Vec<OnceLock<Source>>,
}

/// A photograph's residual and the distances that the field has there, row-major; infinite where the photograph says nothing.
#[derive(Debug)]
struct Source {
    residual: Vec<[f32; 3]>,
    depth: Vec<f32>,
}

impl Residuals {
    /// Those of `scene`'s training views, seen by `cameras`. Each is computed when a picture first needs it.
    ///
    /// # Panics
    /// If views and cameras differ in number.
    pub fn new(scene: Arc<Scene>, cameras: Vec<Camera>) -> Self {
        assert_eq!(scene.train.len(), cameras.len(), "a camera for each view");
        let sources = cameras.iter().map(|_| OnceLock::new()).collect();
        Self { scene, cameras, sources }
    }

    /// Adds them to the field's picture of `camera`. `render` makes the field's picture of a training view.
    pub(crate) fn add_to(
        &self,
        picture: &mut RenderedImage,
        camera: &Camera,
        render: impl Fn(usize, &Camera) -> RenderedImage,
    ) {
        let sources: Vec<(&Camera, &Source)> = self
            .nearest(picture, camera)
            .into_iter()
            .map(|view| {
                let source = self.sources[view].get_or_init(|| self.source(view, &render(view, &self.cameras[view])));
                (&self.cameras[view], source)
            })
            .collect();
        let (width, depth) = (picture.width as usize, &picture.depth);
        picture.rgb.par_iter_mut().enumerate().filter(|(pixel, _)| depth[*pixel].is_finite()).for_each(
            |(pixel, rgb)| {
                let ray = camera.ray((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
                let point = ray.origin + depth[pixel] * ray.direction;
                let (mut sum, mut total) = (Vec3::ZERO, 0.0);
                for (camera, source) in &sources {
                    if let Some((residual, weight)) = source.at(camera, point, ray.direction) {
                        sum += weight * residual;
                        total += weight;
                    }
                }
                *rgb = (Vec3::from_array(*rgb) + sum / (total + PRIOR)).to_array();
            },
        );
    }

    /// The photographs with the greatest sums of weights over some of the picture's pixels, whoever is hidden.
    fn nearest(&self, picture: &RenderedImage, camera: &Camera) -> Vec<usize> {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let rows = (STRIDE / 2..height.max(STRIDE / 2 + 1)).step_by(STRIDE).map(|y| y.min(height - 1));
        let pixels: Vec<(Vec3, Vec3)> = rows
            .flat_map(|y| (STRIDE / 2..width.max(STRIDE / 2 + 1)).step_by(STRIDE).map(move |x| (x.min(width - 1), y)))
            .filter_map(|(x, y)| {
                let (ray, depth) = (camera.ray(x as f32 + 0.5, y as f32 + 0.5), picture.depth[y * width + x]);
                depth.is_finite().then(|| (ray.origin + depth * ray.direction, ray.direction))
            })
            .collect();
        let seen = |camera: &Camera, (point, direction): &(Vec3, Vec3)| {
            seen_at(camera, *point).map_or(0.0, |_| angular_weight(camera, *point, *direction))
        };
        let score = |camera: &Camera| pixels.iter().map(|pixel| seen(camera, pixel)).sum::<f32>();
        let mut scores: Vec<(usize, f32)> = self.cameras.par_iter().map(score).enumerate().collect();
        scores.sort_by(|a, b| b.1.total_cmp(&a.1));
        scores.into_iter().take(NEAREST).filter(|(_, score)| *score > 0.0).map(|(view, _)| view).collect()
    }

    fn source(&self, view: usize, picture: &RenderedImage) -> Source {
        let view = &self.scene.train[view];
        let residual = |(photograph, shown): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| photograph[c] - shown[c]);
        let usable = |pixel: usize| view.valid.as_ref().is_none_or(|valid| valid[pixel]);
        let depth = |(pixel, &depth)| if usable(pixel) { depth } else { f32::INFINITY };
        Source {
            residual: view.image.rgb.iter().zip(&picture.rgb).map(residual).collect(),
            depth: picture.depth.iter().enumerate().map(depth).collect(),
        }
    }
}

impl Source {
    /// Residual and weight of `point` on a ray along `direction`; none where `camera` does not see it.
    fn at(&self, camera: &Camera, point: Vec3, direction: Vec3) -> Option<(Vec3, f32)> {
        let at = seen_at(camera, point)?;
        let distance = point.distance(camera.position());
        let apart = (self.mean(camera, at, |pixel| self.depth[pixel]) - distance) / (TOLERANCE * distance);
        let weight = angular_weight(camera, point, direction) * (-apart * apart).exp();
        // Beside a pixel without a distance the mean is infinite or no number.
        (weight > 1e-9).then(|| (self.mean(camera, at, |pixel| Vec3::from_array(self.residual[pixel])), weight))
    }

    /// The bilinear mean of four pixels at `(x, y)`.
    fn mean<T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>>(
        &self,
        camera: &Camera,
        (x, y): (f32, f32),
        value: impl Fn(usize) -> T,
    ) -> T {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (x, y) = ((x - 0.5).max(0.0), (y - 0.5).max(0.0));
        let (left, top) = ((x as usize).min(width - 1), (y as usize).min(height - 1));
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (u, v) = ((x - left as f32).min(1.0), (y - top as f32).min(1.0));
        let row = |y: usize| value(y * width + left) * (1.0 - u) + value(y * width + right) * u;
        row(top) * (1.0 - v) + row(bottom) * v
    }
}

/// Where `camera` has `point` in its picture, on or within the centres of the pixels at its edges, to rounding.
fn seen_at(camera: &Camera, point: Vec3) -> Option<(f32, f32)> {
    let at = camera.project(point)?;
    let inside = |at: f32, size: u32| (0.49..=size as f32 - 0.49).contains(&at);
    (inside(at.x, camera.width) && inside(at.y, camera.height)).then_some((at.x, at.y))
}

/// (θ₀ / (θ₀ + θ))², θ between `direction` and the ray of `camera` to `point`.
fn angular_weight(camera: &Camera, point: Vec3, direction: Vec3) -> f32 {
    let angle = (point - camera.position()).angle_between(direction);
    (ANGLE / (ANGLE + angle)).powi(2)
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};
    use infonerf_scene::{Image, View};

    use super::*;
    use crate::Counts;

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

    /// What the plane shows beyond the field.
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

    /// How far a picture by the residuals of `scene` is from the grey one, with what the photograph's pattern is at the
    /// same points. The field has `factor` of the photograph's true distances.
    fn added(scene: Scene, at: &Camera, factor: f32) -> Vec<(f32, f32)> {
        let cameras = scene.train.iter().map(|view| view.camera.clone()).collect();
        let mut shown = picture(at, 1.0);
        shown.depth[0] = f32::INFINITY;
        Residuals::new(Arc::new(scene), cameras).add_to(&mut shown, at, |_, camera| picture(camera, factor));
        assert_eq!(shown.rgb[0], [GREY; 3], "a ray that meets nothing");
        let patterns = plane(at).map(|(point, _)| pattern(point));
        shown.rgb.iter().map(|rgb| rgb[0] - GREY).zip(patterns).skip(1).collect()
    }

    #[test]
    fn a_picture_from_where_the_photograph_was_taken_is_the_photograph() {
        for (added, pattern) in added(photographed(), &camera(0.0), 1.0) {
            assert!((added - pattern / (1.0 + PRIOR)).abs() < 1e-3, "{added} {pattern}");
        }
    }

    #[test]
    fn beside_it_the_residual_is_where_its_point_is_and_weighs_less() {
        let at = camera(0.2);
        let photograph = camera(0.0);
        let points: Vec<Vec3> = plane(&at).map(|(point, _)| point).skip(1).collect();
        let mut seen = 0;
        for ((added, pattern), point) in added(photographed(), &at, 1.0).into_iter().zip(points) {
            let angle = (point - at.position()).angle_between(point - photograph.position());
            let weight = (ANGLE / (ANGLE + angle)).powi(2);
            let expected =
                if seen_at(&photograph, point).is_some() { weight / (weight + PRIOR) * pattern } else { 0.0 };
            seen += usize::from(expected != 0.0);
            assert!((added - expected).abs() < 2e-3, "{added} {expected}");
        }
        assert!(seen > 1500, "{seen}");
    }

    #[test]
    fn nothing_is_added_that_the_photograph_does_not_see() {
        let unchanged = |scene, factor| added(scene, &camera(0.1), factor).iter().all(|(added, _)| *added == 0.0);
        assert!(!unchanged(photographed(), 1.0));
        assert!(unchanged(photographed(), 0.8), "something before the plane hides it");
        let mut scene = photographed();
        scene.train[0].valid = Some(vec![false; (SIZE * SIZE) as usize].into());
        assert!(unchanged(scene, 1.0), "pixels that do not count");
    }

    #[test]
    fn only_the_nearest_photographs_are_looked_at() {
        let mut scene = photographed();
        for i in 1..=NEAREST {
            let view = View { camera: camera(0.1 * i as f64), ..scene.train[0].clone() };
            scene.train.push(view);
        }
        let cameras = scene.train.iter().map(|view| view.camera.clone()).collect();
        let residuals = Residuals::new(Arc::new(scene), cameras);
        let at = camera(0.0);
        residuals.add_to(&mut picture(&at, 1.0), &at, |_, camera| picture(camera, 1.0));
        let looked_at: Vec<bool> = residuals.sources.iter().map(|source| source.get().is_some()).collect();
        assert!(looked_at[..NEAREST].iter().all(|&used| used) && !looked_at[NEAREST], "{looked_at:?}");
    }
}
