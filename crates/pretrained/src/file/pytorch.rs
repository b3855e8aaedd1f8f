//! What PyTorch saves: a zip archive since 1.6, pickles one after another before.

use std::collections::BTreeMap;
use std::path::Path;

use pytorch_reader::{PytorchReader, Tensor};

use super::Entry;

/// The tensors of a PyTorch file.
pub(super) fn entries(path: &Path) -> Result<BTreeMap<String, Entry>, String> {
    let reader = PytorchReader::new(path)
        .map_err(|error| one_line(&format!("no safetensors file, and no PyTorch file either: {error}")))?;
    Ok(reader.into_tensors().into_iter().map(|(name, tensor)| (name, entry(tensor))).collect())
}

fn entry(tensor: Tensor) -> Entry {
    let (shape, dtype) = (tensor.shape().to_vec(), format!("{:?}", tensor.dtype()));
    let read = move || {
        let bytes = tensor.read().map_err(|error| one_line(&error.to_string()))?;
        // The reader gives them in the order of this machine.
        Ok(bytes.as_chunks().0.iter().map(|number| f32::from_ne_bytes(*number)).collect())
    };
    Entry { shape, dtype, read: Box::new(read) }
}

fn one_line(error: &str) -> String {
    error.split_whitespace().collect::<Vec<_>>().join(" ")
}
