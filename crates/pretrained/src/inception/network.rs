use InceptionLayer::{Branches, MaxPool, MeanPool, Unit};

use crate::file::TensorShape;
use crate::layers::Window;

/// Layers of Inception v3; `T` is a convolution with its batch normalisation and rectifier.
pub(super) enum InceptionLayer<T> {
    Unit(T),
    MaxPool(Window),
    MeanPool(Window),
    /// Parallel branches, whose outputs are concatenated.
    Branches(Vec<Vec<Self>>),
}

/// Convolution of Inception with its batch normalisation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct UnitShape {
    /// Name in pytorch-fid, such as `Mixed_5b.branch1x1`.
    name: String,
    /// Inputs and outputs.
    pub(super) channels: [usize; 2],
    pub(super) window: Window,
}

impl UnitShape {
    /// Returns the name and shape of the convolution's weight.
    pub(super) fn weight(&self) -> TensorShape {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        (format!("{}.conv.weight", self.name), vec![outputs, inputs, height, width])
    }

    /// Returns the name and shape of γ, β, mean and variance of the normalisation.
    pub(super) fn normalisation(&self) -> [TensorShape; 4] {
        let part = |part: &str| (format!("{}.bn.{part}", self.name), vec![self.channels[1]]);
        ["weight", "bias", "running_mean", "running_var"].map(part)
    }
}

/// Builds Inception v3 as in pytorch-fid with channels divided by `divisor`; `make` turns each unit's shape into a unit.
///
/// # Errors
/// The first error of `make`.
pub(super) fn inception<T, E>(
    divisor: usize,
    make: &mut impl FnMut(UnitShape) -> Result<T, E>,
) -> Result<Vec<InceptionLayer<T>>, E> {
    let mut channels = 3;
    let mut network = Vec::new();
    for (block, layers) in blocks() {
        network.extend(chain(block, layers, &mut channels, divisor, make)?);
    }
    Ok(network)
}

/// Gives the units of `layers` their inputs; `channels` goes from those of the input to those of the output.
fn chain<T, E>(
    block: &str,
    layers: Vec<InceptionLayer<Planned>>,
    channels: &mut usize,
    divisor: usize,
    make: &mut impl FnMut(UnitShape) -> Result<T, E>,
) -> Result<Vec<InceptionLayer<T>>, E> {
    let mut place = |layer: InceptionLayer<Planned>| {
        Ok(match layer {
            MaxPool(window) => MaxPool(window),
            MeanPool(window) => MeanPool(window),
            Unit((name, outputs, window)) => {
                let inputs = std::mem::replace(channels, outputs / divisor);
                Unit(make(UnitShape { name: format!("{block}{name}"), channels: [inputs, *channels], window })?)
            }
            Branches(branches) => {
                let (inputs, mut outputs) = (*channels, 0);
                let branch = |layers| {
                    let mut channels = inputs;
                    let branch = chain(block, layers, &mut channels, divisor, make)?;
                    outputs += channels;
                    Ok(branch)
                };
                let branches = branches.into_iter().map(branch).collect::<Result<_, E>>()?;
                *channels = outputs;
                Branches(branches)
            }
        })
    };
    layers.into_iter().map(&mut place).collect()
}

