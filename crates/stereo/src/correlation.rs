//! Normalised cross-correlation of windows of two images.

use infonerf_scene::image::GreyImage;

/// Constant added to variances, so that noise in uniform windows does not correlate.
const NOISE: f32 = 1e-4;

/// Statistics of the windows of an image with which other images are compared.
pub(crate) struct Windows<'a> {
    image: &'a GreyImage,
    half: usize,
    /// Number of pixels of each window, mean and variance of the image there.
    statistics: Vec<(f32, f32, f32)>,
}

impl<'a> Windows<'a> {
    pub(crate) fn new(image: &'a GreyImage, half: usize) -> Self {
        let rows = image.values.iter().map(|&a| if a.is_nan() { [0.0; 4] } else { [1.0, a, a * a, 0.0] }).collect();
        let of_sums = |[n, sum, squares, _]: [f32; 4]| (n, sum / n, (squares / n - (sum / n).powi(2)).max(0.0));
        Self { image, half, statistics: sums(rows, image.width, half).into_iter().map(of_sums).collect() }
    }

    /// Returns the normalised cross-correlation of the windows of the image, `a`, and of `b` about each pixel, from −1 to 1:
    ///
    /// `(E[ab] − E[a]E[b]) / √((Var a + c)(Var b + c))`, `c = 1e-4`
    ///
    /// NaN pixels of `a` are left out of its windows. The result is NaN where `b` is NaN at another pixel of the window.
    pub(crate) fn correlation(&self, b: &[f32]) -> Vec<f32> {
        let products = |(&a, &b): (&f32, &f32)| {
            if a.is_nan() || b.is_nan() { [0.0; 4] } else { [1.0, b, b * b, a * b] }
        };
        let sums = sums(self.image.values.iter().zip(b).map(products).collect(), self.image.width, self.half);
        let correlation = |(&(n, mean, variance), &[known, sum, squares, both]): (&(f32, f32, f32), &[f32; 4])| {
            if known < n || n == 0.0 {
                return f32::NAN;
            }
            let other = (squares / n - (sum / n).powi(2)).max(0.0);
            (both / n - mean * sum / n) / ((variance + NOISE) * (other + NOISE)).sqrt()
        };
        self.statistics.iter().zip(&sums).map(correlation).collect()
    }
}

/// Sums the values of `rows`, `width` in each, over the part of the square window about each value that lies within the rows.
fn sums(mut rows: Vec<[f32; 4]>, width: usize, half: usize) -> Vec<[f32; 4]> {
    let height = rows.len() / width;
    let mut sum_of_row = vec![[0.0; 4]; width];
    for row in rows.chunks_exact_mut(width) {
        let mut sum = [0.0; 4];
        row[..half.min(width)].iter().for_each(|value| add(&mut sum, value, 1.0));
        for x in 0..width {
            if x + half < width {
                add(&mut sum, &row[x + half], 1.0);
            }
            if x > half {
                add(&mut sum, &row[x - half - 1], -1.0);
            }
            sum_of_row[x] = sum;
        }
        row.copy_from_slice(&sum_of_row);
    }
    let mut sums = vec![[0.0; 4]; rows.len()];
    let mut column = vec![[0.0; 4]; width];
    let accumulate = |y: usize, sign: f32, column: &mut [[f32; 4]]| {
        column.iter_mut().zip(&rows[y * width..][..width]).for_each(|(sum, value)| add(sum, value, sign));
    };
    (0..half.min(height)).for_each(|y| accumulate(y, 1.0, &mut column));
    for y in 0..height {
        if y + half < height {
            accumulate(y + half, 1.0, &mut column);
        }
        if y > half {
            accumulate(y - half - 1, -1.0, &mut column);
        }
        sums[y * width..][..width].copy_from_slice(&column);
    }
    sums
}

fn add(sum: &mut [f32; 4], value: &[f32; 4], sign: f32) {
    sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += sign * value);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(usize, usize) -> f32) -> GreyImage {
        let values = (0..9).flat_map(|y| (0..11).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        GreyImage { width: 11, height: 9, values }
    }

    #[test]
    fn sums_are_those_of_windows() {
        let picture = picture(|x, y| ((3 * x + 7 * y) % 5) as f32);
        let found = sums(picture.values.iter().map(|&value| [value, 1.0, 0.0, 0.0]).collect(), 11, 2);
        for (i, sum) in found.iter().enumerate() {
            let (x, y) = (i % 11, i / 11);
            let (columns, rows) = (x.saturating_sub(2)..(x + 3).min(11), y.saturating_sub(2)..(y + 3).min(9));
            let places: Vec<usize> = rows.flat_map(|y| columns.clone().map(move |x| y * 11 + x)).collect();
            let want: f32 = places.iter().map(|&place| picture.values[place]).sum();
            assert_eq!(*sum, [want, places.len() as f32, 0.0, 0.0]);
        }
    }

    #[test]
    fn brightness_and_contrast_do_not_matter() {
        let a = picture(|x, y| ((3 * x + 7 * y) % 5) as f32 / 5.0);
        let mut brighter: Vec<f32> = a.values.iter().map(|value| 0.2 + 0.5 * value).collect();
        brighter[0] = f32::NAN;
        let found = Windows::new(&a, 2).correlation(&brighter);
        assert!(found[0].is_nan() && found[2].is_nan() && !found[3].is_nan());
        assert!(found.iter().all(|value| value.is_nan() || (*value > 0.98 && *value < 1.001)), "{found:?}");
        // Pixels that are NaN in the image are left out of its windows and affect no others.
        let mut holed = a.clone();
        holed.values[4 * 11 + 5] = f32::NAN;
        let found = Windows::new(&holed, 2).correlation(&a.values);
        assert!(found.iter().all(|value| *value > 0.98 && *value < 1.001), "{found:?}");
        let found = Windows::new(&a, 2).correlation(&vec![0.5; a.values.len()]);
        assert!(found.iter().all(|value| value.abs() < 1e-2), "{found:?}");
    }
}
