//! Bounded reading of `.npy` arrays.

use std::fs;
use std::io::{self, Cursor, Read};
use std::path::Path;

use infonerf_scene::SceneError;
use npyz::{AutoSerialize, Deserialize, NpyFile, Order, TypeChar, WriterBuilder};

use super::read_file;

/// The largest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The longest header that is read, in bytes: NumPy's takes 118 for an array of numbers.
const MAX_HEADER: usize = 1024;
/// Opening brackets in a header: an array of numbers has a dictionary and the tuple of its shape.
const MAX_BRACKETS: usize = 4;

/// A row-major array with its shape.
pub(crate) struct Array<T> {
    pub shape: Vec<u64>,
    pub values: Vec<T>,
}

/// Reads an array of `f32` or `f64` as `f64`; in Fortran's order if it is a matrix.
pub(crate) fn read(path: &Path, expected: &str) -> Result<Array<f64>, SceneError> {
    decode(path, &read_file(path, expected, MAX_BYTES)?, expected)
}

pub(crate) fn decode(path: &Path, mut file: &[u8], expected: &str) -> Result<Array<f64>, SceneError> {
    let size = file.len() as u64;
    let fault = |reason: &dyn std::fmt::Display| SceneError::malformed(path, expected, reason);
    let header = header(&mut file).map_err(|e| fault(&e))?;
    let npy = NpyFile::new(header.chain(file)).map_err(|e| fault(&e))?;
    let shape = npy.shape().to_vec();
    // The header's shape may claim anything; the file's length bounds what is allocated.
    let claimed = shape.iter().try_fold(1u64, |n, &side| n.checked_mul(side));
    if claimed.is_none_or(|n| n > size / 4) {
        return Err(fault(&format!("shape {shape:?} is more than the file holds")));
    }
    let columns_first = npy.order() != Order::C && shape.len() > 1;
    if columns_first && shape.len() > 2 {
        return Err(fault(&"a Fortran-ordered array; save it with order C"));
    }
    let wide = match npy.dtype() {
        npyz::DType::Plain(t) if t.type_char() == TypeChar::Float && t.num_bytes() == Some(8) => true,
        npyz::DType::Plain(t) if t.type_char() == TypeChar::Float && t.num_bytes() == Some(4) => false,
        other => return Err(fault(&format!("element type {}; f4 or f8 needed", other.descr()))),
    };
    let values = if wide { collect::<f64>(npy) } else { collect::<f32>(npy) };
    let mut values = values.map_err(|e| fault(&e))?;
    if let (true, &[rows, columns]) = (columns_first, &shape[..]) {
        let (rows, columns) = (rows as usize, columns as usize);
        values = (0..rows * columns).filter_map(|i| values.get(i % columns * rows + i / columns).copied()).collect();
    }
    Ok(Array { shape, values })
}

/// Returns the header, if it is as short and simple as that of an array of numbers.
///
/// The parser's time is exponential in how deeply brackets nest, and it allocates whatever length the header claims: a
/// file of 160 bytes could keep it busy for hours.
pub(crate) fn header(file: &mut impl Read) -> io::Result<Cursor<Vec<u8>>> {
    // Magic number and version, then the text's length: 2 bytes in version 1, 4 from version 2.
    let mut header = vec![0; 8];
    file.read_exact(&mut header)?;
    let mut length = [0; 4];
    let width = if header[6] == 1 { 2 } else { 4 };
    file.read_exact(&mut length[..width])?;
    header.extend(&length[..width]);
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_HEADER {
        return Err(io::Error::other(format!("a header of {length} bytes, more than {MAX_HEADER}")));
    }
    let start = header.len();
    header.resize(start + length, 0);
    file.read_exact(&mut header[start..])?;
    let brackets = header[start..].iter().filter(|byte| b"([{".contains(byte)).count();
    if brackets > MAX_BRACKETS {
        return Err(io::Error::other(format!("a header with {brackets} brackets, more than {MAX_BRACKETS}")));
    }
    Ok(Cursor::new(header))
}

/// Reads distances along the unit pixel rays, `[height, width]`; +∞ where a ray hits nothing.
pub(crate) fn read_depth(path: &Path, (width, height): (u32, u32)) -> Result<Vec<f32>, SceneError> {
    let expected = format!("f32 ray distances of shape [{height}, {width}]");
    let array = read(path, &expected)?;
    let bad = array.values.iter().find(|v| v.is_nan() || **v < 0.0);
    if array.shape != [u64::from(height), u64::from(width)] {
        return Err(SceneError::malformed(path, expected, format!("shape {:?}", array.shape)));
    }
    match bad {
        Some(bad) => Err(SceneError::malformed(path, expected, format!("the distance {bad}"))),
        None => Ok(array.values.into_iter().map(|v| v as f32).collect()),
    }
}

fn collect<T: Deserialize + Into<f64>>(npy: NpyFile<impl Read>) -> io::Result<Vec<f64>> {
    let values = npy.data::<T>().map_err(io::Error::other)?;
    values.map(|v| v.map(Into::into)).collect()
}

/// Writes an array in C's order.
pub(crate) fn write<T: AutoSerialize + Copy>(path: &Path, shape: &[u64], values: &[T]) -> Result<(), SceneError> {
    encode(shape, values).and_then(|bytes| fs::write(path, bytes)).map_err(|e| SceneError::io(path, e))
}

/// Returns the bytes of a file with an array in C's order.
pub(crate) fn encode<T: AutoSerialize + Copy>(shape: &[u64], values: &[T]) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut bytes).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_may_be_in_fortrans_order() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.npy");
        write(&path, &[2, 3], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let bytes = fs::read(&path).unwrap();
        let mut changed = bytes[..bytes.len() - 24].to_vec();
        let at = changed.windows(5).position(|w| w == b"False").unwrap();
        changed[at..at + 5].copy_from_slice(b"True ");
        changed.extend(&bytes[bytes.len() - 24..]);
        fs::write(&path, changed).unwrap();
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
        // Nested so deeply that the parser would not come back.
        let nested = whole[..10].iter().copied().chain([b'{'; 118]).collect::<Vec<u8>>();
        fs::write(&path, nested).unwrap();
        let text = read(&path, "numbers").err().unwrap().to_string();
        assert!(text.contains("118 brackets"), "{text}");

        let claim = String::from_utf8_lossy(&whole).replace("(2, 3", "(9, 9");
        fs::write(&path, claim.as_bytes()).unwrap();
        assert!(read(&path, "numbers").is_err());
    }
}
