//! Writing of pickles, as `numpy.save` writes a dictionary of arrays, lists and texts.

use super::super::npy;

pub(crate) fn text(value: &str) -> Vec<u8> {
    sized(b'X', value.as_bytes())
}

/// Returns an opcode, the length of `bytes` in 4 bytes, and `bytes`.
fn sized(code: u8, bytes: &[u8]) -> Vec<u8> {
    [&[code], &(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

pub(crate) fn list(items: &[Vec<u8>]) -> Vec<u8> {
    [b"](".to_vec(), items.concat(), b"e".to_vec()].concat()
}

pub(crate) fn dict(items: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let entries: Vec<u8> = items.iter().flat_map(|(k, v)| [text(k), v.clone()].concat()).collect();
    [b"}(".to_vec(), entries, b"u".to_vec()].concat()
}

fn dtype(code: &str, order: &str) -> Vec<u8> {
    let call = [b"cnumpy\ndtype\n".to_vec(), text(code), b"K\x00K\x01\x87R".to_vec()].concat();
    let state = [b"(K\x03".to_vec(), text(order), b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb".to_vec()].concat();
    [call, state].concat()
}

fn ndarray(sides: &[usize], kind: Vec<u8>, data: Vec<u8>) -> Vec<u8> {
    let call = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R".to_vec();
    let shape = sides.iter().flat_map(|&side| [b'K', side as u8]).collect();
    [call, b"(K\x01(".to_vec(), shape, b"t".to_vec(), kind, vec![0x89], data, b"tb".to_vec()].concat()
}

/// Returns a pickled array of `f64`; no side may be longer than 255.
pub(crate) fn numbers(sides: &[usize], values: &[f64]) -> Vec<u8> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    ndarray(sides, dtype("f8", "<"), sized(b'B', &bytes))
}

/// Returns the whole pickle of an array of objects without axes, as `numpy.save` writes a dictionary.
pub(crate) fn object(value: Vec<u8>) -> Vec<u8> {
    let data = [b"]".to_vec(), value, b"a".to_vec()].concat();
    [vec![0x80, 3], ndarray(&[], dtype("O8", "|"), data), b".".to_vec()].concat()
}

pub(crate) fn npy(pickle: &[u8]) -> Vec<u8> {
    npy::with_header("|O", &[], pickle)
}
