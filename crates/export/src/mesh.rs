use crate::shading::colors_along_normals;
use crate::surface::Surface;
use crate::volume::Volume;

/// Surface with a colour at each vertex.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Shape of the mesh.
    pub surface: Surface,
    /// Display-encoded RGB of each vertex in [0, 1], as seen along its normal from outside.
    pub colors: Vec<[f32; 3]>,
}

impl Mesh {
    /// Makes a mesh of `surface` with the colours of `volume`.
    pub fn new(surface: Surface, volume: &dyn Volume) -> Self {
        Self { colors: colors_along_normals(&surface, volume), surface }
    }
}
