//! Adam (Kingma & Ba 2015) as one fused pass over each parameter.
//!
//! Burn's own Adam makes about ten passes over memory per step, which takes longer than the rest of the step for a table
//! of millions of values, and a dozen launches per parameter on a GPU. On `flex` this optimizer reads and writes each
//! value once, on GPUs one launch updates many parameters, and other devices use plain tensor arithmetic.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;

#[cfg(any(feature = "flex", feature = "cube"))]
use burn::backend::{Backend, backend_extension, tensor::FloatTensor};
use burn::optim::{AdamState, AdaptiveMomentumState, LearningRate, Optimizer};
use burn::tensor::{Device, Tensor};

use crate::dispatch::dispatch;

/// Adam without weight decay: m ← β₁ m + (1 − β₁) g, v ← β₂ v + (1 − β₂) g² and x ← x − lr · m̂/(√v̂ + ε) with m̂ = m/(1 − β₁ᵗ) and
/// v̂ = v/(1 − β₂ᵗ) at step t. The defaults are PyTorch's: β = (0.9, 0.999), ε = 1e-8.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the first moment, β₁.
    pub beta1: f32,
    /// Decay of the second moment, β₂.
    pub beta2: f32,
    /// ε, added to √v̂.
    pub epsilon: f32,
    /// Factor on the learning rate of a group of parameters.
    pub rate: f64,
}

impl Default for Adam {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, rate: 1.0 }
    }
}

/// Constants of one step, with bias corrections folded in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AdamStep {
    pub(crate) beta1: f32,
    pub(crate) beta2: f32,
    /// lr · √(1 − β₂ᵗ)/(1 − β₁ᵗ)
    pub(crate) rate: f32,
    /// ε · √(1 − β₂ᵗ)
    pub(crate) epsilon: f32,
}

impl Adam {
    fn at(&self, lr: f64, time: usize) -> AdamStep {
        let time = i32::try_from(time).unwrap_or(i32::MAX);
        let root = (1.0 - f64::from(self.beta2).powi(time)).sqrt();
        AdamStep {
            beta1: self.beta1,
            beta2: self.beta2,
            rate: (lr * self.rate * root / (1.0 - f64::from(self.beta1).powi(time))) as f32,
            epsilon: (f64::from(self.epsilon) * root) as f32,
        }
    }
}

impl Optimizer for Adam {
    type State<const D: usize> = AdamState<D>;

    fn step<const D: usize>(
        &self,
        lr: LearningRate,
        tensor: Tensor<D>,
        grad: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let state = match state {
            Some(state) => state.momentum,
            None => AdaptiveMomentumState::new(0, grad.zeros_like(), grad.zeros_like()),
        };
        let time = state.time + 1;
        let (step, m, v) = (self.at(lr, time), state.moment_1, state.moment_2);
        let [tensor, m, v] = dispatch! {
            &tensor.device();
            host => fused(step, [tensor, grad, m, v]),
            cube => fused(step, [tensor, grad, m, v]),
            plain => {
                let m = m * step.beta1 + grad.clone() * (1.0 - step.beta1);
                let v = v * step.beta2 + grad.square() * (1.0 - step.beta2);
                [tensor - m.clone() * step.rate / (v.clone().sqrt() + step.epsilon), m, v]
            },
        };
        (tensor, Some(AdamState::new(AdaptiveMomentumState::new(time, m, v))))
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        AdamState::new(state.momentum.to_device(device))
    }
}

/// Returns `step(module)`, in which Adam updates the module, unless the flag `finite`, `[1]`, is 0: then parameters and moments
/// stay as they are.
///
/// A GPU reads the flag itself, and updates all parameters by few launches when `step` returns; updated parameters must
/// not be read before.
pub fn step_if<T>(finite: Tensor<1>, module: T, step: impl FnOnce(T) -> T) -> T {
    dispatch! {
        &finite.device();
        cube => gpu::step_together(finite, || step(module)),
        plain => if is_set(finite) { step(module) } else { module },
    }
}

/// Returns the flag 1 if `value` is finite and the flag `before` is not 0, else 0; `[1]` each, without a gradient.
pub fn finite_after(before: Option<Tensor<1>>, value: Tensor<1>) -> Tensor<1> {
    let (device, value) = (value.device().inner(), value.inner());
    dispatch! {
        &device;
        cube => gpu::finite_after(before, value),
        plain => {
            let finite = before.is_none_or(is_set) && value.into_scalar::<f32>().is_finite();
            Tensor::from_floats([f32::from(finite)], &device)
        },
    }
}

fn is_set(flag: Tensor<1>) -> bool {
    flag.into_scalar::<f32>() != 0.0
}

/// Updates x, given g, m and v, in one pass by a kernel of the host or of a GPU: the new x, m and v.
#[cfg(any(feature = "flex", feature = "cube"))]
fn fused<const D: usize>(step: AdamStep, tensors: [Tensor<D>; 4]) -> [Tensor<D>; 3] {
    let [x, g, m, v] = tensors.map(Tensor::into_dispatch);
    let (x, m, v) = <burn::backend::Dispatch as AdamOps>::adam(x, g, m, v, step);
    [x, m, v].map(Tensor::from_dispatch)
}

#[cfg(any(feature = "flex", feature = "cube"))]
#[backend_extension(Flex: cfg(feature = "flex"), Cube: cfg(feature = "cube"))]
pub(crate) trait AdamOps: Backend {
    fn adam(
        x: FloatTensor<Self>,
        g: FloatTensor<Self>,
        m: FloatTensor<Self>,
        v: FloatTensor<Self>,
        step: AdamStep,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_is_not_finite_stops_all_later_steps() {
        for device in [Device::flex(), Device::ndarray()] {
            let after = |before, value: f32| finite_after(before, Tensor::from_floats([value], &device));
            let good = after(Some(after(None, 1.0)), -f32::MAX);
            assert_eq!(step_if(good.clone(), 1, |x| x + 1), 2);
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert_eq!(step_if(after(Some(after(Some(good.clone()), bad)), 1.0), 1, |x| x + 1), 1);
            }
        }
    }

    #[test]
    fn bodies_follow_the_textbook_recursion_in_f64() {
        for device in [Device::flex(), Device::ndarray()] {
            let adam = Adam::default();
            let mut x = Tensor::<1>::from_floats([1.0, -2.0, 0.5], &device);
            let mut state = None;
            let mut oracle = [1.0f64, -2.0, 0.5].map(|x| (x, 0f64, 0f64));
            for t in 1..=50 {
                let g = x.clone() * 2.0 + 0.1;
                for (x, m, v) in &mut oracle {
                    let g = 2.0 * *x + 0.1;
                    *m = 0.9 * *m + 0.1 * g;
                    *v = 0.999 * *v + 0.001 * g * g;
                    let (mh, vh) = (*m / (1.0 - 0.9f64.powi(t)), *v / (1.0 - 0.999f64.powi(t)));
                    *x -= 0.05 * mh / (vh.sqrt() + 1e-8);
                }
                (x, state) = adam.step(0.05, x, g, state);
            }
            let got = crate::to_host(x);
            for (got, (want, ..)) in got.iter().zip(oracle) {
                approx::assert_abs_diff_eq!(f64::from(*got), want, epsilon = 1e-5);
            }
        }
    }
}
