use infonerf_ops::mlp::Activation;
use serde::{Deserialize, Serialize};

/// Activation from raw network output to density σ ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DensityActivation {
    /// max(x, 0), as in NeRF. If raw output is negative everywhere, there is no gradient and the field stays empty.
    Relu,
    /// ln(1 + eˣ⁻¹), as in mip-NeRF: positive everywhere, so that an empty field can recover.
    Softplus,
}

impl From<DensityActivation> for Activation {
    fn from(density: DensityActivation) -> Self {
        match density {
            DensityActivation::Relu => Self::Relu,
            DensityActivation::Softplus => Self::ShiftedSoftplus,
        }
    }
}
