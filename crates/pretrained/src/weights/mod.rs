//! Which published weights there are, where they are looked for, and how they get there.

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
pub use fetch::Progress;
pub use known::{KNOWN_WEIGHTS, KnownWeights};
pub use store::{Status, Store};
