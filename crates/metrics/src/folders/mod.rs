//! Comparison of images that another program rendered: folders of PNG, JPEG, WebP, TIFF and BMP.

mod read;

use std::path::{Path, PathBuf};

use crate::error::MetricError;
use crate::evaluate::Evaluator;
use crate::measured::Measured;
use crate::metric::Metric;
use crate::networks::Networks;
use crate::protocol::Protocol;
use crate::view::Pair;

/// Folders to compare. A render, its truth and its mask have the same name but for the extension.
#[derive(Debug, Clone, Copy)]
pub struct Folders<'a> {
    /// Folder of renders.
    pub renders: &'a Path,
    /// Folder of true images.
    pub truth: &'a Path,
    /// Folder of masks for the masked metrics: PNG, TIFF or BMP, black outside.
    pub masks: Option<&'a Path>,
    /// Whether true images without a render are left out; otherwise they are an error.
    pub partial: bool,
}

/// Result of [`compare_folders`].
#[derive(Debug, Clone, PartialEq)]
pub struct ComparedFolders {
    /// Compared images, by name.
    pub views: Vec<ComparedView>,
    /// Values of these views in the same order, and of the set.
    pub measured: Measured,
}

/// Render with its truth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ComparedView {
    /// Name without extension.
    pub name: String,
    /// File of the render.
    pub render: PathBuf,
    /// File of the true image.
    pub truth: PathBuf,
    /// File of the mask.
    pub mask: Option<PathBuf>,
}

/// Measures every render with `metrics`, one pair in memory at a time. `progress` receives the numbers of measured and all views.
///
/// A metric without a value (such as FID of one image) has a note; [`Measured::require`] makes it an error.
///
/// # Errors
/// If a file cannot be read, has no partner, or does not fit its partner; names the file.
pub fn compare_folders(
    folders: Folders<'_>,
    metrics: &[&'static Metric],
    networks: &Networks,
    protocol: &Protocol,
    mut progress: impl FnMut(usize, usize),
) -> Result<ComparedFolders, MetricError> {
    let views = partners(folders)?;
    let mut evaluator = Evaluator::new(metrics, networks, protocol);
    for (index, view) in views.iter().enumerate() {
        progress(index, views.len());
        let render = read::picture(&view.render, protocol.background)?;
        let truth = read::picture(&view.truth, protocol.background)?;
        let mask = view.mask.as_deref().map(read::mask).transpose()?;
        let pair = Pair { mask: mask.as_ref(), ..Pair::new(&render, &truth) };
        evaluator.add(pair).map_err(|error| MetricError::file(&view.render, error))?;
    }
    progress(views.len(), views.len());
    Ok(ComparedFolders { measured: evaluator.finish(), views })
}

fn partners(folders: Folders<'_>) -> Result<Vec<ComparedView>, MetricError> {
    let renders = read::pictures(folders.renders)?;
    let truths = read::pictures(folders.truth)?;
    let masks = folders.masks.map(|folder| read::pictures(folder).map(|masks| (folder, masks))).transpose()?;
    let missing = |what, path: &Path, folder: &Path, name: &str| {
        let (path, folder) = (path.display(), folder.display());
        MetricError::other(format!("{path} has no {what} in {folder}: expected an image called `{name}`"))
    };
    if let Some((name, path)) = truths.iter().find(|(name, _)| !folders.partial && !renders.contains_key(*name)) {
        return Err(missing("render", path, folders.renders, name));
    }
    let view = |(name, render): (String, PathBuf)| {
        let truth = truths.get(&name).ok_or_else(|| missing("truth", &render, folders.truth, &name))?;
        let mask = masks
            .as_ref()
            .map(|(folder, masks)| masks.get(&name).ok_or_else(|| missing("mask", &render, folder, &name)).cloned());
        let (truth, mask) = (truth.clone(), mask.transpose()?);
        Ok(ComparedView { name, render, truth, mask })
    };
    renders.into_iter().map(view).collect()
}
