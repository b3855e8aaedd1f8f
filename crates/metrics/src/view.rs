use std::borrow::Cow;
use std::cell::OnceCell;

use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::{Picture, check_length, check_size, check_sizes};
use crate::protocol::{Masked, Protocol};

/// Render and the image that it should equal, with optional masks and depth.
#[derive(Debug, Clone, Copy)]
pub struct Pair<'a> {
    /// The render.
    pub render: &'a Picture,
    /// The true image.
    pub truth: &'a Picture,
    /// Pixels that count in masked metrics.
    pub mask: Option<&'a Mask>,
    /// Pixels where the truth is known, if not all: outside the image circle of a lens there is nothing to compare.
    pub valid: Option<&'a Mask>,
    /// Depth maps, if the true depth is known.
    pub depths: Option<Depths<'a>>,
}

/// Rendered and true distance along each pixel's ray, row-major; +∞ where a ray hits nothing (the truth may have NaN there).
#[derive(Debug, Clone, Copy)]
pub struct Depths<'a> {
    /// Rendered depth.
    pub render: &'a [f32],
    /// True depth.
    pub truth: &'a [f32],
}

impl<'a> Pair<'a> {
    /// Returns a pair without masks and depth.
    pub fn new(render: &'a Picture, truth: &'a Picture) -> Self {
        Self { render, truth, mask: None, valid: None, depths: None }
    }
}

/// Pair prepared as the protocol defines, the input of metrics: render, truth, mask and depth maps have the same size.
pub struct PreparedView<'a> {
    /// Prepared render.
    pub render: Picture,
    /// Prepared truth.
    pub truth: Picture,
    /// Protocol by which both were prepared.
    pub protocol: &'a Protocol,
    mask: Option<Mask>,
    pub(crate) valid: Option<&'a Mask>,
    depths: Option<[Cow<'a, [f32]>; 2]>,
    masked: OnceCell<(Picture, Picture)>,
}

