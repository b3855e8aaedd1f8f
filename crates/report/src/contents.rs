use std::{collections::BTreeMap, io::Cursor, path::Path};

use image::ImageFormat;
use indexmap::IndexMap;

use crate::{
    Events, Figure, Quantity, ReportError, ReportInput, Run, Table, TestedClaim,
    chart::standalone,
    figures::{comparison_figures, curve_figures},
    files::write_atomically,
    gallery::{Choice, Gallery, GalleryView},
    overview_table,
    panel::{PanelRow, compose},
    pictured::{Labelled, MAX_PICTURED, pictured, runs_of},
    protocol_lines, scene_table,
    table::{distinct, groups, measured},
};

/// Maximum number of images on a page.
const MAX_IMAGES: usize = 400;
/// Maximum number of scenes, and of variants, in the figure of all scenes.
const MAX_IN_PANEL: usize = 8;
/// File of the figure of all scenes.
pub(crate) const PANEL: &str = "figure.png";
/// Maximum number of runs that a line names.
const MAX_NAMED: usize = 16;

/// Everything that a report shows, in its order, whatever the format.
pub(crate) struct ReportContents<'a> {
    pub(crate) input: &'a ReportInput,
    /// Runs that are shown.
    pub(crate) runs: Vec<&'a Run>,
    pub(crate) protocol: Vec<String>,
    pub(crate) warnings: Vec<String>,
    /// Means over scenes, of quality and of cost.
    pub(crate) overviews: [Table; 2],
    /// The paper's figures next to ours.
    pub(crate) published: Option<Table>,
    pub(crate) claims: Vec<TestedClaim>,
    pub(crate) figures: Vec<Figure>,
    /// Table of scenes for each quantity that was measured; empty for a single scene.
    pub(crate) tables: Vec<Table>,
    pub(crate) scenes: Vec<SceneContents<'a>>,
    /// PNG of all scenes; `None` for too many scenes or variants.
    pub(crate) panel: Option<Vec<u8>>,
    /// Each note with the runs that have it.
    pub(crate) notes: Vec<(String, String)>,
    pub(crate) missing: Vec<String>,
}

/// Images and curves of one scene.
pub(crate) struct SceneContents<'a> {
    pub(crate) name: String,
    /// Labels of the gallery's runs, as in the tables.
    pub(crate) labels: Vec<String>,
    pub(crate) gallery: Gallery<'a>,
    pub(crate) figures: Vec<Figure>,
}

impl<'a> ReportContents<'a> {
    pub(crate) fn gather(input: &'a ReportInput, root: &Path) -> Result<Self, ReportError> {
        let runs = input.shown_runs();
        let mut missing = Vec::new();
        let names = distinct(&runs, |record| record.scene.clone());
        let several = names.len() > 1;
        let tables = Quantity::all().into_iter().filter(|quantity| several && measured(&runs, *quantity));
        // The protocol stands once, above all.
        let bare = |table: Table, title: String| Table { title, protocol: Vec::new(), ..table };
        let pictured = pictured(&runs);
        if pictured.len() < groups(&runs).len() {
            missing.push(format!("images and curves of all but the {MAX_PICTURED} variants with the highest PSNR"));
        }
        // A view has a truth, and a render, its depth and its error for each variant.
        let of_a_view = 3 * pictured.len() + 1;
        let views = (MAX_IMAGES / (of_a_view * names.len().max(1))).clamp(1, input.views.max(1)).min(input.views);
        let mut left = MAX_IMAGES / of_a_view;
        let mut scenes = Vec::new();
        for name in names {
            let views = views.min(left);
            if views < input.views {
                missing.push(format!("{name}: images of {} of {} test views", input.views - views, input.views));
            }
            left -= views;
            scenes.push(scene(&runs, &pictured, root, name, views, &mut missing)?);
        }
        Ok(Self {
            input,
            protocol: protocol_lines(&runs),
            warnings: warnings(input, &runs),
            overviews: [("Quality", Quantity::quality()), ("Cost", Quantity::cost())].map(|(name, quantities)| {
                let table = overview_table(&runs, &quantities);
                let title = format!("{name}, {}", table.title);
                bare(table, title)
            }),
            published: input.published.as_ref().and_then(|published| published.table(&runs)),
            claims: input.tested_claims(),
            figures: comparison_figures(&runs)?.into_iter().chain(input.figures.iter().cloned()).collect(),
            tables: tables.map(|quantity| bare(scene_table(&runs, quantity), quantity.heading())).collect(),
            panel: panel(&scenes)?,
            scenes,
            notes: notes(&runs),
            missing,
            runs,
        })
    }

    /// Writes `plots/*.svg` and `figure.png` into `root`.
    pub(crate) fn write_plots(&self, root: &Path) -> Result<(), ReportError> {
        if let Some(png) = &self.panel {
            write_atomically(&root.join(PANEL), png)?;
        }
        for figure in self.all_figures() {
            write_atomically(&root.join(plot_path(figure)), standalone(&figure.svg).as_bytes())?;
        }
        Ok(())
    }

