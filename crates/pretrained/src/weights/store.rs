use std::path::{Path, PathBuf};

use super::import::recognised;
use super::{KNOWN_WEIGHTS, KnownWeights, WeightsError};
use crate::WeightFile;

/// Where weights are looked for.
#[derive(Debug, Clone)]
pub struct Store {
    /// Files that were named, and what each is.
    files: Vec<(&'static KnownWeights, PathBuf)>,
    /// Folders in the order in which they are searched; imports go to the first.
    folders: Vec<PathBuf>,
}

/// Whether weights are there.
#[derive(Debug, Clone)]
pub struct Status {
    /// The weights.
    pub weights: &'static KnownWeights,
    /// The file that would be used.
    pub path: Option<PathBuf>,
}

impl Store {
    /// Looks at `explicit` (a folder or a weight file, if given), then in the folder `INFONERF_WEIGHTS`, then in
    /// `infonerf/weights` of the user's cache folder.
    ///
    /// # Errors
    /// If `explicit` does not exist or is a file of other weights, or if there is no folder at all.
    pub fn new(explicit: Option<&Path>) -> Result<Self, WeightsError> {
        let (mut files, mut folders) = (Vec::new(), Vec::new());
        match explicit {
            Some(path) if path.is_dir() => folders.push(path.to_owned()),
            Some(path) => {
                let of_file = |cause| WeightsError::File { path: path.to_owned(), cause };
                let file = WeightFile::read(path).map_err(of_file)?;
                files.extend(recognised(&file).map_err(of_file)?.into_iter().map(|weights| (weights, path.to_owned())));
            }
            None => {}
        }
        folders.extend(std::env::var_os("INFONERF_WEIGHTS").filter(|folder| !folder.is_empty()).map(PathBuf::from));
        folders.extend(dirs::cache_dir().map(|cache| cache.join("infonerf").join("weights")));
        if folders.is_empty() { Err(WeightsError::NoFolder) } else { Ok(Self { files, folders }) }
    }

    /// Looks in `folder` alone.
    #[must_use]
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { files: Vec::new(), folders: vec![folder.into()] }
    }

    /// The folders that are searched, in order.
    pub fn folders(&self) -> &[PathBuf] {
        &self.folders
    }

    /// The folder that imports and downloads go to.
    pub(super) fn target(&self) -> &Path {
        &self.folders[0]
    }

    /// The file of `weights`: what an import wrote, or the published file itself.
    pub fn find(&self, weights: &KnownWeights) -> Option<PathBuf> {
        let named = self.files.iter().find(|(known, _)| known.name == weights.name).map(|(_, path)| path.clone());
        let names = [weights.file(), weights.published_file().to_owned()];
        let places = self.folders.iter().flat_map(|folder| names.iter().map(|name| folder.join(name)));
        named.or_else(|| places.into_iter().find(|path| path.is_file()))
    }

    /// Whether each of [`KNOWN_WEIGHTS`] is there.
    pub fn status(&self) -> Vec<Status> {
        KNOWN_WEIGHTS.iter().map(|weights| Status { weights, path: self.find(weights) }).collect()
    }
}
