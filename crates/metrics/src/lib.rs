//! Image metrics for novel view synthesis.
//!
//! [`METRICS`] lists all metrics, [`evaluate`] measures pairs of render and truth with all of them, and [`protocol`] defines
//! what is done to images first. Metrics that need a network get it from [`Networks`]; without it they have no value, and a
//! note names the missing weights. Each metric is a pure function, too:
//!
//! ```
//! use infonerf_metrics::{Networks, Pair, Picture, Protocol, evaluate, psnr};
//!
//! let truth = Picture::new(vec![[0.5; 3]; 16 * 16], 16, 16)?;
//! let render = Picture::new(vec![[0.6; 3]; 16 * 16], 16, 16)?;
//! assert!((psnr(&render, &truth)? - 20.0).abs() < 1e-4);
//!
//! // The protocol rounds 0.5 to 128/255.
//! let measured = evaluate(&[Pair::new(&render, &truth)], &Networks::none(), &Protocol::default())?;
//! assert!(measured.set["psnr"].is_some_and(|psnr| (psnr - 20.17).abs() < 0.01));
//! assert_eq!(measured.set["lpips_vgg"], None);
//! assert!(measured.notes.iter().any(|note| note.to_string().contains("infonerf weights fetch lpips-vgg")));
//! # Ok::<(), infonerf_metrics::MetricError>(())
//! ```

mod descriptor;
mod error;
mod evaluate;
mod features;
mod folders;
mod mask;
mod measured;
mod metric;
mod networks;
mod picture;
pub mod protocol;
mod summary;
mod view;

pub use descriptor::{Better, Descriptor};
pub use error::MetricError;
pub use evaluate::{Evaluator, evaluate};
pub use features::FeatureSet;
pub use folders::{ComparedFolders, ComparedView, Folders, compare_folders};
pub use mask::Mask;
pub use measured::{Measured, Note, Values};
pub use metric::*;
pub use networks::{FeatureExtractor, Networks, PictureDistance};
pub use picture::{Picture, to_rgb8};
pub use protocol::Protocol;
pub use summary::Summary;
pub use view::{Depths, Pair, PreparedView};
