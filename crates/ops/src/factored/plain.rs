//! The same field from plain tensor operations, on any backend.

use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Int, Tensor, TensorData};

use super::Query;
use super::layout::{Layout, Level, PLANES};

/// [`factored_field`](super::factored_field) without any kernel.
pub fn plain(tables: Tensor<1>, weights: Tensor<1>, layout: &Layout, query: &Query) -> Tensor<2> {
    mlp(features(tables, layout, query), weights, layout, query)
}

/// The MLP's input, `[M, layout.features()]`.
fn features(tables: Tensor<1>, layout: &Layout, query: &Query) -> Tensor<2> {
    let mut features = vec![frequencies(query, &tables.device())];
    for (level, &weight) in layout.levels.iter().zip(&query.level_weights) {
        for (p, axes) in PLANES.into_iter().enumerate() {
            features.push(product(&tables, level, p, axes, &query.positions) * weight);
        }
    }
    Tensor::cat(features, 1)
}

/// Density and colour, given the MLP's input.
pub(super) fn mlp(features: Tensor<2>, weights: Tensor<1>, layout: &Layout, query: &Query) -> Tensor<2> {
    let device = features.device();
    let samples = query.positions.len() / 3;
    let mut x = features;
    for (index, layer) in layout.layers.iter().enumerate() {
        let w = weights
            .clone()
            .narrow(0, layer.weight, layer.inputs * layer.outputs)
            .reshape([layer.outputs, layer.inputs]);
        let bias = weights.clone().narrow(0, layer.bias(), layer.outputs).unsqueeze::<2>();
        x = x.matmul(w.transpose()) + bias;
        if index + 1 < layout.layers.len() {
            x = relu(x);
        }
    }
    let sigma = softplus(x.clone().narrow(1, 0, 1) + layout.density_bias) * layout.density_scale;
    if !query.color {
        return sigma;
    }
    let mut color = x.clone().narrow(1, 1, 3);
    if layout.view_dependent {
        let directions = Tensor::<3>::from_data(TensorData::new(query.directions.to_vec(), [samples, 1, 3]), &device);
        let slopes = x.narrow(1, 4, 9).reshape([samples, 3, 3]);
        color = color + (slopes * directions).sum_dim(2).reshape([samples, 3]);
    }
    Tensor::cat(vec![sigma, sigmoid(color)], 1).reshape([samples, 4])
}

/// ln(1 + e^x) with all its digits where it is small, and without overflow where it is large.
fn softplus(x: Tensor<2>) -> Tensor<2> {
    relu(x.clone()) + (-x.abs()).exp().log1p()
}

fn frequencies(query: &Query, device: &burn::tensor::Device) -> Tensor<2> {
    let width = 3 + 6 * query.frequency_weights.len();
    let rows: Vec<f32> = query
        .positions
        .chunks_exact(3)
        .flat_map(|u| {
            let mut row = vec![0.0; width];
            for axis in 0..3 {
                row[axis] = 2.0 * u[axis] - 1.0;
                for (frequency, weight) in query.frequency_weights.iter().enumerate() {
                    let phase = (1u64 << frequency) as f32 * std::f32::consts::PI * (u[axis] - 0.5);
                    row[3 + frequency * 6 + axis * 2] = weight * phase.sin();
                    row[4 + frequency * 6 + axis * 2] = weight * phase.cos();
                }
            }
            row
        })
        .collect();
    Tensor::from_data(TensorData::new(rows, [query.positions.len() / 3, width]), device)
}

/// plane(u_a, u_b) ⊙ line(u_c), `[M, C]`.
fn product(tables: &Tensor<1>, level: &Level, p: usize, [a, b, c]: [usize; 3], positions: &[f32]) -> Tensor<2> {
    let (res, channels) = (level.resolution, level.channels);
    let table = |start, rows| tables.clone().narrow(0, start, rows * channels).reshape([rows, channels]);
    let (plane, line) = (table(level.plane(p), res * res), table(level.line(p), res));
    let at = |axis: usize| -> Vec<(usize, f32)> { positions.chunks_exact(3).map(|u| texel(u[axis], res)).collect() };
    let (a, b, c) = (at(a), at(b), at(c));
    let gather = |table: &Tensor<2>, rows: Vec<i32>, weights: Vec<f32>| {
        let device = table.device();
        let n = rows.len();
        let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [n]), &device);
        let weights = Tensor::<2>::from_data(TensorData::new(weights, [n, 1]), &device);
        table.clone().select(0, rows) * weights
    };
    let corner = |di: usize, dj: usize| {
        let rows = a.iter().zip(&b).map(|(a, b)| ((b.0 + dj) * res + a.0 + di) as i32).collect();
        let share = |t: f32, d: usize| if d == 1 { t } else { 1.0 - t };
        gather(&plane, rows, a.iter().zip(&b).map(|(a, b)| share(a.1, di) * share(b.1, dj)).collect())
    };
    let end = |d: usize| {
        let rows = c.iter().map(|c| (c.0 + d) as i32).collect();
        gather(&line, rows, c.iter().map(|c| if d == 1 { c.1 } else { 1.0 - c.1 }).collect())
    };
    (corner(0, 0) + corner(1, 0) + corner(0, 1) + corner(1, 1)) * (end(0) + end(1))
}

/// The texel before `u` along an axis, and how far behind it `u` is. Texel centres lie at (i + ½)/res.
fn texel(u: f32, resolution: usize) -> (usize, f32) {
    let v = (u * resolution as f32 - 0.5).clamp(0.0, (resolution - 1) as f32 - 1e-3);
    (v as usize, v - (v as usize) as f32)
}
