//! Reading of what `numpy.save` writes for a dictionary of arrays, lists and texts; nothing is executed.
//!
//! A pickle is a program for a stack machine that may call any function. Here it may name only the functions that
//! construct an array: `_reconstruct`, `ndarray`, `dtype`, `scalar`, and `_codecs.encode`, which Python 3 uses for
//! bytes in protocol 2. The machine computes their results without calling them. Any other name is an error.

mod write;

pub(crate) use write::{dict, list, npy, numbers, object, text};

use std::collections::HashMap;

/// Max nesting depth of values.
const MAX_DEPTH: usize = 16;
/// Max number of elements of all arrays of a pickle together.
const MAX_NUMBERS: usize = 1 << 24;
/// Names that a pickle may refer to: module and name, without the underscore that NumPy 2 puts before its core.
const GLOBALS: [(&str, &str); 5] = [
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("_codecs", "encode"),
];
const EARLY: &str = "it ends early";

/// Value of a pickle. Lists, dictionaries and arrays are stored once and referred to by index.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    Bytes(Vec<u8>),
    /// Index into [`Pickle`]'s objects.
    Object(usize),
    /// Name in [`GLOBALS`].
    Global(&'static str),
}

/// List, dictionary, array or array type, which values refer to by index.
#[derive(Clone, Debug)]
enum Object {
    /// A list, a tuple, or the elements of an array along its first axis.
    Items(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    /// Code of an array's type, such as `f8`.
    Kind(String),
}

#[derive(Debug)]
pub(crate) struct Pickle {
    objects: Vec<Object>,
    root: Value,
}

impl Pickle {
    /// Reads a pickle of protocol 2 to 4.
    ///
    /// # Errors
    /// Returns one line of text if the bytes end early, are no such pickle, or name anything but plain values and arrays.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut machine = Machine { rest: bytes, ..Machine::default() };
        let root = machine.run()?;
        Ok(Self { objects: machine.objects, root })
    }

    /// Returns the outermost value, or its element if it is a list or array of one, as of an array without axes.
    pub fn root(&self) -> &Value {
        if let Some([element]) = self.items(&self.root) { element } else { &self.root }
    }

    /// Returns the entry `key` of a dictionary.
    pub fn get<'a>(&'a self, value: &Value, key: &str) -> Option<&'a Value> {
        let Value::Object(index) = value else { return None };
        let Object::Dict(entries) = self.objects.get(*index)? else { return None };
        // The last entry of a repeated key counts.
        entries.iter().rev().find(|(k, _)| self.text(k) == Some(key)).map(|(_, value)| value)
    }

    /// Returns the elements of a list, tuple or array.
    pub fn items(&self, value: &Value) -> Option<&[Value]> {
        let Value::Object(index) = value else { return None };
        let Object::Items(items) = self.objects.get(*index)? else { return None };
        Some(items)
    }

    /// Returns all numbers in a number, or in a nesting of lists and arrays, row by row.
    pub fn numbers(&self, value: &Value) -> Option<Vec<f64>> {
        let mut numbers = Vec::new();
        self.collect(value, MAX_DEPTH, &mut { MAX_NUMBERS }, &mut numbers)?;
        Some(numbers)
    }

    /// Collects numbers from at most `left` values, lists included: nested references to one list grow exponentially.
    fn collect(&self, value: &Value, depth: usize, left: &mut usize, numbers: &mut Vec<f64>) -> Option<()> {
        *left = left.checked_sub(1)?;
        match value {
            Value::Int(v) => numbers.push(*v as f64),
            Value::Float(v) => numbers.push(*v),
            Value::Bool(v) => numbers.push(f64::from(u8::from(*v))),
            _ if depth == 0 => return None,
            _ => self.items(value)?.iter().try_for_each(|item| self.collect(item, depth - 1, left, numbers))?,
        }
        Some(())
    }

    /// Returns the text of a string or of bytes.
    pub fn text<'a>(&self, value: &'a Value) -> Option<&'a str> {
        match value {
            Value::Text(text) => Some(text),
            Value::Bytes(bytes) => std::str::from_utf8(bytes).ok(),
            _ => None,
        }
    }
}

