use std::sync::{Mutex, PoisonError};

/// Feature maps as one slice, `[n, height, width, channels]`: all channels of a pixel are neighbours, so that windows are
/// copied in long runs and pooling runs along channels.
pub(crate) struct HostMaps {
    /// As many as `shape` says, and what is left of the maps whose room they have.
    room: Vec<f32>,
    pub(crate) shape: [usize; 4],
}

/// Rooms of maps that are gone, for others to be in: fresh pages take as long as the layers that fill them.
static SPARE: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());
/// Most rooms that are spare.
const SPARES: usize = 4;

impl HostMaps {
    /// # Panics
    /// If there are not as many values as the shape says.
    pub(crate) fn new(values: Vec<f32>, shape: [usize; 4]) -> Self {
        assert_eq!(values.len(), shape.iter().product::<usize>(), "values of shape {shape:?}");
        Self { room: values, shape }
    }

    /// Maps of any numbers, to be overwritten.
    pub(crate) fn of(shape: [usize; 4]) -> Self {
        let count = shape.iter().product();
        let mut spare = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        let fitting = (0..spare.len()).filter(|&at| spare[at].len() >= count).min_by_key(|&at| spare[at].len());
        let room = fitting.map_or_else(|| vec![0.0; count], |at| spare.swap_remove(at));
        Self { room, shape }
    }

    pub(crate) fn values(&self) -> &[f32] {
        &self.room[..self.shape.iter().product()]
    }

    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.room[..self.shape.iter().product()]
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
        &self.room[((n * height + y) * width + x) * channels..][..channels]
    }

    /// The maps of each picture.
    pub(crate) fn pictures(&self) -> impl Iterator<Item = &[f32]> {
        let [_, height, width, channels] = self.shape;
        self.values().chunks_exact(height * width * channels)
    }
}

impl Clone for HostMaps {
    fn clone(&self) -> Self {
        Self::new(self.values().to_vec(), self.shape)
    }
}

impl Drop for HostMaps {
    fn drop(&mut self) {
        let mut spare = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        spare.push(std::mem::take(&mut self.room));
        if spare.len() > SPARES {
            let least = (0..spare.len()).min_by_key(|&at| spare[at].len());
            least.map(|at| spare.swap_remove(at));
        }
    }
}
