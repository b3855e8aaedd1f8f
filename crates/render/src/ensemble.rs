//! The mean picture of an ensemble.

use infonerf_field::Field;
use infonerf_scene::{Camera, View};

use crate::image::{HIT, render_one};
use crate::{RenderedImage, Renderer, TrainedModel};

/// Renders the picture that `camera` sees: of several members their mean.
///
/// # Panics
/// If there are no members.
pub fn render_image<F: Field>(renderer: &Renderer, members: &[TrainedModel<F>], camera: &Camera) -> RenderedImage {
    combine(members.iter().map(|member| render_one(renderer, member, camera, None)).collect())
}

/// Renders the picture that is compared with `view`: as [`render_image`], but without the residual of `view` itself if it is
/// one of the training views (of the same file). With it, the picture would be its own truth.
///
/// # Panics
/// If there are no members.
pub fn render_tested<F: Field>(renderer: &Renderer, members: &[TrainedModel<F>], view: &View) -> RenderedImage {
    combine(members.iter().map(|member| render_one(renderer, member, &view.camera, Some(&view.file))).collect())
}

/// Returns the mean of `pictures`, each pixel's distance weighted by opacity.
///
/// # Panics
/// If there are no pictures, or they differ in size.
pub(crate) fn combine(mut pictures: Vec<RenderedImage>) -> RenderedImage {
    if pictures.len() == 1 {
        return pictures.remove(0);
    }
    let share = 1.0 / pictures.len() as f32;
    let RenderedImage { width, height, .. } = pictures[0];
    let mut mean = RenderedImage { width, height, ..RenderedImage::default() };
    for pixel in 0..pictures[0].rgb.len() {
        let acc: f32 = pictures.iter().map(|picture| share * picture.acc[pixel]).sum();
        // Where a member hits nothing its distance counts for nothing.
        let hits = pictures.iter().filter(|picture| picture.depth[pixel].is_finite());
        let weight: f32 = hits.clone().map(|picture| share * picture.acc[pixel]).sum();
        let depth: f32 = hits.map(|picture| share * picture.acc[pixel] * picture.depth[pixel]).sum();
        mean.rgb.push([0, 1, 2].map(|channel| pictures.iter().map(|one| share * one.rgb[pixel][channel]).sum()));
        mean.depth.push(if acc > HIT { depth / weight } else { f32::INFINITY });
        mean.acc.push(acc);
    }
    pictures.iter().for_each(|picture| mean.counts += picture.counts);
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: u32 = 40;

    /// An edge at column `x`, of a surface at distance `depth`.
    fn edge(x: u32, depth: f32) -> RenderedImage {
        let pixels = (0..SIZE * SIZE).map(|pixel| pixel % SIZE < x);
        RenderedImage {
            width: SIZE,
            height: SIZE,
            rgb: pixels.clone().map(|inside| if inside { [0.2, 0.4, 0.1] } else { [1.0; 3] }).collect(),
            depth: pixels.clone().map(|inside| if inside { depth } else { f32::INFINITY }).collect(),
            acc: pixels.map(|inside| if inside { 1.0 } else { 0.0 }).collect(),
            ..RenderedImage::default()
        }
    }

    #[test]
    fn colours_are_means_and_distances_are_of_who_sees_the_surface() {
        let combined = combine(vec![edge(18, 2.0), edge(20, 2.0), edge(23, 4.0)]);
        let expected = [(2.0 * 0.2 + 1.0) / 3.0, (2.0 * 0.4 + 1.0) / 3.0, (2.0 * 0.1 + 1.0) / 3.0];
        assert!(combined.rgb[19].iter().zip(expected).all(|(got, want)| (got - want).abs() < 1e-6));
        // Two of three see the surface at column 19: opaque enough to have a distance, which is theirs.
        assert_eq!((combined.depth[0], combined.depth[21]), ((2.0 + 2.0 + 4.0) / 3.0, f32::INFINITY));
        assert!((combined.depth[19] - 3.0).abs() < 1e-6);
    }
}
