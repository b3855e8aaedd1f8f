use InceptionLayer::{Branches, MaxPool, MeanPool, Unit};

use crate::file::{TensorShape, normalisation};
use crate::layers::Window;

pub(super) enum InceptionLayer {
    Unit(UnitShape),
    MaxPool(Window),
    MeanPool(Window),
    /// Parallel branches, whose outputs are concatenated.
    Branches(Vec<Vec<Self>>),
}

/// Convolution of Inception with its batch normalisation and rectifier.
pub(super) struct UnitShape {
    /// Name in pytorch-fid, such as `Mixed_5b.branch1x1`.
    pub(super) name: String,
    pub(super) channels: [usize; 2],
    pub(super) window: Window,
}

impl UnitShape {
    pub(super) fn weight(&self) -> TensorShape {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        (format!("{}.conv.weight", self.name), vec![outputs, inputs, height, width])
    }

    pub(super) fn normalisation(&self) -> [TensorShape; 4] {
        normalisation(&format!("{}.bn", self.name), self.channels[1])
    }
}

/// Builds Inception v3 as in pytorch-fid with channels divided by `divisor`.
pub(super) fn inception(divisor: usize) -> Vec<InceptionLayer> {
    let (mut channels, mut blocks) = (3, blocks());
    for (block, layers) in &mut blocks {
        connect(block, layers, &mut channels, divisor);
    }
    blocks.into_iter().flat_map(|(_, layers)| layers).collect()
}

/// Sets names and channels of the units of `layers`; `channels` is the input's number before, and the output's after.
fn connect(block: &str, layers: &mut [InceptionLayer], channels: &mut usize, divisor: usize) {
    for layer in layers {
        match layer {
            MaxPool(_) | MeanPool(_) => {}
            Unit(unit) => {
                unit.name.insert_str(0, block);
                unit.channels[0] = *channels;
                unit.channels[1] /= divisor;
                *channels = unit.channels[1];
            }
            Branches(branches) => {
                let inputs = std::mem::take(channels);
                for branch in branches {
                    let mut outputs = inputs;
                    connect(block, branch, &mut outputs, divisor);
                    *channels += outputs;
                }
            }
        }
    }
}

pub(super) fn units(layers: &[InceptionLayer]) -> Vec<&UnitShape> {
    let within = layers.iter().map(|layer| match layer {
        Unit(unit) => vec![unit],
        MaxPool(_) | MeanPool(_) => vec![],
        Branches(branches) => branches.iter().flat_map(|branch| units(branch)).collect(),
    });
    within.flatten().collect()
}

/// Creates a unit that is not connected yet.
fn unit(name: &str, outputs: usize, window: Window) -> InceptionLayer {
    Unit(UnitShape { name: name.to_owned(), channels: [0, outputs], window })
}

/// Creates a sequence of units with these outputs and windows; their names are numbered from 1.
fn branch<const N: usize>(name: &str, units: [(usize, Window); N]) -> Vec<InceptionLayer> {
    (1..).zip(units).map(|(i, (outputs, window))| unit(&format!("{name}{i}"), outputs, window)).collect()
}

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
fn blocks() -> Vec<(&'static str, Vec<InceptionLayer>)> {
    let stem = vec![
        unit("Conv2d_1a_3x3", 32, HALVING),
        unit("Conv2d_2a_3x3", 32, VALID),
        unit("Conv2d_2b_3x3", 64, SQUARE),
        MaxPool(HALVING),
        unit("Conv2d_3b_1x1", 80, POINT),
        unit("Conv2d_4a_3x3", 192, VALID),
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

fn block_a(pool: usize) -> Vec<InceptionLayer> {
    vec![Branches(vec![
        vec![unit("branch1x1", 64, POINT)],
        branch("branch5x5_", [(48, POINT), (64, Window::square(5, 1, 2))]),
        branch("branch3x3dbl_", [(64, POINT), (96, SQUARE), (96, SQUARE)]),
        vec![MeanPool(SQUARE), unit("branch_pool", pool, POINT)],
    ])]
}

fn block_b() -> Vec<InceptionLayer> {
    vec![Branches(vec![
        vec![unit("branch3x3", 384, HALVING)],
        branch("branch3x3dbl_", [(64, POINT), (96, SQUARE), (96, HALVING)]),
        vec![MaxPool(HALVING)],
    ])]
}

fn block_c(inner: usize) -> Vec<InceptionLayer> {
    let (row, column) = (row(7), column(7));
    let double = [(inner, POINT), (inner, column), (inner, row), (inner, column), (192, row)];
    vec![Branches(vec![
        vec![unit("branch1x1", 192, POINT)],
        branch("branch7x7_", [(inner, POINT), (inner, row), (192, column)]),
        branch("branch7x7dbl_", double),
        vec![MeanPool(SQUARE), unit("branch_pool", 192, POINT)],
    ])]
}

fn block_d() -> Vec<InceptionLayer> {
    vec![Branches(vec![
        branch("branch3x3_", [(192, POINT), (320, HALVING)]),
        branch("branch7x7x3_", [(192, POINT), (192, row(7)), (192, column(7)), (192, HALVING)]),
        vec![MaxPool(HALVING)],
    ])]
}

fn block_e(pool: InceptionLayer) -> Vec<InceptionLayer> {
    let both = |wide, high| Branches(vec![vec![unit(wide, 384, row(3))], vec![unit(high, 384, column(3))]]);
    let mut double = branch("branch3x3dbl_", [(448, POINT), (384, SQUARE)]);
    double.push(both("branch3x3dbl_3a", "branch3x3dbl_3b"));
    vec![Branches(vec![
        vec![unit("branch1x1", 320, POINT)],
        vec![unit("branch3x3_1", 384, POINT), both("branch3x3_2a", "branch3x3_2b")],
        double,
        vec![pool, unit("branch_pool", 192, POINT)],
    ])]
}