#[derive(Default)]
struct Machine<'a> {
    rest: &'a [u8],
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: HashMap<u64, Value>,
    objects: Vec<Object>,
    /// Number of array elements, plus an eighth of the copied bytes, so far; a short pickle may create many.
    count: usize,
}

impl<'a> Machine<'a> {
    fn run(&mut self) -> Result<Value, String> {
        loop {
            match self.unsigned(1)? as u8 {
                b'.' => return self.pop(),
                // Protocol and length of a frame.
                0x80 => self.take(1).map(drop)?,
                0x95 => self.take(8).map(drop)?,
                b'(' => self.marks.push(self.stack.len()),
                code @ (b'a' | b'e') => {
                    let items = if code == b'a' { vec![self.pop()?] } else { self.above_mark()? };
                    let Object::Items(list) = self.top_object()? else {
                        return Err("an element for what is no list".into());
                    };
                    list.extend(items);
                }
                code @ (b's' | b'u') => {
                    let items = if code == b'u' { self.above_mark()? } else { self.popped(2)? };
                    let (pairs, []) = items.as_chunks() else { return Err("a key without a value".into()) };
                    let Object::Dict(dict) = self.top_object()? else {
                        return Err("an entry for what is no dictionary".into());
                    };
                    dict.extend(pairs.iter().map(|[key, value]| (key.clone(), value.clone())));
                }
                code @ (b'q' | b'r' | 0x94) => {
                    let key = match code {
                        b'q' => self.unsigned(1)?,
                        b'r' => self.unsigned(4)?,
                        _ => self.memo.len() as u64,
                    };
                    let top = self.stack.last().cloned().ok_or("a stack without values")?;
                    self.charge(&top)?;
                    self.memo.insert(key, top);
                }
                b'b' => self.build()?,
                code => {
                    let value = self.value(code)?;
                    self.stack.push(value);
                }
            }
        }
    }

    /// Returns the value that an opcode puts on the stack.
    fn value(&mut self, code: u8) -> Result<Value, String> {
        Ok(match code {
            b'N' => Value::None,
            0x88 => Value::Bool(true),
            0x89 => Value::Bool(false),
            b'J' => Value::Int(signed(self.take(4)?)),
            b'K' => Value::Int(self.unsigned(1)? as i64),
            b'M' => Value::Int(self.unsigned(2)? as i64),
            b'G' => Value::Float(f64::from_bits(self.unsigned(8)?.swap_bytes())),
            0x8a => match self.unsigned(1)? as usize {
                length @ ..=8 => Value::Int(signed(self.take(length)?)),
                _ => return Err("a number of more than 64 bits".into()),
            },
            b'X' | 0x8c => {
                let length = self.unsigned(if code == b'X' { 4 } else { 1 })?;
                Value::Text(String::from_utf8_lossy(self.take(length as usize)?).into_owned())
            }
            b'T' | b'U' | b'B' | b'C' => {
                let length = self.unsigned(if matches!(code, b'T' | b'B') { 4 } else { 1 })?;
                Value::Bytes(self.take(length as usize)?.to_vec())
            }
            b']' | b')' => self.make(Object::Items(Vec::new())),
            b'}' => self.make(Object::Dict(Vec::new())),
            b't' | 0x85..=0x87 => {
                let items = if code == b't' { self.above_mark()? } else { self.popped(usize::from(code - 0x84))? };
                self.make(Object::Items(items))
            }
            b'h' | b'j' => {
                let key = self.unsigned(if code == b'h' { 1 } else { 4 })?;
                let value = self.memo.get(&key).cloned().ok_or("a place in the memo that is empty")?;
                self.charge(&value)?;
                value
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                global(&module, &name)?
            }
            0x93 => match &self.popped(2)?[..] {
                [Value::Text(module), Value::Text(name)] => global(module, name)?,
                _ => return Err("a name that is no text".into()),
            },
            b'R' => self.reduce()?,
            other => {
                return Err(format!("a pickle that asks for more than plain values and arrays (opcode {other:#04x})"));
            }
        })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(EARLY)?;
        self.rest = rest;
        Ok(taken)
    }

