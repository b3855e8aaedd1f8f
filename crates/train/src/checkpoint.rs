//! Checkpoints: written to a temporary folder and renamed, checksummed, the previous one kept.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::optim::{ModuleOptimizer, OptimizerRecord};
use burn::store::ModuleRecord;
use burn::tensor::Bytes;
use infonerf_field::Field;
use infonerf_ops::to_host;
use infonerf_render::{Model, OccupancyGrid};
use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::model::weights;
use crate::progress::Progress;
use crate::weight_averaging::WeightAverage;

/// Everything that a run needs to resume as if it had never stopped.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    progress: Progress,
    /// Number of models in the weight average.
    averaged: usize,
    /// Contents of the files by name.
    parts: BTreeMap<&'static str, Vec<u8>>,
}

const MODEL: &str = "model.bpk";
const AVERAGE: &str = "average.bpk";
const OPTIMIZER: &str = "optimizer.bpk";
const OCCUPANCY: &str = "occupancy.bin";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    version: u32,
    progress: Progress,
    averaged: usize,
    files: Vec<CheckpointFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckpointFile {
    name: String,
    bytes: u64,
    crc32: u32,
}

const VERSION: u32 = 6;
const MANIFEST: &str = "manifest.json";

impl Checkpoint {
    pub(crate) fn take<F: Field>(
        progress: &Progress,
        model: &Model<F>,
        average: &WeightAverage<F>,
        optimizer: &ModuleOptimizer,
        occupancy: Option<&OccupancyGrid>,
    ) -> Result<Self, TrainError> {
        // A model with such a weight must not replace the previous checkpoint.
        if let Some(value) = weights(model).into_iter().flat_map(to_host).find(|value| !value.is_finite()) {
            return Err(TrainError::NonFinite { what: "value of a weight".into(), value, step: progress.step });
        }
        let record = |error: burn::store::RecordError| TrainError::Config(format!("checkpoint: {error}"));
        let bytes = |model: &Model<F>| model.clone().into_record().into_bytes().map(|b| b.to_vec()).map_err(record);
        let parts = [
            (MODEL, Some(bytes(model)?)),
            (AVERAGE, average.mean.as_ref().map(bytes).transpose()?),
            (OPTIMIZER, Some(optimizer.to_record().into_bytes().map_err(record)?.to_vec())),
            (OCCUPANCY, occupancy.map(encode_occupancy)),
        ];
        let parts = parts.into_iter().filter_map(|(name, bytes)| Some((name, bytes?))).collect();
        Ok(Self { progress: progress.clone(), averaged: average.count, parts })
    }

    /// Returns the progress of the run.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Writes the checkpoint to `run/checkpoint`; the previous one becomes `run/checkpoint.previous`.
    ///
    /// # Errors
    /// If anything cannot be written; the checkpoint that was there stays usable.
    pub fn save(&self, run: &Path) -> Result<(), TrainError> {
        let [current, previous, beside] = paths(run);
        remove(&beside)?;
        // A part of a checkpoint would only take up space on a full disk.
        self.write_to(&beside).inspect_err(|_| drop(remove(&beside)))?;
        if current.exists() {
            remove(&previous)?;
            fs::rename(&current, &previous).map_err(|error| TrainError::file(&current, error))?;
        }
        fs::rename(&beside, &current).map_err(|error| TrainError::file(&current, error))
    }

    fn write_to(&self, folder: &Path) -> Result<(), TrainError> {
        fs::create_dir_all(folder).map_err(|error| TrainError::file(folder, error))?;
        let mut files = Vec::new();
        for (&name, bytes) in &self.parts {
            write(&folder.join(name), bytes)?;
            let (name, crc32) = (name.to_owned(), crc32fast::hash(bytes));
            files.push(CheckpointFile { name, bytes: bytes.len() as u64, crc32 });
        }
        let manifest = Manifest { version: VERSION, progress: self.progress.clone(), averaged: self.averaged, files };
        let text = serde_json::to_vec_pretty(&manifest).map_err(|error| TrainError::file(folder, error))?;
        write(&folder.join(MANIFEST), &text)
    }

    /// Reads the newest intact checkpoint of a run; `None` if there is none. Also returns why newer ones were refused.
    ///
    /// # Errors
    /// If there are checkpoints, but none is intact.
    pub fn load(run: &Path) -> Result<(Option<Self>, Vec<String>), TrainError> {
        let [current, previous, _] = paths(run);
        let mut refused = Vec::new();
        for path in [current, previous].into_iter().filter(|path| path.exists()) {
            match Self::read(&path) {
                Ok(checkpoint) => return Ok((Some(checkpoint), refused.iter().map(ToString::to_string).collect())),
                Err(error) => refused.push(error),
            }
        }
        refused.into_iter().next().map_or(Ok((None, Vec::new())), Err)
    }

