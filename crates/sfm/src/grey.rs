//! Grey pictures: blur, halving, doubling.

/// A grey picture, row-major, values in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values.
    pub values: Vec<f32>,
}

impl Grey {
    /// The luma of colours in [0, 1], row-major.
    pub fn of_rgb(width: usize, height: usize, rgb: impl Iterator<Item = [f32; 3]>) -> Self {
        Self { width, height, values: rgb.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect() }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Convolved with a Gaussian of `sigma` pixels; the border is repeated.
    pub(crate) fn blurred(&self, sigma: f32) -> Self {
        let radius = (4.0 * sigma).ceil() as usize;
        let kernel: Vec<f32> =
            (0..=2 * radius).map(|i| (-0.5 * ((i as f32 - radius as f32) / sigma).powi(2)).exp()).collect();
        let sum: f32 = kernel.iter().sum();
        let (width, height) = (self.width, self.height);
        let mut across = vec![0.0; width * height];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in self.values.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (i, k) in kernel.iter().enumerate() {
                add_scaled(out, &padded[i..i + width], k / sum);
            }
        }
        let mut values = vec![0.0; width * height];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (i, k) in kernel.iter().enumerate() {
                let from = (y + i).saturating_sub(radius).min(height - 1) * width;
                add_scaled(out, &across[from..from + width], k / sum);
            }
        }
        Self { width, height, values }
    }

    /// Every second pixel of every second row.
    pub(crate) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let values = (0..width * height).map(|i| self.at(2 * (i % width), 2 * (i / width))).collect();
        Self { width, height, values }
    }

    /// Twice as large: pixel `2 x` of the result is pixel `x`, those between are means.
    pub(crate) fn doubled(&self) -> Self {
        let (width, height) = (2 * self.width, 2 * self.height);
        let value = |i: usize| {
            let (x, y) = (i % width, i / width);
            let (right, below) = (x.div_ceil(2).min(self.width - 1), y.div_ceil(2).min(self.height - 1));
            let (x, y) = (x / 2, y / 2);
            0.25 * (self.at(x, y) + self.at(right, y) + self.at(x, below) + self.at(right, below))
        };
        Self { width, height, values: (0..width * height).map(value).collect() }
    }

    /// `self - other`.
    pub(crate) fn minus(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a - b).collect();
        Self { values, ..*self }
    }
}

fn add_scaled(out: &mut [f32], values: &[f32], factor: f32) {
    out.iter_mut().zip(values).for_each(|(o, v)| *o += factor * v);
}