    /// Reads an unsigned little-endian number of `width` bytes.
    fn unsigned(&mut self, width: usize) -> Result<u64, String> {
        let mut bytes = [0; 8];
        bytes[..width].copy_from_slice(self.take(width)?);
        Ok(u64::from_le_bytes(bytes))
    }

    fn line(&mut self) -> Result<String, String> {
        let length = self.rest.iter().position(|&b| b == b'\n').ok_or(EARLY)?;
        let line = String::from_utf8_lossy(self.take(length)?).trim_end_matches('\r').to_owned();
        self.take(1)?;
        Ok(line)
    }

    fn pop(&mut self) -> Result<Value, String> {
        self.stack.pop().ok_or_else(|| "a stack without values".into())
    }

    fn popped(&mut self, count: usize) -> Result<Vec<Value>, String> {
        let start = self.stack.len().checked_sub(count).ok_or("a stack without values")?;
        Ok(self.stack.split_off(start))
    }

    fn above_mark(&mut self) -> Result<Vec<Value>, String> {
        let mark = self.marks.pop().filter(|&mark| mark <= self.stack.len()).ok_or("a mark that is not there")?;
        Ok(self.stack.split_off(mark))
    }

    fn make(&mut self, object: Object) -> Value {
        self.objects.push(object);
        Value::Object(self.objects.len() - 1)
    }

    fn items(&self, value: &Value) -> Result<&[Value], String> {
        let Value::Object(index) = value else { return Err("a value in place of a list".into()) };
        let Object::Items(items) = &self.objects[*index] else { return Err("a dictionary in place of a list".into()) };
        Ok(items)
    }

    fn top_object(&mut self) -> Result<&mut Object, String> {
        match self.stack.last() {
            Some(Value::Object(index)) => Ok(&mut self.objects[*index]),
            _ => Err("a value where a list, dictionary or array is needed".into()),
        }
    }

    fn charge(&mut self, value: &Value) -> Result<(), String> {
        self.add(match value {
            Value::Text(text) => text.len() / 8,
            Value::Bytes(bytes) => bytes.len() / 8,
            _ => 0,
        })
    }

    fn add(&mut self, numbers: usize) -> Result<(), String> {
        self.count = self.count.saturating_add(numbers);
        if self.count > MAX_NUMBERS { Err(format!("more than {MAX_NUMBERS} numbers")) } else { Ok(()) }
    }

    /// Returns the result that a call of a permitted global has; nothing is called.
    fn reduce(&mut self) -> Result<Value, String> {
        let arguments = self.pop()?;
        let arguments = self.items(&arguments)?.to_vec();
        Ok(match (self.pop()?, arguments.as_slice()) {
            (Value::Global("_reconstruct"), [Value::Global("ndarray"), ..]) => self.make(Object::Items(Vec::new())),
            (Value::Global("dtype"), [Value::Text(code), ..]) => {
                self.make(Object::Kind(code.trim_start_matches(['<', '|', '=']).to_owned()))
            }
            (Value::Global("scalar"), [kind, Value::Bytes(bytes)]) => {
                self.decode(kind, bytes)?.into_iter().next().ok_or("a scalar without a value")?
            }
            (Value::Global("encode"), [Value::Text(text), ..]) => {
                let bytes = text.chars().map(|c| u8::try_from(u32::from(c))).collect::<Result<Vec<u8>, _>>();
                Value::Bytes(bytes.map_err(|_| "bytes that are no bytes")?)
            }
            _ => return Err("a call that makes no array".into()),
        })
    }

