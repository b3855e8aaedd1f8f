//! Comparison figure as in papers: a row per scene with one test view's truth, then render and depth of every variant.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use image::{RgbImage, imageops};
use indexmap::IndexSet;

use crate::chart::{LABEL, text_width, write_text};
use crate::error::ReportError;
use crate::gallery::{GalleryImage, GalleryView, SceneGallery, evenly_spaced, shown_variants};
use crate::record::{Record, distinct};

const HEIGHT: u32 = 240;
const GAP: u32 = 8;
const HEADING: u32 = 24;

const TRUTH: &str = "truth";

/// Comparison figure of some runs.
#[derive(Debug)]
pub struct Panel {
    /// The figure.
    pub picture: RgbImage,
    /// `scene/variant` of each run that has no render of the view.
    pub missing: Vec<String>,
    /// Number of variants that are left out: all but the twelve with the highest PSNR.
    pub left_out: usize,
}

/// Draws the figure of `records`, whose folders lie below `root`: the lowest seed of each variant, and the test view of
/// each scene with the id `view` (file `test/NNN.png` of a run) or else one from the middle. Missing images stay white.
///
/// # Errors
/// If no run has an image of that view, or the labels cannot be drawn.
pub fn panel(records: &[Record], root: &Path, view: Option<usize>) -> Result<Panel, ReportError> {
    let records: Vec<&Record> = records.iter().collect();
    let known = RefCell::new(BTreeSet::new());
    let choose = |all: Vec<String>| {
        known.borrow_mut().extend(all.iter().cloned());
        view.map_or_else(|| evenly_spaced(all, 1), |view| vec![format!("{view:03}")])
    };
    let (variants, left_out) = shown_variants(&records);
    let scenes = distinct(&records, |record| record.scene.clone()).into_iter();
    let gallery = |scene| SceneGallery::collect(&variants, root, scene, choose, &mut Vec::new());
    let galleries: Vec<SceneGallery> = scenes.map(gallery).collect();
    let mut missing = Vec::new();
    for gallery in &galleries {
        let is_missing = |run: usize| gallery.views.iter().all(|view| view.shots[run][0].is_none());
        let variants = gallery.runs.iter().enumerate().filter(|(run, _)| is_missing(*run));
        missing.extend(variants.map(|(_, (_, record))| format!("{}/{}", gallery.scene, record.variant)));
    }
    let picture = compose(&galleries.iter().collect::<Vec<_>>())?;
    picture.map(|picture| Panel { picture, missing, left_out }).ok_or_else(|| {
        let known = Vec::from_iter(known.take()).join(", ");
        let wanted =
            view.map_or("any test view".to_owned(), |view| format!("test view {view}; there are those of {known}"));
        ReportError(format!("{}: no run has an image of {wanted}", root.display()))
    })
}

/// Draws the first view of each scene as a row; `None` if there are no images.
pub(crate) fn compose(scenes: &[&SceneGallery]) -> Result<Option<RgbImage>, ReportError> {
    let rows: Vec<_> = scenes.iter().filter_map(|scene| Some((scene, scene.views.first()?))).collect();
    let labels: IndexSet<_> = rows.iter().flat_map(|(scene, _)| scene.runs.iter().map(|(label, _)| label)).collect();
    // Each column has a heading, and an image for each row.
    let truths = rows.iter().map(|(_, view)| view.truth.as_ref().and_then(decoded)).collect();
    let mut columns: Vec<(String, Vec<Option<RgbImage>>)> = vec![(TRUTH.into(), truths)];
    for label in labels {
        for (kind, heading) in [label.clone(), format!("{label}, depth")].into_iter().enumerate() {
            let image = |(scene, view): &(&&SceneGallery, &GalleryView)| {
                let run = scene.runs.iter().position(|(own, _)| own == label)?;
                view.shots[run][kind].as_ref().and_then(decoded)
            };
            columns.push((heading, rows.iter().map(image).collect()));
        }
    }
    columns.retain(|(_, images)| images.iter().any(Option::is_some));
    if columns.is_empty() {
        return Ok(None);
    }
    // Every row has the name of its scene above the truth. The variants are named in the first row only.
    let text = |heading: &str, row: usize| match (heading, row) {
        (TRUTH, _) => format!("{}, {TRUTH}", rows[row].0.scene),
        (heading, 0) => heading.to_owned(),
        _ => String::new(),
    };
    let width_of = |(heading, images): &(String, Vec<Option<RgbImage>>)| {
        let texts = (0..rows.len()).map(|row| text_width(&text(heading, row), LABEL) as u32);
        texts.chain(images.iter().flatten().map(RgbImage::width)).max().unwrap_or(0)
    };
    let widths = columns.iter().map(width_of);
    let width = widths.clone().map(|width| width + GAP).sum::<u32>() + GAP;
    let step = HEADING + HEIGHT;
    let mut sheet = RgbImage::from_pixel(width, step * rows.len() as u32 + GAP, image::Rgb([255; 3]));
    let (mut texts, mut left) = (Vec::new(), GAP);
    for ((heading, images), width) in columns.iter().zip(widths) {
        for (row, image) in images.iter().enumerate() {
            let top = step * row as u32;
            texts.push((text(heading, row), (left as i32, top as i32 + 6)));
            if let Some(image) = image {
                imageops::replace(&mut sheet, image, left.into(), (top + HEADING).into());
            }
        }
        left += width + GAP;
    }
    write_text(&mut sheet, &texts)?;
    Ok(Some(sheet))
}

fn decoded(picture: &GalleryImage) -> Option<RgbImage> {
    let picture = image::load_from_memory(&picture.png).ok()?.to_rgb8();
    let width = (picture.width() * HEIGHT).div_ceil(picture.height().max(1)).max(1);
    Some(imageops::resize(&picture, width, HEIGHT, imageops::FilterType::CatmullRom))
}
