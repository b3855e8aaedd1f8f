/// Feature maps as one slice, `[n, height, width, channels]`: all channels of a pixel are neighbours, so that windows are
/// copied in long runs and pooling runs along channels.
#[derive(Clone)]
pub(crate) struct HostMaps {
    pub(crate) values: Vec<f32>,
    pub(crate) shape: [usize; 4],
}

impl HostMaps {
    /// # Panics
    /// If there are not as many values as the shape says.
    pub(crate) fn new(values: Vec<f32>, shape: [usize; 4]) -> Self {
        assert_eq!(values.len(), shape.iter().product::<usize>(), "values of shape {shape:?}");
        Self { values, shape }
    }

    /// Height and width.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.shape[1], self.shape[2]]
    }

    pub(crate) fn channels(&self) -> usize {
        self.shape[3]
    }

    /// The channels of the pixel at row `y` and column `x` of map stack `n`.
    pub(crate) fn pixel(&self, n: usize, y: usize, x: usize) -> &[f32] {
        let [_, height, width, channels] = self.shape;
        &self.values[((n * height + y) * width + x) * channels..][..channels]
    }

    /// The maps of each picture.
    pub(crate) fn pictures(&self) -> impl Iterator<Item = &[f32]> {
        let [_, height, width, channels] = self.shape;
        self.values.chunks_exact(height * width * channels)
    }
}
