//! Evaluation protocol: preparation of images before they are measured, and the definition of metrics that have several.
//!
//! A published figure depends on a metric of two images *and* on their preparation. This project reports [`Protocol::default`]
//! everywhere; every deviation is a named option, and [`Display`](fmt::Display) writes the line under each table.
//!
//! 1. **Images** are RGB as displayed (sRGB values, no linearisation), row by row from the upper left corner. A pixel
//!    with opacity is composited on the background, `α c + (1 − α) b`, before anything else.
//! 2. **Size.** A render and its truth must have the same size.
//!    Where a truth is not valid (outside the image circle of a lens, or by a mask of the capture) both images get the
//!    background's colour and neither hits anything, so that nothing is compared there; PSNR is over the other pixels. A view
//!    without a valid pixel has no values.
//! 3. **Rounding.** Both images are clamped to [0, 1] and rounded to 8 bits, `round(255 x) / 255`, so that a render in
//!    memory and its PNG have the same metrics.
//! 4. **Each metric** is computed per view, and the set's value is the mean over views; PSNR is averaged in decibels. A
//!    view without a value, or with an infinite one (PSNR of identical images), is left out of the mean, with a note. FID and
//!    KID compare the sets of renders and of truths.
//!
//! A rendered ray hits something where its opacity exceeds one half. Metrics whose key ends in `_masked` measure a part of the
//! image, see [`Masked`]. [`Protocol::NAMED`] has protocols of other systems.

use std::fmt;

use serde::Serialize;

/// Options of the [evaluation protocol](self).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Protocol {
    /// Whether both images are rounded to 8 bits first.
    pub eight_bit: bool,
    /// Background of pixels that are not opaque.
    pub background: Background,
    /// Input of SSIM and LPIPS over a mask.
    pub masked: Masked,
    /// Definition of SSIM.
    pub ssim: Ssim,
    /// Value range of LPIPS's input.
    pub lpips_input: LpipsInput,
}

impl Default for Protocol {
    fn default() -> Self {
        Self::INFONERF
    }
}

/// Background of pixels that are not opaque.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// White, as in the Blender data set's protocol.
    White,
    /// Black.
    Black,
}

/// Input of SSIM and LPIPS over a mask, which depend on neighbourhoods of pixels; PSNR is over the mask's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Masked {
    /// Whole image, white outside the mask (DTU in RegNeRF and FreeNeRF).
    WhiteComposite,
    /// Bounding rectangle of the mask, black outside the mask (ZJU-MoCap in Neural Body).
    BoundingRectangle,
}

/// Definition of SSIM, see [`crate::ssim`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ssim {
    /// Weights of a neighbourhood.
    pub window: SsimWindow,
    /// Range of values that the constants C₁ and C₂ assume; scikit-image takes 2 for float images by default, which raises SSIM.
    pub data_range: f64,
}

/// Weights of a neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum SsimWindow {
    /// Gaussian, 11×11, σ 1.5, population covariance.
    #[serde(rename = "gaussian-11")]
    Gaussian11,
    /// Equal, 7×7, sample covariance: scikit-image's default.
    #[serde(rename = "uniform-7")]
    Uniform7,
}

/// Value range of LPIPS's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LpipsInput {
    /// [−1, 1], as defined by the authors.
    Signed,
    /// [0, 1].
    Unsigned,
}

impl Protocol {
    /// Protocol of this project's reports.
    pub const INFONERF: Self = Self {
        eight_bit: true,
        background: Background::White,
        masked: Masked::WhiteComposite,
        ssim: Ssim { window: SsimWindow::Gaussian11, data_range: 1.0 },
        lpips_input: LpipsInput::Signed,
    };

    /// Protocol of RegNeRF and FreeNeRF.
    pub const REGNERF: Self = Self {
        eight_bit: false,
        ssim: Ssim { window: SsimWindow::Uniform7, data_range: 2.0 },
        lpips_input: LpipsInput::Unsigned,
        ..Self::INFONERF
    };

    /// Protocol of Neural Body on ZJU-MoCap.
    pub const NEURAL_BODY: Self = Self {
        eight_bit: false,
        background: Background::Black,
        masked: Masked::BoundingRectangle,
        ssim: Ssim { window: SsimWindow::Uniform7, data_range: 2.0 },
        ..Self::INFONERF
    };

    /// Protocols by name.
    pub const NAMED: [(&str, Self); 3] =
        [("infonerf", Self::INFONERF), ("regnerf", Self::REGNERF), ("neural-body", Self::NEURAL_BODY)];

    /// Finds the protocol called `name` in [`Self::NAMED`].
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMED.into_iter().find(|(known, _)| *known == name).map(|(_, protocol)| protocol)
    }
}

impl Background {
    /// Returns the colour.
    pub fn color(self) -> [f32; 3] {
        match self {
            Self::White => [1.0; 3],
            Self::Black => [0.0; 3],
        }
    }
}

impl fmt::Display for Protocol {
    /// Writes one line, such as `8-bit RGB on white; SSIM 11×11 Gaussian, range 1; …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let background = match self.background {
            Background::White => "white",
            Background::Black => "black",
        };
        let rounding = if self.eight_bit { "8-bit RGB" } else { "RGB without rounding" };
        write!(f, "{rounding} on {background}")?;
        let window = match self.ssim.window {
            SsimWindow::Gaussian11 => "11×11 Gaussian",
            SsimWindow::Uniform7 => "7×7 uniform",
        };
        write!(f, "; SSIM {window}, range {}", self.ssim.data_range)?;
        write!(f, "; LPIPS 0.1 of {}", if self.lpips_input == LpipsInput::Signed { "[−1, 1]" } else { "[0, 1]" })?;
        write!(f, "; FID, KID resized as pytorch-fid; masked SSIM, LPIPS ")?;
        match self.masked {
            Masked::WhiteComposite => write!(f, "on white outside the mask"),
            Masked::BoundingRectangle => write!(f, "in the mask's bounding rectangle, black outside the mask"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_names_every_option() {
        let line = "8-bit RGB on white; SSIM 11×11 Gaussian, range 1; LPIPS 0.1 of [−1, 1]; FID, KID resized as pytorch-fid; \
                    masked SSIM, LPIPS on white outside the mask";
        assert_eq!(Protocol::default().to_string(), line);
        let other = Protocol::named("neural-body").unwrap().to_string();
        let parts = ["RGB without rounding on black", "7×7 uniform, range 2", "bounding rectangle"];
        assert!(parts.iter().all(|part| other.contains(part)), "{other}");
    }
}
