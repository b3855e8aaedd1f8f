//! A radiance field factored into planes and lines, with a tiny MLP behind it, as one operation.
//!
//! Each *level* holds three planes and three lines of `channels` features (the vector–matrix decomposition of
//! TensoRF, Chen et al. 2022): at u ∈ [0, 1]³ it gives plane_xy(u) ⊙ line_z(u), plane_xz ⊙ line_y and plane_yz ⊙ line_x,
//! interpolated linearly. The features of all levels, with a few frequencies of the position itself, go through an MLP of
//! ReLU layers to density σ = s·ln(1 + e^(x+b)) and colour 1/(1 + e^−(x + v·d)), linear in the view direction d within the
//! sigmoid (spherical harmonics of degree 1).
//!
//! Low-rank factors represent the fog that few views leave unconstrained less easily than a voxel grid does, and their
//! tables fit into a laptop's cache.

#[cfg(feature = "flex")]
mod backward;
#[cfg(feature = "flex")]
mod dense;
#[cfg(feature = "flex")]
mod encode;
#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod layout;
#[cfg(feature = "flex")]
mod negligible;
mod plain;
mod variation;

pub use layout::{FactoredLayout, Layer, Level, PLANES};
pub use plain::plain;
pub use variation::{plain as plain_variation, plane_variation};

use std::sync::Arc;

use burn::tensor::Tensor;

use crate::dispatch::dispatch;

/// Points at which a field is evaluated, and the level of detail.
#[derive(Clone, Debug)]
pub struct Query {
    /// Positions, each coordinate in [0, 1] over the field's box, `[M, 3]`.
    pub positions: Tensor<2>,
    /// View direction of each sample, `[M, 3]`, for colour that depends on it; it receives no gradient.
    pub directions: Option<Tensor<2>>,
    /// Weight of each frequency of the position's encoding, for annealing; one for each frequency of the layout.
    pub frequency_weights: Vec<f32>,
    /// Weight of each level's features, for annealing; one for each level of the layout. A level of weight 0 is skipped.
    pub level_weights: Vec<f32>,
    /// Whether to compute colour in addition to density.
    pub color: bool,
    /// Max share of the sum of all samples' output gradients that the backward pass may omit: it skips the samples with
    /// the smallest gradients. 0 skips zeros alone. Only the host kernel skips any.
    pub negligible: f32,
}

impl Query {
    pub(crate) fn samples(&self) -> usize {
        self.positions.dims()[0]
    }
}

/// Evaluates the field at the points of `query`: density σ, `[M]`, and red, green and blue, `[M, 3]`, if `query.color`.
///
/// With z the MLP's output for the features plane(u) ⊙ line(u) of all levels and the frequencies of u: σ = s·ln(1 + e^(z₀ + b)), and
/// colour is 1/(1 + e^−(z + v·d)), where v are nine further outputs if colour depends on the view direction d.
///
/// - `tables` `[layout.table_len()]`: planes and lines.
/// - `weights` `[layout.weight_len()]`: the MLP.
///
/// Differentiable in both, and in `query.positions` if these require a gradient (0 along an axis on which a position lies
/// beyond the outermost texels' centres). σ has the unit of `layout.density_scale`, 1/length.
///
/// # Panics
/// If a length does not match `layout`, or directions are missing although colour depends on them.
pub fn factored_field(
    tables: Tensor<1>,
    weights: Tensor<1>,
    layout: &Arc<FactoredLayout>,
    query: Query,
) -> (Tensor<1>, Option<Tensor<2>>) {
    check(&tables, &weights, layout, (&query.frequency_weights, &query.level_weights));
    dispatch! {
        &tables.device();
        host => {
            let directions = query.directions.clone().filter(|_| query.color && layout.view_dependent);
            let inputs = [tables.into_dispatch(), weights.into_dispatch(), query.positions.clone().into_dispatch()];
            let inputs = inputs.into_iter().chain(directions.map(Tensor::into_dispatch));
            let kernel = host::FactoredKernel { layout: layout.clone(), query };
            let shape = [kernel.query.samples(), kernel.outputs()];
            crate::mlp::split_density_and_color(crate::host::apply(kernel, shape, inputs))
        },
        cube if query.samples() > 0 => {
            plain::evaluate_mlp(gpu::features(tables, layout, &query), weights, layout, &query)
        },
        plain => plain(tables, weights, layout, query),
    }
}

/// Function from positions and view directions, one each per sample, to (σ, r, g, b), without tensors.
pub type HostField = Box<dyn Fn(&[[f32; 3]], &[[f32; 3]]) -> Vec<[f32; 4]> + Send + Sync>;

/// Returns [`factored_field`] with colour and weights `detail` of frequencies and levels as a function of the host, for
/// rendering; `None` on devices that the host kernels do not serve. Parameters are packed once; a call works in one thread.
///
/// # Panics
/// As [`factored_field`].
pub fn on_host(
    tables: Tensor<1>,
    weights: Tensor<1>,
    layout: &Arc<FactoredLayout>,
    detail: (Vec<f32>, Vec<f32>),
) -> Option<HostField> {
    check(&tables, &weights, layout, (&detail.0, &detail.1));
    dispatch! {
        &tables.device();
        host => Some(host::field(crate::to_host(tables), &crate::to_host(weights), layout.clone(), detail)),
        plain => None,
    }
}

fn check(tables: &Tensor<1>, weights: &Tensor<1>, layout: &FactoredLayout, (frequencies, levels): (&[f32], &[f32])) {
    assert_eq!(tables.dims(), [layout.table_len()], "tables hold every plane and line of the layout");
    assert_eq!(weights.dims(), [layout.weight_len()], "weights hold every layer of the layout");
    assert_eq!(frequencies.len(), layout.frequencies, "one weight per frequency");
    assert_eq!(levels.len(), layout.levels.len(), "one weight per level");
}
