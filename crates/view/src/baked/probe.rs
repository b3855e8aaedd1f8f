//! Queries of a field at points that are not on rays.

use glam::Vec3;
use infonerf_field::{Extent, Field, FieldOutput};
use infonerf_ops::{to_host, upload};
use infonerf_render::{TrainedModel, Warp, evaluate_at};
use infonerf_scene::Scene;

use crate::package::Subjects;

/// Number of points per query, which bounds the memory.
const CHUNK: usize = 1 << 15;
/// Maximum number of viewpoints from which colours are evaluated.
const MAX_VIEWPOINTS: usize = 6;
/// Minimum distance of a training camera that is used, in radii of the scene.
const MIN_DISTANCE: f32 = 1e-3;

pub(super) struct FieldProbe<'a> {
    trained: &'a TrainedModel,
    warp: &'a Warp,
    /// Whether space is empty beyond the occupancy grid's box.
    closed: bool,
    pub(super) viewpoints: Vec<Vec3>,
    cameras: Vec<Vec3>,
    /// Edge of a pixel's footprint at distance 1, the mean of the training cameras.
    pixel: f32,
    nearest: f32,
}

impl<'a> FieldProbe<'a> {
    pub(super) fn new(subjects: &Subjects<'a>) -> Self {
        let scene = subjects.scene;
        // A cone's radius is 2/√12 of the pixel.
        let pixel = |view: &infonerf_scene::View| {
            let camera = &view.camera;
            3f32.sqrt() * camera.ray(0.5 * camera.width as f32, 0.5 * camera.height as f32).radius
        };
        Self {
            trained: subjects.trained,
            warp: subjects.renderer.warp(),
            closed: subjects.config.clip_to_bounds || !subjects.renderer.warp().is_identity(),
            viewpoints: viewpoints(scene),
            cameras: scene.train.iter().map(|view| view.camera.position()).collect(),
            pixel: scene.train.iter().map(pixel).sum::<f32>() / scene.train.len().max(1) as f32,
            nearest: MIN_DISTANCE * scene.space.radius,
        }
    }

    /// Evaluates densities in the warp's coordinate at points of voxels; 0 where the occupancy grid is empty, as in renders.
    pub(super) fn densities(&self, points: &[Vec3], voxel: f32) -> Vec<f32> {
        let open: Vec<usize> = (0..points.len()).filter(|&index| self.is_open(points[index])).collect();
        let mut densities = vec![0.0; points.len()];
        for queried in open.chunks(CHUNK) {
            let positions: Vec<Vec3> = queried.iter().map(|&index| points[index]).collect();
            let answer = self.evaluate(&positions, &vec![Vec3::Z; queried.len()], voxel, false);
            for (&index, sigma) in queried.iter().zip(to_host(answer.sigma)) {
                // NaN becomes 0.
                densities[index] = sigma.max(0.0);
            }
        }
        densities
    }

    /// Returns whether the grid is occupied at `p`. On and beyond the faces of a closed box, the cell just inside decides.
    fn is_open(&self, p: Vec3) -> bool {
        const WITHIN: f32 = 1.0 - 1e-5;
        let Some(grid) = &self.trained.occupancy else { return true };
        let (centre, half) = (grid.bounds().centre(), 0.5 * WITHIN * grid.bounds().size());
        grid.is_occupied(if self.closed { centre + (p - centre).clamp(-half, half) } else { p })
    }

    /// Evaluates direction and colour of each point as seen from each viewpoint, `[points, viewpoints]`.
    pub(super) fn colors(&self, points: &[Vec3], voxel: f32) -> Vec<(Vec3, Vec3)> {
        let count = self.viewpoints.len();
        let of_chunk = |points: &[Vec3]| -> Vec<(Vec3, Vec3)> {
            let places: Vec<Vec3> = points.iter().flat_map(|&p| std::iter::repeat_n(p, count)).collect();
            let direction = |&p: &Vec3| {
                let place = self.warp.world(p);
                self.viewpoints.iter().map(move |&eye| (place - eye).normalize_or(Vec3::Z))
            };
            let directions: Vec<Vec3> = points.iter().flat_map(direction).collect();
            let color = self.evaluate(&places, &directions, voxel, true).color.expect("colour was requested");
            directions.into_iter().zip(to_host(color).chunks_exact(3).map(Vec3::from_slice)).collect()
        };
        points.chunks((CHUNK / count).max(1)).flat_map(of_chunk).collect()
    }

    /// Evaluates the field at points that represent cubes of the size of a pixel's footprint from the nearest training
    /// camera, or of a voxel if that is larger. The size matters only to fields of volumes, which are not warped.
    fn evaluate(&self, points: &[Vec3], directions: &[Vec3], voxel: f32, color: bool) -> FieldOutput {
        let distance = |p: &Vec3| {
            let nearest = self.cameras.iter().map(|camera| camera.distance(*p)).reduce(f32::min);
            nearest.unwrap_or(1.0).max(self.nearest)
        };
        let t: Vec<f32> = points.iter().map(distance).collect();
        let edges: Vec<f32> = t.iter().map(|t| (self.pixel * t).max(voxel)).collect();
        // The cone has the same variance across the ray as along it: edge²/12.
        let radii: Vec<f32> = t.iter().zip(&edges).map(|(t, edge)| edge / (3f32.sqrt() * t)).collect();
        let (field, count) = (&self.trained.model.fine, points.len());
        let device = field.device();
        let [t, delta, radii] = [t, edges, radii].map(|numbers| upload(numbers, [count], &device));
        let extent = Extent::Cones { t, delta, radii };
        let positions = points.iter().flat_map(|p| p.to_array()).collect();
        evaluate_at(field, positions, Some(directions), extent, color, self.trained.at)
    }
}

/// Chooses viewpoints far apart: the first camera, then the farthest from those before; without cameras, six around the scene.
fn viewpoints(scene: &Scene) -> Vec<Vec3> {
    let views = scene.train.iter().map(|view| view.camera.position());
    let places: Vec<Vec3> = views.chain(scene.all_train_cameras.iter().map(|camera| camera.position())).collect();
    let Some(&first) = places.first() else {
        let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        return axes.map(|axis| scene.space.centre + scene.space.radius * axis).collect();
    };
    let mut viewpoints = vec![first];
    while viewpoints.len() < MAX_VIEWPOINTS {
        let apart = |place: &Vec3| viewpoints.iter().map(|eye| eye.distance(*place)).fold(f32::INFINITY, f32::min);
        match places.iter().max_by(|a, b| apart(a).total_cmp(&apart(b))) {
            Some(&farthest) if apart(&farthest) > 0.0 => viewpoints.push(farthest),
            _ => break,
        }
    }
    viewpoints
}
