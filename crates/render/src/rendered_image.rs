use glam::Vec3;
use infonerf_scene::Camera;

use crate::Counts;

/// Opacity from which a ray is said to hit something, for depth.
pub(crate) const HIT: f32 = 0.5;

/// A rendered picture with distances, opacities and sample counts. All row-major.
#[derive(Clone, Debug, Default)]
pub struct RenderedImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour on the background, not clamped; before an unknown one, on the neighbouring pixels.
    pub rgb: Vec<[f32; 3]>,
    /// Expected distance Σ w t/Σ w along the ray; infinite where the ray hits nothing.
    pub depth: Vec<f32>,
    /// Opacity.
    pub acc: Vec<f32>,
    /// Points along rays before and after skipping.
    pub counts: Counts,
}

impl RenderedImage {
    /// Returns the end of the ray of `pixel`, and its direction; `None` if it hits nothing.
    pub(crate) fn point(&self, camera: &Camera, pixel: usize) -> Option<(Vec3, Vec3)> {
        let (width, depth) = (self.width as usize, self.depth[pixel]);
        let ray = camera.ray((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        depth.is_finite().then(|| (ray.origin + depth * ray.direction, ray.direction))
    }
}
