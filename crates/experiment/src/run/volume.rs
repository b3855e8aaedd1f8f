//! The fields of a run as a [`Volume`], for export.

use glam::Vec3;
use infonerf_export::Volume;
use infonerf_field::{Extent, FieldOutput};
use infonerf_ops::to_host;
use infonerf_render::{TrainedModel, evaluate_at};
use infonerf_scene::Aabb;

use super::Trained;

/// Number of points at which a field is evaluated at a time, which bounds the memory.
const CHUNK: usize = 1 << 15;
/// Minimum weight of a field's colour, so that the mean is defined at points where no field has any opacity.
const MIN_WEIGHT: f32 = 1e-6;

/// Density and colour of all fields of a run together, at points in the scene's world coordinates, also for fields that learned
/// their cameras. Space that renders skip as empty has zero density.
///
/// The transmittance of several fields over a step of length h is the mean of theirs, `exp(−σh) = mean exp(−σᵢh)`. Their colour
/// is the mean with weights `1 − exp(−σᵢh)`. So there is a surface where most of the fields have one.
impl Volume for Trained {
    fn bounds(&self) -> Aabb {
        self.scene().space.bounds
    }

    fn density(&self, points: &[Vec3]) -> Vec<f32> {
        let of_model = |model: &TrainedModel| self.densities(model, &self.warped(model, points));
        let of_models: Vec<Vec<f32>> = self.models.iter().map(of_model).collect();
        let cameras: Vec<Vec3> = self.scene().train.iter().map(|view| view.camera.position()).collect();
        let step = self.step_length();
        let of_point = |(index, &p): (usize, &Vec3)| {
            // The derivative of the warp's coordinate per scene unit is that seen from the nearest training camera.
            let nearest = cameras.iter().map(|camera| camera.distance(p)).fold(f32::INFINITY, f32::min);
            let density = mean_density(of_models.iter().map(|densities| densities[index]), step);
            density * self.renderer().warp().rate(nearest)
        };
        points.iter().enumerate().map(of_point).collect()
    }

    fn color(&self, points: &[Vec3], directions: &[Vec3]) -> Vec<[f32; 3]> {
        let (mut sums, mut weights) = (vec![Vec3::ZERO; points.len()], vec![0.0; points.len()]);
        let step = self.step_length();
        for model in &self.models {
            let mut start = 0;
            let turned: Vec<Vec3> = match model.frame {
                Some(frame) => directions.iter().map(|&d| frame.similarity.direction(d)).collect(),
                None => directions.to_vec(),
            };
            for (points, directions) in self.warped(model, points).chunks(CHUNK).zip(turned.chunks(CHUNK)) {
                let FieldOutput { sigma, color } = self.output(model, points, Some(directions));
                let color = to_host(color.expect("colour was asked for"));
                for (i, (sigma, color)) in to_host(sigma).into_iter().zip(color.chunks_exact(3)).enumerate() {
                    let weight = MIN_WEIGHT - (-sigma * step).exp_m1();
                    sums[start + i] += weight * Vec3::from_slice(color);
                    weights[start + i] += weight;
                }
                start += points.len();
            }
        }
        let mean = |(sum, weight): (Vec3, f32)| (sum / weight).clamp(Vec3::ZERO, Vec3::ONE).to_array();
        sums.into_iter().zip(weights).map(mean).collect()
    }
}

impl Trained {
    /// Returns the step length h of the renderer, the minimum over the fields, in the coordinate of the warp.
    fn step_length(&self) -> f32 {
        self.models.iter().map(|model| self.renderer().step_length(model.at)).fold(f32::INFINITY, f32::min)
    }

    /// Returns the inputs of a field at points of the scene: in the frame that the field was trained in, and warped.
    fn warped(&self, model: &TrainedModel, points: &[Vec3]) -> Vec<Vec3> {
        let there = |p: Vec3| model.frame.map_or(p, |frame| frame.similarity.point(p));
        points.iter().map(|&p| self.renderer().warp().point(there(p))).collect()
    }

    /// Returns the densities of one field in the coordinate of the warp; 0 in cells that are empty in its occupancy grid.
    fn densities(&self, model: &TrainedModel, warped: &[Vec3]) -> Vec<f32> {
        let is_open = |p: Vec3| model.occupancy.as_ref().is_none_or(|grid| grid.is_occupied(p));
        let open: Vec<usize> = (0..warped.len()).filter(|&index| is_open(warped[index])).collect();
        let scale = model.scale();
        let mut densities = vec![0.0; warped.len()];
        for asked in open.chunks(CHUNK) {
            let points: Vec<Vec3> = asked.iter().map(|&index| warped[index]).collect();
            let sigma = self.output(model, &points, None).sigma;
            for (&index, sigma) in asked.iter().zip(to_host(sigma)) {
                densities[index] = scale * sigma;
            }
        }
        densities
    }

    /// Evaluates a field at points that are not on rays, each as a ball of the variance of a step, `step²/12`.
    fn output(&self, model: &TrainedModel, points: &[Vec3], directions: Option<&[Vec3]>) -> FieldOutput {
        let extent = Extent::Ball { variance: self.step_length().powi(2) / 12.0 };
        let positions = points.iter().flat_map(|p| p.to_array()).collect();
        evaluate_at(&model.model.fine, positions, directions, extent, directions.is_some(), model.at)
    }
}

/// Returns the density σ with `exp(−σh) = mean exp(−σᵢh)`, computed as the minimum σᵢ plus a correction, for accuracy.
fn mean_density(densities: impl ExactSizeIterator<Item = f32> + Clone, step: f32) -> f32 {
    let count = densities.len() as f32;
    let least = densities.clone().fold(f32::INFINITY, f32::min);
    let passes = densities.map(|density| (-(density - least) * step).exp()).sum::<f32>() / count;
    least - passes.ln() / step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_density_lets_through_the_mean() {
        for densities in [[0.0, 0.0], [3.0, 3.0], [0.0, 1e6], [40.0, 2.5], [1e6, 1.0001e6]] {
            let step = 0.02;
            let passes = densities.map(|density| f64::from(-density * step).exp()).iter().sum::<f64>() / 2.0;
            let found = mean_density(densities.into_iter(), step);
            assert!(found >= densities[0].min(densities[1]) && found.is_finite());
            assert!((f64::from(-found * step).exp() - passes).abs() < 1e-6, "{densities:?}: {found}");
        }
        assert_eq!(mean_density([7.0].into_iter(), 0.1), 7.0);
    }
}
