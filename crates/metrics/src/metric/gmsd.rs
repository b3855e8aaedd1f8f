use super::{Measure, Metric};
use crate::picture::check_sizes;
use crate::{Better, Descriptor, MetricError, Picture, luminance};

pub(super) const GMSD: Metric = Metric {
    descriptor: Descriptor { key: "gmsd", name: "GMSD", unit: "", decimals: 3, better: Better::Lower },
    definition: "gradient magnitude similarity deviation (Xue et al. 2014)",
    measure: Measure::View(|view| gmsd(&view.render, &view.truth)),
};

/// The paper's `T = 170` for 8-bit values, squared gradients on `[0, 1]`.
const STABILISER: f64 = 170.0 / (255.0 * 255.0);

/// Gradient magnitude similarity deviation: 0 for identical pictures, larger is worse.
///
/// The luma of both pictures is averaged over 2×2 blocks; with the magnitudes `m` of the Prewitt gradient (kernels / 3),
///
/// `GMS = (2 m_r m_t + c) / (m_r² + m_t² + c)`, `c = 170 / 255² ≈ 0.0026`, `GMSD = sqrt(mean((GMS − mean(GMS))²))`
///
/// (Xue, Zhang, Mou, Bovik 2014, Eqs. 4–6). Outside the picture all values are 0, as in the authors' implementation,
/// also in the last block of an odd side. The deviation divides by the number of pixels, as in the paper.
///
/// # Errors
/// [`MetricError::Size`].
pub fn gmsd(render: &Picture, truth: &Picture) -> Result<f64, MetricError> {
    check_sizes(render, truth)?;
    let magnitudes = |picture: &Picture| {
        let grey = Grey { values: luminance(picture.pixels()), width: picture.width() };
        prewitt_magnitude(&grey.halved())
    };
    let similarity: Vec<f64> = magnitudes(render)
        .into_iter()
        .zip(magnitudes(truth))
        .map(|(r, t)| (2.0 * r * t + STABILISER) / (r * r + t * t + STABILISER))
        .collect();
    let count = similarity.len() as f64;
    let mean = similarity.iter().sum::<f64>() / count;
    Ok((similarity.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt())
}

/// A grey picture which is 0 outside its bounds.
struct Grey {
    values: Vec<f64>,
    width: usize,
}

impl Grey {
    fn height(&self) -> usize {
        self.values.len() / self.width
    }

    /// Value at column `x` and row `y`, each shifted by `−1` so that the left and upper neighbours have unsigned
    /// positions.
    fn shifted(&self, x: usize, y: usize) -> f64 {
        let inside = (1..=self.width).contains(&x) && (1..=self.height()).contains(&y);
        if inside { self.values[(y - 1) * self.width + x - 1] } else { 0.0 }
    }

    /// Means of 2×2 blocks, `[⌈h/2⌉ × ⌈w/2⌉]`.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height().div_ceil(2));
        let block = |x: usize, y: usize| {
            let corners = [(1, 1), (2, 1), (1, 2), (2, 2)];
            corners.iter().map(|(dx, dy)| self.shifted(2 * x + dx, 2 * y + dy)).sum::<f64>() / 4.0
        };
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| block(x, y)).collect();
        Self { values, width }
    }
}

fn prewitt_magnitude(grey: &Grey) -> Vec<f64> {
    let at = |x: usize, y: usize| {
        let column = |x: usize| (0..3).map(|dy| grey.shifted(x, y + dy)).sum::<f64>() / 3.0;
        let row = |y: usize| (0..3).map(|dx| grey.shifted(x + dx, y)).sum::<f64>() / 3.0;
        (column(x) - column(x + 2)).hypot(row(y) - row(y + 2))
    };
    (0..grey.height()).flat_map(|y| (0..grey.width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixel: impl Fn(usize) -> f32, width: usize, height: usize) -> Picture {
        Picture::new((0..width * height).map(|i| [pixel(i); 3]).collect(), width, height).unwrap()
    }

    #[test]
    fn identical_pictures_are_zero() {
        let steps = picture(|i| (i % 4) as f32 / 4.0, 7, 5);
        assert_eq!(gmsd(&steps, &steps), Ok(0.0));
    }

    #[test]
    fn a_single_pixel_has_no_deviation() {
        assert_eq!(gmsd(&picture(|_| 1.0, 1, 1), &picture(|_| 0.0, 1, 1)), Ok(0.0));
    }

    #[test]
    fn blur_is_worse_than_a_faint_offset() {
        let bars = |i: usize| ((i % 32 / 4) % 2) as f32;
        let truth = picture(bars, 32, 32);
        let (offset, flat) = (picture(|i| 0.95 * bars(i), 32, 32), picture(|_| 0.5, 32, 32));
        assert!(gmsd(&flat, &truth).unwrap() > 10.0 * gmsd(&offset, &truth).unwrap());
    }
}
