//! A reader of pickles of plain values and NumPy arrays that executes nothing.
//!
//! A pickle is a program for a stack machine that may call whatever it names. Here it may name only what makes up an
//! array: `_reconstruct`, `ndarray`, `dtype`, `scalar`, `_frombuffer`, and `_codecs.encode`, which Python 3 uses for
//! bytes in old protocols. None of them is called: the machine knows what each would give. Anything else is refused.

use std::collections::HashMap;

/// The greatest nesting depth of values.
const DEEPEST: usize = 16;
/// The most numbers that all arrays of a pickle hold together.
const MOST_NUMBERS: usize = 1 << 24;

/// A value. Lists, dictionaries and arrays are kept apart, since a pickle may refer to one from many places.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    Bytes(Vec<u8>),
    /// An index into [`Pickle`]'s objects.
    Object(usize),
    Global(Global),
}

/// The names that a pickle may refer to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Global {
    Reconstruct,
    Ndarray,
    Dtype,
    Scalar,
    FromBuffer,
    Encode,
}

/// A value that others may refer to.
#[derive(Clone, Debug)]
enum Object {
    List(Vec<Value>),
    Tuple(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    Kind { code: String, big: bool },
    Array { values: Vec<Value> },
}

/// A pickle that was read.
#[derive(Debug)]
pub(super) struct Pickle {
    objects: Vec<Object>,
    root: Value,
}

impl Pickle {
    /// The outermost value; of an array without axes, its element.
    pub fn root(&self) -> &Value {
        match self.object(&self.root) {
            Some(Object::Array { values }) if values.len() == 1 => &values[0],
            _ => &self.root,
        }
    }

    /// The value under `key` of a dictionary.
    pub fn get(&self, value: &Value, key: &str) -> Option<&Value> {
        let Object::Dict(entries) = self.object(value)? else { return None };
        let same = |k: &Value| match k {
            Value::Text(text) => text == key,
            Value::Bytes(bytes) => bytes == key.as_bytes(),
            _ => false,
        };
        entries.iter().find(|(k, _)| same(k)).map(|(_, v)| v)
    }

    /// The elements of a list, tuple or array.
    pub fn items(&self, value: &Value) -> Option<&[Value]> {
        match self.object(value)? {
            Object::List(items) | Object::Tuple(items) | Object::Array { values: items, .. } => Some(items),
            _ => None,
        }
    }

    /// All numbers in a number, or in a nesting of lists and arrays, row by row.
    pub fn numbers(&self, value: &Value) -> Option<Vec<f64>> {
        let mut numbers = Vec::new();
        self.collect(value, DEEPEST, &mut { MOST_NUMBERS }, &mut numbers)?;
        Some(numbers)
    }

    /// `left` bounds how many values are looked at: lists that hold one list many times grow without numbers in them.
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

    /// A string.
    pub fn text<'a>(&self, value: &'a Value) -> Option<&'a str> {
        match value {
            Value::Text(text) => Some(text),
            Value::Bytes(bytes) => std::str::from_utf8(bytes).ok(),
            _ => None,
        }
    }

    fn object(&self, value: &Value) -> Option<&Object> {
        match value {
            Value::Object(index) => self.objects.get(*index),
            _ => None,
        }
    }
}

/// Reads a pickle of protocol 0 to 5.
///
/// # Errors
/// It ends early, is not a pickle, or asks for anything but plain values and arrays: one line says what.
pub(super) fn read(bytes: &[u8]) -> Result<Pickle, String> {
    let mut machine = Machine {
        bytes,
        at: 0,
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
        objects: Vec::new(),
        numbers: 0,
    };
    let root = machine.run()?;
    Ok(Pickle { objects: machine.objects, root })
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: HashMap<u64, Value>,
    objects: Vec<Object>,
    numbers: usize,
}

