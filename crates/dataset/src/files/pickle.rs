//! Pickled dictionaries of arrays, lists and texts, as `numpy.save` writes them. What a pickle names is never run: the
//! parser keeps the states of objects, and an array's is `(version, shape, type, whether columns come first, data)`.

use serde_pickle::{DeOptions, HashableValue, Value};

use super::npy;

/// Reads a pickle, and returns its outermost value; of an array without axes, its element.
pub(crate) fn read(bytes: &[u8]) -> Result<Value, serde_pickle::Error> {
    let options = DeOptions::new().keep_restore_state().replace_unresolved_globals();
    let root = serde_pickle::value_from_reader(bytes, options)?;
    match items(&root).as_deref() {
        Some([element]) => Ok(element.clone()),
        _ => Ok(root),
    }
}

pub(crate) fn get<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    let Value::Dict(entries) = value else { return None };
    let as_bytes = || entries.get(&HashableValue::Bytes(key.into()));
    entries.get(&HashableValue::String(key.into())).or_else(as_bytes)
}

/// Returns the elements of a list or tuple, or of an array along its first axis.
pub(crate) fn items(value: &Value) -> Option<Vec<Value>> {
    let (Value::List(all) | Value::Tuple(all)) = value else { return None };
    let [Value::I64(_), Value::Tuple(shape), kind, Value::Bool(columns_first), data] = &all[..] else {
        return Some(all.clone());
    };
    let side = |side: &Value| if let Value::I64(side) = side { usize::try_from(*side).ok() } else { None };
    let sides = shape.iter().map(side).collect::<Option<Vec<usize>>>()?;
    let count = sides.iter().try_fold(1usize, |count, side| count.checked_mul(*side))?;
    let mut values = match data {
        Value::Bytes(bytes) if is_little_endian(kind) => decode(bytes, count)?,
        Value::List(values) => values.clone(),
        _ => return None,
    };
    if values.len() != count || *columns_first && sides.len() > 2 {
        return None;
    }
    if let (true, &[rows, columns]) = (*columns_first, &sides[..]) {
        values = (0..count).map(|i| values[i % columns * rows + i / columns].clone()).collect();
    }
    match sides[..] {
        [first, _, ..] if count > 0 => {
            Some(values.chunks(count / first).map(|row| Value::List(row.to_vec())).collect())
        }
        _ => Some(values),
    }
}

/// Whether the state of an array's type, if it is there (a pickle has it where the type first occurs), names no order of
/// bytes or the lowest first.
fn is_little_endian(kind: &Value) -> bool {
    !matches!(kind, Value::Tuple(state) if state.get(1) == Some(&Value::String(">".into())))
}

/// Decodes `count` elements by their size: numbers of 4 or 8 bytes, else texts of letters of 4 bytes.
fn decode(bytes: &[u8], count: usize) -> Option<Vec<Value>> {
    let size = bytes.len().checked_div(count).filter(|size| *size > 0)?;
    let letter = |letter: &[u8; 4]| char::from_u32(u32::from_le_bytes(*letter));
    let value = |element: &[u8]| match size {
        4 => Some(Value::F64(f32::from_le_bytes(element.try_into().ok()?).into())),
        8 => Some(Value::F64(f64::from_le_bytes(element.try_into().ok()?))),
        _ => {
            let text: String = element.as_chunks().0.iter().map(letter).collect::<Option<_>>()?;
            Some(Value::String(text.trim_end_matches('\0').to_owned()))
        }
    };
    bytes.chunks(size).map(value).collect()
}

/// Returns all numbers in a number, or in a nesting of lists and arrays, row by row.
pub(crate) fn numbers(value: &Value) -> Option<Vec<f64>> {
    match value {
        Value::I64(number) => Some(vec![*number as f64]),
        Value::F64(number) => Some(vec![*number]),
        _ => Some(items(value)?.iter().map(numbers).collect::<Option<Vec<_>>>()?.concat()),
    }
}

