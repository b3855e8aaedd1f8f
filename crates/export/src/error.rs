/// Why something could not be exported, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A resolution out of range.
    #[error("resolution: expected {} to {} voxels, found {found}", crate::RESOLUTIONS.start(), crate::RESOLUTIONS.end())]
    Resolution {
        /// What was asked for.
        found: usize,
    },
    /// No voxel is dense enough.
    #[error(
        "the field has no surface: a voxel at resolution {resolution} is opaque from density {level:.3} on, and the greatest \
         is {densest:.3}; a lower resolution has a lower level"
    )]
    NoSurface {
        /// Voxels along the longest side.
        resolution: usize,
        /// The density of the surface, 1/scene unit.
        level: f32,
        /// The greatest density of the grid, 1/scene unit.
        densest: f32,
    },
    /// An archive or container that could not be put together.
    #[error("{format}: {cause}")]
    Encoding {
        /// The format.
        format: &'static str,
        /// The encoder's reason.
        cause: String,
    },
}
