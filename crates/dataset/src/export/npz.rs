//! `.npz` archives of arrays.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use infonerf_scene::SceneError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::loaders::encode_npy;

/// An array's name, shape and values in C's order.
pub(crate) type Named = (String, Vec<u64>, Vec<f64>);

/// Writes arrays of `f64` as `numpy.savez` does, or as `numpy.savez_compressed`.
///
/// # Errors
/// The file cannot be written, or a shape does not fit its values.
pub(crate) fn write(path: &Path, arrays: &[Named], method: CompressionMethod) -> Result<(), SceneError> {
    let written = || -> io::Result<()> {
        let mut archive = ZipWriter::new(File::create(path)?);
        for (name, shape, values) in arrays {
            archive.start_file(format!("{name}.npy"), SimpleFileOptions::default().compression_method(method))?;
            archive.write_all(&encode_npy(shape, values)?)?;
        }
        archive.finish().map(drop).map_err(io::Error::from)
    };
    written().map_err(|e| SceneError::io(path, e))
}
