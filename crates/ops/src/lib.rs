//! The costly tensor operations of a radiance field, as Burn backend extensions.
//!
//! Every operation is one file or folder, with up to three bodies that are tested against each other and against
//! `infonerf-oracle`, in `f64`:
//!
//! | body | device | purpose |
//! |---|---|---|
//! | host kernel (`host.rs`, on the base in `host/`) | Burn's `flex` backend, over rayon | speed: one fused pass, hand-written backward |
//! | CubeCL kernel (`gpu.rs`, on the base in `cube/`, with the feature `cube`) | GPUs | few launches |
//! | plain tensors (`plain`) | every backend | portability, and a reference for the kernels |
//!
//! The public function of each operation picks the body by the device of its tensors.
//!
//! Host kernels give the same bits for the same arguments, whatever the number of threads. GPUs do not: if many samples add
//! to one element (planes and lines), the device chooses the order of the atomic additions.
//!
//! Names follow the field: `tau` = σδ optical depth, `alpha` = 1 − e^−τ, `trans` transmittance, `w` = trans·α.
//! Samples are *packed*: ray `r` owns samples `offsets[r]..offsets[r + 1]` of every per-sample tensor
//! ([`Segments`]), so that a skipped sample costs nothing downstream.
//!
//! ```
//! # #[cfg(feature = "flex")] {
//! use burn::tensor::{Device, Tensor, TensorData};
//! use infonerf_ops::{Segments, composite, ray_entropy, to_host};
//!
//! // Two rays, with two samples and one: optical depths, and red, green and blue of each sample.
//! let device = Device::flex().autodiff();
//! let rays = Segments::from_counts([2, 1]);
//! let tau = Tensor::<1>::from_floats([0.7, 50.0, 0.0], &device).require_grad();
//! let rgb = Tensor::<2>::from_floats([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], &device);
//!
//! let rendered = composite(tau.clone(), rgb, &rays);
//! let entropy = ray_entropy(tau.clone(), &rays, 0.0);
//! let gradients = (rendered.values.sum() + entropy.bits.mean()).backward();
//! assert_eq!(to_host(rendered.acc), [1.0, 0.0]);
//! assert_eq!(tau.grad(&gradients).map(to_host).map(|gradient| gradient.len()), Some(3));
//! # }
//! ```
#![cfg_attr(test, allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable"))]

pub mod adam;
pub mod additive;
#[cfg(feature = "flex")]
mod bf16;
pub mod bilinear;
pub mod composite;
#[cfg(feature = "cube")]
mod cube;
mod dispatch;
pub mod divergence;
pub mod entropy;
pub mod factored;
pub mod frequency;
pub mod frustum;
#[cfg(any(feature = "flex", feature = "cube"))]
mod graph;
#[cfg(feature = "flex")]
mod host;
pub mod means;
pub mod mlp;
mod plain;
pub mod random;
pub mod rotation;
pub mod sampling;
mod segments;
mod traffic;
pub mod trilinear;
pub mod unit_box;

pub use additive::additive_depth;
pub use bilinear::bilinear;
pub use composite::{Composite, CompositeOver, composite, composite_over};
pub use dispatch::{has_host_kernels, is_gpu};
pub use divergence::ray_divergence;
pub use entropy::{RayEntropy, ray_entropy};
pub use factored::{HostField, factored_field, plane_variation};
pub use frequency::{frequency_encode, integrated_encode};
pub use frustum::{RayGaussians, frustum_gaussians};
pub use mlp::radiance_mlp;
pub use rotation::rotate;
pub use segments::Segments;
pub use traffic::{HostNumber, Traffic, to_host, to_host_together, upload, upload_rows, upload_together};
pub use trilinear::trilinear;
pub use unit_box::unit_box;
