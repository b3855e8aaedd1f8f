use glam::{Vec3, Vec4};
use infonerf_field::Field;
use infonerf_ops::{has_host_kernels, to_host};
use infonerf_scene::{Backdrop, Camera, Ray, View};
use rayon::prelude::*;

use crate::fill::filled;
use crate::march::march;
use crate::model::TrainedModel;
use crate::output::{Counts, RenderOutput, RenderRequest};
use crate::renderer::Renderer;

/// Number of rays that march at a time, which bounds the memory of a picture.
const CHUNK: usize = 1 << 15;
/// Number of rays that march at a time on the host, where several threads march side by side.
const HOST_CHUNK: usize = 1 << 12;

/// Opacity above which a ray hits something and has a depth.
pub(crate) const HIT: f32 = 0.5;

/// A rendered picture with distances, opacities and sample counts. All row-major.
#[derive(Clone, Debug, Default)]
pub struct RenderedImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour on the background, not clamped. If the background is unknown, colours of neighbouring pixels replace it.
    pub rgb: Vec<[f32; 3]>,
    /// Expected distance Σ w t/Σ w along the ray; infinite where the ray hits nothing.
    pub depth: Vec<f32>,
    /// Opacity Σ w of each pixel's ray.
    pub acc: Vec<f32>,
    /// Points along rays before and after skipping.
    pub counts: Counts,
}

/// Renders the picture that `camera` sees: the mean of all members' pictures.
///
/// # Panics
/// If there are no members.
pub fn render_image<F: Field>(renderer: &Renderer, members: &[TrainedModel<F>], camera: &Camera) -> RenderedImage {
    combine(members.iter().map(|member| render_one(renderer, member, camera, None)).collect())
}

/// Renders the picture that is compared with `view`, as [`render_image`] does, but without the residual of the training
/// view of the same file. That residual would add the true image to the picture.
///
/// # Panics
/// If there are no members.
pub fn render_tested<F: Field>(renderer: &Renderer, members: &[TrainedModel<F>], view: &View) -> RenderedImage {
    combine(members.iter().map(|member| render_one(renderer, member, &view.camera, Some(&view.file))).collect())
}

