use std::io::{Cursor, Write};

use glam::Vec3;
use npyz::WriterBuilder;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::encode::bytes;
use crate::{ExportError, Grid, Volume};

/// Voxels whose opacity is below this have no colour: it would not show in 8 bits.
const LEAST_OPACITY: f32 = 0.5 / 255.0;
/// Voxels per query of colours: bounds the memory.
const CHUNK: usize = 1 << 14;
/// Directions of view over which a voxel's colour is averaged.
const DIRECTIONS: [Vec3; 6] = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];

/// A grid as NumPy reads it (`numpy.load`), compressed:
///
/// - `density`, float32 `[nz, ny, nx]`: σ in 1/scene unit, of the voxel whose centre is `origin + voxel · (x, y, z)`;
/// - `color`, uint8 `[nz, ny, nx, 3]`: display-encoded RGB, the mean over six directions of view along the axes; 0 where the
///   voxel is practically empty;
/// - `origin`, float32 `[3]`, and `voxel`, float32 `[1]`, scene units.
///
/// # Errors
/// If the archive cannot be put together.
pub fn npz(grid: &Grid, volume: &dyn Volume) -> Result<Vec<u8>, ExportError> {
    let [nx, ny, nz] = grid.size.to_array().map(u64::from);
    let mut archive = Archive(ZipWriter::new(Cursor::new(Vec::new())));
    let written = archive
        .add("density", &[nz, ny, nx], &grid.density)
        .and_then(|()| archive.add("color", &[nz, ny, nx, 3], &colors(grid, volume)))
        .and_then(|()| archive.add("origin", &[3], &grid.origin.to_array()))
        .and_then(|()| archive.add("voxel", &[1], &[grid.voxel]))
        .and_then(|()| Ok(archive.0.finish()?.into_inner()));
    written.map_err(|error| ExportError::Encoding { format: "npz", cause: error.to_string() })
}

/// RGB of every voxel.
fn colors(grid: &Grid, volume: &dyn Volume) -> Vec<u8> {
    let mut colors = vec![0; 3 * grid.len()];
    let dense: Vec<usize> = (0..grid.len()).filter(|&index| grid.opacity(index) >= LEAST_OPACITY).collect();
    for cells in dense.chunks(CHUNK) {
        let points: Vec<Vec3> = cells.iter().map(|&index| grid.point(index)).collect();
        let mut sums = vec![Vec3::ZERO; cells.len()];
        for direction in DIRECTIONS {
            for (sum, color) in sums.iter_mut().zip(volume.color(&points, &vec![direction; cells.len()])) {
                *sum += Vec3::from_array(color) / DIRECTIONS.len() as f32;
            }
        }
        for (&index, mean) in cells.iter().zip(sums) {
            colors[3 * index..3 * index + 3].copy_from_slice(&bytes(mean.to_array()));
        }
    }
    colors
}

struct Archive(ZipWriter<Cursor<Vec<u8>>>);

impl Archive {
    fn add<T>(&mut self, name: &str, shape: &[u64], values: &[T]) -> std::io::Result<()>
    where
        T: npyz::AutoSerialize + Copy,
    {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        self.0.start_file(format!("{name}.npy"), options)?;
        let mut array = Vec::new();
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut array).begin_nd()?;
        writer.extend(values.iter().copied())?;
        writer.finish()?;
        self.0.write_all(&array)
    }
}
