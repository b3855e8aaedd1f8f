use infonerf_ops::to_host;
use infonerf_scene::{Camera, Ray};

use crate::ensemble::combine;
use crate::march::march;
use crate::{Counts, Level, Model, OccupancyGrid, Renderer, Want};

/// A rendered picture with what the report shows beside it. All row-major.
#[derive(Clone, Debug)]
pub struct RenderedImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour on the background, not clamped.
    pub rgb: Vec<[f32; 3]>,
    /// Expected distance Σ w t/Σ w along the ray; infinite where the ray hits nothing.
    pub depth: Vec<f32>,
    /// Opacity.
    pub acc: Vec<f32>,
    /// Points along rays before and after skipping.
    pub counts: Counts,
}

/// Rays rendered at a time: bounds the memory of a picture.
const CHUNK: usize = 1 << 15;
/// The same with a coarse and a fine pass, whose networks' activations are wide.
const HIERARCHICAL_CHUNK: usize = 4096;

/// A trained model without gradients, and what is known to be empty around it.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The model, as `valid()`.
    pub model: Model,
    /// What pictures of it may skip.
    pub occupancy: Option<OccupancyGrid>,
}

/// Renders the picture that `camera` sees: of several members their mean, with as much detail as they have.
///
/// # Panics
/// If there are no members.
pub fn render_image(renderer: &Renderer, members: &[Learned], camera: &Camera) -> RenderedImage {
    combine(members.iter().map(|member| render_one(renderer, member, camera)).collect())
}

fn render_one(renderer: &Renderer, learned: &Learned, camera: &Camera) -> RenderedImage {
    let (model, occupancy) = (&learned.model, learned.occupancy.as_ref());
    let rays: Vec<Ray> = (0..camera.height)
        .flat_map(|y| (0..camera.width).map(move |x| (x as f32 + 0.5, y as f32 + 0.5)))
        .map(|(x, y)| camera.ray(x, y))
        .collect();
    let mut image = RenderedImage {
        width: camera.width,
        height: camera.height,
        rgb: Vec::with_capacity(rays.len()),
        depth: Vec::with_capacity(rays.len()),
        acc: Vec::with_capacity(rays.len()),
        counts: Counts::default(),
    };
    if !renderer.is_hierarchical() {
        for rays in rays.chunks(CHUNK) {
            let (marched, counts) = march(renderer, &model.fine, rays, occupancy);
            image.counts += counts;
            for ray in marched {
                image.push(ray.rgb, ray.depth, 1.0 - ray.trans);
            }
        }
        return image;
    }
    for rays in rays.chunks(HIERARCHICAL_CHUNK) {
        let want = Want { color: true, entropy: None };
        let (coarse, fine) = renderer.render(model, rays, want, None, occupancy, 1.0);
        image.append(&fine);
        for level in coarse.iter().chain([&fine]) {
            image.counts += Counts::from(&level.samples);
        }
    }
    image
}

impl RenderedImage {
    fn append(&mut self, level: &Level) {
        let rgb = to_host(level.color.clone().expect("colour was wanted"));
        let acc = to_host(level.composite.acc.clone());
        let depth = to_host(level.depth.clone());
        for ((rgb, depth), acc) in rgb.chunks_exact(3).zip(depth).zip(acc) {
            self.push([rgb[0], rgb[1], rgb[2]], depth, acc);
        }
    }

    /// Adds a pixel; `depth` is Σ w t.
    fn push(&mut self, rgb: [f32; 3], depth: f32, acc: f32) {
        self.rgb.push(rgb);
        self.depth.push(if acc > HIT { depth / acc } else { f32::INFINITY });
        self.acc.push(acc);
    }
}

/// Opacity from which a ray is said to hit something, for depth.
pub(crate) const HIT: f32 = 0.5;
