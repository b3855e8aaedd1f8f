//! Images of the runs, next to each other.

use std::{
    collections::BTreeSet,
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use image::{ImageFormat, imageops::FilterType};

use crate::{Run, run::VIEWER_PAGE};

/// Maximum width and height of an image in the page; larger ones are scaled down.
const MAX_SIDE: u32 = 512;

/// Images of one scene.
pub(crate) struct Gallery<'a> {
    /// Runs shown, one of each variant.
    pub(crate) runs: Vec<&'a Run>,
    pub(crate) views: Vec<GalleryView>,
    /// Page of each run that shows its scene in 3D, relative to the report.
    pub(crate) viewers: Vec<Option<String>>,
}

/// Test view: the truth, and the images of each run.
pub(crate) struct GalleryView {
    /// Stem of the files' names.
    pub(crate) name: String,
    pub(crate) truth: Option<GalleryImage>,
    /// Images of each of the gallery's runs.
    pub(crate) shots: Vec<Shots>,
}

/// Images of one view from one run.
pub(crate) struct Shots {
    pub(crate) render: Option<GalleryImage>,
    pub(crate) depth: Option<GalleryImage>,
    pub(crate) error: Option<GalleryImage>,
}

/// Kind of image: its name, and its field of [`Shots`].
pub(crate) type ImageKind = (&'static str, fn(&Shots) -> &Option<GalleryImage>);

/// Kinds in the order of the rows.
pub(crate) const KINDS: [ImageKind; 3] =
    [("render", |shots| &shots.render), ("depth", |shots| &shots.depth), ("error", |shots| &shots.error)];

/// PNG file.
pub(crate) struct GalleryImage {
    /// Path relative to the report, with forward slashes.
    pub(crate) path: String,
    /// Contents of the file, at most [`MAX_SIDE`] pixels wide and high.
    pub(crate) png: Vec<u8>,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Choice of the views of a gallery.
pub(crate) enum Choice {
    /// This number of views, spread evenly over those that every run has, or over all if there is none.
    Spread(usize),
    /// View of this name.
    Named(String),
}

impl<'a> Gallery<'a> {
    /// Reads the views of `choice`. Images that are missing or cannot be read are left out and named in `missing`.
    pub(crate) fn collect(root: &Path, runs: Vec<&'a Run>, choice: &Choice, missing: &mut Vec<String>) -> Self {
        let names: Vec<BTreeSet<String>> =
            runs.iter().map(|run| picture_names(&root.join(&run.directory).join("test"))).collect();
        for (run, names) in runs.iter().zip(&names) {
            if names.is_empty() {
                missing.push(format!("{}: no images", slashed(&run.directory.join("test"))));
            }
        }
        let shared = names.iter().cloned().reduce(|a, b| &a & &b).unwrap_or_default();
        let all = if shared.is_empty() { names.into_iter().flatten().collect() } else { shared };
        let all: Vec<String> = all.into_iter().collect();
        let chosen = match choice {
            Choice::Spread(count) => spread(all, *count),
            Choice::Named(wanted) => all.into_iter().filter(|name| name == wanted).collect(),
        };
        let mut views = Vec::new();
        for name in chosen {
            let truth = runs.iter().find_map(|run| read(root, run, "truth", &name).ok());
            if truth.is_none() {
                missing
                    .push(format!("no truth for view {name} of {}", runs.first().map_or("", |run| &run.record.scene)));
            }
            let mut wanted =
                |run: &Run, folder: &str| read(root, run, folder, &name).map_err(|note| missing.push(note)).ok();
            let shots = runs.iter().map(|run| Shots {
                render: wanted(run, "test"),
                depth: wanted(run, "depth"),
                error: wanted(run, "error"),
            });
            let shots = shots.collect();
            views.push(GalleryView { name, truth, shots });
        }
        let viewer = |run: &&Run| {
            let path = run.directory.join(VIEWER_PAGE);
            root.join(&path).is_file().then(|| slashed(&path))
        };
        let viewers = runs.iter().map(viewer).collect();
        Self { runs, views, viewers }
    }
}

/// Reads an image of a run, or returns the reason, in one line, why it cannot be read.
fn read(root: &Path, run: &Run, folder: &str, name: &str) -> Result<GalleryImage, String> {
    let path = run.directory.join(folder).join(format!("{name}.png"));
    let described = |error: &dyn std::fmt::Display| format!("{}: {error}", slashed(&path));
    let bytes = fs::read(root.join(&path)).map_err(|error| described(&error))?;
    let decoded = image::load_from_memory_with_format(&bytes, ImageFormat::Png).map_err(|error| described(&error))?;
    let (png, decoded) = if decoded.width().max(decoded.height()) > MAX_SIDE {
        let small = decoded.resize(MAX_SIDE, MAX_SIDE, FilterType::Triangle);
        let mut png = Cursor::new(Vec::new());
        small.write_to(&mut png, ImageFormat::Png).map_err(|error| described(&error))?;
        (png.into_inner(), small)
    } else {
        (bytes, decoded)
    };
    Ok(GalleryImage { path: slashed(&path), png, width: decoded.width(), height: decoded.height() })
}

/// Lists the stems of the PNG files in a folder; empty if it cannot be read.
pub fn picture_names(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let stem = |path: PathBuf| {
        path.extension().is_some_and(|e| e == "png").then(|| path.file_stem()?.to_str().map(str::to_owned))
    };
    entries.filter_map(|entry| stem(entry.path()).flatten()).collect()
}

/// Chooses `count` of the names, from the middles of as many equal parts.
fn spread(names: Vec<String>, count: usize) -> Vec<String> {
    if names.len() <= count {
        return names;
    }
    (0..count).filter_map(|i| names.get((2 * i + 1) * names.len() / (2 * count)).cloned()).collect()
}

fn slashed(path: &Path) -> String {
    path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_spread_evenly() {
        let names: Vec<String> = (0..10).map(|i| i.to_string()).collect();
        assert_eq!(spread(names.clone(), 2), ["2", "7"]);
        assert_eq!(spread(names, 20).len(), 10);
        assert!(spread(vec!["a".into()], 0).is_empty());
    }
}
