//! Filling of the transparent parts of pictures.

use glam::{Vec3, Vec4};

/// Returns the colours of a picture whose transparent parts are filled. A pixel shows its own colour by its opacity, and
/// behind it the mean colour of the pixels around it, of more pixels the less opaque these are (the pull–push pyramid of
/// Gortler et al. 1996, Sec. 3.4).
///
/// `pixels` holds (Σ w c, α) of each pixel, row-major; `background` shows through where the whole picture is transparent.
pub(crate) fn filled(pixels: &[Vec4], (width, height): (usize, usize), background: Vec3) -> Vec<Vec3> {
    let over = |pixel: &Vec4, behind: Vec3| pixel.truncate() + (1.0 - pixel.w).max(0.0) * behind;
    if pixels.len() <= 1 {
        return pixels.iter().map(|pixel| over(pixel, background)).collect();
    }
    let half = (width.div_ceil(2), height.div_ceil(2));
    let mut coarse = vec![Vec4::ZERO; half.0 * half.1];
    for (i, pixel) in pixels.iter().enumerate() {
        coarse[i / width / 2 * half.0 + i % width / 2] += *pixel;
    }
    // A coarse pixel is opaque if the opacities of its four pixels sum to at least 1.
    coarse.iter_mut().for_each(|pixel| *pixel /= pixel.w.max(1.0));
    let coarse = filled(&coarse, half, background);
    // Weights along each axis: ¾ for the coarse pixel that contains the pixel, ¼ for the nearest other one.
    let ends = |at: usize, size: usize| {
        [at / 2, if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { (at / 2 + 1).min(size - 1) }]
    };
    let behind = |i: usize| {
        let (columns, rows) = (ends(i % width, half.0), ends(i / width, half.1));
        let weighted = |k: usize| {
            let weight: f32 = [0.75, 0.25][k % 2] * [0.75, 0.25][k / 2];
            weight * coarse[rows[k / 2] * half.0 + columns[k % 2]]
        };
        (0..4).map(weighted).fold(Vec3::ZERO, |sum, color| sum + color)
    };
    pixels.iter().enumerate().map(|(i, pixel)| over(pixel, behind(i))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (13, 7);

    /// A picture red on the left and green on the right, with a hole in each.
    fn holed(opacity: f32) -> Vec<Vec4> {
        let pixel = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let alpha = if (y == 3 && (x == 2 || x == 10)) || (2..5).contains(&y) && x == 11 { opacity } else { 1.0 };
            if x < 6 { alpha * Vec4::new(1.0, 0.0, 0.0, 1.0) } else { alpha * Vec4::new(0.0, 1.0, 0.0, 1.0) }
        };
        (0..SIZE.0 * SIZE.1).map(pixel).collect()
    }

    #[test]
    fn holes_take_the_colours_around_them() {
        for (i, color) in filled(&holed(0.0), SIZE, Vec3::splat(0.5)).into_iter().enumerate() {
            assert!(color.abs_diff_eq(if i % SIZE.0 < 6 { Vec3::X } else { Vec3::Y }, 1e-5), "{i}: {color}");
        }
        // A hole of two pixels in a ramp: ¾ of the nearer end and ¼ of the other.
        let ramp = |i: u8| if i == 3 || i == 4 { Vec4::ZERO } else { Vec3::splat(f32::from(i)).extend(1.0) };
        for size in [(8, 1), (1, 8)] {
            let shown = filled(&(0..8).map(ramp).collect::<Vec<_>>(), size, Vec3::ZERO);
            assert_eq!([shown[3], shown[4]], [2.75, 4.25].map(Vec3::splat));
        }
    }

    #[test]
    fn pixels_show_the_filling_by_their_transparency() {
        let [clear, half] = [0.0, 0.5].map(|opacity| filled(&holed(opacity), SIZE, Vec3::splat(0.5)));
        for (i, pixel) in holed(0.5).iter().enumerate() {
            assert!(half[i].abs_diff_eq(pixel.truncate() + (1.0 - pixel.w) * clear[i], 1e-5), "{i}");
        }
    }

    #[test]
    fn empty_pictures_show_the_background() {
        let background = Vec3::new(0.2, 0.4, 0.6);
        for size in [(1, 1), (5, 3), (0, 0)] {
            let picture = filled(&vec![Vec4::ZERO; size.0 * size.1], size, background);
            assert!(picture.iter().all(|color| color.abs_diff_eq(background, 1e-6)));
        }
    }
}
