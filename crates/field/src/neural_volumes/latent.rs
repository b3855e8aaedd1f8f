use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::init::normal;

/// ln σ of a latent code before training: small beside its numbers, so that a short run is not spent on quietening it. A
/// divergence term (`loss.latent`) raises it.
const FIRST_LOG_DEVIATION: f32 = -4.0;

/// The latent code of one frame: z ~ N(μ, σ²) in training, z = μ in pictures.
///
/// The encoder of Neural Volumes makes μ and ln σ of the photographs of a frame. A scene of one frame is one input, so its
/// output is a constant, and is learned here as such.
#[derive(Module, Debug)]
pub(super) struct Latent {
    mean: Param<Tensor<1>>,
    log_deviation: Param<Tensor<1>>,
}

impl Latent {
    /// A code of `size` numbers of the standard normal distribution.
    pub(super) fn new(size: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let parameter = |values: Vec<f32>| Param::from_data(TensorData::new(values, [size]), device);
        Self { mean: parameter(normal(rng, size)), log_deviation: parameter(vec![FIRST_LOG_DEVIATION; size]) }
    }

    /// The code, `[1, size]`: drawn by `seed`, or the mean.
    pub(super) fn code(&self, seed: Option<u64>) -> Tensor<2> {
        let mean = self.mean.val();
        let code = match seed {
            Some(seed) => {
                let [size] = mean.dims();
                let drawn = normal(&mut ChaCha8Rng::seed_from_u64(seed), size);
                let drawn = Tensor::<1>::from_data(TensorData::new(drawn, [size]), &mean.device());
                mean + self.log_deviation.val().exp() * drawn
            }
            None => mean,
        };
        code.unsqueeze()
    }

    /// ½(μ² + σ² − 1) − ln σ, the mean over the code's numbers, `[1]`.
    pub(super) fn divergence(&self) -> Tensor<1> {
        let (mean, log_deviation) = (self.mean.val(), self.log_deviation.val());
        let squares = mean.square() + (log_deviation.clone() * 2.0).exp() - 1.0;
        (squares * 0.5 - log_deviation).mean()
    }

    pub(super) fn device(&self) -> Device {
        self.mean.val().device()
    }
}
