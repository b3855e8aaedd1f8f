use thiserror::Error;

/// Reason why a metric has no value, in one line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum MetricError {
    /// Nothing to average over.
    #[error("{what} is empty: a metric needs at least one value")]
    Empty {
        /// The argument that is empty.
        what: &'static str,
    },
    /// Length other than the counterpart's, or than `width × height`.
    #[error("{what} holds {found} values, expected {expected}")]
    Length {
        /// The argument of the wrong length.
        what: &'static str,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// NaN or infinity among values that must be finite.
    #[error("{what} is not finite at index {index}")]
    NonFinite {
        /// The offending argument.
        what: &'static str,
        /// Index of the first such pixel or value.
        index: usize,
    },
    /// Different sizes of two images, or of an image and its mask.
    #[error("the {what} has {} pixels, the render {}", dimensions(*found), dimensions(*expected))]
    Size {
        /// Part that does not fit the render: `truth`, `mask`.
        what: &'static str,
        /// Width and height found.
        found: [usize; 2],
        /// Width and height of the render.
        expected: [usize; 2],
    },
    /// Image smaller than the metric's window.
    #[error("both sides need at least {minimum} pixels, got {}", dimensions(*found))]
    TooSmall {
        /// Width and height of the image.
        found: [usize; 2],
        /// Minimum of both sides.
        minimum: usize,
    },
    /// Data range of SSIM that is not positive and finite.
    #[error("SSIM's data range is {found}, expected more than 0")]
    DataRange {
        /// Data range found.
        found: String,
    },
    /// Border that covers the whole image.
    #[error("a border of {crop} pixels leaves nothing of {}", dimensions(*found))]
    Cropped {
        /// Width of the border.
        crop: usize,
        /// Width and height of the image.
        found: [usize; 2],
    },
    /// Mask without a pixel inside.
    #[error("the mask is empty: no pixel is inside")]
    EmptyMask,
    /// Valid pixels that are all in the border that is left out, or none at all.
    #[error("no valid pixel to compare")]
    NothingValid,
    /// View without the mask that the metric needs.
    #[error("no mask")]
    NoMask,
    /// View without the true depth that the metric needs.
    #[error("no true depth")]
    NoDepth,
    /// No ray that hits something both in the render and in the truth.
    #[error("no pixel where both the render and the truth hit something")]
    NothingHit,
    /// Truth without a gradient to compare with.
    #[error("the truth is flat")]
    Flat,
    /// Network without weights.
    #[error("no weights of {weights}; `infonerf weights import FILE` or `infonerf weights fetch {weights}`")]
    NoWeights {
        /// Name of the missing weights, such as `lpips-alex`.
        weights: &'static str,
    },
    /// Network that cannot process the images; the line gives its reason.
    #[error("{0}")]
    Network(String),
    /// Too few images for a metric that compares distributions.
    #[error("needs at least {minimum} images, got {found}")]
    TooFew {
        /// Number of images.
        found: usize,
        /// Minimum number of images.
        minimum: usize,
    },
    /// Unknown key of a metric.
    #[error("no metric is called `{key}`; known: {known}")]
    UnknownMetric {
        /// The requested key.
        key: String,
        /// All keys, separated by commas.
        known: String,
    },
    /// Requested metric without a value.
    #[error("{key}: {reason}")]
    Missing {
        /// Key of the metric.
        key: String,
        /// Reason, in one line.
        reason: String,
    },
}

/// Formats `width × height`.
fn dimensions([width, height]: [usize; 2]) -> String {
    format!("{width}×{height}")
}
