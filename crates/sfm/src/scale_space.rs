//! Steps between the images of a scale space: blur, halving, doubling, differences.

use infonerf_scene::image::GreyImage;

/// Convolves `image` with a Gaussian of `sigma` pixels; the border is repeated.
pub(crate) fn blurred(image: &GreyImage, sigma: f32) -> GreyImage {
    let radius = (4.0 * sigma).ceil() as usize;
    let kernel: Vec<f32> =
        (0..=2 * radius).map(|i| (-0.5 * ((i as f32 - radius as f32) / sigma).powi(2)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    let (width, height) = (image.width, image.height);
    let mut across = vec![0.0; width * height];
    let mut padded = vec![0.0; width + 2 * radius];
    for (row, out) in image.values.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
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
    GreyImage { width, height, values }
}

/// Keeps every second pixel of every second row.
pub(crate) fn halved(image: &GreyImage) -> GreyImage {
    let (width, height) = (image.width / 2, image.height / 2);
    let values = (0..width * height).map(|i| image.at(2 * (i % width), 2 * (i / width))).collect();
    GreyImage { width, height, values }
}

/// Doubles the size: pixel `2 x` of the result is pixel `x`, those between are means.
pub(crate) fn doubled(image: &GreyImage) -> GreyImage {
    let (width, height) = (2 * image.width, 2 * image.height);
    let value = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (right, below) = (x.div_ceil(2).min(image.width - 1), y.div_ceil(2).min(image.height - 1));
        let (x, y) = (x / 2, y / 2);
        0.25 * (image.at(x, y) + image.at(right, y) + image.at(x, below) + image.at(right, below))
    };
    GreyImage { width, height, values: (0..width * height).map(value).collect() }
}

/// Subtracts `other` from `image`.
pub(crate) fn difference(image: &GreyImage, other: &GreyImage) -> GreyImage {
    let values = image.values.iter().zip(&other.values).map(|(a, b)| a - b).collect();
    GreyImage { values, ..*image }
}

fn add_scaled(out: &mut [f32], values: &[f32], factor: f32) {
    out.iter_mut().zip(values).for_each(|(o, v)| *o += factor * v);
}
