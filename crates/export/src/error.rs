/// Error of an export, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// Resolution out of range.
    #[error("resolution: expected {} to {} voxels, found {found}", crate::RESOLUTIONS.start(), crate::RESOLUTIONS.end())]
    Resolution {
        /// Requested number of voxels.
        found: usize,
    },
    /// Field that absorbs half of no camera's ray.
    #[error(
        "the field has no surface: of all rays of the training cameras the most opaque has opacity {most:.2}, expected at \
         least 0.5; train it longer"
    )]
    Transparent {
        /// Greatest opacity of a ray.
        most: f32,
    },
    /// Grid without a voxel of the surface's density.
    #[error("the field has no surface: expected a voxel of density {level:.3}, found at most {densest:.3}")]
    NoSurface {
        /// Density of the surface, 1/scene unit.
        level: f32,
        /// Greatest density of the grid, 1/scene unit.
        densest: f32,
    },
    /// File that its format cannot hold.
    #[error("{format}: {cause}")]
    Encoding {
        /// Name of the format.
        format: &'static str,
        /// Reason.
        cause: String,
    },
}
