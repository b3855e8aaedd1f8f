use thiserror::Error;

/// Why a metric has no value.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum MetricError {
    /// There is nothing to average over.
    #[error("{what} is empty: a metric needs at least one value")]
    Empty {
        /// The argument that is empty.
        what: &'static str,
    },
    /// A slice does not hold as many values as its counterpart, or as `width × height`.
    #[error("{what} holds {found} values, expected {expected}")]
    Length {
        /// The argument of the wrong length.
        what: &'static str,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// A value is NaN or infinite where a number is needed.
    #[error("{what} is not finite at index {index}")]
    NonFinite {
        /// The offending argument.
        what: &'static str,
        /// Index of the first such pixel or value.
        index: usize,
    },
    /// The image is smaller than the metric's window.
    #[error("{metric} needs both sides to be at least {minimum} pixels, got {width}×{height}")]
    TooSmall {
        /// The metric that was asked for.
        metric: &'static str,
        /// Image width in pixels.
        width: usize,
        /// Image height in pixels.
        height: usize,
        /// Smallest side accepted.
        minimum: usize,
    },
}
