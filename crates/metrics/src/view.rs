use std::borrow::Cow;
use std::cell::OnceCell;

use crate::error::MetricError;
use crate::mask::Mask;
use crate::picture::{Picture, check_length, check_size, check_sizes};
use crate::protocol::{Masked, Protocol, Sizes};
use crate::rectangle::Rectangle;
use crate::shrink::{shrunk_mask, shrunk_picture};

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

/// Rendered and true distance along each pixel's ray, row-major; +∞ where a ray hits nothing (the truth may have NaN
/// there).
#[derive(Debug, Clone, Copy)]
pub struct Depths<'a> {
    /// Rendered depth.
    pub render: &'a [f32],
    /// True depth.
    pub truth: &'a [f32],
}

impl<'a> Pair<'a> {
    /// Returns a pair without masks and depth.
    #[must_use]
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
    valid: Option<Mask>,
    depths: Option<[Cow<'a, [f32]>; 2]>,
    masked: OnceCell<(Picture, Picture)>,
}

impl<'a> PreparedView<'a> {
    /// Prepares `pair` as `protocol` defines. Where the truth is not valid, both images get the background's colour, neither
    /// hits anything, and no mask is inside.
    ///
    /// # Errors
    /// [`MetricError::Size`] if sizes differ in a way that the protocol does not allow, [`MetricError::Cropped`] if the border
    /// covers everything, [`MetricError::NothingValid`] if no pixel inside the border is valid, [`MetricError::Length`] for
    /// depth maps of another size.
    pub fn new(pair: Pair<'a>, protocol: &'a Protocol) -> Result<Self, MetricError> {
        let (render, size) = (pair.render, pair.render.size());
        let shrinks = protocol.sizes == Sizes::ShrinkTruth;
        let truth = match pair.truth {
            larger if shrinks && larger.size() != size => Cow::Owned(shrunk_picture(larger, size)?),
            truth => Cow::Borrowed(truth),
        };
        check_sizes(render, &truth)?;
        for depth in pair.depths.iter().flat_map(|depths| [depths.render, depths.truth]) {
            check_length("depth", depth.len(), size)?;
        }

        let inner = inner(size, protocol.crop)?;
        let mask = |mask: Option<&Mask>| {
            let Some(mask) = mask else { return Ok(None) };
            if shrinks && mask.size() != size {
                return shrunk_mask(mask, size)?.cropped(inner).map(Some);
            }
            check_size("mask", mask.size(), size)?;
            mask.cropped(inner).map(Some)
        };
        let (mask, valid) = (mask(pair.mask)?, mask(pair.valid)?);
        if valid.as_ref().is_some_and(Mask::is_empty) {
            return Err(MetricError::NothingValid);
        }
        let picture = |picture: &Picture| {
            let cropped = if protocol.crop == 0 { picture.clone() } else { picture.cropped(inner) };
            let seen = match &valid {
                Some(valid) => valid.composite(&cropped, protocol.background.color()),
                None => cropped,
            };
            if protocol.eight_bit { seen.rounded() } else { seen }
        };
        let depth = |map: &'a [f32]| match (protocol.crop, &valid) {
            (0, None) => Cow::Borrowed(map),
            (_, None) => Cow::Owned(inner.of(map, size[0])),
            (_, Some(valid)) => {
                let seen = inner.of(map, size[0]).into_iter().zip(valid.inside());
                Cow::Owned(seen.map(|(depth, valid)| if *valid { depth } else { f32::INFINITY }).collect())
            }
        };
        Ok(Self {
            render: picture(render),
            truth: picture(&truth),
            protocol,
            depths: pair.depths.map(|depths| [depths.render, depths.truth].map(depth)),
            mask: match (mask, &valid) {
                (Some(mask), Some(valid)) => Some(mask.and(valid)),
                (mask, _) => mask,
            },
            valid,
            masked: OnceCell::new(),
        })
    }

    /// Returns the mask, if it has pixels inside.
    ///
    /// # Errors
    /// [`MetricError::NoMask`], [`MetricError::EmptyMask`].
    pub fn mask(&self) -> Result<&Mask, MetricError> {
        let mask = self.mask.as_ref().ok_or(MetricError::NoMask)?;
        if mask.is_empty() { Err(MetricError::EmptyMask) } else { Ok(mask) }
    }

    /// Returns the pixels to compare, if not all.
    pub(crate) fn valid(&self) -> Option<&Mask> {
        self.valid.as_ref()
    }

    /// Returns render and truth for SSIM and LPIPS over the mask, see [`Masked`].
    ///
    /// # Errors
    /// As [`PreparedView::mask`].
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
    /// [`MetricError::NoDepth`].
    pub fn depths(&self) -> Result<(&[f32], &[f32]), MetricError> {
        let [render, truth] = self.depths.as_ref().ok_or(MetricError::NoDepth)?;
        Ok((render, truth))
    }
}