pub(crate) fn text(value: &Value) -> Option<&str> {
    match value {
        Value::String(text) => Some(text),
        Value::Bytes(bytes) => std::str::from_utf8(bytes).ok(),
        _ => None,
    }
}

pub(crate) fn write_text(value: &str) -> Vec<u8> {
    let mut out = vec![b'X'];
    out.extend((value.len() as u32).to_le_bytes());
    out.extend(value.bytes());
    out
}

pub(crate) fn list(items: &[Vec<u8>]) -> Vec<u8> {
    [b"](".to_vec(), items.concat(), b"e".to_vec()].concat()
}

pub(crate) fn dict(items: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let entries: Vec<u8> = items.iter().flat_map(|(k, v)| [write_text(k), v.clone()].concat()).collect();
    [b"}(".to_vec(), entries, b"u".to_vec()].concat()
}

fn dtype(code: &str, order: &str) -> Vec<u8> {
    let call = [b"cnumpy\ndtype\n".to_vec(), write_text(code), b"K\x00K\x01\x87R".to_vec()].concat();
    let state =
        [b"(K\x03".to_vec(), write_text(order), b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb".to_vec()].concat();
    [call, state].concat()
}

fn shape(sides: &[usize]) -> Vec<u8> {
    let sides: Vec<u8> = sides.iter().flat_map(|&s| [b'K', s as u8]).collect();
    [b"(".to_vec(), sides, b"t".to_vec()].concat()
}

fn ndarray(sides: &[usize], kind: Vec<u8>, data: Vec<u8>) -> Vec<u8> {
    let call = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R".to_vec();
    [call, b"(K\x01".to_vec(), shape(sides), kind, vec![0x89], data, b"tb".to_vec()].concat()
}

/// Returns an array of `f64`, no side longer than 255.
pub(crate) fn write_numbers(sides: &[usize], values: &[f64]) -> Vec<u8> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut data = vec![b'B'];
    data.extend((bytes.len() as u32).to_le_bytes());
    data.extend(bytes);
    ndarray(sides, dtype("f8", "<"), data)
}

/// Returns the whole pickle of an array of objects without axes, as `numpy.save` writes a dictionary.
pub(crate) fn object(value: Vec<u8>) -> Vec<u8> {
    let data = [b"]".to_vec(), value, b"a".to_vec()].concat();
    [vec![0x80, 3], ndarray(&[], dtype("O8", "|"), data), b".".to_vec()].concat()
}

/// Returns the `.npy` file around such a pickle.
pub(crate) fn npy(pickle: &[u8]) -> Vec<u8> {
    npy::with_header("|O", &[], pickle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_lists_and_texts() {
        let matrix = write_numbers(&[2, 2], &[1.0, 2.0, 3.0, 4.5]);
        let value = dict(&[
            ("K", list(&[matrix])),
            ("ims", list(&[write_text("a/0.jpg"), write_text("b")])),
            ("n", b"\x8a\x02\xfe\xff".to_vec()),
        ]);
        let whole = object(value);
        let root = read(&whole).unwrap();
        let k = items(get(&root, "K").unwrap()).unwrap();
        assert_eq!(numbers(&k[0]).unwrap(), [1.0, 2.0, 3.0, 4.5]);
        let rows = items(&k[0]).unwrap();
        assert_eq!((rows.len(), numbers(&rows[1]).unwrap()), (2, vec![3.0, 4.5]));
        let names = items(get(&root, "ims").unwrap()).unwrap();
        assert_eq!(text(&names[0]), Some("a/0.jpg"));
        assert_eq!(numbers(get(&root, "n").unwrap()).unwrap(), [-2.0]);
        assert!(get(&root, "x").is_none() && numbers(&names[0]).is_none());
        for keep in 0..whole.len() {
            assert!(read(&whole[..keep]).is_err(), "{keep}");
        }
        // Nothing is run, and a list that holds itself is refused.
        assert!(numbers(&read(b"cos\nsystem\n(S'true'\ntR.").unwrap()).is_none());
        assert!(read(b"]q\x00h\x00a.").is_err());
    }
}
