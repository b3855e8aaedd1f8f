use infonerf_field::Field;
use infonerf_ops::to_host;
use infonerf_scene::{Camera, Ray};
use infonerf_schedule::Moment;

use crate::march::march;
use crate::{Counts, RenderOutput, RenderRequest, Renderer, TrainedModel};

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

/// Rays that march at a time: bounds the memory of a picture.
const CHUNK: usize = 1 << 15;

/// Renders the picture of one member.
pub(crate) fn render_one<F: Field>(renderer: &Renderer, trained: &TrainedModel<F>, camera: &Camera) -> RenderedImage {
    let (model, occupancy) = (&trained.model, trained.occupancy.as_ref());
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
    if renderer.sampler().config().marches() {
        for rays in rays.chunks(CHUNK) {
            let (marched, counts) = march(renderer, &model.fine, rays, occupancy);
            image.counts += counts;
            for ray in marched {
                image.push(ray.rgb, ray.depth, 1.0 - ray.trans);
            }
        }
        return image;
    }
    for rays in rays.chunks(renderer.rays_at_once()) {
        let passes = renderer.render(model, rays, RenderRequest { color: true }, None, occupancy, Moment::END);
        image.append(&passes.fine);
        image.counts += passes.counts();
    }
    image
}

impl RenderedImage {
    fn append(&mut self, output: &RenderOutput) {
        let rgb = to_host(output.color.clone().expect("colour was asked for"));
        let acc = to_host(output.acc.clone());
        let depth = to_host(output.depth.clone());
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
