//! The factored field and the variation of its planes, one sample at a time.

use infonerf_ops::factored::{FactoredLayout, Level, PLANES, Query};
use infonerf_ops::to_host;

const OUTPUTS: usize = 4;

/// Evaluates [`factored_field`](infonerf_ops::factored_field) at `positions`, with everything else as in `query`.
pub fn value(tables: &[f64], weights: &[f64], positions: &[f64], layout: &FactoredLayout, query: &Query) -> Vec<f64> {
    let field = FactoredOracle { tables, weights, positions, directions: directions(query), layout, query };
    (0..positions.len() / 3).flat_map(|sample| field.outputs(sample, &field.trace(sample))).collect()
}

/// Computes the gradients of ⟨`grad`, output⟩ with respect to `tables`, `weights` and `positions`.
pub fn gradient(
    tables: &[f64],
    weights: &[f64],
    positions: &[f64],
    layout: &FactoredLayout,
    query: &Query,
    grad: &[f64],
) -> [Vec<f64>; 3] {
    let field = FactoredOracle { tables, weights, positions, directions: directions(query), layout, query };
    let [mut dtables, mut dweights, mut dpositions] = [tables, weights, positions].map(|input| vec![0.0; input.len()]);
    for (sample, grad) in grad.chunks_exact(if query.color { OUTPUTS } else { 1 }).enumerate() {
        let trace = field.trace(sample);
        let dx = field.mlp_gradient(&trace, field.raw_gradient(sample, &trace, grad), &mut dweights);
        field.table_gradient(sample, &dx, &mut dtables);
        field.position_gradient(sample, &trace[0], &dx, &mut dpositions[3 * sample..3 * sample + 3]);
    }
    [dtables, dweights, dpositions]
}

struct FactoredOracle<'a> {
    tables: &'a [f64],
    weights: &'a [f64],
    positions: &'a [f64],
    directions: Vec<f64>,
    layout: &'a FactoredLayout,
    query: &'a Query,
}

fn directions(query: &Query) -> Vec<f64> {
    query.directions.clone().map(to_host).unwrap_or_default().into_iter().map(f64::from).collect()
}

/// Terms of an interpolation: index of a table's element, and its weight.
type Terms = Vec<(usize, f64)>;

