use serde::{Deserialize, Serialize};

use crate::error::SceneError;
use crate::format::Format;
use crate::image::MAX_SIDE;
use crate::select::{TestProtocol, ViewSelection};

/// Request for a scene: its views, their size, their background.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneRequest {
    /// Choice of training views.
    pub train: ViewSelection,
    /// Choice of test views.
    pub test: TestProtocol,
    /// Longest side of the images in pixels: larger images are reduced with a box filter, none is enlarged. `None` for
    /// the size that they have (procedural scenes have a default).
    pub image_size: Option<u32>,
    /// Colour behind transparent pixels, display-encoded RGB in `[0, 1]`.
    pub background: [f32; 3],
    /// Frame of a film (ZJU-MoCap); `None` for the first.
    pub frame: Option<usize>,
    /// Format of a folder; `None` for the first that reads it.
    pub format: Option<Format>,
    /// Treatment of the pixels that a capture's masks leave out.
    pub masks: MaskUse,
}

/// Treatment of the pixels that a capture's masks leave out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaskUse {
    /// Left out of training, as in nerfstudio, and of all metrics.
    #[default]
    LeaveOut,
    /// Trained on, and left out by masked metrics alone.
    Score,
}

impl Default for SceneRequest {
    /// Returns the request for four training views of seed 0, every 8th test view, native size, white.
    fn default() -> Self {
        Self {
            train: ViewSelection::Seed { seed: 0, count: 4 },
            test: TestProtocol::Every(8),
            image_size: None,
            background: [1.0; 3],
            frame: None,
            format: None,
            masks: MaskUse::default(),
        }
    }
}

impl SceneRequest {
    /// Returns an error for a request that no scene can satisfy.
    ///
    /// # Errors
    /// An image size of 0 or beyond the largest, or a background outside `[0, 1]`.
    pub fn check(&self) -> Result<(), SceneError> {
        if let Some(size) = self.image_size.filter(|size| !(1..=MAX_SIDE).contains(size)) {
            return Err(SceneError::request("image_size", format!("a size from 1 to {MAX_SIDE} pixels"), size));
        }
        if !self.background.iter().all(|v| (0.0..=1.0).contains(v)) {
            let found = format!("{:?}", self.background);
            return Err(SceneError::request("background", "three numbers from 0 to 1", found));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_requests() {
        for size in [0, 1 << 20] {
            let request = SceneRequest { image_size: Some(size), ..Default::default() };
            assert!(request.check().unwrap_err().to_string().contains("image_size"));
        }
        for bad in [f32::NAN, -0.1, 1.1] {
            let request = SceneRequest { background: [0.5, bad, 0.5], ..Default::default() };
            assert!(request.check().unwrap_err().to_string().contains("background"));
        }
    }
}
