//! Published weights: the list, where files are searched, importing and fetching.

mod error;
#[cfg(feature = "fetch")]
mod fetch;
mod import;
mod known;
mod networks;
mod resnet34;
mod store;

pub use error::WeightsError;
#[cfg(feature = "fetch")]
pub use fetch::DownloadProgress;
pub use known::{KNOWN_WEIGHTS, KnownWeights};
pub use store::Store;
