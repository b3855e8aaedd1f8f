/// Why something could not be exported, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A resolution out of range.
    #[error("resolution: expected {} to {} voxels, found {found}", crate::RESOLUTIONS.start(), crate::RESOLUTIONS.end())]
    Resolution {
        /// The requested value.
        found: usize,
    },
    /// No ray of a camera is half absorbed.
    #[error(
        "the field has no surface: of all rays of the training cameras the most opaque has opacity {most:.2}, expected at \
         least 0.5; train it longer"
    )]
    Transparent {
        /// The greatest opacity of a ray.
        most: f32,
    },
    /// No voxel reaches the density of the surface.
    #[error("the field has no surface: expected a voxel of density {level:.3}, found at most {densest:.3}")]
    NoSurface {
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
