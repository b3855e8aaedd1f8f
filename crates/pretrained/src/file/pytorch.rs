//! PyTorch's files: a zip archive since version 1.6, a sequence of pickles before.

use std::collections::BTreeMap;
use std::path::Path;

use pytorch_reader::{PytorchReader, Tensor};

use super::WeightEntry;

pub(super) fn entries(path: &Path) -> Result<BTreeMap<String, WeightEntry>, String> {
    let reader = PytorchReader::new(path)
        .map_err(|error| one_line(&format!("no safetensors file, and no PyTorch file either: {error}")))?;
    Ok(reader.into_tensors().into_iter().map(|(name, tensor)| (name, entry(tensor))).collect())
}

fn entry(tensor: Tensor) -> WeightEntry {
    let (shape, dtype) = (tensor.shape().to_vec(), format!("{:?}", tensor.dtype()));
    let read = move || {
        let bytes = tensor.read().map_err(|error| one_line(&error.to_string()))?;
        // The reader returns bytes in this machine's order.
        Ok(bytes.as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect())
    };
    WeightEntry { shape, dtype, read: Box::new(read) }
}

fn one_line(error: &str) -> String {
    error.split_whitespace().collect::<Vec<_>>().join(" ")
}