    /// Fills an array with its state, or checks that a type's state is little-endian.
    fn build(&mut self) -> Result<(), String> {
        let state = self.pop()?;
        let state = self.items(&state)?.to_vec();
        match (&*self.top_object()?, state.as_slice()) {
            (Object::Kind(_), [_, Value::Text(order), ..]) if order != ">" => Ok(()),
            (Object::Items(_), [_, shape, kind, Value::Bool(columns_first), data]) => {
                let values = match data {
                    Value::Bytes(bytes) => self.decode(kind, bytes)?,
                    list => self.items(list)?.to_vec(),
                };
                values.iter().try_for_each(|value| self.charge(value))?;
                self.add(values.len())?;
                *self.top_object()? = Object::Items(self.arranged(values, shape, *columns_first)?);
                Ok(())
            }
            _ => Err("a state of neither an array nor its type, the lowest byte first".into()),
        }
    }

    /// Returns elements along the first axis, with further axes as lists; an error if their number is not that of `shape`.
    fn arranged(&mut self, mut values: Vec<Value>, shape: &Value, columns_first: bool) -> Result<Vec<Value>, String> {
        let side = |v: &Value| if let Value::Int(n) = v { usize::try_from(*n).ok() } else { None };
        let sides: Option<Vec<usize>> = self.items(shape)?.iter().map(side).collect();
        let sides = sides.ok_or("a shape that is no whole numbers")?;
        if sides.iter().try_fold(1usize, |n, &s| n.checked_mul(s)) != Some(values.len()) {
            return Err(format!("an array of shape {sides:?} with {} values", values.len()));
        }
        if let (true, &[rows, columns]) = (columns_first, &sides[..]) {
            values = (0..rows * columns).map(|i| values[i % columns * rows + i / columns].clone()).collect();
        } else if columns_first && sides.len() > 2 {
            return Err("an array in Fortran's order with more than two axes".into());
        }
        for &side in sides.iter().skip(1).rev().filter(|&&side| side > 0) {
            values = values.chunks(side).map(|row| self.make(Object::Items(row.to_vec()))).collect();
        }
        Ok(values)
    }

    /// Decodes numbers or texts from the bytes of an array.
    fn decode(&mut self, kind: &Value, bytes: &[u8]) -> Result<Vec<Value>, String> {
        let object = if let Value::Object(index) = kind { Some(&self.objects[*index]) } else { None };
        let Some(Object::Kind(code)) = object else { return Err("an array without a type".into()) };
        let code = code.clone();
        let unknown = || format!("{} bytes of type `{code}`", bytes.len());
        let width: usize = code.get(1..).and_then(|width| width.parse().ok()).ok_or_else(unknown)?;
        let size = if code.starts_with('U') { width.saturating_mul(4) } else { width };
        if size == 0 || !bytes.len().is_multiple_of(size) {
            return Err(unknown());
        }
        self.add(bytes.len() / size.min(8))?;
        let value = |chunk: &[u8]| -> Option<Value> {
            Some(match (&code[..1], width) {
                ("f", 4) => Value::Float(f32::from_le_bytes(chunk.try_into().ok()?).into()),
                ("f", 8) => Value::Float(f64::from_le_bytes(chunk.try_into().ok()?)),
                ("i", 1..=8) => Value::Int(signed(chunk)),
                ("U", _) => {
                    let (letters, _) = chunk.as_chunks();
                    let text: Option<String> = letters.iter().map(|c| char::from_u32(u32::from_le_bytes(*c))).collect();
                    Value::Text(text?.trim_end_matches('\0').to_owned())
                }
                _ => return None,
            })
        };
        bytes.chunks(size).map(value).collect::<Option<_>>().ok_or_else(unknown)
    }
}

/// Returns the little-endian two's complement number in up to 8 bytes.
fn signed(bytes: &[u8]) -> i64 {
    let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
    let mut whole = [if negative { 0xff } else { 0 }; 8];
    whole[..bytes.len()].copy_from_slice(bytes);
    i64::from_le_bytes(whole)
}

