use std::sync::Arc;

/// An image that a field is conditioned on, with its camera.
///
/// The camera looks along its −z axis, y up: a point `(X, Y, Z)` of its space, Z < 0, is at the pixel position
/// `(cx − fx·X/Z, cy + fy·Y/Z)`, in which pixel centres are at + 0.5.
#[derive(Clone, Debug)]
pub struct SourceView {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colours in [0, 1], row-major.
    pub rgb: Arc<[[f32; 3]]>,
    /// Focal lengths fx and fy in pixels.
    pub focal: [f32; 2],
    /// Principal point cx, cy in pixels.
    pub centre: [f32; 2],
    /// World to camera: rows of `[R | t]`.
    pub to_camera: [[f32; 4]; 3],
}

/// Images that a field is conditioned on.
#[derive(Clone, Debug)]
pub struct Sources {
    /// Images, at least one, all of one size.
    pub views: Arc<[SourceView]>,
    /// The middle of the scene's box: the origin of positions in a view's axes.
    pub middle: [f32; 3],
}
