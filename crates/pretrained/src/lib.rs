//! Pretrained networks with fixed weights: LPIPS, Inception (FID and KID) and the image encoder of CLIP; and
//! reading, finding, importing and fetching their weights.
//!
//! This crate trains nothing and contains no weights: missing ones are an error or a note, never random values.
//!
//! ```no_run
//! use burn::tensor::Device;
//! use infonerf_metrics::{METRICS, Pair, Picture, Protocol, evaluate};
//! use infonerf_pretrained::Store;
//!
//! let store = Store::new(None)?;
//! store.fetch("lpips-vgg", &mut |progress| eprintln!("{} of {} bytes", progress.done, progress.total))?;
//! let networks = store.networks(METRICS, &Device::flex())?;
//!
//! let [render, truth] = ["render.png", "truth.png"].map(|path| image::open(path).unwrap().to_rgb8());
//! let (render, truth) = (Picture::from_rgb8(&render)?, Picture::from_rgb8(&truth)?);
//! let measured = evaluate(&[Pair::new(&render, &truth)], &networks, &Protocol::default())?;
//! println!("{:?}", measured.set["lpips_vgg"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod clip;
mod file;
mod inception;
mod layers;
mod lpips;
mod weights;

pub use clip::{ClipConfig, ClipVision};
pub use file::{TensorShape, WeightFile, normalisation};
pub use inception::{Inception, InceptionConfig};
pub use lpips::{Lpips, LpipsConfig};
#[cfg(feature = "fetch")]
pub use weights::DownloadProgress;
pub use weights::{KNOWN_WEIGHTS, KnownWeights, Store, WeightsError};
