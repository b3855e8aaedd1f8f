//! Images of the runs, next to each other.

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use image::imageops::FilterType;

use crate::files::png_bytes;
use crate::quantity::Quantity;
use crate::record::{Record, distinct};
use crate::table::{VariantGroup, groups};

/// Maximum number of variants whose images and curves are shown.
const MAX_PICTURED: usize = 12;
/// Maximum width and height of an image in the page; larger ones are scaled down.
const MAX_SIDE: u32 = 512;
/// Kinds of images of a view, in the order of the rows, with the folder of each.
const KINDS: [(&str, &str); 3] = [("render", "test"), ("depth", "depth"), ("error", "error")];

pub(crate) struct SceneGallery<'a> {
    pub(crate) scene: String,
    /// Runs with the lowest seed of each variant that has runs of the scene: label, as in the tables, and record.
    pub(crate) runs: Vec<(String, &'a Record)>,
    pub(crate) views: Vec<GalleryView>,
}

pub(crate) struct GalleryView {
    /// Stem of the names of the view's files.
    pub(crate) name: String,
    pub(crate) truth: Option<GalleryImage>,
    /// Render, depth and error of each of the gallery's runs.
    pub(crate) shots: Vec<[Option<GalleryImage>; 3]>,
}

pub(crate) struct GalleryImage {
    /// Path relative to the report, with forward slashes.
    pub(crate) path: String,
    /// Contents of the file, at most [`MAX_SIDE`] pixels wide and high.
    pub(crate) png: Vec<u8>,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Returns the variants whose images and curves are shown: all, or those with the highest PSNR, in their order; and the number
/// of the others.
pub(crate) fn shown_variants<'a>(records: &[&'a Record]) -> (Vec<VariantGroup<'a>>, usize) {
    let scenes = distinct(records, |record| record.scene.clone());
    let groups = groups(records.iter().copied());
    let psnr = groups.iter().map(|group| group.mean(Quantity::PSNR, &scenes).unwrap_or(f64::NEG_INFINITY));
    let mut ranked: Vec<(f64, usize)> = psnr.zip(0..).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best: HashSet<usize> = ranked.into_iter().take(MAX_PICTURED).map(|(_, index)| index).collect();
    let left_out = groups.len() - best.len();
    let shown = groups.into_iter().enumerate().filter(|(index, _)| best.contains(index)).map(|(_, group)| group);
    (shown.collect(), left_out)
}

impl<'a> SceneGallery<'a> {
    /// Reads images of the lowest seed of each variant: of the views that `choose` picks from those that every run of `scene`
    /// has, or from all if no view is shared. Images that are missing or cannot be read are left out and named in `missing`.
    pub(crate) fn collect(
        variants: &[VariantGroup<'a>],
        root: &Path,
        scene: String,
        choose: impl Fn(Vec<String>) -> Vec<String>,
        missing: &mut Vec<String>,
    ) -> Self {
        let run = |variant: &VariantGroup<'a>| Some((variant.label.clone(), variant.first(&scene)?));
        let runs: Vec<(String, &Record)> = variants.iter().filter_map(run).collect();
        let mut names = Vec::new();
        for (_, record) in &runs {
            let folder = record.directory().join("test");
            let own = picture_names(&root.join(&folder));
            missing.extend(own.is_empty().then(|| format!("{}: no images", with_forward_slashes(&folder))));
            names.push(own);
        }
        let shared = names.iter().cloned().reduce(|a, b| &a & &b).unwrap_or_default();
        let all = if shared.is_empty() { names.into_iter().flatten().collect() } else { shared };
        let mut views = Vec::new();
        for name in choose(all.into_iter().collect()) {
            let truth = runs.iter().find_map(|(_, record)| read(root, record, "truth", &name).ok());
            missing.extend(truth.is_none().then(|| format!("no truth for view {name} of {scene}")));
            let mut shot = |record: &Record| {
                KINDS.map(|(_, folder)| read(root, record, folder, &name).map_err(|note| missing.push(note)).ok())
            };
            let shots = runs.iter().map(|(_, record)| shot(record)).collect();
            views.push(GalleryView { name, truth, shots });
        }
        Self { scene, runs, views }
    }

    pub(crate) fn shows_training_views(&self) -> bool {
        self.runs.iter().all(|(_, record)| record.test_views.protocol == "training")
    }
}

impl GalleryView {
    /// Returns whether any run has an image of the kind with this index in [`KINDS`].
    pub(crate) fn has(&self, kind: usize) -> bool {
        self.shots.iter().any(|shots| shots[kind].is_some())
    }

    /// Returns the kinds that any run has, each with the image of every run.
    pub(crate) fn rows(&self) -> Vec<(&'static str, Vec<Option<&GalleryImage>>)> {
        let images = |kind: usize| self.shots.iter().map(move |shots| shots[kind].as_ref()).collect();
        let kinds = KINDS.iter().enumerate().filter(|(kind, _)| self.has(*kind));
        kinds.map(|(kind, (name, _))| (*name, images(kind))).collect()
    }
}

impl GalleryImage {
    pub(crate) fn data(&self) -> String {
        format!("data:image/png;base64,{}", BASE64_STANDARD.encode(&self.png))
    }
}

/// Reads an image of a run, or returns the reason, in one line, why it cannot be read.
fn read(root: &Path, record: &Record, folder: &str, name: &str) -> Result<GalleryImage, String> {
    let path = record.directory().join(folder).join(format!("{name}.png"));
    let described = |error: &dyn std::fmt::Display| format!("{}: {error}", with_forward_slashes(&path));
    let mut png = fs::read(root.join(&path)).map_err(|error| described(&error))?;
    let mut shown = image::load_from_memory(&png).map_err(|error| described(&error))?;
    if shown.width().max(shown.height()) > MAX_SIDE {
        shown = shown.resize(MAX_SIDE, MAX_SIDE, FilterType::Triangle);
        png = png_bytes(&shown).map_err(|error| described(&error))?;
    }
    Ok(GalleryImage { path: with_forward_slashes(&path), png, width: shown.width(), height: shown.height() })
}

/// Lists the stems of the PNG files in a folder; empty if it cannot be read.
pub fn picture_names(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let pictures = entries.filter(|path| path.extension().is_some_and(|extension| extension == "png"));
    pictures.filter_map(|path| path.file_stem()?.to_str().map(str::to_owned)).collect()
}

/// Chooses `count` of the names: the middle one of each of `count` equal parts.
pub(crate) fn evenly_spaced(names: Vec<String>, count: usize) -> Vec<String> {
    if names.len() <= count {
        return names;
    }
    (0..count).map(|i| names[(2 * i + 1) * names.len() / (2 * count)].clone()).collect()
}

pub(crate) fn with_forward_slashes(path: &Path) -> String {
    path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_spread_evenly() {
        let names: Vec<String> = (0..10).map(|i| i.to_string()).collect();
        assert_eq!(evenly_spaced(names.clone(), 2), ["2", "7"]);
        assert_eq!(evenly_spaced(names, 20).len(), 10);
        assert!(evenly_spaced(vec!["a".into()], 0).is_empty());
    }
}
