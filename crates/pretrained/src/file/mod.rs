mod pytorch;
mod safetensors;

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};

/// Name and shape of a tensor.
pub type TensorShape = (String, Vec<usize>);

/// A file of named tensors: safetensors, or what PyTorch saves (`.pth`, `.pt`, `.bin`, of any of its versions), of which
/// nothing is executed. Faults are one line each, without the file's name.
pub struct WeightFile {
    tensors: BTreeMap<String, Entry>,
}

/// A tensor whose numbers stay in the file until they are asked for.
struct Entry {
    shape: Vec<usize>,
    /// As `F32`.
    dtype: String,
    /// The numbers of a tensor of single precision.
    read: Box<dyn Fn() -> Result<Vec<f32>, String> + Send + Sync>,
}

impl WeightFile {
    /// Opens the file at `path`; what it is follows from its content.
    ///
    /// # Errors
    /// If it cannot be read, or is neither.
    pub fn read(path: &Path) -> Result<Self, String> {
        let is_safetensors = safetensors::is_one(path).map_err(|error| error.to_string())?;
        let tensors = if is_safetensors { safetensors::entries(path)? } else { pytorch::entries(path)? };
        Ok(Self { tensors })
    }

    /// Names and shapes of all tensors.
    pub fn shapes(&self) -> impl Iterator<Item = (&str, &[usize])> {
        self.tensors.iter().map(|(name, entry)| (name.as_str(), entry.shape.as_slice()))
    }

    /// Checks that there is a tensor `name` of that `shape` in single precision.
    ///
    /// # Errors
    /// What is there instead.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<(), String> {
        self.entry(name, shape).map(|_| ())
    }

    /// The numbers of the tensor `name`, row-major.
    ///
    /// # Errors
    /// If there is none of that name, in single precision, of that `shape` and finite.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let numbers = (self.entry(name, shape)?.read)()?;
        match numbers.iter().position(|number| !number.is_finite()) {
            Some(index) => Err(format!("`{name}` is not finite at index {index}")),
            None => Ok(numbers),
        }
    }

    /// The same as a tensor.
    ///
    /// # Errors
    /// As [`Self::floats`].
    pub fn tensor<const D: usize>(&self, name: &str, shape: [usize; D], device: &Device) -> Result<Tensor<D>, String> {
        Ok(Tensor::from_data(TensorData::new(self.floats(name, &shape)?, shape), device))
    }

    fn entry(&self, name: &str, shape: &[usize]) -> Result<&Entry, String> {
        let entry = self.tensors.get(name).ok_or_else(|| format!("no tensor `{name}`, expected F32 {shape:?}"))?;
        if entry.dtype != "F32" || entry.shape != shape {
            return Err(format!("`{name}` is {} {:?}, not F32 {shape:?}", entry.dtype, entry.shape));
        }
        Ok(entry)
    }
}

/// A weight file whose faults name it.
pub(crate) struct Named<'a> {
    path: &'a Path,
    file: WeightFile,
}

impl<'a> Named<'a> {
    pub(crate) fn open(path: &'a Path) -> Result<Self, String> {
        let file = WeightFile::read(path).map_err(|cause| format!("{}: {cause}", path.display()))?;
        Ok(Self { path, file })
    }

    pub(crate) fn floats(&self, (name, shape): &TensorShape) -> Result<Vec<f32>, String> {
        self.file.floats(name, shape).map_err(|cause| format!("{}: {cause}", self.path.display()))
    }
}
