//! A field factored into planes and lines with a tiny MLP: the field of preset `fast`.

use std::fmt;
use std::sync::Arc;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use infonerf_ops::HostField;
use infonerf_ops::factored::{FactoredLayout, Query, factored_field, on_host, plane_variation};
use infonerf_ops::unit_box::{share_of_box, unit_box};
use infonerf_schedule::{Fault, Moment, Schedule};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_density, check_detail, check_range};
use crate::detail::part_weights;
use crate::field::{Field, FieldSetup, FieldSpec, Footprint, Penalty};
use crate::init::{parameter, uniform};
use crate::points::{FieldOutput, Points};

/// Sizes of [`FactoredField`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactoredConfig {
    /// Texels along each axis of each level, coarsest first.
    pub resolutions: Vec<usize>,
    /// Features of each plane and line: 2, 4, 8 or 16.
    pub channels: usize,
    /// Frequencies of the position's encoding.
    pub frequencies: usize,
    /// Hidden layers of the MLP.
    pub layers: usize,
    /// Width of the MLP.
    pub width: usize,
    /// Factor v, 0 to 1, in the colour sigmoid(a + v·B d) in direction d, where the MLP gives a and the 3 × 3 matrix B.
    /// With 0, colour does not depend on d. As Adam's step size does not depend on v, v scales the rate at which B is
    /// learned: with a smaller v, shape explains more of the views.
    pub view_dependence: f32,
    /// s in σ = s·softplus(x + b), relative to the longest side of the scene's box: training does not depend on the
    /// scene's units.
    pub density_scale: f32,
    /// b in σ = s·softplus(x + b), which sets the initial density.
    pub density_bias: f32,
    /// Share of the finer levels and higher frequencies in use, coarsest first; 1 for all.
    pub detail: Schedule,
    /// Max share of the sum of all samples' gradients, 0 to 0.1, that the backward pass may omit: it skips the samples
    /// with the smallest gradients. 0 skips zeros alone. Only CPUs skip samples.
    #[serde(default)]
    pub negligible: f32,
}

impl fmt::Display for FactoredConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let finest = self.resolutions.iter().max().copied().unwrap_or(0);
        write!(f, "planes and lines of up to {finest} texels with an MLP of {} layers of {}", self.layers, self.width)
    }
}

impl FieldSpec for FactoredConfig {
    type Field = FactoredField;

    fn validate(&self) -> Result<(), Fault> {
        let good = (1..=8).contains(&self.resolutions.len()) && self.resolutions.iter().all(|r| (2..=2048).contains(r));
        check("resolutions", "1 to 8 numbers from 2 to 2048", format!("{:?}", self.resolutions), good)?;
        check("channels", "2, 4, 8 or 16", self.channels, [2, 4, 8, 16].contains(&self.channels))?;
        check_range("frequencies", 0..=10, self.frequencies)?;
        check_range("layers", 0..=8, self.layers)?;
        check_range("width", 1..=256, self.width)?;
        check_range("view_dependence", 0.0..=1.0, self.view_dependence)?;
        check_density(self.density_scale, self.density_bias)?;
        check_range("negligible", 0.0..=0.1, self.negligible)?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<FactoredField, Fault> {
        let &FieldSetup { bounds, seed, device, .. } = setup;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let levels: Vec<(usize, usize)> = self.resolutions.iter().map(|&r| (r, self.channels)).collect();
        let density = (self.density_scale / setup.longest_side(), self.density_bias);
        let mlp = (self.layers, self.width);
        let layout = FactoredLayout::new(self.frequencies, &levels, mlp, self.view_dependence > 0.0, density);
        let mut tables = Vec::with_capacity(layout.table_len());
        for level in &layout.levels {
            tables.extend(uniform(&mut rng, 3 * level.plane_len(), 0.1));
            tables.extend(uniform(&mut rng, 3 * level.line_len(), 0.17).into_iter().map(|x| 1.0 + x));
        }
        let mut weights = Vec::with_capacity(layout.weight_len());
        for (index, layer) in layout.layers.iter().enumerate() {
            let gain = if index + 1 == layout.layers.len() { 0.5 } else { 1.0 };
            let mut matrix = uniform(&mut rng, layer.inputs * layer.outputs, gain * (6.0 / layer.inputs as f32).sqrt());
            if index + 1 == layout.layers.len() {
                // Colour does not depend on the direction before training.
                matrix[4 * layer.inputs..].fill(0.0);
            }
            weights.extend(matrix);
            weights.extend(std::iter::repeat_n(0.0, layer.outputs));
        }
        let tables = parameter(tables, [layout.table_len()], device);
        let weights = parameter(weights, [layout.weight_len()], device);
        Ok(FactoredField { tables, weights, layout: Arc::new(layout), config: self.clone(), bounds })
    }

    fn footprint(&self) -> Footprint {
        let texels: u64 = self.resolutions.iter().map(|&r| (r as u64).pow(2) + r as u64).sum();
        // Position, direction, distance, interval, density and colour; the kernel works through the rest in blocks.
        Footprint { parameters: 3 * self.channels as u64 * texels, per_sample: 12 }
    }
}

/// Planes ⊙ lines → features → MLP → density and colour, in one operation: see [`infonerf_ops::factored`].
///
/// Colour is at most linear in the direction before the sigmoid: with few views, a freely view-dependent colour would fit
/// them with a wrong shape.
#[derive(Module, Debug)]
pub struct FactoredField {
    tables: Param<Tensor<1>>,
    weights: Param<Tensor<1>>,
    #[module(skip)]
    layout: Arc<FactoredLayout>,
    #[module(skip)]
    config: FactoredConfig,
    #[module(skip)]
    bounds: [[f32; 3]; 2],
}

impl FactoredField {
    /// Returns planes and lines, `[layout.table_len()]`: see [`Self::layout`].
    pub fn tables(&self) -> Tensor<1> {
        self.tables.val()
    }

