//! Shrinking of images by averaging over areas.

use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::Picture;

/// Shrinks an image to `size` (without 0): each pixel is the mean over the area that it covers.
///
/// # Errors
/// [`MetricError::Size`] if a side is smaller than that of `size`.
pub(crate) fn shrunk_picture(picture: &Picture, size: [usize; 2]) -> Result<Picture, MetricError> {
    check("truth", picture.size(), size)?;
    let channel = |channel: usize| {
        let plane: Vec<f64> = picture.pixels().iter().map(|pixel| f64::from(pixel[channel])).collect();
        shrunk(&plane, picture.size(), size)
    };
    let channels = [0, 1, 2].map(channel);
    let pixel = |index: usize| std::array::from_fn(|channel| channels[channel][index] as f32);
    Picture::new((0..size[0] * size[1]).map(pixel).collect(), size[0], size[1])
}

/// Shrinks a mask to `size`: a pixel is inside if at least half of its area is.
///
/// # Errors
/// As [`shrunk_picture`].
pub(crate) fn shrunk_mask(mask: &Mask, size: [usize; 2]) -> Result<Mask, MetricError> {
    check("mask", mask.size(), size)?;
    let coverage: Vec<f64> = mask.inside().iter().map(|&inside| f64::from(u8::from(inside))).collect();
    let coverage = shrunk(&coverage, mask.size(), size);
    Mask::new(coverage.into_iter().map(|share| share >= 0.5).collect(), size[0], size[1])
}

fn check(what: &'static str, found: [usize; 2], expected: [usize; 2]) -> Result<(), MetricError> {
    let is_larger = found[0] >= expected[0] && found[1] >= expected[1];
    if is_larger { Ok(()) } else { Err(MetricError::Size { what, found, expected }) }
}

fn shrunk(plane: &[f64], from: [usize; 2], to: [usize; 2]) -> Vec<f64> {
    let [columns, rows] = [0, 1].map(|axis| areas(from[axis], to[axis]));
    let across: Vec<f64> = plane
        .chunks_exact(from[0])
        .flat_map(|row| columns.iter().map(|area| area.iter().map(|&(x, share)| share * row[x]).sum::<f64>()))
        .collect();
    let down = |area: &[(usize, f64)], x: usize| area.iter().map(|&(y, share)| share * across[y * to[0] + x]).sum();
    rows.iter().flat_map(|area| (0..to[0]).map(|x| down(area, x))).collect()
}

/// Returns for each of `to` equal parts of a side of `from` pixels the pixels that it covers, and their shares of it.
fn areas(from: usize, to: usize) -> Vec<Vec<(usize, f64)>> {
    // In units of 1/to of a pixel, part i covers [i·from, (i+1)·from) and pixel x covers [x·to, (x+1)·to).
    let part = |i: usize| {
        let (start, end) = (i * from, (i + 1) * from);
        let overlap = |x: usize| (end.min((x + 1) * to) - start.max(x * to)) as f64 / from as f64;
        (start / to..end.div_ceil(to)).map(|x| (x, overlap(x))).collect()
    };
    (0..to).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_may_share_pixels() {
        let third = 1.0 / 3.0;
        assert_eq!(areas(3, 2), [vec![(0, 2.0 * third), (1, third)], vec![(1, third), (2, 2.0 * third)]]);
        assert_eq!(areas(4, 1), [[(0, 0.25), (1, 0.25), (2, 0.25), (3, 0.25)]]);
    }

    #[test]
    fn shrinking_keeps_the_mean() {
        let picture = Picture::new((0..35).map(|i| [i as f32 / 35.0, 0.25, 1.0]).collect(), 7, 5).unwrap();
        let mean = |picture: &Picture| {
            picture.pixels().iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / picture.pixels().len() as f64
        };
        let small = shrunk_picture(&picture, [3, 2]).unwrap();
        assert_eq!(small.size(), [3, 2]);
        approx::assert_abs_diff_eq!(mean(&small), mean(&picture), epsilon = 1e-7);
        assert_eq!(shrunk_picture(&picture, [7, 5]).unwrap(), picture);
    }

    #[test]
    fn enlarging_is_refused() {
        let picture = Picture::new(vec![[0.0; 3]; 6], 3, 2).unwrap();
        let expected = MetricError::Size { what: "truth", found: [3, 2], expected: [4, 2] };
        assert_eq!(shrunk_picture(&picture, [4, 2]), Err(expected));
    }

    #[test]
    fn half_covered_pixels_are_inside() {
        let mask = Mask::new(vec![true, false, false, false, true, false, false, false], 4, 2).unwrap();
        assert_eq!(shrunk_mask(&mask, [2, 1]).unwrap().inside(), [true, false]);
        let mask = Mask::new(vec![true, false, false, false], 2, 2).unwrap();
        assert!(shrunk_mask(&mask, [1, 1]).unwrap().is_empty());
    }
}