impl Machine<'_> {
    fn run(&mut self) -> Result<Value, String> {
        loop {
            let code = self.byte()?;
            match code {
                b'.' => return self.pop(),
                0x80 => drop(self.byte()?),
                0x95 => drop(self.take(8)?),
                b'(' => self.marks.push(self.stack.len()),
                b'0' => drop(self.pop()?),
                b'1' => drop(self.above_mark()?),
                b'a' => {
                    let item = self.pop()?;
                    self.append(vec![item])?;
                }
                b'e' => {
                    let items = self.above_mark()?;
                    self.append(items)?;
                }
                b's' => {
                    let value = self.pop()?;
                    let key = self.pop()?;
                    self.set(vec![(key, value)])?;
                }
                b'u' => {
                    let items = self.above_mark()?;
                    self.set(pairs(items)?)?;
                }
                b'p' | b'q' | b'r' => {
                    let key = self.key(code)?;
                    self.remember(key)?;
                }
                0x94 => self.remember(self.memo.len() as u64)?,
                b'b' => self.build()?,
                _ => {
                    let value = self.value(code)?;
                    self.stack.push(value);
                }
            }
        }
    }

    /// The value that an opcode puts on the stack.
    fn value(&mut self, code: u8) -> Result<Value, String> {
        Ok(match code {
            b'2' => self.top()?.clone(),
            b'N' => Value::None,
            0x88 => Value::Bool(true),
            0x89 => Value::Bool(false),
            b'J' => Value::Int(i32::from_le_bytes(self.array()?).into()),
            b'K' => Value::Int(self.byte()?.into()),
            b'M' => Value::Int(u16::from_le_bytes(self.array()?).into()),
            b'I' | b'L' => self.decimal()?,
            b'F' => {
                let line = self.line()?;
                Value::Float(line.parse().map_err(|_| format!("`{line}` for a number"))?)
            }
            b'G' => Value::Float(f64::from_be_bytes(self.array()?)),
            0x8a => self.long()?,
            b'V' => Value::Text(unescaped(self.raw_line()?)),
            b'S' => Value::Text(self.line()?.trim_matches(['\'', '"']).to_owned()),
            b'X' | 0x8c | 0x8d => {
                let length = self.length(if code == b'X' { 4 } else { [1, 8][usize::from(code - 0x8c)] })?;
                Value::Text(String::from_utf8_lossy(self.take(length)?).into_owned())
            }
            b'T' | b'U' | b'B' | b'C' | 0x8e | 0x96 => {
                let length = self.length(match code {
                    b'T' | b'B' => 4,
                    b'U' | b'C' => 1,
                    _ => 8,
                })?;
                Value::Bytes(self.take(length)?.to_vec())
            }
            b']' => self.make(Object::List(Vec::new())),
            b'}' => self.make(Object::Dict(Vec::new())),
            b')' => self.make(Object::Tuple(Vec::new())),
            b'l' | b't' | b'd' => {
                let items = self.above_mark()?;
                self.make(match code {
                    b'l' => Object::List(items),
                    b't' => Object::Tuple(items),
                    _ => Object::Dict(pairs(items)?),
                })
            }
            0x85..=0x87 => {
                let start = self.stack.len().checked_sub(usize::from(code - 0x84));
                let items = self.stack.split_off(start.ok_or("too few values for a tuple")?);
                self.make(Object::Tuple(items))
            }
            b'g' | b'h' | b'j' => {
                let key = self.key(code)?;
                self.recall(key)?
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                global(&module, &name)?
            }
            0x93 => match (self.pop()?, self.pop()?) {
                (Value::Text(name), Value::Text(module)) => global(&module, &name)?,
                _ => return Err("a name that is no text".into()),
            },
            b'R' => self.reduce()?,
            other => {
                return Err(format!("a pickle that asks for more than plain values and arrays (opcode {other:#04x})"));
            }
        })
    }

    /// The place in the memo that the argument of an opcode names.
    fn key(&mut self, code: u8) -> Result<u64, String> {
        match code {
            b'p' | b'g' => {
                let line = self.line()?;
                line.parse().map_err(|_| format!("`{line}` for a place in the memo"))
            }
            b'q' | b'h' => Ok(self.byte()?.into()),
            _ => Ok(u32::from_le_bytes(self.array()?).into()),
        }
    }

    fn take(&mut self, count: usize) -> Result<&[u8], String> {
        let end = self.at.checked_add(count).filter(|&end| end <= self.bytes.len()).ok_or("it ends early")?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn byte(&mut self) -> Result<u8, String> {
        self.array::<1>().map(|[b]| b)
    }

    /// An unsigned number of 1, 4 or 8 bytes.
    fn length(&mut self, width: usize) -> Result<usize, String> {
        let mut bytes = [0; 8];
        bytes[..width].copy_from_slice(self.take(width)?);
        usize::try_from(u64::from_le_bytes(bytes)).map_err(|_| "it ends early".into())
    }

    fn raw_line(&mut self) -> Result<&[u8], String> {
        let start = self.at;
        let length = self.bytes[start..].iter().position(|&b| b == b'\n').ok_or("it ends early")?;
        self.at += length + 1;
        Ok(&self.bytes[start..start + length])
    }

    fn line(&mut self) -> Result<String, String> {
        Ok(String::from_utf8_lossy(self.raw_line()?).trim_end_matches('\r').to_owned())
    }

    fn decimal(&mut self) -> Result<Value, String> {
        match self.line()?.as_str() {
            "00" => Ok(Value::Bool(false)),
            "01" => Ok(Value::Bool(true)),
            text => text.trim_end_matches('L').parse().map(Value::Int).map_err(|_| format!("`{text}` for a number")),
        }
    }

    /// A two's complement number of up to 8 bytes.
    fn long(&mut self) -> Result<Value, String> {
        let length = self.byte()?.into();
        let bytes = self.take(length)?;
        if length > 8 {
            return Err("a number of more than 64 bits".into());
        }
        Ok(Value::Int(signed(bytes)))
    }

    fn pop(&mut self) -> Result<Value, String> {
        self.stack.pop().ok_or_else(|| "a stack without values".into())
    }

    fn top(&self) -> Result<&Value, String> {
        self.stack.last().ok_or_else(|| "a stack without values".into())
    }

    fn above_mark(&mut self) -> Result<Vec<Value>, String> {
        let mark = self.marks.pop().filter(|&mark| mark <= self.stack.len()).ok_or("a mark that is not there")?;
        Ok(self.stack.split_off(mark))
    }

    fn make(&mut self, object: Object) -> Value {
        self.objects.push(object);
        Value::Object(self.objects.len() - 1)
    }

    /// The elements of a tuple; `what` names it in an error.
    fn tuple(&self, value: &Value, what: &str) -> Result<Vec<Value>, String> {
        match value {
            Value::Object(index) => match self.objects.get(*index) {
                Some(Object::Tuple(items)) => Ok(items.clone()),
                _ => Err(format!("{what} that is no tuple")),
            },
            _ => Err(format!("{what} that is no tuple")),
        }
    }

    fn top_object(&mut self) -> Result<&mut Object, String> {
        match self.top()? {
            Value::Object(index) => {
                let index = *index;
                self.objects.get_mut(index).ok_or_else(|| "an object that is not there".into())
            }
            _ => Err("a value where a list, dictionary or array is needed".into()),
        }
    }

    fn append(&mut self, items: Vec<Value>) -> Result<(), String> {
        match self.top_object()? {
            Object::List(list) => list.extend(items),
            _ => return Err("an element for what is no list".into()),
        }
        Ok(())
    }

    fn set(&mut self, entries: Vec<(Value, Value)>) -> Result<(), String> {
        match self.top_object()? {
            Object::Dict(dict) => dict.extend(entries),
            _ => return Err("an entry for what is no dictionary".into()),
        }
        Ok(())
    }

    fn remember(&mut self, key: u64) -> Result<(), String> {
        let top = self.top()?.clone();
        self.charge(&top)?;
        self.memo.insert(key, top);
        Ok(())
    }

    fn recall(&mut self, key: u64) -> Result<Value, String> {
        let value = self.memo.get(&key).cloned().ok_or("a place in the memo that is empty")?;
        self.charge(&value)?;
        Ok(value)
    }

    /// Copies of texts and bytes count against the limit: a pickle of a few bytes may make many.
    fn charge(&mut self, value: &Value) -> Result<(), String> {
        self.count(match value {
            Value::Text(text) => text.len() / 8,
            Value::Bytes(bytes) => bytes.len() / 8,
            _ => 0,
        })
    }

    fn count(&mut self, numbers: usize) -> Result<(), String> {
        self.numbers = self.numbers.saturating_add(numbers);
        if self.numbers > MOST_NUMBERS { Err(format!("more than {MOST_NUMBERS} numbers")) } else { Ok(()) }
    }

    /// The result that calling one of the names would have.
    fn reduce(&mut self) -> Result<Value, String> {
        let arguments = self.pop()?;
        let arguments = self.tuple(&arguments, "arguments of a call")?;
        Ok(match (self.pop()?, arguments.as_slice()) {
            (Value::Global(Global::Reconstruct), [Value::Global(Global::Ndarray), ..]) => {
                self.make(Object::Array { values: Vec::new() })
            }
            (Value::Global(Global::Dtype), [Value::Text(code), ..]) => {
                let big = code.starts_with('>');
                let code = code.trim_start_matches(['<', '>', '|', '=']).to_owned();
                self.make(Object::Kind { code, big })
            }
            (Value::Global(Global::Scalar), [kind, Value::Bytes(bytes)]) => {
                let values = self.decode(kind, bytes)?;
                values.into_iter().next().ok_or("a scalar without a value")?
            }
            (Value::Global(Global::FromBuffer), [Value::Bytes(bytes), kind, shape, Value::Text(order)]) => {
                let values = self.decode(kind, bytes)?;
                let values = self.arranged(values, shape, order == "F")?;
                self.make(Object::Array { values })
            }
            (Value::Global(Global::Encode), [Value::Text(text), ..]) => {
                let bytes = text.chars().map(|c| u8::try_from(u32::from(c))).collect::<Result<Vec<u8>, _>>();
                Value::Bytes(bytes.map_err(|_| "bytes that are no bytes")?)
            }
            _ => return Err("a call that makes no array".into()),
        })
    }

    /// Fills in the state of an array or a dtype.
    fn build(&mut self) -> Result<(), String> {
        let state = self.pop()?;
        let items = self.tuple(&state, "a state")?;
        match (self.top_object()?, items.as_slice()) {
            (Object::Kind { big, .. }, [_, Value::Text(order), ..]) => *big = order == ">",
            (Object::Array { .. }, [_, shape, kind, Value::Bool(columns_first), data]) => {
                let values = match data {
                    Value::Bytes(bytes) => self.decode(kind, bytes)?,
                    Value::Object(index) => match self.objects.get(*index) {
                        Some(Object::List(items)) => {
                            let items = items.clone();
                            self.count(items.len())?;
                            items
                        }
                        _ => return Err("an array without values".into()),
                    },
                    _ => return Err("an array without values".into()),
                };
                let filled = self.arranged(values, shape, *columns_first)?;
                if let Object::Array { values } = self.top_object()? {
                    *values = filled;
                }
            }
            _ => return Err("a state of neither an array nor its type".into()),
        }
        Ok(())
    }

    /// The elements along the first axis, those of further axes as lists, if the values are as many as the shape says.
    fn arranged(&mut self, values: Vec<Value>, shape: &Value, columns_first: bool) -> Result<Vec<Value>, String> {
        let sides = self.tuple(shape, "a shape")?;
        let side = |v: &Value| if let Value::Int(n) = v { usize::try_from(*n).ok() } else { None };
        let sides: Vec<usize> =
            sides.iter().map(side).collect::<Option<_>>().ok_or("a shape that is no whole numbers")?;
        let count = sides.iter().try_fold(1usize, |n, &s| n.checked_mul(s));
        if count != Some(values.len()) {
            return Err(format!("an array of shape {sides:?} with {} values", values.len()));
        }
        let mut values = match (columns_first, sides.as_slice()) {
            (true, &[rows, columns]) => {
                let at = |i: usize| values.get(i % columns * rows + i / columns).cloned();
                (0..rows * columns).filter_map(at).collect()
            }
            (true, [_, _, ..]) => return Err("an array in Fortran's order with more than two axes".into()),
            _ => values,
        };
        for &side in sides.iter().skip(1).rev().filter(|&&side| side > 0) {
            let rows: Vec<Vec<Value>> = values.chunks(side).map(<[Value]>::to_vec).collect();
            values = rows.into_iter().map(|row| self.make(Object::List(row))).collect();
        }
        Ok(values)
    }

    /// Numbers or strings from the bytes of an array.
    fn decode(&mut self, kind: &Value, bytes: &[u8]) -> Result<Vec<Value>, String> {
        let kind = match kind {
            Value::Object(index) => self.objects.get(*index),
            _ => None,
        };
        let Some(Object::Kind { code, big }) = kind else { return Err("an array without a type".into()) };
        let (code, big) = (code.clone(), *big);
        let (letter, width) = code.split_at_checked(1).ok_or("an array type without a name")?;
        let width: usize = width.parse().map_err(|_| format!("an array of type `{code}`"))?;
        let size = if letter == "U" { width.saturating_mul(4) } else { width };
        if size == 0 || !bytes.len().is_multiple_of(size) {
            return Err(format!("{} bytes of type `{code}`", bytes.len()));
        }
        self.count(bytes.len() / size.min(8))?;
        let value = |chunk: &[u8]| -> Option<Value> {
            let mut whole = chunk.to_vec();
            if big && letter != "S" && letter != "U" {
                whole.reverse();
            }
            Some(match (letter, width) {
                ("f", 4) => Value::Float(f32::from_le_bytes(whole.try_into().ok()?).into()),
                ("f", 8) => Value::Float(f64::from_le_bytes(whole.try_into().ok()?)),
                ("i", 1 | 2 | 4 | 8) => Value::Int(signed(&whole)),
                ("u", 1 | 2 | 4) => {
                    whole.resize(8, 0);
                    Value::Int(i64::from_le_bytes(whole.try_into().ok()?))
                }
                ("b", 1) => Value::Bool(whole != [0]),
                ("S", _) => Value::Text(String::from_utf8_lossy(&whole).trim_end_matches('\0').to_owned()),
                ("U", _) => {
                    let code = |c: &[u8]| {
                        let c: [u8; 4] = c.try_into().unwrap_or([0; 4]);
                        char::from_u32(if big { u32::from_be_bytes(c) } else { u32::from_le_bytes(c) })
                    };
                    let text: Option<String> = whole.chunks(4).map(code).collect();
                    Value::Text(text?.trim_end_matches('\0').to_owned())
                }
                _ => return None,
            })
        };
        bytes.chunks(size).map(value).collect::<Option<_>>().ok_or_else(|| format!("an array of type `{code}`"))
    }
}

