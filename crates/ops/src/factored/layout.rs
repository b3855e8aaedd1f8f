//! Places of a factored field's parameters.

/// Axes of each plane, and of the line that goes with it.
pub const PLANES: [[usize; 3]; 3] = [[0, 1, 2], [0, 2, 1], [1, 2, 0]];

/// Planes and lines of one resolution.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Level {
    /// Texels along each axis, at least 2.
    pub resolution: usize,
    /// Features of each plane and line: 2, 4, 8 or 16.
    pub channels: usize,
    /// Start of the level's tables: three planes `[res, res, C]` (second axis slower), then three lines `[res, C]`.
    pub offset: usize,
    /// Start of the level's 3 · `channels` features in the MLP's input.
    pub feature: usize,
}

impl Level {
    /// Returns the number of elements of one plane.
    pub fn plane_len(&self) -> usize {
        self.resolution * self.resolution * self.channels
    }

    /// Returns the number of elements of one line.
    pub fn line_len(&self) -> usize {
        self.resolution * self.channels
    }

    fn elements(&self) -> usize {
        3 * (self.plane_len() + self.line_len())
    }

    /// Returns the start of plane `p`.
    pub fn plane(&self, p: usize) -> usize {
        self.offset + p * self.plane_len()
    }

    /// Returns the start of line `p`.
    pub fn line(&self, p: usize) -> usize {
        self.offset + 3 * self.plane_len() + p * self.line_len()
    }
}

/// Dense layer of the MLP: weights `[outputs, inputs]` row-major, then biases `[outputs]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Width of the input.
    pub inputs: usize,
    /// Width of the output.
    pub outputs: usize,
    /// Start of the weights.
    pub weight: usize,
}

impl Layer {
    /// Returns the start of the biases.
    pub fn bias(&self) -> usize {
        self.weight + self.inputs * self.outputs
    }

    /// Returns the start of the next layer.
    pub fn end(&self) -> usize {
        self.bias() + self.outputs
    }
}

/// Sizes of a field, and places of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredLayout {
    /// Frequencies of the position's encoding.
    pub frequencies: usize,
    /// Planes and lines, coarsest first.
    pub levels: Vec<Level>,
    /// Layers of the MLP; the last layer gives density, red, green and blue, and if `view_dependent` the nine derivatives of red,
    /// green and blue with respect to x, y and z of the view direction.
    pub layers: Vec<Layer>,
    /// Whether colour depends on the view direction.
    pub view_dependent: bool,
    /// s in σ = s·softplus(x + b).
    pub density_scale: f32,
    /// b in σ = s·softplus(x + b).
    pub density_bias: f32,
}

/// Number of outputs: density and colour.
pub(crate) const OUTPUTS: usize = 4;
/// Largest number of outputs of the MLP.
pub(crate) const RAW: usize = OUTPUTS + 9;

impl FactoredLayout {
    /// Lays out levels of `(resolution, channels)` and an MLP of `hidden_layers` layers of `hidden` units.
    ///
    /// # Panics
    /// If there is no level.
    pub fn new(
        frequencies: usize,
        levels: &[(usize, usize)],
        (hidden_layers, hidden): (usize, usize),
        view_dependent: bool,
        density: (f32, f32),
    ) -> Self {
        assert!(!levels.is_empty(), "a factored field has a level");
        let mut feature = 3 + 6 * frequencies;
        let mut offset = 0;
        let level = |&(resolution, channels): &(usize, usize)| {
            let level = Level { resolution, channels, offset, feature };
            offset += level.elements();
            feature += 3 * channels;
            level
        };
        let levels = levels.iter().map(level).collect();
        let (mut weight, mut inputs) = (0, feature);
        let layer = |outputs: usize| {
            let layer = Layer { inputs, outputs, weight };
            (weight, inputs) = (layer.end(), outputs);
            layer
        };
        let widths = std::iter::repeat_n(hidden, hidden_layers).chain([if view_dependent { RAW } else { OUTPUTS }]);
        let layers = widths.map(layer).collect();
        Self { frequencies, levels, layers, view_dependent, density_scale: density.0, density_bias: density.1 }
    }

    /// Returns the number of elements of all planes and lines.
    pub fn table_len(&self) -> usize {
        self.levels.iter().map(Level::elements).sum()
    }

    /// Splits `tables` into planes and lines: three planes of a level, then its three lines.
    #[cfg(feature = "flex")]
    pub(super) fn split_tables<'a>(&self, mut tables: &'a mut [f32]) -> Vec<&'a mut [f32]> {
        let lengths = self.levels.iter().flat_map(|level| [[level.plane_len(); 3], [level.line_len(); 3]]).flatten();
        lengths.map(|length| tables.split_off_mut(..length).expect("tables hold every plane and line")).collect()
    }

    /// Returns the number of weights and biases of the MLP.
    pub fn weight_len(&self) -> usize {
        self.layers.last().map_or(0, Layer::end)
    }

    /// Returns the width of the MLP's input.
    pub fn features(&self) -> usize {
        self.layers[0].inputs
    }
}
