//! Image metrics: pictures in, numbers out.
//!
//! [`METRICS`] is the one list of what is measured, [`evaluate`] measures pairs of render and truth with all of it, and
//! [`protocol`] says exactly how. Metrics that need a network get it from [`Networks`]; without it they have no value, and
//! a note says how to get its weights. Each metric is a pure function too:
//!
//! ```
//! use infonerf_metrics::{Picture, psnr};
//!
//! let truth = Picture::new(vec![[0.5; 3]; 16 * 16], 16, 16)?;
//! let render = Picture::new(vec![[0.6; 3]; 16 * 16], 16, 16)?;
//! assert!((psnr(&render, &truth)? - 20.0).abs() < 1e-4);
//! # Ok::<(), infonerf_metrics::MetricError>(())
//! ```
//!
//! Adding a metric takes a file with a [`Metric`] constant, and its line in [`METRICS`].

mod depth;
mod descriptor;
mod error;
mod evaluate;
mod features;
mod folders;
mod luminance;
mod mask;
mod measured;
mod metric;
mod networks;
mod picture;
pub mod protocol;
mod rectangle;
mod rgb8;
mod shrink;
mod size;
mod summary;
mod view;

pub use descriptor::{Better, Descriptor};
pub use error::MetricError;
pub use evaluate::{Evaluator, evaluate};
pub use features::Features;
pub use folders::{ComparedFolders, ComparedView, FolderError, Folders, compare_folders};
pub use luminance::luminance;
pub use mask::Mask;
pub use measured::{Measured, Note, Values};
pub use metric::*;
pub use networks::{FeatureExtractor, Networks, PictureDistance};
pub use picture::Picture;
pub use protocol::Protocol;
pub use rectangle::Rectangle;
pub use rgb8::{from_rgb8, quantise_8bit, to_rgb8};
pub use summary::Summary;
pub use view::{Depths, Pair, View};