/// Returns the permitted global of a name, or an error.
fn global(module: &str, name: &str) -> Result<Value, String> {
    let core = module.replace("numpy._core", "numpy.core");
    let known = GLOBALS.iter().find(|known| **known == (core.as_str(), name));
    let refused = || format!("a pickle that asks for the code `{module}.{name}`; nothing of it was run");
    known.map(|(_, name)| Value::Global(name)).ok_or_else(refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_lists_and_texts() {
        let matrix = numbers(&[2, 2], &[1.0, 2.0, 3.0, 4.5]);
        let value = dict(&[
            ("K", list(&[matrix])),
            ("ims", list(&[text("a/0.jpg"), text("b")])),
            ("n", b"\x8a\x02\xfe\xff".to_vec()),
        ]);
        let pickle = Pickle::read(&object(value)).unwrap();
        let root = pickle.root();
        let k = pickle.items(pickle.get(root, "K").unwrap()).unwrap();
        assert_eq!(pickle.numbers(&k[0]).unwrap(), [1.0, 2.0, 3.0, 4.5]);
        let rows = pickle.items(&k[0]).unwrap();
        assert_eq!((rows.len(), pickle.numbers(&rows[1]).unwrap()), (2, vec![3.0, 4.5]));
        let names = pickle.items(pickle.get(root, "ims").unwrap()).unwrap();
        assert_eq!(pickle.text(&names[0]), Some("a/0.jpg"));
        assert_eq!(pickle.numbers(pickle.get(root, "n").unwrap()).unwrap(), [-2.0]);
        assert!(pickle.get(root, "x").is_none() && pickle.numbers(&names[0]).is_none());
    }

    #[test]
    fn code_is_refused() {
        let attacks: [&[u8]; 6] = [
            b"cos\nsystem\n(U\x07echo hitR.",
            b"\x80\x04\x8c\x02os\x8c\x06system\x93.",
            b"(ios\nsystem\n.",
            b"\x80\x02cnumpy\nndarray\n)\x81.",
            b"Pname\n.",
            b"cnumpy.f2py.capi_maps\nload_f2cmap_file\n.",
        ];
        for attack in attacks {
            let error = Pickle::read(attack).unwrap_err();
            assert!(error.contains("a pickle that asks for"), "{error}");
        }
    }

    #[test]
    fn broken_pickles_are_refused() {
        let whole = object(dict(&[("a", numbers(&[2], &[1.0, 2.0]))]));
        for keep in 0..whole.len() {
            assert!(Pickle::read(&whole[..keep]).is_err(), "{keep}");
        }
        for bad in [&b"."[..], b"e.", b"h\x00.", b"]s.", b"NR.", b"Nb.", b"cnumpy\ndtype\nNR.", b"(", b"K\x01K\x02s."] {
            assert!(Pickle::read(bad).is_err());
        }
        // A list that contains itself can be read; the search for numbers in it stops at a depth.
        let pickle = Pickle::read(b"]q\x00h\x00a.").unwrap();
        assert!(pickle.numbers(pickle.root()).is_none());
        // One text of 256 bytes is copied 2²⁰ times.
        let bomb = [b"X\x00\x01\x00\x00", &[b'a'; 256][..], b"q\x00", &b"h\x00".repeat(1 << 20), b"."].concat();
        assert!(Pickle::read(&bomb).unwrap_err().contains("numbers"));
        // A list with one text of 64 KiB is copied into 2¹² arrays.
        let array = object(b"N".to_vec());
        let at = array.windows(3).position(|bytes| bytes == b"]Na").unwrap();
        let array = [&array[2..at], b"h\x00", &array[at + 3..array.len() - 1]].concat();
        let list = [b"]X\x00\x00\x01\x00", &[b'a'; 1 << 16][..], b"aq\x00"].concat();
        let bomb = [list, array.repeat(1 << 12), b".".to_vec()].concat();
        assert!(Pickle::read(&bomb).unwrap_err().contains("numbers"));
    }
}
