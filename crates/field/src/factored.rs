//! A field factored into planes and lines with a tiny MLP: the fast one.

use std::sync::Arc;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::factored::{Layout, Query, factored_field, plane_variation};
use rand::Rng;

use crate::{FactoredConfig, Points, Sampled, init::uniform};

/// Planes ⊙ lines → features → MLP → density and colour, in one operation: see [`infonerf_ops::factored`].
///
/// Colour is at most linear in the direction: with a handful of views, a colour that follows the direction freely explains
/// the views without getting the shape right.
#[derive(Module, Debug)]
pub struct FactoredField {
    tables: Param<Tensor<1>>,
    weights: Param<Tensor<1>>,
    #[module(skip)]
    layout: Arc<Layout>,
    #[module(skip)]
    config: FactoredConfig,
    #[module(skip)]
    bounds: [[f32; 3]; 2],
}

impl FactoredField {
    /// A field over the box from `bounds[0]` to `bounds[1]`.
    pub(crate) fn new(config: &FactoredConfig, bounds: [[f32; 3]; 2], rng: &mut impl Rng, device: &Device) -> Self {
        let levels: Vec<(usize, usize)> = config.resolutions.iter().map(|&r| (r, config.channels)).collect();
        let longest = (0..3).map(|axis| bounds[1][axis] - bounds[0][axis]).fold(0.0, f32::max);
        let density = (config.density_scale / longest, config.density_bias);
        let layout =
            Layout::new(config.octaves, &levels, (config.layers, config.width), config.view_dependent, density);
        let mut tables = Vec::with_capacity(layout.table_len());
        for level in &layout.levels {
            tables.extend(uniform(rng, 3 * level.plane_len(), 0.1));
            tables.extend(uniform(rng, 3 * level.line_len(), 0.17).into_iter().map(|x| 1.0 + x));
        }
        let mut weights = Vec::with_capacity(layout.weight_len());
        for (index, layer) in layout.layers.iter().enumerate() {
            let gain = if index + 1 == layout.layers.len() { 0.5 } else { 1.0 };
            let mut matrix = uniform(rng, layer.inputs * layer.outputs, gain * (6.0 / layer.inputs as f32).sqrt());
            if index + 1 == layout.layers.len() {
                // Colour does not depend on the direction before training.
                matrix[4 * layer.inputs..].fill(0.0);
            }
            weights.extend(matrix);
            weights.extend(std::iter::repeat_n(0.0, layer.outputs));
        }
        let parameter = |values: Vec<f32>| {
            let length = values.len();
            Param::from_data(TensorData::new(values, [length]), device)
        };
        Self {
            tables: parameter(tables),
            weights: parameter(weights),
            layout: Arc::new(layout),
            config: config.clone(),
            bounds,
        }
    }

    pub(crate) fn evaluate(&self, points: Points<'_>, color: bool, progress: f32) -> Sampled {
        let [low, high] = self.bounds;
        let scale = [0, 1, 2].map(|axis| 1.0 / (high[axis] - low[axis]));
        let mut positions = points.positions.to_vec();
        for p in positions.chunks_exact_mut(3) {
            for axis in 0..3 {
                // Beyond the box the border goes on.
                p[axis] = ((p[axis] - low[axis]) * scale[axis]).clamp(0.0, 1.0);
            }
        }
        let positions: Arc<[f32]> = positions.into();
        let samples = positions.len() / 3;
        let open = if self.config.anneal > 0.0 { (progress / self.config.anneal).min(1.0) } else { 1.0 };
        let directions: Arc<[f32]> = if color && self.config.view_dependent {
            let mut directions = Vec::with_capacity(3 * samples);
            for (ray, range) in points.directions.chunks_exact(3).zip(points.segments.ranges()) {
                for _ in range {
                    directions.extend_from_slice(ray);
                }
            }
            directions.into()
        } else {
            Arc::new([])
        };
        let query = Query {
            positions,
            directions,
            octave_weights: fade(self.config.octaves, 2.0, open),
            level_weights: fade(self.layout.levels.len(), 1.0, open),
            color,
        };
        let out = factored_field(self.tables.val(), self.weights.val(), &self.layout, query);
        Sampled { sigma: out.clone().narrow(1, 0, 1).reshape([samples]), color: color.then(|| out.narrow(1, 1, 3)) }
    }

    /// Total variation of the planes; a scalar.
    pub(crate) fn variation(&self) -> Tensor<1> {
        plane_variation(self.tables.val(), &self.layout)
    }

    pub(crate) fn device(&self) -> Device {
        self.tables.val().device()
    }
}

/// Weights of `count` parts, the first `start` of them there from the beginning, the others one after another.
fn fade(count: usize, start: f32, open: f32) -> Vec<f32> {
    let there = start + (count as f32 - start).max(0.0) * open;
    (0..count).map(|part| (there - part as f32).clamp(0.0, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fade_in_one_after_another() {
        assert_eq!(fade(4, 1.0, 0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(fade(4, 1.0, 0.5), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(fade(4, 1.0, 1.0), [1.0; 4]);
        assert_eq!(fade(1, 2.0, 0.3), [1.0]);
    }
}