    fn all_figures(&self) -> impl Iterator<Item = &Figure> {
        self.figures.iter().chain(self.scenes.iter().flat_map(|scene| &scene.figures))
    }
}

/// Draws the first view of each scene as a PNG; `None` for too many scenes or variants.
fn panel<'a>(scenes: &'a [SceneContents<'a>]) -> Result<Option<Vec<u8>>, ReportError> {
    if scenes.iter().map(|scene| scene.labels.len()).chain([scenes.len()]).any(|count| count > MAX_IN_PANEL) {
        return Ok(None);
    }
    let viewed = scenes.iter().filter_map(|scene| Some((scene, scene.gallery.views.first()?)));
    let row = |(scene, view): (&'a SceneContents<'a>, &'a GalleryView)| PanelRow {
        scene: &scene.name,
        labels: &scene.labels,
        view,
    };
    let rows: Vec<PanelRow> = viewed.map(row).collect();
    let Some(picture) = compose(&rows)? else { return Ok(None) };
    let mut png = Cursor::new(Vec::new());
    let written = picture.write_to(&mut png, ImageFormat::Png);
    written.map_err(|error| ReportError::Chart { title: PANEL.into(), reason: error.to_string() })?;
    Ok(Some(png.into_inner()))
}

/// Returns `plots/<name>.svg` in ASCII: λ₁ becomes `lambda1`, and other characters than letters, digits, `-` and `_`
/// become `-`.
pub(crate) fn plot_path(figure: &Figure) -> String {
    let name = figure.name.replace('λ', "lambda").replace('₁', "1").replace('₂', "2");
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_') { c } else { '-' };
    format!("plots/{}.svg", name.chars().map(safe).collect::<String>())
}

/// Collects images and curves of a scene, of the lowest seed of each variant.
fn scene<'a>(
    runs: &[&'a Run],
    variants: &[Labelled],
    root: &Path,
    name: String,
    views: usize,
    missing: &mut Vec<String>,
) -> Result<SceneContents<'a>, ReportError> {
    let (labels, runs) = runs_of(runs, variants, &name);
    let mut curves = Vec::new();
    for (label, run) in labels.iter().zip(&runs) {
        // A run that trained several fields shows the first one's events.
        let found = ["metrics.jsonl", "member0/metrics.jsonl"].map(|name| run.directory.join(name));
        let path = found.iter().find(|path| root.join(path).exists()).unwrap_or(&found[0]);
        match Events::read(&root.join(path)) {
            Ok(events) => {
                if events.skipped > 0 {
                    missing.push(format!("{}: {} lines were not understood", path.display(), events.skipped));
                }
                curves.push((label.clone(), events));
            }
            Err(_) => missing.push(format!("{}: cannot be read", path.display())),
        }
    }
    let figures = curve_figures(&name, &curves)?;
    let gallery = Gallery::collect(root, runs, &Choice::Spread(views), missing);
    Ok(SceneContents { name, labels, gallery, figures })
}

fn warnings(input: &ReportInput, runs: &[&Run]) -> Vec<String> {
    let left_out = (runs.len() < input.runs.len()).then(|| {
        let [shown, all] = [groups(runs).len(), groups(&input.runs).len()];
        format!("Shown are the {shown} variants with the highest PSNR, of {all}: the others are in results.json.")
    });
    let collapsed: Vec<String> = runs.iter().filter(|run| run.record.collapsed).map(|run| run.label()).collect();
    let collapsed = match collapsed.len() {
        count if count > MAX_NAMED => vec![format!("{count} runs collapsed: their fields went empty")],
        _ => collapsed.into_iter().map(|run| format!("{run} collapsed: its field went empty")).collect(),
    };
    let mut presets: BTreeMap<&Path, Vec<&str>> = BTreeMap::new();
    for run in runs {
        presets.entry(&run.directory).or_default().push(&run.record.preset);
    }
    let shared = presets.into_iter().filter(|(_, presets)| presets.len() > 1).map(|(folder, presets)| {
        format!("{} holds the images and curves of one of its runs only: {}", folder.display(), presets.join(", "))
    });
    input.warnings.iter().cloned().chain(left_out).chain(collapsed).chain(shared).collect()
}

/// Returns distinct notes in order of appearance, each with the runs that have it.
fn notes(runs: &[&Run]) -> Vec<(String, String)> {
    let mut notes: IndexMap<&String, Vec<&Run>> = IndexMap::new();
    for run in runs {
        for note in &run.record.notes {
            notes.entry(note).or_default().push(run);
        }
    }
    let bearers = |of: Vec<&Run>| match of.len() {
        count if count == runs.len() => "all runs".to_owned(),
        count if count > MAX_NAMED => format!("{count} runs"),
        _ => of.into_iter().map(Run::label).collect::<Vec<_>>().join(", "),
    };
    notes.into_iter().map(|(note, of)| (note.clone(), bearers(of))).collect()
}
