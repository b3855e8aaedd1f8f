//! Pictures where rays meet nothing.

/// Returns a picture in which each pixel shows its own colour as far as it is opaque, and behind it the mean of what
/// the pixels about it show, the more of them the less opaque they are (the pull–push pyramid of Gortler et al. 1996,
/// Sec. 3.4).
///
/// `pixels` holds (Σ w c, α) of each pixel, row-major; `background` shows through where the whole picture is transparent.
pub(crate) fn filled(pixels: &[[f32; 4]], (width, height): (usize, usize), background: [f32; 3]) -> Vec<[f32; 3]> {
    let over = |pixel: &[f32; 4], behind: [f32; 3]| {
        std::array::from_fn(|channel| pixel[channel] + (1.0 - pixel[3]).max(0.0) * behind[channel])
    };
    if pixels.len() <= 1 {
        return pixels.iter().map(|pixel| over(pixel, background)).collect();
    }
    let half = (width.div_ceil(2), height.div_ceil(2));
    let mut coarse = vec![[0.0; 4]; half.0 * half.1];
    for (i, pixel) in pixels.iter().enumerate() {
        let sum = &mut coarse[i / width / 2 * half.0 + i % width / 2];
        sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value);
    }
    // A pixel is opaque as soon as the four that it stands for have the opacity of one.
    for pixel in &mut coarse {
        let opacity = pixel[3].max(1.0);
        *pixel = pixel.map(|value| value / opacity);
    }
    let coarse = filled(&coarse, half, background);
    // Three parts of the coarse pixel that it is of to one of the nearest other, along each axis.
    let ends = |at: usize, size: usize| {
        [at / 2, if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { (at / 2 + 1).min(size - 1) }]
    };
    let behind = |i: usize| {
        let (columns, rows) = (ends(i % width, half.0), ends(i / width, half.1));
        let weighted = |k: usize| {
            let weight = [0.75, 0.25][k % 2] * [0.75, 0.25][k / 2];
            coarse[rows[k / 2] * half.0 + columns[k % 2]].map(|value| weight * value)
        };
        (0..4).map(weighted).fold([0.0; 3], |sum, color| std::array::from_fn(|channel| sum[channel] + color[channel]))
    };
    pixels.iter().enumerate().map(|(i, pixel)| over(pixel, behind(i))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (13, 7);

    /// A picture red on the left and green on the right, with a hole in each.
    fn holed(opacity: f32) -> Vec<[f32; 4]> {
        let pixel = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let alpha = if (y == 3 && (x == 2 || x == 10)) || (2..5).contains(&y) && x == 11 { opacity } else { 1.0 };
            if x < 6 { [alpha, 0.0, 0.0, alpha] } else { [0.0, alpha, 0.0, alpha] }
        };
        (0..SIZE.0 * SIZE.1).map(pixel).collect()
    }

    #[test]
    fn a_hole_shows_what_is_about_it() {
        let picture = filled(&holed(0.0), SIZE, [0.5; 3]);
        for (i, color) in picture.iter().enumerate() {
            let want = if i % SIZE.0 < 6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
            assert!(color.iter().zip(want).all(|(found, want)| (found - want).abs() < 1e-5), "{i}: {color:?}");
        }
    }

    #[test]
    fn what_is_opaque_stays_and_the_rest_is_as_much_as_it_lets_through() {
        let [clear, half] = [0.0, 0.5].map(|opacity| filled(&holed(opacity), SIZE, [0.5; 3]));
        for (i, pixel) in holed(0.5).iter().enumerate() {
            let own = [0, 1, 2].map(|channel| pixel[channel] + (1.0 - pixel[3]) * clear[i][channel]);
            assert!(own.iter().zip(half[i]).all(|(own, found)| (own - found).abs() < 1e-5), "{i}");
        }
    }

    #[test]
    fn where_nothing_is_seen_there_is_the_background() {
        for size in [(1, 1), (5, 3), (0, 0)] {
            let picture = filled(&vec![[0.0; 4]; size.0 * size.1], size, [0.2, 0.4, 0.6]);
            assert!(picture.iter().flatten().zip([0.2, 0.4, 0.6].iter().cycle()).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}
