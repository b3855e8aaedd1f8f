use std::{collections::BTreeMap, io::Cursor, path::Path};

use image::ImageFormat;
use indexmap::IndexMap;

use crate::{
    Events, Figure, Quantity, Record, ReportError, ReportInput, Run, Table, TestedClaim,
    chart::standalone,
    figures::{comparison_figures, curve_figures},
    files::write_atomically,
    gallery::{Choice, Gallery, View},
    overview_table,
    panel::{PanelRow, compose},
    pictured::{Labelled, MOST_PICTURED, pictured, runs_of},
    protocol_lines, scene_table,
    table::{distinct, groups},
};

/// Pictures that are shown, at most.
const MOST_PICTURES: usize = 400;
/// Scenes and variants of which a report has a figure, at most.
const MOST_IN_PANEL: usize = 8;
/// File of that figure.
pub(crate) const PANEL: &str = "figure.png";
/// Runs that a line names, at most.
const MOST_NAMED: usize = 16;

/// Everything that a report shows, in its order, whatever the format.
pub(crate) struct Contents<'a> {
    pub(crate) input: &'a ReportInput,
    pub(crate) protocol: Vec<String>,
    pub(crate) warnings: Vec<String>,
    /// Means over scenes, of quality and of cost.
    pub(crate) overviews: [Table; 2],
    /// The paper's figures beside ours.
    pub(crate) published: Option<Table>,
    pub(crate) claims: Vec<TestedClaim>,
    pub(crate) figures: Vec<Figure>,
    /// A table of scenes for each quantity that was measured; none for a single scene.
    pub(crate) tables: Vec<Table>,
    pub(crate) scenes: Vec<Scene<'a>>,
    /// The figure of all scenes, where they and the variants are few.
    pub(crate) panel: Option<Vec<u8>>,
    /// Each note with the runs that have it.
    pub(crate) notes: Vec<(String, String)>,
    pub(crate) missing: Vec<String>,
}

/// One scene of a report.
pub(crate) struct Scene<'a> {
    pub(crate) name: String,
    /// Labels of the gallery's runs, as in the tables.
    pub(crate) labels: Vec<String>,
    pub(crate) gallery: Gallery<'a>,
    pub(crate) figures: Vec<Figure>,
}

