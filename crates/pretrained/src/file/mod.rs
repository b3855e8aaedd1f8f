mod pytorch;
mod safetensors;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name and shape of a tensor.
pub type TensorShape = (String, Vec<usize>);

/// Returns names and shapes of γ, β, mean and variance of the batch normalisation `name`, as in PyTorch.
pub fn normalisation(name: &str, channels: usize) -> [TensorShape; 4] {
    ["weight", "bias", "running_mean", "running_var"].map(|part| (format!("{name}.{part}"), vec![channels]))
}

/// File of named tensors: safetensors, or PyTorch's (`.pth`, `.pt`, `.bin`, of any version), whose pickles are not
/// executed. Each error is one line that begins with the file's path, except errors of [`WeightFile::check`].
pub struct WeightFile {
    path: PathBuf,
    tensors: BTreeMap<String, WeightEntry>,
}

/// Tensor whose values stay in the file until they are read.
struct WeightEntry {
    shape: Vec<usize>,
    dtype: String,
    /// Reads the values of a tensor of single precision.
    read: Box<dyn Fn() -> Result<Vec<f32>, String> + Send + Sync>,
}

impl WeightFile {
    /// Opens the file at `path`; its content decides the format.
    ///
    /// # Errors
    /// The file cannot be read, or has neither format.
    pub fn read(path: &Path) -> Result<Self, String> {
        let entries = || match safetensors::is_safetensors(path).map_err(|error| error.to_string())? {
            true => safetensors::entries(path),
            false => pytorch::entries(path),
        };
        let tensors = entries().map_err(|cause| format!("{}: {cause}", path.display()))?;
        Ok(Self { path: path.to_owned(), tensors })
    }

    /// Checks that there is a tensor `name` of that `shape` in single precision.
    ///
    /// # Errors
    /// There is none; the message names what is there instead.
    pub fn check(&self, name: &str, shape: &[usize]) -> Result<(), String> {
        self.entry(name, shape).map(|_| ())
    }

    /// Reads the values of the tensor `name`, row-major.
    ///
    /// # Errors
    /// Errors of [`Self::check`], or a value is not finite.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let values = self.entry(name, shape).and_then(|entry| (entry.read)());
        let finite = values.and_then(|values| match values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(format!("`{name}` is not finite at index {index}")),
            None => Ok(values),
        });
        finite.map_err(|cause| format!("{}: {cause}", self.path.display()))
    }

    /// Reads a convolution W and the batch normalisation (γ, β, μ, σ²) after it as one: weights s W and biases β − s μ
    /// with s = γ/√(σ² + ε), since γ (W x − μ)/√(σ² + ε) + β = (s W) x + (β − s μ).
    ///
    /// # Errors
    /// Errors of [`Self::floats`].
    pub fn folded(
        &self,
        (name, shape): &TensorShape,
        normalisation: &[TensorShape; 4],
        epsilon: f32,
    ) -> Result<(Vec<f32>, Vec<f32>), String> {
        let mut weight = self.floats(name, shape)?;
        let [gamma, beta, mean, variance] = normalisation.each_ref().map(|(name, shape)| self.floats(name, shape));
        let (gamma, mut bias, mean, variance) = (gamma?, beta?, mean?, variance?);
        let kernel = weight.len() / bias.len();
        for (channel, weights) in weight.chunks_exact_mut(kernel).enumerate() {
            let scale = gamma[channel] / (variance[channel] + epsilon).sqrt();
            weights.iter_mut().for_each(|weight| *weight *= scale);
            bias[channel] -= scale * mean[channel];
        }
        Ok((weight, bias))
    }

    fn entry(&self, name: &str, shape: &[usize]) -> Result<&WeightEntry, String> {
        let entry = self.tensors.get(name).ok_or_else(|| format!("no tensor `{name}`, expected F32 {shape:?}"))?;
        if entry.dtype != "F32" || entry.shape != shape {
            return Err(format!("`{name}` is {} {:?}, not F32 {shape:?}", entry.dtype, entry.shape));
        }
        Ok(entry)
    }
}