/// Returns the image without its border.
fn inner(size: [usize; 2], crop: usize) -> Result<Rectangle, MetricError> {
    let left = |side: usize| side.checked_sub(crop.checked_mul(2)?).filter(|left| *left > 0);
    match size.map(left) {
        [Some(width), Some(height)] => Ok(Rectangle { origin: [crop; 2], size: [width, height] }),
        _ => Err(MetricError::Cropped { crop, found: size }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> Picture {
        Picture::new((0..width * height).map(|i| [i as f32 / 50.0, 0.3, 0.0]).collect(), width, height).unwrap()
    }

    fn refused(pair: Pair<'_>, protocol: Protocol) -> MetricError {
        PreparedView::new(pair, &protocol).map(|_| ()).unwrap_err()
    }

    #[test]
    fn different_sizes_are_refused() {
        let (render, truth) = (picture(6, 4), picture(12, 8));
        let expected = MetricError::Size { what: "truth", found: [12, 8], expected: [6, 4] };
        assert_eq!(refused(Pair::new(&render, &truth), Protocol::default()), expected);
        let mask = Mask::new(vec![true; 20], 5, 4).unwrap();
        let pair = Pair { mask: Some(&mask), ..Pair::new(&render, &render) };
        let expected = MetricError::Size { what: "mask", found: [5, 4], expected: [6, 4] };
        assert_eq!(refused(pair, Protocol::default()), expected);
        let depths = Depths { render: &[1.0; 24], truth: &[1.0; 23] };
        let pair = Pair { depths: Some(depths), ..Pair::new(&render, &render) };
        let expected = MetricError::Length { what: "depth", found: 23, expected: 24 };
        assert_eq!(refused(pair, Protocol::default()), expected);
    }

    #[test]
    fn larger_truth_and_mask_are_shrunk_on_request() {
        let (render, truth) = (picture(6, 4), picture(12, 8));
        let mask = Mask::new((0..96).map(|i| i % 12 < 6).collect(), 12, 8).unwrap();
        let protocol = Protocol { sizes: Sizes::ShrinkTruth, ..Protocol::default() };
        let pair = Pair { mask: Some(&mask), ..Pair::new(&render, &truth) };
        let view = PreparedView::new(pair, &protocol).unwrap();
        assert_eq!(view.truth.size(), [6, 4]);
        assert_eq!(view.mask().unwrap().inside()[..6], [true, true, true, false, false, false]);
        assert!(matches!(refused(Pair::new(&truth, &render), protocol), MetricError::Size { what: "truth", .. }));
    }

    #[test]
    fn border_is_cut_from_images_mask_and_depth() {
        let render = picture(6, 4);
        let mask = Mask::new((0..24).map(|i| i < 6 || i == 8).collect(), 6, 4).unwrap();
        let depth: Vec<f32> = (0..24).map(|i| i as f32).collect();
        let depths = Some(Depths { render: &depth, truth: &depth });
        let pair = Pair { mask: Some(&mask), depths, ..Pair::new(&render, &render) };
        let protocol = Protocol { crop: 1, ..Protocol::default() };
        let view = PreparedView::new(pair, &protocol).unwrap();
        assert_eq!(view.render.size(), [4, 2]);
        assert_eq!(view.depths().unwrap().0, [7.0, 8.0, 9.0, 10.0, 13.0, 14.0, 15.0, 16.0]);
        assert_eq!(view.mask().unwrap().inside().iter().filter(|inside| **inside).count(), 1);
        for crop in [2, usize::MAX] {
            let expected = MetricError::Cropped { crop, found: [6, 4] };
            assert_eq!(refused(pair, Protocol { crop, ..protocol }), expected);
        }
    }

    #[test]
    fn only_valid_pixels_are_compared() {
        let truth = picture(6, 4);
        let render = truth.mapped(|index, pixel| if index < 6 { [0.9; 3] } else { pixel });
        let [valid, mask, none] =
            [6, 12, 24].map(|from| Mask::new((0..24).map(|i| i >= from).collect(), 6, 4).unwrap());
        let (nearer, depth) = ([1.0; 24], [2.0; 24]);
        let depths = Some(Depths { render: &nearer, truth: &depth });
        let pair = Pair { valid: Some(&valid), mask: Some(&none), depths, ..Pair::new(&render, &truth) };
        let protocol = Protocol { eight_bit: false, ..Protocol::default() };
        let view = PreparedView::new(pair, &protocol).unwrap();
        assert_eq!(view.render.pixels(), view.truth.pixels());
        assert!(view.depths().unwrap().0[..6].iter().all(|depth| depth.is_infinite()));
        assert_eq!(view.mask(), Err(MetricError::EmptyMask));
        let off = render.mapped(|_, pixel| pixel.map(|value| value + 0.1));
        let pairs = [Pair { render: &off, ..pair }, Pair { render: &off, mask: Some(&mask), ..pair }];
        let measured = crate::evaluate(&pairs, &crate::Networks::none(), &protocol).unwrap();
        approx::assert_abs_diff_eq!(measured.set["psnr"].unwrap(), 20.0, epsilon = 1e-4);
        let note = measured.notes.iter().find(|note| note.metrics.contains(&"psnr_masked".to_owned())).unwrap();
        assert_eq!(note.reason, "mean over 1 of 2 views, for the others: the mask is empty: no pixel is inside");
        assert_eq!(refused(Pair { valid: Some(&none), ..pair }, protocol), MetricError::NothingValid);
    }

    #[test]
    fn rounding_is_optional() {
        let render = picture(6, 4);
        let rounded = |eight_bit| {
            let protocol = Protocol { eight_bit, ..Protocol::default() };
            PreparedView::new(Pair::new(&render, &render), &protocol).unwrap().render
        };
        assert_eq!((rounded(true), rounded(false)), (render.rounded(), render.clone()));
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
        assert_eq!(
            (white.size(), white.pixels()[0], white.pixels()[8]),
            ([6, 4], [1.0; 3], render.rounded().pixels()[8])
        );
        let rectangle = seen(&Protocol { masked: Masked::BoundingRectangle, ..Protocol::default() });
        assert_eq!((rectangle.size(), rectangle.pixels()[1]), ([2, 2], [0.0; 3]));
        assert_eq!(rectangle.pixels()[3], render.rounded().pixels()[15]);
    }
}
