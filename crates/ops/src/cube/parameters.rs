//! Parameters of an operation with any number of layers, where the graph records operations of at most four inputs.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;

use super::{CubeKernel, Pass, apply};
use crate::mlp::Dense;

/// A matrix and a bias.
type Pair = [CubeTensor; 2];

/// Of each layer its matrix and bias, and on the way back their gradients.
///
/// Layers are a chain of operations in the graph that launch nothing: each leaves its own here and hands on a *token*, which the
/// operation that uses them has as an input. It leaves gradients here, and gives the token one, which is not looked at; on the way
/// back along the chain each takes its own.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    values: Mutex<Vec<Pair>>,
    grads: Mutex<Vec<Pair>>,
}

impl Parameters {
    /// Those of `layers`, of which there is at least one, and the token.
    pub(super) fn new<'a>(layers: impl IntoIterator<Item = &'a Dense>) -> (Arc<Self>, Tensor<1>) {
        let parameters = Arc::new(Self::default());
        let mut token: Option<Tensor<1>> = None;
        for (index, Dense { weight, bias }) in layers.into_iter().enumerate() {
            let link = Link { parameters: parameters.clone(), index };
            let (weight, bias) = (weight.clone(), bias.clone());
            token = Some(match token {
                None => apply(link, (weight, bias)),
                Some(token) => apply(link, (token, weight, bias)),
            });
        }
        (parameters, token.expect("a network has layers"))
    }

    /// What the layers have left here.
    pub(super) fn values(&self) -> Vec<Pair> {
        locked(&self.values).clone()
    }

    /// Leaves their gradients here.
    pub(super) fn leave(&self, grads: Vec<Pair>) {
        *locked(&self.grads) = grads;
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A layer of the chain: perhaps of a token, and of its matrix and bias.
#[derive(Debug)]
struct Link {
    parameters: Arc<Parameters>,
    index: usize,
}

impl CubeKernel for Link {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [.., weight, bias] = inputs else { unreachable!("a layer has a matrix and a bias") };
        locked(&self.parameters.values).push([weight.clone(), bias.clone()]);
        bias.clone()
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let own = locked(&self.parameters.grads)[self.index].clone();
        let token = (self.index > 0).then(|| pass.grad.clone());
        token.into_iter().chain(own).map(Some).collect()
    }
}
