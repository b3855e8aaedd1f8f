//! Resizing of images to Inception's size and range.

use infonerf_metrics::Picture;
use infonerf_metrics::protocol::InceptionInput;

/// Resizes `picture` to `side` × `side` pixels and scales it to about [−1, 1], row-major with channels innermost.
///
/// pytorch-fid resizes like PyTorch's `interpolate(mode="bilinear", align_corners=False)`, which skips pixels where it
/// shrinks, and takes 2x − 1. clean-fid resizes like Pillow's bicubic filter of float images, as wide as what it shrinks,
/// and takes (x − 128)/128 of 8-bit values; neither result is clamped.
pub(super) fn resized(picture: &Picture, side: usize, input: InceptionInput) -> Vec<f32> {
    let [width, height] = picture.size();
    let (columns, rows) = (taps(width, side, input), taps(height, side, input));
    let mut across = vec![[0f32; 3]; height * side];
    for (line, line_across) in picture.pixels().chunks_exact(width).zip(across.chunks_exact_mut(side)) {
        for (pixel, taps) in line_across.iter_mut().zip(&columns) {
            *pixel = taps.sum(|x| line[x]);
        }
    }
    let scale = |value: f32| match input {
        InceptionInput::PytorchFid => 2.0 * value - 1.0,
        InceptionInput::CleanFid => (255.0 * value - 128.0) / 128.0,
    };
    let line = |taps: &ResizeTaps| (0..side).map(|x| taps.sum(|y| across[y * side + x])).collect::<Vec<_>>();
    rows.iter().flat_map(line).flatten().map(scale).collect()
}

/// Weights of consecutive input pixels for an output pixel, along one axis.
struct ResizeTaps {
    first: usize,
    weights: Vec<f32>,
}

impl ResizeTaps {
    fn sum(&self, pixel: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (at, weight) in (self.first..).zip(&self.weights) {
            let pixel = pixel(at);
            sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += weight * value);
        }
        sum
    }
}

/// Returns the taps of `to` output pixels among `from` input pixels, centres at + 0.5.
fn taps(from: usize, to: usize, input: InceptionInput) -> Vec<ResizeTaps> {
    let step = from as f64 / to as f64;
    let centre = |at: usize| (at as f64 + 0.5) * step;
    match input {
        InceptionInput::PytorchFid => (0..to).map(|at| linear(centre(at) - 0.5, from)).collect(),
        InceptionInput::CleanFid => (0..to).map(|at| cubic(centre(at), step.max(1.0), from)).collect(),
    }
}

/// Interpolates between the two pixels around `at`, measured in pixels from the first one's centre.
fn linear(at: f64, from: usize) -> ResizeTaps {
    let at = at.clamp(0.0, (from - 1) as f64);
    let first = (at as usize).min(from.saturating_sub(2));
    let share = (at - first as f64) as f32;
    let weights = if from == 1 { vec![1.0] } else { vec![1.0 - share, share] };
    ResizeTaps { first, weights }
}

/// Samples Keys' cubic with a = −½ about `centre`, stretched by `scale`, at the pixels inside the image.
fn cubic(centre: f64, scale: f64, from: usize) -> ResizeTaps {
    let reach = 2.0 * scale;
    let first = (centre - reach + 0.5).max(0.0) as usize;
    let end = ((centre + reach + 0.5) as usize).min(from);
    let weight = |x: usize| keys((x as f64 + 0.5 - centre) / scale);
    let total: f64 = (first..end).map(weight).sum();
    ResizeTaps { first, weights: (first..end).map(|x| (weight(x) / total) as f32).collect() }
}

fn keys(x: f64) -> f64 {
    const A: f64 = -0.5;
    let x = x.abs();
    if x < 1.0 {
        ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        (((x - 5.0) * x + 8.0) * x - 4.0) * A
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resizing_to_the_same_size_changes_nothing() {
        let picture = Picture::new((0..25).map(|i| [i as f32 / 25.0, 0.0, 1.0]).collect(), 5, 5).unwrap();
        for input in [InceptionInput::PytorchFid, InceptionInput::CleanFid] {
            let resized = resized(&picture, 5, input);
            let back = |value: f32| {
                if input == InceptionInput::PytorchFid { (value + 1.0) / 2.0 } else { (value * 128.0 + 128.0) / 255.0 }
            };
            for (found, expected) in resized.iter().zip(picture.pixels().as_flattened()) {
                approx::assert_abs_diff_eq!(back(*found), *expected, epsilon = 1e-6);
            }
        }
    }

    #[test]
    fn flat_images_stay_flat_at_any_size() {
        for (width, height) in [(1, 1), (1, 7), (2, 3), (31, 400)] {
            let picture = Picture::new(vec![[0.25; 3]; width * height], width, height).unwrap();
            let expected = (255.0 * 0.25 - 128.0) / 128.0;
            for (input, expected) in [(InceptionInput::PytorchFid, -0.5), (InceptionInput::CleanFid, expected)] {
                for found in resized(&picture, 29, input) {
                    approx::assert_abs_diff_eq!(found, expected, epsilon = 1e-6);
                }
            }
        }
    }
}
