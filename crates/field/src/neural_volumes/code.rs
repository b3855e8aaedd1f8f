use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::init::normal;

/// The distribution of a latent code, N(μ, σ²) for each of its numbers.
#[derive(Module, Debug)]
pub(super) struct Code {
    /// μ, `[size]`.
    pub(super) mean: Tensor<1>,
    /// ln σ, `[size]`.
    pub(super) log_deviation: Tensor<1>,
}

impl Code {
    /// A code, `[1, size]`: μ + σε with ε drawn by `seed`, or μ without one.
    pub(super) fn draw(&self, seed: Option<u64>) -> Tensor<2> {
        let mean = self.mean.clone();
        let code = match seed {
            Some(seed) => {
                let [size] = mean.dims();
                let drawn = normal(&mut ChaCha8Rng::seed_from_u64(seed), size);
                let drawn = Tensor::<1>::from_data(TensorData::new(drawn, [size]), &mean.device());
                mean + self.log_deviation.clone().exp() * drawn
            }
            None => mean,
        };
        code.unsqueeze()
    }

    /// ½(μ² + σ² − 1) − ln σ, the mean over the code's numbers, `[1]`.
    pub(super) fn divergence(&self) -> Tensor<1> {
        let squares = self.mean.clone().square() + (self.log_deviation.clone() * 2.0).exp() - 1.0;
        (squares * 0.5 - self.log_deviation.clone()).mean()
    }
}