/// Returns the mean of `pictures`, at least one and all of one size, with each pixel's distance weighted by opacity.
pub(crate) fn combine(mut pictures: Vec<RenderedImage>) -> RenderedImage {
    if pictures.len() == 1 {
        return pictures.remove(0);
    }
    let share = 1.0 / pictures.len() as f32;
    let RenderedImage { width, height, .. } = pictures[0];
    let mut mean = RenderedImage { width, height, ..RenderedImage::default() };
    for pixel in 0..pictures[0].rgb.len() {
        let acc: f32 = pictures.iter().map(|picture| share * picture.acc[pixel]).sum();
        // Members whose ray hits nothing do not count in the distance.
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

/// Renders the picture of one member, without the residual of the training view of the file `left_out`.
pub(crate) fn render_one<F: Field>(
    renderer: &Renderer,
    trained: &TrainedModel<F>,
    camera: &Camera,
    left_out: Option<&str>,
) -> RenderedImage {
    let camera = trained.camera(camera);
    let mut image = render_in_frame(renderer, trained, &camera);
    if let Some(residuals) = &trained.residuals {
        let render = |view: usize, camera: &Camera| {
            let picture = render_in_frame(renderer, trained, camera);
            match &trained.model.exposure {
                Some(exposure) => exposure.expose(picture, renderer.background, view),
                None => picture,
            }
        };
        residuals.add_to(&mut image, &camera, left_out, render);
    }
    image.depth.iter_mut().for_each(|depth| *depth /= trained.scale());
    image
}

/// Renders the picture of a camera in the model's own frame.
fn render_in_frame<F: Field>(renderer: &Renderer, trained: &TrainedModel<F>, camera: &Camera) -> RenderedImage {
    let row = |y: u32| (0..camera.width).map(move |x| camera.ray(x as f32 + 0.5, y as f32 + 0.5));
    let rays: Vec<Ray> = (0..camera.height).into_par_iter().flat_map_iter(row).collect();
    let mut image = RenderedImage { width: camera.width, height: camera.height, ..RenderedImage::default() };
    if renderer.config.marches() {
        let host = trained.model.fine.on_host(trained.at);
        let march = |rays: &[Ray]| march(renderer, trained, host.as_ref(), rays);
        let parts: Vec<_> = match has_host_kernels(&trained.model.fine.device()) {
            true => rays.par_chunks(HOST_CHUNK).map(march).collect(),
            false => rays.chunks(CHUNK).map(march).collect(),
        };
        for (rays, counts) in parts {
            image.counts += counts;
            rays.into_iter().for_each(|ray| image.push(ray.rgb.to_array(), ray.depth, 1.0 - ray.trans));
        }
        return image.over_backdrop(renderer);
    }
    for rays in rays.chunks(renderer.rays_at_once(trained.at)) {
        let rays = renderer.rays(rays.to_vec(), &trained.model.fine.device());
        let request = RenderRequest { color: true, hidden: true };
        let passes = renderer.render(&trained.model, &rays, request, trained.occupancy.as_ref(), trained.at);
        image.counts += passes.counts();
        let RenderOutput { color, depth, acc, .. } = passes.fine;
        let color = to_host(color.expect("colour was asked for"));
        for ((rgb, depth), acc) in color.as_chunks().0.iter().zip(to_host(depth)).zip(to_host(acc)) {
            image.push(*rgb, depth, acc);
        }
    }
    image.over_backdrop(renderer)
}

impl RenderedImage {
    /// Returns the end point of the ray of `pixel`, and the ray's direction; `None` if it hits nothing.
    pub(crate) fn point(&self, camera: &Camera, pixel: usize) -> Option<(Vec3, Vec3)> {
        let (width, depth) = (self.width as usize, self.depth[pixel]);
        let ray = camera.ray((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        depth.is_finite().then(|| (ray.origin + depth * ray.direction, ray.direction))
    }

    /// Returns the picture before the scene's backdrop. If that is unknown, transparent pixels show the colours around them.
    fn over_backdrop(mut self, renderer: &Renderer) -> Self {
        if renderer.backdrop == Backdrop::Unknown {
            let background = Vec3::from(renderer.background);
            let own = |(rgb, acc): (&[f32; 3], &f32)| (Vec3::from(*rgb) - (1.0 - acc) * background).extend(*acc);
            let pixels: Vec<Vec4> = self.rgb.iter().zip(&self.acc).map(own).collect();
            let shown = filled(&pixels, (self.width as usize, self.height as usize), background);
            self.rgb = shown.into_iter().map(|color| color.to_array()).collect();
        }
        self
    }

    fn push(&mut self, rgb: [f32; 3], depth: f32, acc: f32) {
        self.rgb.push(rgb);
        self.depth.push(if acc > HIT { depth / acc } else { f32::INFINITY });
        self.acc.push(acc);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use burn::module::Module;
    use burn::tensor::{Device, Tensor, TensorData};
    use glam::{DMat3, DMat4, DVec3};
    use infonerf_field::{FieldOutput, Points};
    use infonerf_ops::sampling::Placement;
    use infonerf_scene::{Scene, Similarity};
    use infonerf_schedule::Moment;

    use super::*;
    use crate::config::{Compositing, OccupancyConfig, RenderConfig};
    use crate::model::{Model, ModelFrame};
    use crate::noise::{Noise, RandomStream};
    use crate::occupancy::OccupancyGrid;

    /// 32 samples in a single pass, through a grid of 2³ cells.
    pub(crate) fn config(placement: Placement) -> RenderConfig {
        RenderConfig {
            samples: 32.0.into(),
            fine_samples: 0,
            placement,
            early_stop_transmittance: 1e-3,
            hidden_depth: 1.0,
            occupancy: OccupancyConfig { enabled: true, resolution: 2, ..OccupancyConfig::default() },
            ..RenderConfig::default()
        }
    }

    /// Field with any density, whose grey level is the progress of the run.
    #[derive(Module, Debug)]
    struct GreyField {
        none: Tensor<1>,
        #[module(skip)]
        sigma: fn(Vec3) -> f32,
    }

    impl Field for GreyField {
        fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
            let positions = to_host(points.positions.clone());
            let sigma: Vec<f32> = positions.chunks_exact(3).map(|p| (self.sigma)(Vec3::from_slice(p))).collect();
            let count = sigma.len();
            let color = color.then(|| Tensor::full([count, 3], at.progress, &self.device()));
            FieldOutput { sigma: Tensor::from_data(TensorData::new(sigma, [count]), &self.device()), color }
        }
    }

    /// Returns a [`GreyField`] at a quarter of the run, seen along −z in the middle of a box of 3 units. All eight cells
    /// of the grid are opaque.
    fn seen(sigma: fn(Vec3) -> f32, placement: Placement) -> (Renderer, TrainedModel<GreyField>, Camera) {
        let scene = Scene::default();
        let config = config(placement);
        let mut grid = OccupancyGrid::new(&config.occupancy, scene.space.bounds);
        grid.restore(vec![1e4; 8], vec![true; 8], true).unwrap();
        let model = Model::of(GreyField { none: Tensor::zeros([1], &Device::flex()), sigma });
        let camera = Camera::from_fov(1, 1, 0.1, DMat4::from_translation(DVec3::new(0.1, 0.1, 4.0)));
        let at = Moment { step: 10, progress: 0.25 };
        let trained = TrainedModel { occupancy: Some(grid), ..TrainedModel::of(model, at) };
        (Renderer::new(&config, &scene), trained, camera)
    }

    /// Checks a ray that passes the clear part of an opaque cell and hits matter behind it. Training skips this matter;
    /// pictures show it, in the colour of the last training step.
    #[test]
    fn pictures_show_matter_that_training_skips_as_hidden() {
        for placement in [Placement::Mid, Placement::Left] {
            let (renderer, trained, camera) = seen(|p| if p.x > 1.0 || p.z < 0.0 { 1e4 } else { 0.0 }, placement);
            let training = RenderRequest { color: false, hidden: false };
            let rays = renderer.rays(vec![camera.ray(0.5, 0.5)], &Device::flex());
            let grid = trained.occupancy.as_ref();
            let passes = renderer.render(&trained.model, &rays, training, grid, trained.at);
            assert_eq!(passes.fine.acc.into_scalar::<f32>(), 0.0, "{placement:?}");
            let picture = render_one(&renderer, &trained, &camera, None);
            let RenderedImage { width, height, rgb, acc, .. } = picture;
            assert_eq!((width, height, acc[0], rgb[0]), (1, 1, 1.0, [0.25; 3]), "{placement:?}");
            let (renderer, trained, camera) = seen(|_| 0.0, placement);
            let renderer = Renderer { background: [0.5, 0.6, 0.7], ..renderer };
            assert_eq!(render_one(&renderer, &trained, &camera, None).rgb[0], renderer.background, "{placement:?}");
        }
    }

    /// Compares pictures, which march, with a batch of tensors; also in a frame of twice the size.
    #[test]
    fn pictures_have_the_values_of_a_batch() {
        let (_, trained, camera) = seen(|p| if p.z < 0.0 { 1.0 } else { 0.4 }, Placement::Mid);
        let similarity = Similarity { rotation: DMat3::IDENTITY, scale: 2.0, translation: DVec3::ZERO };
        let scaled = TrainedModel { frame: Some(ModelFrame { similarity, zoom: 1.0 }), ..trained.clone() };
        let nearer = camera.with_pose(DMat4::from_translation(DVec3::new(0.05, 0.05, 2.0)));
        for compositing in [Compositing::Exponential, Compositing::Additive] {
            let config = RenderConfig { samples: 28.0.into(), early_stop_transmittance: 0.0, ..config(Placement::Mid) };
            let config = RenderConfig { compositing, ..config };
            let (background, backdrop) = ([0.5, 0.6, 0.7], Backdrop::Unknown);
            let renderer = Renderer { background, backdrop, ..Renderer::new(&config, &Scene::default()) };
            let rays = renderer.rays(vec![camera.ray(0.5, 0.5)], &Device::flex());
            let request = RenderRequest { color: true, hidden: true };
            let passes = renderer.render(&trained.model, &rays, request, trained.occupancy.as_ref(), trained.at);
            let (counts, want) = (passes.counts(), passes.fine);
            let (color, depth, acc) = (to_host(want.color.unwrap()), to_host(want.depth)[0], to_host(want.acc)[0]);
            for (trained, camera, scale) in [(&trained, &camera, 1.0), (&scaled, &nearer, 2.0)] {
                let picture = render_one(&renderer, trained, camera, None);
                assert_eq!((picture.counts.total, counts.total), (28, 28));
                let found = [&picture.rgb[0][..], &[scale * picture.depth[0] * acc, picture.acc[0]]].concat();
                for (found, want) in found.iter().zip([&color[..], &[depth, acc]].concat()) {
                    approx::assert_abs_diff_eq!(*found, want, epsilon = 2e-5);
                }
            }
        }
    }

    /// Renders a wall behind uniform fog with a finer grid, which knows both.
    #[test]
    fn thin_fog_takes_fewer_samples_of_the_same_picture() {
        let sigma = |p: Vec3| if p.z < 0.0 { 1e4 } else { 0.4 };
        let (_, mut trained, camera) = seen(sigma, Placement::Mid);
        let step = Renderer::new(&config(Placement::Mid), &Scene::default()).step_length(trained.at);
        let noise = Noise::new(0, 0, RandomStream::RefinedOccupancy);
        let known = |points: Vec<f32>| points.chunks_exact(3).map(|p| sigma(Vec3::from_slice(p))).collect();
        trained.occupancy = trained.occupancy.map(|grid| grid.refined(8, noise, step, known));
        let picture = |early_stop_transmittance: f32| {
            let config = RenderConfig { early_stop_transmittance, clip_to_bounds: true, ..config(Placement::Mid) };
            render_one(&Renderer::new(&config, &Scene::default()), &trained, &camera, None)
        };
        let [exact, still, joined] = [0.0, 1e-5, 1e-3].map(picture);
        // The optical depth of a step of the fog is 0.063.
        let in_fog = |picture: &RenderedImage| picture.counts.evaluated - 1;
        let counts = [in_fog(&still), in_fog(&joined)];
        assert!(counts[0] >= 8 && counts[1] <= counts[0] / 2 + 2, "{counts:?}");
        assert_eq!(exact.counts.total, 32);
        assert!((exact.acc[0] - joined.acc[0]).abs() < 1e-5, "{} {}", exact.acc[0], joined.acc[0]);
        assert!((exact.depth[0] - joined.depth[0]).abs() < 0.1 * step, "{} {}", exact.depth[0], joined.depth[0]);
    }

    const SIZE: u32 = 40;

    /// Returns a picture of a surface at distance `depth`, which ends at column `x`.
    fn edge(x: u32, depth: f32) -> RenderedImage {
        let counts = Counts { total: 3, evaluated: 2 };
        let mut image = RenderedImage { width: SIZE, height: SIZE, counts, ..RenderedImage::default() };
        for pixel in 0..SIZE * SIZE {
            let inside = pixel % SIZE < x;
            let (rgb, acc) = if inside { ([0.2, 0.4, 0.1], 1.0) } else { ([1.0; 3], 0.0) };
            image.push(rgb, depth, acc);
        }
        image
    }

    #[test]
    fn distances_are_means_over_the_members_that_see_the_surface() {
        let combined = combine(vec![edge(18, 2.0), edge(20, 2.0), edge(23, 4.0)]);
        let expected = [(2.0 * 0.2 + 1.0) / 3.0, (2.0 * 0.4 + 1.0) / 3.0, (2.0 * 0.1 + 1.0) / 3.0];
        assert!(combined.rgb[19].iter().zip(expected).all(|(got, want)| (got - want).abs() < 1e-6));
        // Two of three members see the surface at column 19: opaque enough to have a distance, the mean of theirs.
        assert_eq!((combined.width, combined.height, combined.depth[0]), (SIZE, SIZE, (2.0 + 2.0 + 4.0) / 3.0));
        assert!((combined.depth[19] - 3.0).abs() < 1e-6 && combined.depth[21] == f32::INFINITY);
        assert_eq!(combined.counts, Counts { total: 9, evaluated: 6 });
    }
}
