//! `.npz` archives of arrays.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Cursor, Read, Write};
use std::path::Path;

use infonerf_scene::SceneError;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use super::npy::{self, Array};
use super::read_file;

/// Largest archive that is read, in bytes, packed or unpacked.
const MAX_BYTES: u64 = 256 << 20;
const MAX_ARRAYS: usize = 10_000;

/// Reads the arrays of an archive whose name `wanted` accepts, by their names.
pub(crate) fn read(
    path: &Path,
    expected: &str,
    wanted: impl Fn(&str) -> bool,
) -> Result<BTreeMap<String, Array<f64>>, SceneError> {
    decode(path, &read_file(path, expected, MAX_BYTES)?, expected, wanted)
}

/// Reads the arrays of an archive in memory; errors name `path`.
pub(crate) fn decode(
    path: &Path,
    bytes: &[u8],
    expected: &str,
    wanted: impl Fn(&str) -> bool,
) -> Result<BTreeMap<String, Array<f64>>, SceneError> {
    let fault = |reason: &dyn std::fmt::Display| SceneError::malformed(path, expected, reason);
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| fault(&e))?;
    if archive.len() > MAX_ARRAYS {
        return Err(fault(&format!("{} arrays, more than {MAX_ARRAYS}", archive.len())));
    }
    let mut arrays = BTreeMap::new();
    let mut left = MAX_BYTES;
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).map_err(|e| fault(&e))?;
        let file_name = file.name().map_err(|e| fault(&e))?.into_owned();
        let name = file_name.strip_suffix(".npy").unwrap_or(&file_name).to_owned();
        if !wanted(&name) {
            continue;
        }
        // What the archive says of the size may be wrong: it is read up to what is left and a byte more.
        let mut unpacked = Vec::new();
        (&mut file).take(left + 1).read_to_end(&mut unpacked).map_err(|e| fault(&format!("{name}: {e}")))?;
        let size = unpacked.len() as u64;
        left = left.checked_sub(size).ok_or_else(|| fault(&format!("more than {MAX_BYTES} bytes unpacked")))?;
        let inner = path.join(format!("{name}.npy"));
        arrays.insert(name, npy::decode(&inner, &unpacked, expected)?);
    }
    Ok(arrays)
}

/// Name, shape and values, in C's order, of an array.
pub(crate) type NamedArray = (String, Vec<u64>, Vec<f64>);

/// Writes arrays of `f64` as `numpy.savez_compressed` does.
pub(crate) fn write(path: &Path, arrays: &[NamedArray]) -> Result<(), SceneError> {
    let written = || -> io::Result<()> {
        let mut archive = ZipWriter::new(File::create(path)?);
        for (name, shape, values) in arrays {
            archive.start_file(format!("{name}.npy"), SimpleFileOptions::default())?;
            archive.write_all(&npy::encode(shape, values))?;
        }
        archive.finish().map(drop).map_err(io::Error::from)
    };
    written().map_err(|e| SceneError::io(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archives_round_trip() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npz");
        let arrays = vec![("a".to_owned(), vec![2, 2], vec![1.0, 2.0, 3.0, 4.0]), ("b".to_owned(), vec![1], vec![7.0])];
        write(&path, &arrays).unwrap();
        let read = read(&path, "arrays", |name| name == "a").unwrap();
        assert_eq!(read.len(), 1);
        assert_eq!((&read["a"].shape[..], &read["a"].values[..]), (&[2, 2][..], &[1.0, 2.0, 3.0, 4.0][..]));
        let whole = std::fs::read(&path).unwrap();
        for keep in [0, 30, whole.len() / 2] {
            let text = decode(&path, &whole[..keep], "arrays", |_| true).err().unwrap().to_string();
            assert!(text.contains("a.npz: expected arrays"), "{text}");
        }
    }
}
