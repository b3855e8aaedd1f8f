use super::ssim::{Terms, terms};
use super::{Measure, Metric};
use crate::protocol::Ssim;
use crate::{Better, Descriptor, MetricError, Picture};

pub(super) const MS_SSIM: Metric = Metric {
    descriptor: Descriptor { key: "ms_ssim", name: "MS-SSIM", unit: "", decimals: 3, better: Better::Higher },
    definition: "SSIM over five scales, sides of at least 161 pixels (Wang, Simoncelli, Bovik 2003)",
    measure: Measure::View(|view| ms_ssim(&view.render, &view.truth)),
};

/// Weight of each scale, the finest first.
const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
/// Smallest side whose coarsest scale still holds a window of 11 pixels.
const MINIMUM: usize = 10 * (1 << (WEIGHTS.len() - 1)) + 1;

/// Multi-scale structural similarity: mean over the three channels of
///
/// `MS-SSIM = SSIM₅^w₅ · Π_{s<5} CS_s^{w_s}`, `w` = 0.0448, 0.2856, 0.3001, 0.2363, 0.1333,
///
/// with SSIM at the coarsest scale, and its factor of contrast and structure `CS` at the others, each a mean over the
/// windows of [`crate::ssim`] with its defaults (Wang, Simoncelli, Bovik 2003, Eq. 7). A mean below 0 counts as 0. Each
/// scale is the one before averaged over 2×2 blocks, with the last row or column repeated for an odd side, as in the
/// authors' and TensorFlow's implementations.
///
/// # Errors
/// [`MetricError::Size`]; [`MetricError::TooSmall`] when a side is below 161 pixels.
fn ms_ssim(render: &Picture, truth: &Picture) -> Result<f64, MetricError> {
    let [width, height] = truth.size();
    if width.min(height) < MINIMUM {
        return Err(MetricError::TooSmall { found: truth.size(), minimum: MINIMUM });
    }
    let (mut render, mut truth) = (render.clone(), truth.clone());
    let mut products = [1.0; 3];
    for (scale, weight) in WEIGHTS.into_iter().enumerate() {
        if scale > 0 {
            (render, truth) = (halved(&render)?, halved(&truth)?);
        }
        let is_coarsest = scale + 1 == WEIGHTS.len();
        let factor = |terms: Terms| if is_coarsest { terms.similarity } else { terms.contrast };
        for (product, terms) in products.iter_mut().zip(terms(&render, &truth, Ssim::default())?) {
            *product *= factor(terms).max(0.0).powf(weight);
        }
    }
    Ok(products.iter().sum::<f64>() / 3.0)
}

/// Means of 2×2 blocks, `[⌈h/2⌉ × ⌈w/2⌉]`; beyond the border is the pixel at the border.
fn halved(picture: &Picture) -> Result<Picture, MetricError> {
    let [width, height] = picture.size();
    let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
    let pixel = |x: usize, y: usize| picture.pixels()[y.min(height - 1) * width + x.min(width - 1)];
    let block = |index: usize| {
        let (x, y) = (index % columns * 2, index / columns * 2);
        let block = [pixel(x, y), pixel(x + 1, y), pixel(x, y + 1), pixel(x + 1, y + 1)];
        std::array::from_fn(|channel| block.iter().map(|pixel| pixel[channel]).sum::<f32>() / 4.0)
    };
    Picture::new((0..columns * rows).map(block).collect(), columns, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(side: usize) -> Picture {
        Picture::new((0..side * side).map(|i| [(i * i % 97) as f32 / 96.0, 0.3, 1.0]).collect(), side, side).unwrap()
    }

    #[test]
    fn identical_pictures_are_one() {
        approx::assert_abs_diff_eq!(ms_ssim(&picture(161), &picture(161)).unwrap(), 1.0, epsilon = 1e-12);
    }

    #[test]
    fn five_scales_need_161_pixels() {
        let expected = MetricError::TooSmall { found: [160, 160], minimum: 161 };
        assert_eq!(ms_ssim(&picture(160), &picture(160)), Err(expected));
    }

    #[test]
    fn an_odd_side_repeats_its_last_pixel() {
        let picture = Picture::new(vec![[0.0; 3], [0.5; 3], [1.0; 3]], 3, 1).unwrap();
        assert_eq!(halved(&picture).unwrap().pixels(), [[0.25; 3], [1.0; 3]]);
    }
}