impl<'a> Contents<'a> {
    pub(crate) fn gather(input: &'a ReportInput, root: &Path) -> Result<Self, ReportError> {
        let records: Vec<Record> = input.runs.iter().map(|run| run.record.clone()).collect();
        let mut missing = Vec::new();
        let names = distinct(&records, |record| record.scene.clone());
        let several = names.len() > 1;
        let measured = |quantity: &Quantity| records.iter().any(|record| quantity.value(record).is_some());
        let tables = Quantity::all().into_iter().filter(|quantity| several && measured(quantity));
        // The protocol stands once, above all.
        let bare = |table: Table, title: String| Table { title, protocol: Vec::new(), ..table };
        let pictured = pictured(&records);
        if pictured.len() < groups(&records).len() {
            missing.push(format!("pictures and curves of all but the {MOST_PICTURED} variants with the highest PSNR"));
        }
        // A view has a truth, and a render, its depth and its error for each variant.
        let of_a_view = 3 * pictured.len() + 1;
        let views = (MOST_PICTURES / (of_a_view * names.len().max(1))).clamp(1, input.views.max(1)).min(input.views);
        let mut left = MOST_PICTURES / of_a_view;
        let mut scenes = Vec::new();
        for name in names {
            let views = views.min(left);
            if views < input.views {
                missing.push(format!("{name}: pictures of {} of {} test views", input.views - views, input.views));
            }
            left -= views;
            scenes.push(scene(input, &pictured, root, name, views, &mut missing)?);
        }
        Ok(Self {
            input,
            protocol: protocol_lines(&records),
            warnings: warnings(input),
            overviews: [("Quality", Quantity::quality()), ("Cost", Quantity::cost())].map(|(name, quantities)| {
                let table = overview_table(&records, &quantities);
                let title = format!("{name}, {}", table.title);
                bare(table, title)
            }),
            published: input.published.as_ref().and_then(|published| published.table(&records)),
            claims: input.tested_claims(),
            figures: comparison_figures(&records)?.into_iter().chain(input.figures.iter().cloned()).collect(),
            tables: tables.map(|quantity| bare(scene_table(&records, quantity), quantity.heading())).collect(),
            panel: panel(&scenes)?,
            scenes,
            notes: notes(&input.runs),
            missing,
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

/// A PNG of the first view of each scene; none of too many scenes or variants.
fn panel<'a>(scenes: &'a [Scene<'a>]) -> Result<Option<Vec<u8>>, ReportError> {
    if scenes.iter().map(|scene| scene.labels.len()).chain([scenes.len()]).any(|count| count > MOST_IN_PANEL) {
        return Ok(None);
    }
    let viewed = scenes.iter().filter_map(|scene| Some((scene, scene.gallery.views.first()?)));
    let row = |(scene, view): (&'a Scene<'a>, &'a View)| PanelRow { scene: &scene.name, labels: &scene.labels, view };
    let rows: Vec<PanelRow> = viewed.map(row).collect();
    let Some(picture) = compose(&rows)? else { return Ok(None) };
    let mut png = Cursor::new(Vec::new());
    let written = picture.write_to(&mut png, ImageFormat::Png);
    written.map_err(|error| ReportError::Chart { title: PANEL.into(), reason: error.to_string() })?;
    Ok(Some(png.into_inner()))
}

/// `plots/<name>.svg`, with characters that may be invalid in file names replaced by `-`.
pub(crate) fn plot_path(figure: &Figure) -> String {
    let safe = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_') { c } else { '-' };
    format!("plots/{}.svg", figure.name.chars().map(safe).collect::<String>())
}

/// Pictures and curves of a scene, of the lowest seed of each variant.
fn scene<'a>(
    input: &'a ReportInput,
    variants: &[Labelled],
    root: &Path,
    name: String,
    views: usize,
    missing: &mut Vec<String>,
) -> Result<Scene<'a>, ReportError> {
    let (labels, runs) = runs_of(input, variants, &name);
    let mut curves = Vec::new();
    for (label, run) in labels.iter().zip(&runs) {
        // Of a run that trained several fields, the first one's.
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
    Ok(Scene { name, labels, gallery, figures })
}

fn warnings(input: &ReportInput) -> Vec<String> {
    let collapsed: Vec<String> = input.runs.iter().filter(|run| run.record.collapsed).map(Run::label).collect();
    let collapsed = match collapsed.len() {
        count if count > MOST_NAMED => vec![format!("{count} runs collapsed: their fields went empty")],
        _ => collapsed.into_iter().map(|run| format!("{run} collapsed: its field went empty")).collect(),
    };
    let mut presets: BTreeMap<&Path, Vec<&str>> = BTreeMap::new();
    for run in &input.runs {
        presets.entry(&run.directory).or_default().push(&run.record.preset);
    }
    let shared = presets.into_iter().filter(|(_, presets)| presets.len() > 1).map(|(folder, presets)| {
        format!("{} holds the pictures and curves of one of its runs only: {}", folder.display(), presets.join(", "))
    });
    input.warnings.iter().cloned().chain(collapsed).chain(shared).collect()
}

/// Distinct notes in order of appearance, each with the runs that have it.
fn notes(runs: &[Run]) -> Vec<(String, String)> {
    let mut notes: IndexMap<&String, Vec<&Run>> = IndexMap::new();
    for run in runs {
        for note in &run.record.notes {
            notes.entry(note).or_default().push(run);
        }
    }
    let bearers = |of: Vec<&Run>| match of.len() {
        count if count == runs.len() => "all runs".to_owned(),
        count if count > MOST_NAMED => format!("{count} runs"),
        _ => of.into_iter().map(Run::label).collect::<Vec<_>>().join(", "),
    };
    notes.into_iter().map(|(note, of)| (note.clone(), bearers(of))).collect()
}
