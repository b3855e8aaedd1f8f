//! The factored field by plain tensor operations, on any backend.

use std::sync::Arc;

use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Int, Tensor};

use super::Query;
use super::layout::{FactoredLayout, Level, PLANES};
use crate::mlp::{Activation, Dense, Precision, dense};

/// Computes [`factored_field`](super::factored_field) without host kernels, and without kernels that read tables.
pub fn plain(
    tables: Tensor<1>,
    weights: Tensor<1>,
    layout: &Arc<FactoredLayout>,
    query: Query,
) -> (Tensor<1>, Option<Tensor<2>>) {
    let mut features = vec![frequencies(&query)];
    for (level, &weight) in layout.levels.iter().zip(&query.level_weights) {
        for (p, axes) in PLANES.into_iter().enumerate() {
            features.push(plane_by_line(&tables, level, p, axes, &query.positions) * weight);
        }
    }
    evaluate_mlp(Tensor::cat(features, 1), weights, layout, &query)
}

/// Computes density, `[M]`, and colour, `[M, 3]`, from the MLP's input, `[M, layout.features()]`.
pub(super) fn evaluate_mlp(
    features: Tensor<2>,
    weights: Tensor<1>,
    layout: &FactoredLayout,
    query: &Query,
) -> (Tensor<1>, Option<Tensor<2>>) {
    let samples = query.samples();
    let mut x = features;
    for (index, layer) in layout.layers.iter().enumerate() {
        let rows = weights.clone().narrow(0, layer.weight, layer.inputs * layer.outputs);
        let weight = rows.reshape([layer.outputs, layer.inputs]).transpose();
        let bias = weights.clone().narrow(0, layer.bias(), layer.outputs);
        let activation = if index + 1 < layout.layers.len() { Activation::Relu } else { Activation::None };
        x = dense(x, &Dense { weight, bias }, activation, Precision::F32);
    }
    let density = x.clone().narrow(1, 0, 1) + layout.density_bias;
    // ln(1 + e^x), accurate where it is small, and without overflow where it is large.
    let sigma = (relu(density.clone()) + (-density.abs()).exp().log1p()) * layout.density_scale;
    let sigma = sigma.squeeze_dim(1);
    if !query.color {
        return (sigma, None);
    }
    let mut color = x.clone().narrow(1, 1, 3);
    if layout.view_dependent {
        let directions = query.directions.clone().expect("colour depends on directions").detach();
        let derivatives = x.narrow(1, 4, 9).reshape([samples, 3, 3]);
        color = color + (derivatives * directions.unsqueeze_dim(1)).sum_dim(2).reshape([samples, 3]);
    }
    (sigma, Some(sigmoid(color)))
}

/// Computes 2u − 1, then for each frequency sin and cos of 2ᵏπ(u − ½) of each axis.
fn frequencies(query: &Query) -> Tensor<2> {
    let u = query.positions.clone();
    let centred = u.clone() - 0.5;
    let waves = query.frequency_weights.iter().enumerate().map(|(frequency, weight)| {
        let phase = centred.clone() * (std::f64::consts::PI * 2f64.powi(frequency as i32));
        let pairs: Tensor<3> = Tensor::stack(vec![phase.clone().sin(), phase.cos()], 2);
        pairs.reshape([-1, 6]) * *weight
    });
    Tensor::cat(std::iter::once(u * 2.0 - 1.0).chain(waves).collect(), 1)
}

/// Computes plane(u_a, u_b) ⊙ line(u_c), `[M, C]`.
fn plane_by_line(tables: &Tensor<1>, level: &Level, p: usize, axes: [usize; 3], positions: &Tensor<2>) -> Tensor<2> {
    let (res, channels) = (level.resolution, level.channels);
    let table = |start, rows| tables.clone().narrow(0, start, rows * channels).reshape([rows, channels]);
    let (plane, line) = (table(level.plane(p), res * res), table(level.line(p), res));
    let [(a, a_shares), (b, b_shares), (c, c_shares)] =
        axes.map(|axis| texel(positions.clone().narrow(1, axis, 1), res));
    let read = |table: &Tensor<2>, rows: Tensor<2, Int>| table.clone().select(0, rows.squeeze_dim::<1>(1));
    let corner = |i: usize, j: usize| {
        let rows = (b.clone() + j as i32) * res as i32 + a.clone() + i as i32;
        read(&plane, rows) * (a_shares[i].clone() * b_shares[j].clone())
    };
    let end = |i: usize| read(&line, c.clone() + i as i32) * c_shares[i].clone();
    (corner(0, 0) + corner(1, 0) + corner(0, 1) + corner(1, 1)) * (end(0) + end(1))
}

/// Finds the texel before each coordinate, and the weights of that texel and of the next. Texel centres lie at (i + ½)/res.
fn texel(u: Tensor<2>, resolution: usize) -> (Tensor<2, Int>, [Tensor<2>; 2]) {
    let v = (u * resolution as f32 - 0.5).clamp(0.0, (resolution - 1) as f32 - 1e-3);
    let before = v.clone().detach().floor();
    let behind = v - before.clone();
    (before.int(), [behind.clone().neg() + 1.0, behind])
}
