use burn::tensor::Tensor;
use infonerf_schedule::Moment;

use crate::{Field, Points};

/// Computes density σ, `[M]`, and its gradient ∂σ/∂x, `[M, 3]`, in 1/unit and 1/unit² of the positions' space; −∂σ/∂x points out of
/// what is dense. The results are in no graph, and parameters get no gradients.
///
/// The density of a sample depends on its own position alone, so that the gradient of Σσ is the gradient of each. View
/// directions, and the lengths and distances of [`Extent`](crate::Extent), are held fixed.
///
/// `None` if the field does not [track positions](crate::FieldTraits::tracks_positions).
///
/// # Panics
/// As [`Field::evaluate`].
pub fn density_gradient<F: Field>(field: &F, points: &Points, at: Moment) -> Option<(Tensor<1>, Tensor<2>)> {
    let positions = points.positions.clone().inner().autodiff().require_grad();
    let tracked = Points { positions: positions.clone(), ..points.clone() };
    let sigma = field.valid().train().no_grad().evaluate(&tracked, false, at).sigma;
    let gradients = sigma.is_tracked().then(|| sigma.clone().sum().backward())?;
    Some((sigma.inner(), positions.grad(&gradients)?))
}
