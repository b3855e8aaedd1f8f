//! Safetensors: eight bytes with the length of a JSON header, the header, and the values.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use safetensors::tensor::{Metadata, TensorInfo};

use super::WeightEntry;

/// Max length of a header in bytes, as in the format's own library.
const MAX_HEADER: u64 = 100_000_000;

/// Returns whether the file at `path` begins like safetensors.
pub(super) fn is_safetensors(path: &Path) -> io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(9).read_to_end(&mut start)?;
    Ok(start.len() == 9 && start[8] == b'{')
}

pub(super) fn entries(path: &Path) -> Result<BTreeMap<String, WeightEntry>, String> {
    let fault = |cause: &dyn std::fmt::Display| format!("no safetensors file: {cause}");
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    let length = file.metadata().map_err(|error| error.to_string())?.len();
    let mut header = [0; 8];
    file.read_exact(&mut header).map_err(|error| fault(&error))?;
    let start = u64::from_le_bytes(header).saturating_add(8);
    let most = length.min(MAX_HEADER);
    if start > most {
        return Err(fault(&format!("its header should be {start} bytes long, at most {most} are possible")));
    }
    let mut header = vec![0; start as usize - 8];
    file.read_exact(&mut header).map_err(|error| fault(&error))?;
    // Parsing checks that the tensors follow each other and that their lengths match their shapes.
    let metadata: Metadata = serde_json::from_slice(&header).map_err(|error| fault(&error))?;
    let tensors = metadata.tensors();
    let values = tensors.values().map(|info| info.data_offsets.1).max().unwrap_or(0) as u64;
    if start.checked_add(values) != Some(length) {
        return Err(fault(&format!("its tensors should be {values} bytes long, the file has {}", length - start)));
    }
    Ok(tensors.into_iter().map(|(name, info)| (name, entry(path, start, info))).collect())
}

fn entry(path: &Path, start: u64, info: &TensorInfo) -> WeightEntry {
    let (path, (first, end)) = (path.to_owned(), info.data_offsets);
    let bytes = move || {
        let mut file = File::open(&path)?;
        file.seek(SeekFrom::Start(start + first as u64))?;
        let mut bytes = vec![0; end - first];
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    };
    let read = move || {
        let bytes = bytes().map_err(|error: io::Error| error.to_string())?;
        Ok(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    };
    WeightEntry { shape: info.shape.clone(), dtype: format!("{:?}", info.dtype), read: Box::new(read) }
}
