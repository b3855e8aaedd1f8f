//! Area resampling.

/// Returns the size with longest side `longest` and the aspect ratio of `(width, height)`, each side
/// rounded to the nearest pixel and at least 1.
pub fn resized_dimensions(width: u32, height: u32, longest: u32) -> (u32, u32) {
    let long = f64::from(width.max(height)).max(1.0);
    let scale = |side: u32| ((f64::from(side) * f64::from(longest) / long).round() as u32).max(1);
    (scale(width), scale(height))
}

/// Box-filters row-major pixels from size `from` to size `to`, both `(width, height)`.
///
/// Output pixel `k` of `m` from `n` covers the interval `[k·n/m, (k+1)·n/m]` of the input and takes the mean over it,
/// so that every factor works, whole or not, up or down, and a constant stays constant. Separable: rows first. Sums are
/// kept in `f64`. Pixels missing from a `pixels` shorter than `from` count as 0.
pub(super) fn box_filter<const C: usize>(pixels: &[[f32; C]], from: (u32, u32), to: (u32, u32)) -> Vec<[f32; C]> {
    let (w, h) = (from.0 as usize, from.1 as usize);
    let (columns, rows) = (spans(from.0, to.0), spans(from.1, to.1));
    let pixel = |x: usize, y: usize| pixels.get(y * w + x).map_or([0.0; C], |p| p.map(f64::from));
    let narrow_row = |y: usize| columns.iter().map(|span| span.mean(|x| pixel(x, y))).collect();
    let narrow: Vec<Vec<[f64; C]>> = (0..h).map(narrow_row).collect();
    let row = |span: &FilterSpan| {
        let means = (0..columns.len()).map(|x| span.mean(|y| narrow[y][x]).map(|v| v as f32));
        means.collect::<Vec<_>>()
    };
    rows.iter().flat_map(row).collect()
}

/// The input pixels `first..first + weights.len()` under one output pixel; weights sum to 1.
struct FilterSpan {
    first: usize,
    weights: Vec<f64>,
}

impl FilterSpan {
    fn mean<const C: usize>(&self, pixel: impl Fn(usize) -> [f64; C]) -> [f64; C] {
        let mut sum = [0.0; C];
        for (k, weight) in self.weights.iter().enumerate() {
            let p = pixel(self.first + k);
            for c in 0..C {
                sum[c] += weight * p[c];
            }
        }
        sum
    }
}

/// Returns the span of input pixels under each output pixel, in integer arithmetic: in units of `1/m` of an input
/// pixel, input pixel `i` is `[i·m, (i+1)·m]` and output pixel `k` is `[k·n, (k+1)·n]`, so that the weights are exact
/// fractions of `n`.
fn spans(n: u32, m: u32) -> Vec<FilterSpan> {
    let (n, m) = (u64::from(n), u64::from(m));
    (0..m)
        .map(|k| {
            let (lo, hi) = (k * n, (k + 1) * n);
            let (first, end) = (lo / m, hi.div_ceil(m));
            let weights = (first..end).map(|i| (hi.min((i + 1) * m) - lo.max(i * m)) as f64 / n as f64).collect();
            FilterSpan { first: first as usize, weights }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn factors_by_hand() {
        let pixels = [[1.0f32], [3.0], [5.0], [7.0], [2.0], [4.0], [6.0], [8.0]];
        assert_eq!(box_filter(&pixels, (4, 2), (2, 1)), [[2.5], [6.5]]);
        // 3 → 2: each output pixel covers 1½ input pixels.
        assert_eq!(box_filter(&[[0.0f32], [3.0], [9.0]], (3, 1), (2, 1)), [[1.0], [7.0]]);
        assert_eq!(box_filter(&[[1.0f32], [2.0]], (2, 1), (4, 1)), [[1.0], [1.0], [2.0], [2.0]]);
    }

    #[test]
    fn dimensions_keep_the_aspect() {
        assert_eq!(resized_dimensions(800, 600, 400), (400, 300));
        assert_eq!(resized_dimensions(504, 378, 100), (100, 75));
        assert_eq!(resized_dimensions(10_000, 1, 10), (10, 1));
    }

    proptest! {
        #[test]
        fn keeps_the_mean(w in 1u32..12, h in 1u32..12, tw in 1u32..12, th in 1u32..12) {
            let pixels: Vec<_> = (0..w * h).map(|i| [(i * 37 % 11) as f32]).collect();
            let out = box_filter(&pixels, (w, h), (tw, th));
            prop_assert_eq!(out.len(), (tw * th) as usize);
            let mean = |p: &[[f32; 1]]| p.iter().map(|v| v[0]).sum::<f32>() / p.len() as f32;
            prop_assert!((mean(&pixels) - mean(&out)).abs() < 1e-4);
        }
    }
}
