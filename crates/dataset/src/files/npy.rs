//! NumPy's `.npy` files, a short header of text and then the values, and `.npz` archives of them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Cursor, Read, Write};
use std::path::Path;

use infonerf_scene::SceneError;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use super::{read_file, write_file};

const MAX_BYTES: u64 = 1 << 30;

/// A row-major array with its shape.
pub(crate) struct Array {
    pub shape: Vec<u64>,
    pub values: Vec<f64>,
}

/// Arrays of an archive, by their names.
pub(crate) type Arrays = BTreeMap<String, Array>;

/// Reads an array of `f32` or `f64` as `f64`. A matrix may be in Fortran's order.
pub(crate) fn read(path: &Path, expected: &str) -> Result<Array, SceneError> {
    decode(path, &read_file(path, expected, MAX_BYTES)?, expected)
}

pub(crate) fn decode(path: &Path, bytes: &[u8], expected: &str) -> Result<Array, SceneError> {
    let fault = |reason: &dyn std::fmt::Display| SceneError::malformed(path, expected, reason);
    let (header, data) = split(bytes).ok_or_else(|| fault(&"no whole header of NumPy's"))?;
    let sides = entry(header, "shape").and_then(|rest| Some(rest.strip_prefix('(')?.split_once(')')?.0));
    let sides = sides.map(|sides| sides.split(',').map(str::trim).filter(|side| !side.is_empty()).map(str::parse));
    let shape: Option<Vec<u64>> = sides.and_then(|sides| sides.collect::<Result<_, _>>().ok());
    let shape = shape.ok_or_else(|| fault(&"no shape"))?;
    let mut values: Vec<f64> = match entry(header, "descr").and_then(|kind| kind.get(..5)) {
        Some("'<f4'") => data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes).into()).collect(),
        Some("'<f8'") => data.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect(),
        kind => return Err(fault(&format!("element type {}; <f4 or <f8 needed", kind.unwrap_or("unknown")))),
    };
    let count = shape.iter().try_fold(1u64, |count, side| count.checked_mul(*side));
    if count.is_none_or(|count| count > values.len() as u64) {
        return Err(fault(&format!("shape {shape:?} is more than the file holds")));
    }
    values.truncate(count.unwrap_or(0) as usize);
    if entry(header, "fortran_order").is_some_and(|order| order.starts_with("True")) && shape.len() > 1 {
        let &[rows, columns] = &shape[..] else {
            return Err(fault(&"a Fortran-ordered array; save it with order C"));
        };
        let (rows, columns) = (rows as usize, columns as usize);
        values = (0..rows * columns).map(|i| values[i % columns * rows + i / columns]).collect();
    }
    Ok(Array { shape, values })
}

/// Returns the text of a file's header, and the bytes that follow it.
pub(crate) fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    // Magic number and version, then the text's length: 2 bytes in version 1, 4 from version 2.
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_at_checked(2)?;
    let (length, rest) = rest.split_at_checked(if version[0] == 1 { 2 } else { 4 })?;
    let length = length.iter().rev().fold(0usize, |length, byte| length << 8 | usize::from(*byte));
    let (header, data) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

/// Returns the text of a header from the value of `key` on.
pub(crate) fn entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    Some(header.split_once(&format!("'{key}':"))?.1.trim_start())
}

/// Returns the bytes of a file: a header, then `data`. `kind` is NumPy's code of the element type.
pub(crate) fn with_header(kind: &str, shape: &[u64], data: &[u8]) -> Vec<u8> {
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    // Magic number, version, length and line end take 11 bytes; the data begin at a multiple of 64.
    let width = (text.len() + 11).next_multiple_of(64) - 11;
    let length = (width as u16 + 1).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], format!("{text:width$}\n").as_bytes(), data].concat()
}

/// Reads distances along the unit pixel rays, `[height, width]`; +∞ where a ray hits nothing.
pub(crate) fn read_depth(path: &Path, (width, height): (u32, u32)) -> Result<Vec<f32>, SceneError> {
    let expected = format!("f32 ray distances of shape [{height}, {width}]");
    let array = read(path, &expected)?;
    if array.shape != [u64::from(height), u64::from(width)] {
        return Err(SceneError::malformed(path, expected, format!("shape {:?}", array.shape)));
    }
    match array.values.iter().find(|v| v.is_nan() || **v < 0.0) {
        Some(bad) => Err(SceneError::malformed(path, expected, format!("the distance {bad}"))),
        None => Ok(array.values.into_iter().map(|v| v as f32).collect()),
    }
}

pub(crate) fn write<T: Copy + Into<f64>>(path: &Path, shape: &[u64], values: &[T]) -> Result<(), SceneError> {
    write_file(path, encode(shape, values))
}

