//! Averaging of weights over the end of a run (Polyak and Juditsky 1992; Izmailov et al. 2018).
//!
//! Few views leave much of a scene undetermined, and there the weights keep fluctuating with the batches; their mean less so.

use std::vec::IntoIter;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::Tensor;
use infonerf_field::Field;
use infonerf_render::Model;

use crate::model::weights;

/// Number of steps between averaged models: successive ones are nearly the same, and each costs a pass over all weights.
const EVERY: usize = 8;

#[derive(Clone, Debug)]
pub(crate) struct WeightAverage<F: Field> {
    /// The mean; `None` before the first model.
    pub(crate) mean: Option<Model<F>>,
    /// Number of models in the mean.
    pub(crate) count: usize,
}

impl<F: Field> WeightAverage<F> {
    /// Returns whether a run that averages its last `share` includes the model after `step` steps, at the share `done`.
    pub(crate) fn includes(share: f64, step: usize, done: f64) -> bool {
        share > 0.0 && done >= 1.0 - share && step.is_multiple_of(EVERY)
    }

    /// Adds a model: mean ← mean + (model − mean)/n.
    pub(crate) fn add(&mut self, model: Model<F>) {
        self.count += 1;
        self.mean = Some(match self.mean.take() {
            None => model,
            Some(mean) => mean.map(&mut Blend { weights: weights(&model).into_iter(), share: 1.0 / self.count as f32 }),
        });
    }
}

/// Maps a model to a + share · (b − a), weight by weight, for another model b of the same shape.
struct Blend {
    /// All weights of b, each flattened, in the module's order.
    weights: IntoIter<Tensor<1>>,
    share: f32,
}

impl ModuleMapper for Blend {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let other = self.weights.next().expect("models of one shape");
        param.map(|weight| {
            let shape = weight.shape();
            weight.clone() + (other.reshape(shape) - weight) * self.share
        })
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use infonerf_field::{FieldOutput, Points};
    use infonerf_ops::to_host;
    use infonerf_schedule::Moment;

    use super::*;

    #[derive(Module, Debug)]
    struct OneWeight {
        weight: Param<Tensor<1>>,
    }

    impl Field for OneWeight {
        fn evaluate(&self, _points: &Points, _color: bool, _at: Moment) -> FieldOutput {
            unreachable!("the field is not rendered")
        }
    }

    #[test]
    fn the_mean_is_over_every_eighth_model_at_the_end_of_a_run() {
        let mut average = WeightAverage { mean: None, count: 0 };
        for weight in [1.0f32, 2.0, 6.0] {
            average.add(Model::of(OneWeight { weight: Param::from_data([weight], &Device::flex()) }));
        }
        let mean = to_host(average.mean.expect("models were added").fine.weight.val());
        assert!((mean[0] - 3.0).abs() < 1e-6, "{mean:?}");
        let included = |share: f64| -> Vec<usize> {
            let is_included = |step: &usize| WeightAverage::<OneWeight>::includes(share, *step, *step as f64 / 32.0);
            (0..=32).filter(is_included).collect()
        };
        assert_eq!([0.0, 0.25, 0.5].map(included), [vec![], vec![24, 32], vec![16, 24, 32]]);
    }
}
