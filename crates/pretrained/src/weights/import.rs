use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::{TensorView, serialize_to_file};

use super::{KNOWN_WEIGHTS, KnownWeights, Store, WeightsError};
use crate::file::WeightFile;

impl Store {
    /// Imports the weights in `file`, safetensors or PyTorch's: recognises them by names and shapes, and writes the tensors
    /// that are needed as safetensors into the first folder, where a file of that name is replaced only by a whole one.
    /// Returns what was found, with the path of the copy.
    ///
    /// # Errors
    /// If the file cannot be read, holds none of [`KNOWN_WEIGHTS`] in full, or the folder cannot be written.
    pub fn import(&self, file: &Path) -> Result<Vec<(&'static KnownWeights, PathBuf)>, WeightsError> {
        let tensors = WeightFile::read(file).map_err(WeightsError)?;
        let found = recognised(&tensors).map_err(|cause| WeightsError::file(file, cause))?;
        found.into_iter().map(|weights| Ok((weights, self.keep(weights, &tensors)?))).collect()
    }

    pub(super) fn keep(&self, weights: &KnownWeights, tensors: &WeightFile) -> Result<PathBuf, WeightsError> {
        let read = |(name, shape): (String, Vec<usize>)| {
            let values = tensors.floats(&name, &shape)?;
            Ok((name, shape, values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>()))
        };
        let needed = (weights.tensors)().into_iter().map(read).collect::<Result<Vec<_>, String>>();
        let needed = needed.map_err(WeightsError)?;
        let views = needed.iter().map(|(name, shape, bytes)| {
            let view = TensorView::new(Dtype::F32, shape.clone(), bytes).expect("bytes of that shape were read");
            (name.as_str(), view)
        });

        let folder = &self.folders()[0];
        std::fs::create_dir_all(folder).map_err(|error| WeightsError::io(folder, &error))?;
        let path = folder.join(weights.file());
        let temporary = folder.join(format!(".{}.{}", weights.file(), std::process::id()));
        let written = serialize_to_file(views, &None, &temporary)
            .map_err(|error| match error {
                safetensors::SafeTensorError::IoError(error) => WeightsError::io(&path, &error),
                error => WeightsError::file(&path, format!("{error:?}")),
            })
            .and_then(|()| std::fs::rename(&temporary, &path).map_err(|error| WeightsError::io(&path, &error)));
        // The first error matters, not one of cleaning up.
        written.inspect_err(|_| drop(std::fs::remove_file(&temporary))).map(|()| path)
    }
}

/// Returns the weights that a file holds in full; the error names what the most similar ones lack.
pub(super) fn recognised(file: &WeightFile) -> Result<Vec<&'static KnownWeights>, String> {
    let mut nearest = (0.0, "it has no tensor that a known network has".to_owned());
    let mut found = Vec::new();
    for weights in KNOWN_WEIGHTS {
        let tensors = (weights.tensors)();
        let faults: Vec<String> = tensors.iter().filter_map(|(name, shape)| file.check(name, shape).err()).collect();
        let share = 1.0 - faults.len() as f64 / tensors.len() as f64;
        match faults.into_iter().next() {
            None => found.push(weights),
            Some(fault) if share > nearest.0 => nearest = (share, format!("most like {}, but {fault}", weights.name)),
            Some(_) => {}
        }
    }
    if found.is_empty() { Err(format!("none of the known weights: {}", nearest.1)) } else { Ok(found) }
}
