//! The pictures that the runs left, side by side.

use std::{
    collections::BTreeSet,
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use image::{ImageFormat, imageops::FilterType};

use crate::{Run, run::VIEWER_PAGE};

/// Pictures wider or higher than this are scaled down before they go into the page.
const LARGEST_SIDE: u32 = 512;

/// The pictures of one scene.
pub(crate) struct Gallery<'a> {
    /// The runs shown, one a variant.
    pub(crate) runs: Vec<&'a Run>,
    pub(crate) views: Vec<View>,
    /// The page of each run that shows its scene in 3D, relative to the report, where there is one.
    pub(crate) viewers: Vec<Option<String>>,
}

/// One test view: the truth, and what each run made of it.
pub(crate) struct View {
    /// Stem of the files' names.
    pub(crate) name: String,
    pub(crate) truth: Option<Picture>,
    /// As many as the gallery has runs.
    pub(crate) shots: Vec<Shots>,
}

/// The pictures of one view that a run left.
pub(crate) struct Shots {
    pub(crate) render: Option<Picture>,
    pub(crate) depth: Option<Picture>,
    pub(crate) error: Option<Picture>,
}

/// A kind of picture: its name, and where [`Shots`] keep it.
pub(crate) type Kind = (&'static str, fn(&Shots) -> &Option<Picture>);

/// The kinds, in the order of the rows.
pub(crate) const KINDS: [Kind; 3] =
    [("render", |shots| &shots.render), ("depth", |shots| &shots.depth), ("error", |shots| &shots.error)];

/// A PNG file.
pub(crate) struct Picture {
    /// Relative to the report, with forward slashes.
    pub(crate) path: String,
    /// Its content, at most [`LARGEST_SIDE`] pixels wide and high.
    pub(crate) png: Vec<u8>,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Which views of a gallery are read.
pub(crate) enum Choice {
    /// So many, spread evenly over those that every run has, or over all if there is none.
    Spread(usize),
    /// The one of this name.
    Named(String),
}

impl<'a> Gallery<'a> {
    /// Reads the views of `choice` that there are. What is missing or cannot be read is left out and named in `missing`.
    pub(crate) fn collect(root: &Path, runs: Vec<&'a Run>, choice: &Choice, missing: &mut Vec<String>) -> Self {
        let names: Vec<BTreeSet<String>> =
            runs.iter().map(|run| picture_names(&root.join(&run.directory).join("test"))).collect();
        for (run, names) in runs.iter().zip(&names) {
            if names.is_empty() {
                missing.push(format!("{}: no pictures", slashed(&run.directory.join("test"))));
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
            views.push(View { name, truth, shots });
        }
        let viewer = |run: &&Run| {
            let path = run.directory.join(VIEWER_PAGE);
            root.join(&path).is_file().then(|| slashed(&path))
        };
        let viewers = runs.iter().map(viewer).collect();
        Self { runs, views, viewers }
    }
}

/// A picture of a run, or one line that says why there is none.
fn read(root: &Path, run: &Run, folder: &str, name: &str) -> Result<Picture, String> {
    let path = run.directory.join(folder).join(format!("{name}.png"));
    let described = |error: &dyn std::fmt::Display| format!("{}: {error}", slashed(&path));
    let bytes = fs::read(root.join(&path)).map_err(|error| described(&error))?;
    let decoded = image::load_from_memory_with_format(&bytes, ImageFormat::Png).map_err(|error| described(&error))?;
    let (png, decoded) = if decoded.width().max(decoded.height()) > LARGEST_SIDE {
        let small = decoded.resize(LARGEST_SIDE, LARGEST_SIDE, FilterType::Triangle);
        let mut png = Cursor::new(Vec::new());
        small.write_to(&mut png, ImageFormat::Png).map_err(|error| described(&error))?;
        (png.into_inner(), small)
    } else {
        (bytes, decoded)
    };
    Ok(Picture { path: slashed(&path), png, width: decoded.width(), height: decoded.height() })
}

/// Stems of the PNG files in a folder; none if it cannot be read.
pub fn picture_names(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let stem = |path: PathBuf| {
        path.extension().is_some_and(|e| e == "png").then(|| path.file_stem()?.to_str().map(str::to_owned))
    };
    entries.filter_map(|entry| stem(entry.path()).flatten()).collect()
}

/// `count` of the names, from the middles of as many equal parts.
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
