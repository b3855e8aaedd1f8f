//! InfoNeRF's two losses with somebody else's renderer: densities go in, losses and their gradients come out.
//!
//! ```text
//! cargo run --release --example own_renderer
//! ```

#![allow(clippy::print_stdout, reason = "an example shows what it computes")]

use burn::tensor::{Device, Tensor};
use infonerf_ops::{Segments, ray_divergence, ray_entropy};

fn main() {
    // A renderer has densities σ at its samples and the lengths δ of their intervals. Rays may have different numbers of
    // samples, which follow each other in one list: here three, two and none.
    let device = Device::flex().autodiff();
    let rays = Segments::from_counts([3, 2, 0]);
    let sigma = Tensor::<1>::from_floats([0.1, 8.0, 2.0, 0.5, 0.5], &device).require_grad();
    let delta = Tensor::<1>::from_floats([0.2, 0.2, 0.2, 0.3, 0.3], &device);
    let tau = sigma.clone() * delta.clone();

    // Optical depths of the same samples on neighbouring rays, which the information-gain reduction compares with.
    let neighbour = Tensor::<1>::from_floats([0.1, 6.0, 3.0, 0.4, 0.7], &device) * delta;

    // H(r) in bits (Eq. 5), which counts where a ray hits something (Eq. 6), and D(P(R) || P(R~)) in nats (Eq. 9).
    let entropy = ray_entropy(tau.clone(), &rays, 0.0);
    let hits = entropy.alpha_sum.clone().detach().greater_elem(0.1).float();
    let kl = ray_divergence(tau, neighbour, &rays, 1e-10);
    println!("H(r)    {} bits", entropy.bits.to_data());
    println!("D(r|r~) {} nats", kl.to_data());

    // L = λ₁ mean M(r) H(r) + λ₂ mean D (Eq. 8 to 10); its gradient goes back into the renderer.
    let loss = (entropy.bits * hits).mean() * 1e-3 + kl.mean() * 2e-5;
    let gradients = loss.backward();
    println!("dL/dσ   {}", sigma.grad(&gradients).expect("the loss depends on σ").to_data());
}
