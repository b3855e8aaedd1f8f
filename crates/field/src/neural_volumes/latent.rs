use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;

use super::code::Code;
use crate::init::normal;

/// Initial ln σ of a latent code: σ is small compared with the code, so that short runs are not dominated by its noise. The divergence
/// term raises it.
const FIRST_LOG_DEVIATION: f32 = -4.0;

/// The latent code of one frame, learned as it is.
///
/// For a scene of one frame the output of an encoder is a constant.
#[derive(Module, Debug)]
pub(super) struct Latent {
    mean: Param<Tensor<1>>,
    log_deviation: Param<Tensor<1>>,
}

impl Latent {
    /// Draws a code of `size` elements from the standard normal distribution.
    pub(super) fn new(size: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let parameter = |values: Vec<f32>| Param::from_data(TensorData::new(values, [size]), device);
        Self { mean: parameter(normal(rng, size)), log_deviation: parameter(vec![FIRST_LOG_DEVIATION; size]) }
    }

    pub(super) fn code(&self) -> Code {
        Code { mean: self.mean.val(), log_deviation: self.log_deviation.val() }
    }
}