    fn read(folder: &Path) -> Result<Self, TrainError> {
        let path = folder.join(MANIFEST);
        let text = fs::read(&path).map_err(|error| TrainError::file(&path, error))?;
        let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| TrainError::file(&path, error))?;
        if manifest.version != VERSION {
            let cause = format!("version: expected {VERSION}, found {}", manifest.version);
            return Err(TrainError::file(&path, cause));
        }
        let mut parts = BTreeMap::new();
        for name in [MODEL, AVERAGE, OPTIMIZER, OCCUPANCY] {
            let Some(part) = manifest.files.iter().find(|part| part.name == name) else { continue };
            let path = folder.join(name);
            let bytes = fs::read(&path).map_err(|error| TrainError::file(&path, error))?;
            if bytes.len() as u64 != part.bytes || crc32fast::hash(&bytes) != part.crc32 {
                let expected = format!("expected {} bytes with checksum {:08x}", part.bytes, part.crc32);
                return Err(TrainError::file(&path, format!("{expected}: the file is damaged")));
            }
            parts.insert(name, bytes);
        }
        if let Some(name) = [MODEL, OPTIMIZER].into_iter().find(|name| !parts.contains_key(name)) {
            return Err(TrainError::file(&path, format!("files: expected an entry for `{name}`")));
        }
        Ok(Self { progress: manifest.progress, averaged: manifest.averaged, parts })
    }

    /// Puts the trained weights into a model of the same config.
    pub(crate) fn restore_model<F: Field>(&self, model: Model<F>) -> Result<Model<F>, TrainError> {
        load(model, &self.parts[MODEL])
    }

    pub(crate) fn restore_average<F: Field>(&self, model: &Model<F>) -> Result<WeightAverage<F>, TrainError> {
        let mean = self.parts.get(AVERAGE).map(|bytes| load(model.clone(), bytes)).transpose()?;
        Ok(WeightAverage { mean, count: self.averaged })
    }

    pub(crate) fn restore_optimizer(&self, optimizer: ModuleOptimizer) -> Result<ModuleOptimizer, TrainError> {
        let record = OptimizerRecord::from_bytes(Bytes::from_bytes_vec(self.parts[OPTIMIZER].clone()))
            .map_err(|error| TrainError::Config(format!("checkpoint: {error}")))?;
        Ok(optimizer.load_record(record))
    }

    /// Puts the occupancy back into a grid of the same config.
    pub(crate) fn restore_occupancy(&self, grid: &mut OccupancyGrid) -> Result<(), TrainError> {
        let Some(bytes) = self.parts.get(OCCUPANCY) else { return Ok(()) };
        let (updated, cells) = bytes.split_first().map_or((false, &[][..]), |(&first, cells)| (first != 0, cells));
        let (density, occupied) = cells.split_at(cells.len() / 5 * 4);
        let density = density.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let (occupied, cells) = (occupied.iter().map(|&b| b != 0).collect(), cells.len() / 5);
        grid.restore(density, occupied, updated).map_err(|expected| {
            TrainError::Config(format!("checkpoint: occupancy.bin: expected {expected} cells, found {cells}"))
        })
    }
}

fn load<F: Field>(model: Model<F>, bytes: &[u8]) -> Result<Model<F>, TrainError> {
    let fault = |error: burn::store::RecordError| {
        TrainError::Config(format!("checkpoint: expected the weights of the field that the config describes: {error}"))
    };
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(fault)?;
    model.try_load_record(record).map_err(fault)
}

fn encode_occupancy(grid: &OccupancyGrid) -> Vec<u8> {
    let (density, occupied, updated) = grid.state();
    let mut bytes = vec![u8::from(updated)];
    bytes.extend(density.iter().flat_map(|d| d.to_le_bytes()));
    bytes.extend(occupied.iter().map(|&occupied| u8::from(occupied)));
    bytes
}

/// Returns the checkpoint, the one before, and the one being written.
fn paths(run: &Path) -> [PathBuf; 3] {
    ["checkpoint", "checkpoint.previous", "checkpoint.writing"].map(|name| run.join(name))
}

fn remove(folder: &Path) -> Result<(), TrainError> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(TrainError::file(folder, error)),
        _ => Ok(()),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    let mut file = fs::File::create(path).map_err(|error| TrainError::file(path, error))?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(|error| TrainError::file(path, error))
}
