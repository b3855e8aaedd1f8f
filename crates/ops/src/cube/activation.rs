//! Activations within kernels, and their slopes.

use burn::cubecl::{self, prelude::*};

use super::rays::{alpha_of, ln_1p};
use crate::mlp::Activation;

/// ln(1 + e^x).
#[cube]
pub(super) fn softplus(x: f32) -> f32 {
    f32::max(x, 0.0f32) + ln_1p(f32::exp(-f32::abs(x)))
}

/// 1/(1 + e^−x).
#[cube]
pub(super) fn sigmoid(x: f32) -> f32 {
    1.0f32 / (1.0f32 + f32::exp(-x))
}

/// The `function` of x; what is no number stays that.
#[cube]
pub(super) fn activated(x: f32, #[comptime] function: Activation) -> f32 {
    let mut value = x + 0.0f32;
    match comptime!(function) {
        Activation::None => {}
        Activation::Relu => {
            if x < 0.0f32 {
                value = 0.0f32;
            }
        }
        Activation::ShiftedSoftplus => value = softplus(x - 1.0f32),
        Activation::Sigmoid => value = sigmoid(x),
    }
    value
}

/// The gradient with respect to x, given y = function(x) and the gradient with respect to that.
#[cube]
pub(super) fn before_activation(y: f32, grad: f32, #[comptime] function: Activation) -> f32 {
    let mut slope = grad + 0.0f32;
    match comptime!(function) {
        Activation::None => {}
        Activation::Relu => {
            if y <= 0.0f32 {
                slope = 0.0f32;
            }
        }
        Activation::ShiftedSoftplus => slope *= alpha_of(y),
        Activation::Sigmoid => slope *= y * (1.0f32 - y),
    }
    slope
}