impl FactoredOracle<'_> {
    fn position(&self, sample: usize, axis: usize) -> f64 {
        self.positions[3 * sample + axis]
    }

    /// Returns the two texels around a coordinate with their weights, or with the derivatives of their weights if `moved`.
    fn texels(&self, sample: usize, axis: usize, resolution: usize, moved: bool) -> [(usize, f64); 2] {
        let (size, last) = (resolution as f64, (resolution - 1) as f64 - 1e-3);
        let v = self.position(sample, axis) * size - 0.5;
        let derivative = if v > 0.0 && v < last { size } else { 0.0 };
        let v = v.min(last).max(0.0);
        let [first, second] = if moved { [-derivative, derivative] } else { [1.0 - v.fract(), v.fract()] };
        [(v as usize, first), (v as usize + 1, second)]
    }

    /// Lists the terms of feature `k` of plane `p`, and of its line; weights along axis `moved` are replaced by their derivatives.
    fn terms(&self, sample: usize, level: &Level, p: usize, k: usize, moved: Option<usize>) -> (Terms, Terms) {
        let [a, b, c] = PLANES[p].map(|axis| self.texels(sample, axis, level.resolution, moved == Some(axis)));
        let place = |j: usize, i: usize| level.plane(p) + (j * level.resolution + i) * level.channels + k;
        let plane = b.into_iter().flat_map(|(j, v)| a.map(|(i, u)| (place(j, i), u * v))).collect();
        let line = c.into_iter().map(|(i, w)| (level.line(p) + i * level.channels + k, w)).collect();
        (plane, line)
    }

    fn interpolate(&self, terms: &Terms) -> f64 {
        terms.iter().map(|&(at, weight)| weight * self.tables[at]).sum()
    }

    /// Lists all features: column of the MLP's input, weight of the level, [`Self::terms`] of the plane and of the line.
    fn features(&self, sample: usize, moved: Option<usize>) -> impl Iterator<Item = (usize, f64, Terms, Terms)> + '_ {
        let levels = self.layout.levels.iter().zip(&self.query.level_weights);
        levels.flat_map(move |(level, &weight)| {
            (0..3 * level.channels).map(move |f| {
                let (plane, line) = self.terms(sample, level, f / level.channels, f % level.channels, moved);
                (level.feature + f, f64::from(weight), plane, line)
            })
        })
    }

    /// Computes the MLP's input and the output of each layer, the last one before its activation.
    fn trace(&self, sample: usize) -> Vec<Vec<f64>> {
        let mut x = vec![0.0; self.layout.features()];
        for axis in 0..3 {
            let u = self.position(sample, axis);
            x[axis] = 2.0 * u - 1.0;
            for (frequency, &weight) in self.query.frequency_weights.iter().enumerate() {
                let phase = (1u64 << frequency) as f64 * std::f64::consts::PI * (u - 0.5);
                x[3 + 6 * frequency + 2 * axis] = f64::from(weight) * phase.sin();
                x[4 + 6 * frequency + 2 * axis] = f64::from(weight) * phase.cos();
            }
        }
        for (at, weight, plane, line) in self.features(sample, None) {
            x[at] = weight * self.interpolate(&plane) * self.interpolate(&line);
        }
        let mut trace = vec![x];
        for (index, layer) in self.layout.layers.iter().enumerate() {
            let x = &trace[index];
            let row = |o: usize| {
                let w = &self.weights[layer.weight + o * layer.inputs..][..layer.inputs];
                let sum = self.weights[layer.bias() + o] + w.iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
                if index + 1 < self.layout.layers.len() { sum.max(0.0) } else { sum }
            };
            let y = (0..layer.outputs).map(row).collect();
            trace.push(y);
        }
        trace
    }

    fn raw_color(&self, sample: usize, raw: &[f64], channel: usize) -> f64 {
        let axes = if self.layout.view_dependent { 0..3 } else { 0..0 };
        raw[1 + channel]
            + axes.map(|axis| raw[4 + 3 * channel + axis] * self.directions[3 * sample + axis]).sum::<f64>()
    }

    fn outputs(&self, sample: usize, trace: &[Vec<f64>]) -> Vec<f64> {
        let raw = &trace[trace.len() - 1];
        let x = raw[0] + f64::from(self.layout.density_bias);
        let mut out = vec![f64::from(self.layout.density_scale) * (x.max(0.0) + (-x.abs()).exp().ln_1p())];
        if self.query.color {
            out.extend((0..3).map(|channel| sigmoid(self.raw_color(sample, raw, channel))));
        }
        out
    }

    fn raw_gradient(&self, sample: usize, trace: &[Vec<f64>], grad: &[f64]) -> Vec<f64> {
        let raw = &trace[trace.len() - 1];
        let mut draw = vec![0.0; raw.len()];
        let derivative = sigmoid(raw[0] + f64::from(self.layout.density_bias));
        draw[0] = grad[0] * f64::from(self.layout.density_scale) * derivative;
        for (channel, g) in grad[1..].iter().enumerate() {
            let x = self.raw_color(sample, raw, channel);
            let d = g * sigmoid(x) * sigmoid(-x);
            draw[1 + channel] = d;
            if self.layout.view_dependent {
                for axis in 0..3 {
                    draw[4 + 3 * channel + axis] = d * self.directions[3 * sample + axis];
                }
            }
        }
        draw
    }

    /// Adds the gradient of the weights to `dweights`, and returns the gradient of the MLP's input.
    fn mlp_gradient(&self, trace: &[Vec<f64>], mut dy: Vec<f64>, dweights: &mut [f64]) -> Vec<f64> {
        for (index, layer) in self.layout.layers.iter().enumerate().rev() {
            if index + 1 < self.layout.layers.len() {
                for (d, y) in dy.iter_mut().zip(&trace[index + 1]) {
                    *d = if *y > 0.0 { *d } else { 0.0 };
                }
            }
            let mut dx = vec![0.0; layer.inputs];
            for (o, d) in dy.iter().enumerate() {
                dweights[layer.bias() + o] += d;
                for (i, x) in trace[index].iter().enumerate() {
                    let at = layer.weight + o * layer.inputs + i;
                    dweights[at] += d * x;
                    dx[i] += d * self.weights[at];
                }
            }
            dy = dx;
        }
        dy
    }

    fn position_gradient(&self, sample: usize, x: &[f64], dx: &[f64], out: &mut [f64]) {
        for (axis, out) in out.iter_mut().enumerate() {
            *out = 2.0 * dx[axis];
            for frequency in 0..self.query.frequency_weights.len() {
                let (sine, cosine) = (3 + 6 * frequency + 2 * axis, 4 + 6 * frequency + 2 * axis);
                let scale = (1u64 << frequency) as f64 * std::f64::consts::PI;
                *out += scale * (dx[sine] * x[cosine] - dx[cosine] * x[sine]);
            }
            for (at, weight, plane, line) in self.features(sample, Some(axis)) {
                // An axis belongs to the plane or to the line: `terms` differentiates one factor, and keeps the other.
                *out += dx[at] * weight * (self.interpolate(&plane) * self.interpolate(&line));
            }
        }
    }

    fn table_gradient(&self, sample: usize, dx: &[f64], dtables: &mut [f64]) {
        for (at, weight, plane, line) in self.features(sample, None) {
            let d = dx[at] * weight;
            let (on_plane, on_line) = (self.interpolate(&plane), self.interpolate(&line));
            plane.into_iter().for_each(|(place, share)| dtables[place] += d * on_line * share);
            line.into_iter().for_each(|(place, share)| dtables[place] += d * on_plane * share);
        }
    }
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Computes [`plane_variation`](infonerf_ops::plane_variation) and its gradient.
pub fn variation(tables: &[f64], layout: &FactoredLayout) -> (f64, Vec<f64>) {
    let (mut sum, mut gradient) = (0.0, vec![0.0; tables.len()]);
    for level in &layout.levels {
        let (r, c) = (level.resolution, level.channels);
        let weight = 1.0 / (64.0 * 3.0 * r as f64);
        for p in 0..3 {
            let place = |y: usize, x: usize, k: usize| level.plane(p) + (y * r + x) * c + k;
            for (y, x) in (0..r).flat_map(|y| (0..r).map(move |x| (y, x))) {
                for (next, inside) in [((y + 1, x), y + 1 < r), ((y, x + 1), x + 1 < r)] {
                    for k in (0..c).filter(|_| inside) {
                        let (a, b) = (place(y, x, k), place(next.0, next.1, k));
                        let difference = tables[b] - tables[a];
                        sum += weight * difference * difference;
                        gradient[a] -= 2.0 * weight * difference;
                        gradient[b] += 2.0 * weight * difference;
                    }
                }
            }
        }
    }
    (sum, gradient)
}
