use nalgebra::{DMatrix, DVector};

use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::features::FeatureSet;

/// Name of Inception with pytorch-fid's weights among [`crate::Networks`].
pub const INCEPTION_NETWORK: &str = "inception-fid";

pub(super) const FID: Metric = Metric {
    descriptor: Descriptor { key: "fid", name: "FID", unit: "", decimals: 2, better: Better::Lower },
    definition: "Fréchet distance of Inception's 2048 features, with pytorch-fid's network (Heusel et al. 2017)",
    measure: Measure::Set(INCEPTION_NETWORK, frechet_distance),
};

/// Computes the Fréchet distance between Gaussians with the means `μ` and unbiased covariances `Σ` of two sets of vectors,
///
/// `d² = ‖μ₁ − μ₂‖² + tr Σ₁ + tr Σ₂ − 2 tr (Σ₁ Σ₂)^½`
///
/// (Heusel et al. 2017, Eq. 6), in double precision.
///
/// With the centred vectors as rows, `A = X / √(n − 1)` and `B = Y / √(m − 1)`, the covariances are `AᵀA` and `BᵀB`. The
/// eigenvalues of `AᵀA BᵀB` other than 0 equal those of `(A Bᵀ)(A Bᵀ)ᵀ`, so that the trace of the root is the sum of the
/// singular values of `A Bᵀ`, an n × m matrix. This is exact for covariances of any rank and cheap for few images, where
/// pytorch-fid takes the real part of SciPy's `sqrtm` of a singular matrix of 2048², and adds 1e-6 to the diagonals if that
/// is not finite; without the addition, both values are equal. If there are more vectors than dimensions, A is replaced by
/// the R of its QR decomposition, for which `RᵀR = AᵀA`.
///
/// # Errors
/// If a set has fewer than two vectors, or dimensions differ.
pub fn frechet_distance(a: &FeatureSet, b: &FeatureSet) -> Result<f64, MetricError> {
    let [(mean_a, root_a), (mean_b, root_b)] = FeatureSet::matrices(a, b)?.map(moments);
    let traces = root_a.norm_squared() + root_b.norm_squared();
    let root = (&root_a * root_b.transpose()).singular_values().sum();
    Ok((mean_a - mean_b).norm_squared() + traces - 2.0 * root)
}

/// Returns the mean, and a matrix A of at most `dimension` rows with the covariance AᵀA.
fn moments(mut rows: DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let (n, dimension) = rows.shape();
    let mean = rows.row_mean();
    rows.row_iter_mut().for_each(|mut row| row -= &mean);
    rows /= ((n - 1) as f64).sqrt();
    let root = if n > dimension { rows.qr().r() } else { rows };
    (mean.transpose(), root)
}
