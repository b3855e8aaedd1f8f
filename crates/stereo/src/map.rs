use infonerf_scene::Camera;

/// How far away the surface is that each pixel of a view shows.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Inverse distance along the unit ray through each pixel's centre, row-major, 1/scene unit; NaN where nothing was matched.
    pub disparity: Vec<f32>,
    /// The step between planes at each pixel, in the same unit: how exact a disparity can be.
    pub step: Vec<f32>,
}

impl DepthMap {
    /// Disparity and step at the continuous position `(x, y)` of `camera`'s image, which may be larger than the map: those
    /// of the pixel that it lies in. `None` where nothing was matched.
    pub fn at(&self, camera: &Camera, x: f32, y: f32) -> Option<(f32, f32)> {
        let column = (x / camera.width as f32 * self.width as f32) as usize;
        let row = (y / camera.height as f32 * self.height as f32) as usize;
        let at = row.min(self.height - 1) * self.width + column.min(self.width - 1);
        let disparity = self.disparity[at];
        disparity.is_finite().then_some((disparity, self.step[at]))
    }

    /// Number of pixels that have a depth.
    pub fn matched(&self) -> usize {
        self.disparity.iter().filter(|disparity| disparity.is_finite()).count()
    }
}