/// A two's complement number of up to 8 bytes, the lowest first.
fn signed(bytes: &[u8]) -> i64 {
    let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
    let mut whole = [if negative { 0xff } else { 0 }; 8];
    whole[..bytes.len()].copy_from_slice(bytes);
    i64::from_le_bytes(whole)
}

/// The permitted global of a name.
fn global(module: &str, name: &str) -> Result<Value, String> {
    Ok(Value::Global(match (module, name) {
        ("numpy.core.multiarray" | "numpy._core.multiarray", "_reconstruct") => Global::Reconstruct,
        ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Global::Scalar,
        ("numpy.core.numeric" | "numpy._core.numeric", "_frombuffer") => Global::FromBuffer,
        ("numpy", "ndarray") => Global::Ndarray,
        ("numpy", "dtype") => Global::Dtype,
        ("_codecs", "encode") => Global::Encode,
        _ => return Err(format!("a pickle that asks for the code `{module}.{name}`; nothing of it was run")),
    }))
}

/// Text in Python's raw-unicode-escape: Latin-1 with `\\uXXXX` and `\\UXXXXXXXX`.
fn unescaped(line: &[u8]) -> String {
    let mut text = String::new();
    let mut rest = line;
    while let Some((&byte, after)) = rest.split_first() {
        let width = match (byte, after.first()) {
            (b'\\', Some(b'u')) => 4,
            (b'\\', Some(b'U')) => 8,
            _ => 0,
        };
        let code = after.get(1..1 + width).filter(|_| width > 0).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u32::from_str_radix(hex, 16).ok()).and_then(char::from_u32) {
            Some(c) => {
                text.push(c);
                rest = &after[1 + width..];
            }
            None => {
                text.push(char::from(byte));
                rest = after;
            }
        }
    }
    text
}

