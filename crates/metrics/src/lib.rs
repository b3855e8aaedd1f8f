//! Image, depth and summary metrics of a few-shot radiance field.
//!
//! Images are row-major slices of RGB triples, `pixels[y * width + x]`, with values in `[0, 1]` as displayed and
//! composited on the background; every metric is a pure function of two of them. [`compare`] is the evaluation
//! protocol (both images rounded to 8 bits first, then every metric), [`Summary`] the mean ± standard deviation over
//! seeds.
//!
//! ```
//! use infonerf_metrics::{Comparison, compare, psnr};
//!
//! let truth = vec![[0.5, 0.5, 0.5]; 16 * 16];
//! let render = vec![[0.6, 0.6, 0.6]; 16 * 16];
//! assert!((psnr(&render, &truth)? - 20.0).abs() < 1e-4);
//!
//! let comparison: Comparison = compare(&render, &truth, 16, 16)?;
//! assert_eq!(comparison.sharpness, None); // a flat truth has no gradient to compare with
//! # Ok::<(), infonerf_metrics::MetricError>(())
//! ```

mod compare;
mod depth;
mod error;
mod gmsd;
mod luminance;
mod psnr;
mod rgb8;
mod sharpness;
mod ssim;
mod summary;
mod validate;

pub use compare::{Comparison, compare};
pub use depth::depth_rmse;
pub use error::MetricError;
pub use gmsd::gmsd;
pub use luminance::luminance;
pub use psnr::psnr;
pub use rgb8::{from_rgb8, quantise_8bit, to_rgb8};
pub use sharpness::{mean_gradient, sharpness};
pub use ssim::{SSIM_WINDOW, ssim};
pub use summary::Summary;