/// Name within its block, outputs and window of a unit.
type Planned = (&'static str, usize, Window);

const POINT: Window = Window::square(1, 1, 0);
const SQUARE: Window = Window::square(3, 1, 1);
const VALID: Window = Window::square(3, 1, 0);
const HALVING: Window = Window::square(3, 2, 0);

const fn row(width: usize) -> Window {
    Window { kernel: [1, width], stride: 1, padding: [0, width / 2] }
}

const fn column(height: usize) -> Window {
    Window { kernel: [height, 1], stride: 1, padding: [height / 2, 0] }
}

/// Layers of each block, with the prefix of their names.
fn blocks() -> Vec<(&'static str, Vec<InceptionLayer<Planned>>)> {
    let stem = vec![
        Unit(("Conv2d_1a_3x3", 32, HALVING)),
        Unit(("Conv2d_2a_3x3", 32, VALID)),
        Unit(("Conv2d_2b_3x3", 64, SQUARE)),
        MaxPool(HALVING),
        Unit(("Conv2d_3b_1x1", 80, POINT)),
        Unit(("Conv2d_4a_3x3", 192, VALID)),
        MaxPool(HALVING),
    ];
    vec![
        ("", stem),
        ("Mixed_5b.", block_a(32)),
        ("Mixed_5c.", block_a(64)),
        ("Mixed_5d.", block_a(64)),
        ("Mixed_6a.", block_b()),
        ("Mixed_6b.", block_c(128)),
        ("Mixed_6c.", block_c(160)),
        ("Mixed_6d.", block_c(160)),
        ("Mixed_6e.", block_c(192)),
        ("Mixed_7a.", block_d()),
        ("Mixed_7b.", block_e(MeanPool(SQUARE))),
        ("Mixed_7c.", block_e(MaxPool(SQUARE))),
    ]
}

fn block_a(pool: usize) -> Vec<InceptionLayer<Planned>> {
    vec![Branches(vec![
        vec![Unit(("branch1x1", 64, POINT))],
        vec![Unit(("branch5x5_1", 48, POINT)), Unit(("branch5x5_2", 64, Window::square(5, 1, 2)))],
        vec![
            Unit(("branch3x3dbl_1", 64, POINT)),
            Unit(("branch3x3dbl_2", 96, SQUARE)),
            Unit(("branch3x3dbl_3", 96, SQUARE)),
        ],
        vec![MeanPool(SQUARE), Unit(("branch_pool", pool, POINT))],
    ])]
}

fn block_b() -> Vec<InceptionLayer<Planned>> {
    vec![Branches(vec![
        vec![Unit(("branch3x3", 384, HALVING))],
        vec![
            Unit(("branch3x3dbl_1", 64, POINT)),
            Unit(("branch3x3dbl_2", 96, SQUARE)),
            Unit(("branch3x3dbl_3", 96, HALVING)),
        ],
        vec![MaxPool(HALVING)],
    ])]
}

fn block_c(inner: usize) -> Vec<InceptionLayer<Planned>> {
    vec![Branches(vec![
        vec![Unit(("branch1x1", 192, POINT))],
        vec![
            Unit(("branch7x7_1", inner, POINT)),
            Unit(("branch7x7_2", inner, row(7))),
            Unit(("branch7x7_3", 192, column(7))),
        ],
        vec![
            Unit(("branch7x7dbl_1", inner, POINT)),
            Unit(("branch7x7dbl_2", inner, column(7))),
            Unit(("branch7x7dbl_3", inner, row(7))),
            Unit(("branch7x7dbl_4", inner, column(7))),
            Unit(("branch7x7dbl_5", 192, row(7))),
        ],
        vec![MeanPool(SQUARE), Unit(("branch_pool", 192, POINT))],
    ])]
}

fn block_d() -> Vec<InceptionLayer<Planned>> {
    vec![Branches(vec![
        vec![Unit(("branch3x3_1", 192, POINT)), Unit(("branch3x3_2", 320, HALVING))],
        vec![
            Unit(("branch7x7x3_1", 192, POINT)),
            Unit(("branch7x7x3_2", 192, row(7))),
            Unit(("branch7x7x3_3", 192, column(7))),
            Unit(("branch7x7x3_4", 192, HALVING)),
        ],
        vec![MaxPool(HALVING)],
    ])]
}

fn block_e(pool: InceptionLayer<Planned>) -> Vec<InceptionLayer<Planned>> {
    let both = |row_name, column_name| {
        Branches(vec![vec![Unit((row_name, 384, row(3)))], vec![Unit((column_name, 384, column(3)))]])
    };
    vec![Branches(vec![
        vec![Unit(("branch1x1", 320, POINT))],
        vec![Unit(("branch3x3_1", 384, POINT)), both("branch3x3_2a", "branch3x3_2b")],
        vec![
            Unit(("branch3x3dbl_1", 448, POINT)),
            Unit(("branch3x3dbl_2", 384, SQUARE)),
            both("branch3x3dbl_3a", "branch3x3dbl_3b"),
        ],
        vec![pool, Unit(("branch_pool", 192, POINT))],
    ])]
}
