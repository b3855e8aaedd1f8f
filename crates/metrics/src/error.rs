use thiserror::Error;

/// Why a metric has no value, in one line.
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
    /// Two pictures, or a picture and its mask, differ in size.
    #[error("the {what} has {} pixels, the render {}", dimensions(*found), dimensions(*expected))]
    Size {
        /// What does not fit the render: `truth`, `mask`.
        what: &'static str,
        /// Its width and height.
        found: [usize; 2],
        /// Width and height of the render.
        expected: [usize; 2],
    },
    /// The picture is smaller than the metric's window.
    #[error("both sides need at least {minimum} pixels, got {}", dimensions(*found))]
    TooSmall {
        /// Width and height of the picture.
        found: [usize; 2],
        /// Smallest side accepted.
        minimum: usize,
    },
    /// SSIM's data range is no positive number.
    #[error("SSIM's data range is {found}, expected more than 0")]
    DataRange {
        /// The number given.
        found: String,
    },
    /// A border of that width is all of the picture.
    #[error("a border of {crop} pixels leaves nothing of {}", dimensions(*found))]
    Cropped {
        /// Width of the border.
        crop: usize,
        /// Width and height of the picture.
        found: [usize; 2],
    },
    /// No pixel of the mask is inside.
    #[error("the mask is empty: no pixel is inside")]
    EmptyMask,
    /// The metric is over a mask, and there is none.
    #[error("no mask")]
    NoMask,
    /// The metric compares depth, and the true depth is not known.
    #[error("no true depth")]
    NoDepth,
    /// No ray hits something both in the render and in the truth.
    #[error("no pixel where both the render and the truth hit something")]
    NothingHit,
    /// The truth has no gradient to compare with.
    #[error("the truth is flat")]
    Flat,
    /// The metric needs a network whose weights are not at hand.
    #[error("no weights; `infonerf weights import FILE` or `infonerf weights fetch {network}`")]
    NoWeights {
        /// Name of the network, such as `lpips-alex`.
        network: &'static str,
    },
    /// The network gave no answer.
    #[error("{0}")]
    Network(String),
    /// The metric compares distributions, and there are too few samples.
    #[error("needs at least {minimum} pictures, got {found}")]
    TooFew {
        /// Pictures given.
        found: usize,
        /// Fewest pictures accepted.
        minimum: usize,
    },
    /// No metric has that key.
    #[error("no metric is called `{key}`; known: {known}")]
    UnknownMetric {
        /// The key that was asked for.
        key: String,
        /// The keys there are, separated by commas.
        known: String,
    },
    /// A metric that was asked for has no value.
    #[error("{key}: {reason}")]
    Missing {
        /// Its key.
        key: String,
        /// Why.
        reason: String,
    },
}

/// `width × height` for people.
fn dimensions([width, height]: [usize; 2]) -> String {
    format!("{width}×{height}")
}
