use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use infonerf_ops::upload;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::field::Penalty;
use crate::init::{normal, parameter};

impl Penalty {
    /// Divergence of a field's latent code from a standard normal distribution (Neural Volumes, Lombardi et al. 2019), in nats:
    /// the mean over the code's elements of `KL(N(μ, σ²) ‖ N(0, 1)) = ½(μ² + σ² − 1) − ln σ`.
    pub const LATENT_DIVERGENCE: Self = Self("latent divergence");
}

/// The distribution of a latent code, N(μ, σ²) for each element.
#[derive(Module, Debug)]
pub(super) struct Code {
    /// μ, `[size]`.
    pub(super) mean: Tensor<1>,
    /// ln σ, `[size]`.
    pub(super) log_deviation: Tensor<1>,
}

impl Code {
    /// Draws a code, `[1, size]`: μ + σε with ε drawn by `seed`, or μ without one.
    pub(super) fn draw(&self, seed: Option<u64>) -> Tensor<2> {
        let mean = self.mean.clone();
        let Some(seed) = seed else { return mean.unsqueeze() };
        let [size] = mean.dims();
        let drawn = upload(normal(&mut ChaCha8Rng::seed_from_u64(seed), size), [size], &mean.device());
        (mean + self.log_deviation.clone().exp() * drawn).unsqueeze()
    }

    pub(super) fn divergence(&self) -> Tensor<1> {
        let squares = self.mean.clone().square() + (self.log_deviation.clone() * 2.0).exp() - 1.0;
        (squares * 0.5 - self.log_deviation.clone()).mean()
    }
}

/// Initial ln σ of a latent code: small, so that short runs are not dominated by its noise; the divergence term raises it.
const FIRST_LOG_DEVIATION: f32 = -4.0;

/// Latent code of one frame, which is a parameter itself: for a scene of one frame the output of an encoder would be a
/// constant.
#[derive(Module, Debug)]
pub(super) struct Latent {
    mean: Param<Tensor<1>>,
    log_deviation: Param<Tensor<1>>,
}

impl Latent {
    /// Draws a code of `size` elements from the standard normal distribution.
    pub(super) fn new(size: usize, rng: &mut impl Rng, device: &Device) -> Self {
        let parameter = |values: Vec<f32>| parameter(values, [size], device);
        Self { mean: parameter(normal(rng, size)), log_deviation: parameter(vec![FIRST_LOG_DEVIATION; size]) }
    }

    pub(super) fn code(&self) -> Code {
        Code { mean: self.mean.val(), log_deviation: self.log_deviation.val() }
    }
}