fn pairs(items: Vec<Value>) -> Result<Vec<(Value, Value)>, String> {
    if !items.len().is_multiple_of(2) {
        return Err("a dictionary with a key and no value".into());
    }
    let mut items = items.into_iter();
    Ok(std::iter::from_fn(|| items.next().zip(items.next())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::pickle as testing;

    #[test]
    fn arrays_lists_and_texts() {
        let matrix = testing::numbers(&[2, 2], &[1.0, 2.0, 3.0, 4.5]);
        let value = testing::dict(&[
            ("K", testing::list(&[matrix])),
            ("ims", testing::list(&[testing::text("a/0.jpg"), testing::text("b")])),
            ("n", b"\x8a\x02\xfe\xff".to_vec()),
        ]);
        let pickle = read(&testing::object(value)).unwrap();
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
            b"cos\nsystem\n(S'echo hi'\ntR.",
            b"\x80\x04\x8c\x02os\x8c\x06system\x93.",
            b"(ios\nsystem\n.",
            b"\x80\x02cnumpy\nndarray\n)\x81.",
            b"Pname\n.",
            b"cnumpy.f2py.capi_maps\nload_f2cmap_file\n.",
        ];
        for attack in attacks {
            let error = read(attack).unwrap_err();
            assert!(error.contains("a pickle that asks for"), "{error}");
        }
    }

    #[test]
    fn broken_pickles_are_refused() {
        let whole = testing::object(testing::dict(&[("a", testing::numbers(&[2], &[1.0, 2.0]))]));
        for keep in 0..whole.len() {
            assert!(read(&whole[..keep]).is_err(), "{keep}");
        }
        for bad in [&b"."[..], b"e.", b"h\x00.", b"]s.", b"NR.", b"Nb.", b"cnumpy\ndtype\nNR.", b"(", b"K\x01K\x02s."] {
            assert!(read(bad).is_err());
        }
        // A list that holds itself is read, and looked through only so far.
        let pickle = read(b"]q\x00h\x00a.").unwrap();
        assert!(pickle.numbers(pickle.root()).is_none());
        // Doubling, again and again.
        let mut bomb = b"X\x00\x01\x00\x00".to_vec();
        bomb.extend([b'a'; 256]);
        bomb.extend(b"q\x00");
        bomb.extend(b"h\x00".repeat(1 << 20));
        bomb.push(b'.');
        assert!(read(&bomb).unwrap_err().contains("numbers"));
    }
}
