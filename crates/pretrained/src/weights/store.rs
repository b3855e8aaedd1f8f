use std::path::{Path, PathBuf};

use super::import::recognised;
use super::{KNOWN_WEIGHTS, KnownWeights, WeightsError};
use crate::file::WeightFile;

/// Files and folders in which weights are searched.
#[derive(Debug, Clone)]
pub struct Store {
    files: Vec<(&'static KnownWeights, PathBuf)>,
    /// Folders in order of search; imports go to the first.
    folders: Vec<PathBuf>,
}

impl Store {
    /// Searches `explicit` (a folder or a weight file, if given), then that in the environment variable
    /// `INFONERF_WEIGHTS`, then `infonerf/weights` in the user's cache folder.
    ///
    /// # Errors
    /// If `explicit` does not exist or is a file of other weights, or if there is no folder at all.
    pub fn new(explicit: Option<&Path>) -> Result<Self, WeightsError> {
        let (mut files, mut folders) = (Vec::new(), Vec::new());
        let variable = std::env::var_os("INFONERF_WEIGHTS").filter(|place| !place.is_empty()).map(PathBuf::from);
        // A folder that the variable names is made when weights are imported.
        let is_folder = |path: &Path| path.is_dir() || (explicit != Some(path) && !path.exists());
        for path in explicit.map(Path::to_owned).into_iter().chain(variable) {
            if is_folder(&path) {
                folders.push(path);
                continue;
            }
            let file = WeightFile::read(&path).map_err(WeightsError)?;
            let found = recognised(&file).map_err(|cause| WeightsError::file(&path, cause))?;
            files.extend(found.into_iter().map(|weights| (weights, path.clone())));
        }
        folders.extend(dirs::cache_dir().map(|cache| cache.join("infonerf").join("weights")));
        if folders.is_empty() {
            return Err(WeightsError("no folder to keep weights in: set INFONERF_WEIGHTS to one".to_owned()));
        }
        Ok(Self { files, folders })
    }

    /// Searches `folder` alone.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { files: Vec::new(), folders: vec![folder.into()] }
    }

    /// Folders in order of search.
    pub fn folders(&self) -> &[PathBuf] {
        &self.folders
    }

    /// Finds the file of `weights`: written by an import, or the published file itself.
    pub fn find(&self, weights: &KnownWeights) -> Option<PathBuf> {
        let named = self.files.iter().find(|(known, _)| known.name == weights.name).map(|(_, path)| path.clone());
        let names = [weights.file(), weights.published_file().to_owned()];
        let places = self.folders.iter().flat_map(|folder| names.iter().map(|name| folder.join(name)));
        named.or_else(|| places.into_iter().find(|path| path.is_file()))
    }

    /// Finds the file of each of [`KNOWN_WEIGHTS`], if present.
    pub fn status(&self) -> impl Iterator<Item = (&'static KnownWeights, Option<PathBuf>)> {
        KNOWN_WEIGHTS.iter().map(|weights| (weights, self.find(weights)))
    }
}