    /// Returns the MLP's weights, `[layout.weight_len()]`: see [`Self::layout`].
    pub fn weights(&self) -> Tensor<1> {
        self.weights.val()
    }

    /// Returns the layout of [`Self::tables`] and [`Self::weights`].
    pub fn layout(&self) -> &FactoredLayout {
        &self.layout
    }

    /// Returns the factor v on directions: [`FactoredConfig::view_dependence`].
    pub fn view_dependence(&self) -> f32 {
        self.config.view_dependence
    }

    /// Returns the corners of the box that the tables cover.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        self.bounds
    }

    /// Returns the weights of the frequencies and of the levels at a moment of the run, 0 before they fade in.
    pub fn detail(&self, at: Moment) -> (Vec<f32>, Vec<f32>) {
        let detail = self.config.detail.at(at);
        let levels = part_weights(self.layout.levels.len(), 1.0, detail);
        (part_weights(self.config.frequencies, 2.0, detail), levels)
    }
}

impl Field for FactoredField {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let (frequency_weights, level_weights) = self.detail(at);
        let v = self.config.view_dependence;
        let query = Query {
            positions: unit_box(points.positions.clone(), self.bounds),
            directions: (color && v > 0.0).then(|| points.segments.spread(points.directions.clone() * v)),
            frequency_weights,
            level_weights,
            color,
            negligible: self.config.negligible,
        };
        let (sigma, color) = factored_field(self.tables.val(), self.weights.val(), &self.layout, query);
        FieldOutput { sigma, color }
    }

    fn on_host(&self, at: Moment) -> Option<HostField> {
        let (bounds, v) = (self.bounds, self.config.view_dependence);
        let field = on_host(self.tables.val(), self.weights.val(), &self.layout, self.detail(at))?;
        Some(Box::new(move |positions, directions| {
            let positions: Vec<[f32; 3]> = positions.iter().map(|&p| share_of_box(p, bounds)).collect();
            let directions: Vec<[f32; 3]> = directions.iter().map(|d| d.map(|d| d * v)).collect();
            field(&positions, &directions)
        }))
    }

    fn penalty(&self, name: Penalty) -> Option<Tensor<1>> {
        (name == Penalty::TOTAL_VARIATION).then(|| plane_variation(self.tables.val(), &self.layout))
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use infonerf_ops::to_host;

    use super::*;
    use crate::points::Extent;

    fn field(view_dependence: f32, device: &Device) -> FactoredField {
        let config = FactoredConfig {
            resolutions: vec![4, 9],
            channels: 4,
            frequencies: 2,
            layers: 1,
            width: 8,
            view_dependence,
            density_scale: 10.0,
            density_bias: -1.0,
            detail: 0.7.into(),
            negligible: 0.0,
        };
        config.build(&FieldSetup { bounds: [[-1.0; 3], [1.0, 2.0, 3.0]], seed: 0, device, body: None }).unwrap()
    }

    #[test]
    fn evaluation_without_tensors_agrees() {
        let device = Device::flex();
        // More than a block, some beyond the box.
        let points: Vec<[f32; 3]> =
            (0..300).map(|i| [0, 1, 2].map(|axis| ((i * 7 + axis * 5) % 23) as f32 / 8.0 - 1.2)).collect();
        let directions: Vec<[f32; 3]> = points.iter().map(|p| [p[1], -p[0], 0.5]).collect();
        let upload = |rows: &[[f32; 3]]| infonerf_ops::upload(rows.as_flattened().to_vec(), [rows.len(), 3], &device);
        for view_dependence in [0.0, 0.5] {
            let field = field(view_dependence, &device);
            let at = Points::scattered(upload(&points), Extent::Ball { variance: 0.0 }).seen_along(upload(&directions));
            let FieldOutput { sigma, color } = field.evaluate(&at, true, Moment::START);
            let (sigma, color) = (to_host(sigma), to_host(color.unwrap()));
            let got = field.on_host(Moment::START).unwrap()(&points, &directions);
            for (i, got) in got.iter().enumerate() {
                let want = [sigma[i], color[3 * i], color[3 * i + 1], color[3 * i + 2]];
                let agrees = got.iter().zip(want).all(|(got, want)| (got - want).abs() <= 1e-6 * want.abs());
                assert!(agrees, "{i}: {got:?}, {want:?}");
            }
        }
        #[allow(deprecated, reason = "a CPU backend without our kernels")]
        let plain = field(0.5, &Device::ndarray());
        assert!(plain.on_host(Moment::START).is_none());
    }
}
