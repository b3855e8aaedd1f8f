use std::collections::HashMap;
use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use safetensors::tensor::TensorInfo;
use safetensors::{Dtype, SafeTensors};

/// A safetensors file in memory. Faults are one line each, without the file's name.
pub struct WeightFile {
    bytes: Vec<u8>,
    /// Where the tensors begin.
    start: usize,
    tensors: HashMap<String, TensorInfo>,
}

impl WeightFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// If it cannot be read, or is no safetensors file.
    pub fn read(path: &Path) -> Result<Self, String> {
        let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
        let (header, metadata) =
            SafeTensors::read_metadata(&bytes).map_err(|error| format!("no safetensors file: {error:?}"))?;
        let tensors = metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
        Ok(Self { start: header + 8, bytes, tensors })
    }

    /// The numbers of the tensor `name`, row-major.
    ///
    /// # Errors
    /// If there is none of that name, in single precision and of that `shape`.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let info = self.tensors.get(name).ok_or_else(|| format!("no tensor `{name}`"))?;
        if info.dtype != Dtype::F32 || info.shape != shape {
            return Err(format!("`{name}` is {:?} {:?}, not F32 {shape:?}", info.dtype, info.shape));
        }
        let (first, end) = info.data_offsets;
        let numbers = self.bytes[self.start + first..self.start + end].chunks_exact(4);
        Ok(numbers.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// The same as a tensor.
    ///
    /// # Errors
    /// As [`Self::floats`].
    pub fn tensor<const D: usize>(&self, name: &str, shape: [usize; D], device: &Device) -> Result<Tensor<D>, String> {
        Ok(Tensor::from_data(TensorData::new(self.floats(name, &shape)?, shape), device))
    }
}
