//! Comparison figure as in papers: a row per scene with one test view's truth, then render and depth of every variant.

use std::path::Path;

use image::{RgbImage, imageops};
use indexmap::IndexSet;

use crate::{
    ReportError, ReportInput, Run,
    chart::{LABEL, text_width, write_text},
    gallery::{Choice, Gallery, GalleryImage, GalleryView},
    pictured::{pictured, runs_of},
    table::distinct,
};

/// Height of an image, in pixels.
const HEIGHT: u32 = 240;
/// Pixels between images.
const GAP: u32 = 8;
/// Height of the line of labels, in pixels.
const HEADING: u32 = 24;

/// Heading of the first column.
const TRUTH: &str = "truth";

/// Row of one scene.
pub(crate) struct PanelRow<'a> {
    pub(crate) scene: &'a str,
    /// Labels of the view's shots.
    pub(crate) labels: &'a [String],
    pub(crate) view: &'a GalleryView,
}

/// Draws the figure of the runs in `input`, whose folders lie below `root`: the lowest seed of each variant, and the
/// test view of each scene with the id `view` (file `test/NNN.png` of a run) or else one from the middle. Missing
/// images stay white.
///
/// # Errors
/// [`ReportError::NoPictures`] if no run has an image of that view, [`ReportError::Chart`] if the labels cannot be drawn.
pub fn panel(input: &ReportInput, root: &Path, view: Option<usize>) -> Result<RgbImage, ReportError> {
    let runs: Vec<&Run> = input.runs.iter().collect();
    let choice = view.map_or(Choice::Spread(1), |view| Choice::Named(format!("{view:03}")));
    let variants = pictured(&runs);
    let scenes: Vec<(String, Vec<String>, Gallery)> = distinct(&runs, |record| record.scene.clone())
        .into_iter()
        .map(|scene| {
            let (labels, runs) = runs_of(&runs, &variants, &scene);
            let gallery = Gallery::collect(root, runs, &choice, &mut Vec::new());
            (scene, labels, gallery)
        })
        .collect();
    let rows = scenes
        .iter()
        .flat_map(|(scene, labels, gallery)| gallery.views.first().map(|view| PanelRow { scene, labels, view }));
    compose(&rows.collect::<Vec<_>>())?.ok_or_else(|| ReportError::NoPictures { path: root.into(), view })
}

/// Draws all rows as one image; `None` without any.
pub(crate) fn compose(rows: &[PanelRow]) -> Result<Option<RgbImage>, ReportError> {
    let labels: IndexSet<&String> = rows.iter().flat_map(|row| row.labels).collect();
    let shot = |row: &PanelRow<'_>, label: &String| row.labels.iter().position(|own| own == label);
    // Columns: a heading, and the image of each row.
    let mut columns: Vec<(String, Vec<Option<RgbImage>>)> =
        vec![(TRUTH.into(), rows.iter().map(|row| row.view.truth.as_ref().and_then(decoded)).collect())];
    for label in labels {
        let shots = || rows.iter().map(|row| Some(&row.view.shots[shot(row, label)?]));
        columns.push((label.clone(), shots().map(|shots| decoded(shots?.render.as_ref()?)).collect()));
        columns.push((format!("{label}, depth"), shots().map(|shots| decoded(shots?.depth.as_ref()?)).collect()));
    }
    columns.retain(|(_, pictures)| pictures.iter().any(Option::is_some));
    if columns.is_empty() {
        return Ok(None);
    }
    let width_of = |(heading, pictures): &(String, Vec<Option<RgbImage>>)| {
        let label =
            |row: &PanelRow<'_>| if heading == TRUTH { format!("{}, {TRUTH}", row.scene) } else { heading.clone() };
        let labels = rows.iter().map(|row| text_width(&label(row), LABEL) as u32);
        labels.chain(pictures.iter().flatten().map(RgbImage::width)).max().unwrap_or(0)
    };
    let widths = columns.iter().map(width_of);
    let width = widths.clone().map(|width| width + GAP).sum::<u32>() + GAP;
    let step = HEADING + HEIGHT;
    let mut sheet = RgbImage::from_pixel(width, step * rows.len() as u32 + GAP, image::Rgb([255; 3]));
    let (mut texts, mut left) = (Vec::new(), GAP);
    for ((heading, pictures), width) in columns.iter().zip(widths) {
        for (index, (picture, row)) in pictures.iter().zip(rows).enumerate() {
            let top = step * index as u32;
            // Each scene names its truth, the first also the variants.
            let text = match (heading.as_str(), index) {
                (TRUTH, _) => format!("{}, {TRUTH}", row.scene),
                (heading, 0) => heading.to_owned(),
                _ => String::new(),
            };
            texts.push((text, (left as i32, top as i32 + 6)));
            if let Some(picture) = picture {
                imageops::replace(&mut sheet, picture, left.into(), (top + HEADING).into());
            }
        }
        left += width + GAP;
    }
    write_text(&mut sheet, &texts)?;
    Ok(Some(sheet))
}

/// Decodes an image and scales it to the height of the row.
fn decoded(picture: &GalleryImage) -> Option<RgbImage> {
    let picture = image::load_from_memory(&picture.png).ok()?.to_rgb8();
    let width = (picture.width() * HEIGHT).div_ceil(picture.height().max(1)).max(1);
    Some(imageops::resize(&picture, width, HEIGHT, imageops::FilterType::CatmullRom))
}