impl<'a> PreparedView<'a> {
    /// Prepares `pair` as `protocol` defines. Where the truth is not valid, both images get the background's colour,
    /// both depths are +∞, and the mask excludes the pixel.
    ///
    /// # Errors
    /// If sizes differ; [`MetricError::NothingValid`] if no pixel is valid.
    pub fn new(pair: Pair<'a>, protocol: &'a Protocol) -> Result<Self, MetricError> {
        let (size, valid) = (pair.render.size(), pair.valid);
        check_sizes(pair.render, pair.truth)?;
        for depth in pair.depths.iter().flat_map(|depths| [depths.render, depths.truth]) {
            check_length("depth", depth.len(), size)?;
        }
        for mask in pair.mask.into_iter().chain(valid) {
            check_size("mask", mask.size(), size)?;
        }
        if valid.is_some_and(Mask::is_empty) {
            return Err(MetricError::NothingValid);
        }
        let picture = |picture: &Picture| {
            let behind = protocol.background.color();
            let seen = valid.map_or_else(|| picture.clone(), |valid| valid.composite(picture, behind));
            if protocol.eight_bit { seen.rounded() } else { seen }
        };
        let depth = |map: &'a [f32]| match valid {
            None => Cow::Borrowed(map),
            Some(valid) => {
                let seen = map.iter().zip(valid.inside());
                seen.map(|(depth, valid)| if *valid { *depth } else { f32::INFINITY }).collect()
            }
        };
        Ok(Self {
            render: picture(pair.render),
            truth: picture(pair.truth),
            protocol,
            depths: pair.depths.map(|depths| [depths.render, depths.truth].map(depth)),
            mask: pair.mask.map(|mask| valid.map_or_else(|| mask.clone(), |valid| mask.and(valid))),
            valid,
            masked: OnceCell::new(),
        })
    }

    /// Returns the mask.
    ///
    /// # Errors
    /// If there is none, or no pixel is inside.
    pub fn mask(&self) -> Result<&Mask, MetricError> {
        let mask = self.mask.as_ref().ok_or_else(|| MetricError::other("no mask"))?;
        mask.check_inside().map(|()| mask)
    }

    /// Returns render and truth for SSIM and LPIPS over the mask, see [`Masked`].
    ///
    /// # Errors
    /// Errors of [`PreparedView::mask`].
    pub fn masked(&self) -> Result<(&Picture, &Picture), MetricError> {
        let mask = self.mask()?;
        let (render, truth) = self.masked.get_or_init(|| {
            let seen = |picture: &Picture| match self.protocol.masked {
                Masked::WhiteComposite => mask.composite(picture, [1.0; 3]),
                Masked::BoundingRectangle => mask.composite(picture, [0.0; 3]).cropped(mask.bounding_rectangle()),
            };
            (seen(&self.render), seen(&self.truth))
        });
        Ok((render, truth))
    }

    /// Returns rendered and true depth.
    ///
    /// # Errors
    /// If the true depth is unknown.
    pub fn depths(&self) -> Result<(&[f32], &[f32]), MetricError> {
        let [render, truth] = self.depths.as_ref().ok_or_else(|| MetricError::other("no true depth"))?;
        Ok((render, truth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> Picture {
        Picture::new((0..width * height).map(|i| [i as f32 / 50.0, 0.3, 0.0]).collect(), width, height).unwrap()
    }

    #[test]
    fn different_sizes_are_refused() {
        let (render, truth) = (picture(6, 4), picture(12, 8));
        let mask = Mask::new(vec![true; 20], 5, 4).unwrap();
        let depths = Depths { render: &[1.0; 24], truth: &[1.0; 23] };
        let pair = Pair::new(&render, &render);
        for (pair, expected) in [
            (Pair { truth: &truth, ..pair }, "the truth has 12×8 pixels, the render 6×4"),
            (Pair { mask: Some(&mask), ..pair }, "the mask has 5×4 pixels, the render 6×4"),
            (Pair { depths: Some(depths), ..pair }, "depth holds 23 values, expected 24"),
        ] {
            let refused = PreparedView::new(pair, &Protocol::default()).map(|_| ());
            assert_eq!(refused, Err(MetricError::other(expected)));
        }
    }

    #[test]
    fn only_valid_pixels_are_compared() {
        let truth = picture(6, 4);
        let render = truth.mapped(|index, pixel| if index < 6 { [0.9; 3] } else { pixel });
        let [valid, mask, none] = [6, 12, 24].map(|n| Mask::new((0..24).map(|i| i >= n).collect(), 6, 4).unwrap());
        let (nearer, depth) = ([1.0; 24], [2.0; 24]);
        let depths = Some(Depths { render: &nearer, truth: &depth });
        let pair = Pair { valid: Some(&valid), mask: Some(&none), depths, ..Pair::new(&render, &truth) };
        let protocol = Protocol { eight_bit: false, ..Protocol::default() };
        let view = PreparedView::new(pair, &protocol).unwrap();
        assert_eq!(view.render.pixels(), view.truth.pixels());
        assert!(view.depths().unwrap().0[..6].iter().all(|depth| depth.is_infinite()));
        assert!(view.mask().is_err());
        let off = render.mapped(|_, pixel| pixel.map(|value| value + 0.1));
        let pairs = [Pair { render: &off, ..pair }, Pair { render: &off, mask: Some(&mask), ..pair }];
        let measured = crate::evaluate(&pairs, &crate::Networks::none(), &protocol).unwrap();
        approx::assert_abs_diff_eq!(measured.set["psnr"].unwrap(), 20.0, epsilon = 1e-4);
        let note = measured.notes.iter().find(|note| note.metrics.contains(&"psnr_masked".to_owned())).unwrap();
        assert_eq!(note.reason, "mean over 1 of 2 views, for the others: the mask is empty: no pixel is inside");
    }

    #[test]
    fn masked_images_follow_the_protocol() {
        let render = picture(6, 4);
        let mask = Mask::new((0..24).map(|i| i == 8 || i == 15).collect(), 6, 4).unwrap();
        let pair = Pair { mask: Some(&mask), ..Pair::new(&render, &render) };
        let seen = |protocol: &Protocol| {
            let view = PreparedView::new(pair, protocol).unwrap();
            view.masked().unwrap().0.clone()
        };
        let white = seen(&Protocol::default());
        assert_eq!((white.size(), white.pixels()[0]), ([6, 4], [1.0; 3]));
        assert_eq!(white.pixels().iter().filter(|pixel| **pixel == [1.0; 3]).count(), 22);
        assert_eq!(white.pixels()[8], render.rounded().pixels()[8]);
        let rectangle = seen(&Protocol { masked: Masked::BoundingRectangle, ..Protocol::default() });
        assert_eq!((rectangle.size(), rectangle.pixels()[1]), ([2, 2], [0.0; 3]));
        assert_eq!(rectangle.pixels()[3], render.rounded().pixels()[15]);
    }
}
