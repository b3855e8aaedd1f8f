//! Positions in images.

/// A point in the image of one of several views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelAt {
    /// Index of the view.
    pub view: usize,
    /// Column in pixels of the view's camera; the first pixel's centre is at 0.5.
    pub x: f32,
    /// Row, from the top.
    pub y: f32,
}