/// Returns the bytes of a file with an array of `f32` or `f64` in C's order.
pub(crate) fn encode<T: Copy + Into<f64>>(shape: &[u64], values: &[T]) -> Vec<u8> {
    let is_wide = size_of::<T>() == size_of::<f64>();
    let mut data = Vec::new();
    for value in values.iter().map(|value| (*value).into()) {
        if is_wide { data.extend(f64::to_le_bytes(value)) } else { data.extend((value as f32).to_le_bytes()) }
    }
    with_header(if is_wide { "<f8" } else { "<f4" }, shape, &data)
}

/// Max size of an archive in bytes, packed or unpacked.
pub(crate) const MAX_ARCHIVE: u64 = 256 << 20;
const MAX_ARRAYS: usize = 10_000;

/// Reads the arrays of an archive whose name `wanted` accepts.
pub(crate) fn decode_archive(
    path: &Path,
    bytes: &[u8],
    expected: &str,
    wanted: impl Fn(&str) -> bool,
) -> Result<Arrays, SceneError> {
    let fault = |reason: &dyn std::fmt::Display| SceneError::malformed(path, expected, reason);
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| fault(&e))?;
    if archive.len() > MAX_ARRAYS {
        return Err(fault(&format!("{} arrays, more than {MAX_ARRAYS}", archive.len())));
    }
    let mut arrays = BTreeMap::new();
    let mut left = MAX_ARCHIVE;
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).map_err(|e| fault(&e))?;
        let file_name = file.name().map_err(|e| fault(&e))?.into_owned();
        let name = file_name.strip_suffix(".npy").unwrap_or(&file_name).to_owned();
        if !wanted(&name) {
            continue;
        }
        // The size that the archive states may be wrong, so at most one byte more than the rest of the limit is read.
        let mut unpacked = Vec::new();
        (&mut file).take(left + 1).read_to_end(&mut unpacked).map_err(|e| fault(&format!("{name}: {e}")))?;
        let size = unpacked.len() as u64;
        left = left.checked_sub(size).ok_or_else(|| fault(&format!("more than {MAX_ARCHIVE} bytes unpacked")))?;
        let inner = path.join(format!("{name}.npy"));
        arrays.insert(name, decode(&inner, &unpacked, expected)?);
    }
    Ok(arrays)
}

/// Name, shape and values, in C's order, of an array.
pub(crate) type NamedArray = (String, Vec<u64>, Vec<f64>);

/// Writes arrays of `f64` as `numpy.savez_compressed` does.
pub(crate) fn write_archive(path: &Path, arrays: &[NamedArray]) -> Result<(), SceneError> {
    let written = || -> io::Result<()> {
        let mut archive = ZipWriter::new(File::create(path)?);
        for (name, shape, values) in arrays {
            archive.start_file(format!("{name}.npy"), SimpleFileOptions::default())?;
            archive.write_all(&encode(shape, values))?;
        }
        archive.finish().map(drop).map_err(io::Error::from)
    };
    written().map_err(|e| SceneError::io(path, e))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn matrices_may_be_in_fortrans_order() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.npy");
        write(&path, &[2, 3], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        let at = bytes.windows(5).position(|w| w == b"False").unwrap();
        bytes[at..at + 5].copy_from_slice(b"True ");
        fs::write(&path, bytes).unwrap();
        assert_eq!(read(&path, "numbers").unwrap().values, [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
    }

    #[test]
    fn round_trip_and_damage() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npy");
        write(&path, &[2, 3], &[0.0, 1.5, -2.0, f32::INFINITY, 4.0, 5.0]).unwrap();
        let array = read(&path, "numbers").unwrap();
        assert_eq!(array.shape, [2, 3]);
        assert_eq!(array.values, [0.0, 1.5, -2.0, f64::INFINITY, 4.0, 5.0]);

        let whole = fs::read(&path).unwrap();
        for keep in [0, 5, 9, 40, whole.len() - 4] {
            fs::write(&path, &whole[..keep]).unwrap();
            let text = read(&path, "numbers").err().unwrap().to_string();
            assert!(text.contains("a.npy: expected numbers"), "{keep}: {text}");
        }
        for (old, new, fault) in [("<f4", "<i4", "element type '<i4'"), ("(2, 3", "(9, 9", "more than the file holds")]
        {
            let mut changed = whole.clone();
            let start = whole.windows(old.len()).position(|bytes| bytes == old.as_bytes()).unwrap();
            changed[start..start + old.len()].copy_from_slice(new.as_bytes());
            let text = decode(&path, &changed, "numbers").err().unwrap().to_string();
            assert!(text.contains(fault), "{text}");
        }
    }
}
