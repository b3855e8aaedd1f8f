use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use indexmap::IndexMap;

use crate::chart::standalone;
use crate::claim::TestedClaim;
use crate::error::ReportError;
use crate::events::{EVENTS_FILE, Events};
use crate::figures::{Figure, comparison_figures, curve_figures};
use crate::files::{save_png, write_atomically};
use crate::gallery::{SceneGallery, evenly_spaced, shown_variants, with_forward_slashes};
use crate::input::ReportInput;
use crate::panel::compose;
use crate::protocol::protocol_lines;
use crate::quantity::Quantity;
use crate::record::{Record, VIEWER_PAGE, distinct};
use crate::table::{Table, groups, measured, overview_table, scene_table};
use crate::text::counted;

const MAX_IMAGES: usize = 400;
/// Maximum number of test views shown of each scene.
const MAX_VIEWS: usize = 3;
/// Maximum number of scenes, and of variants, in the figure of all scenes.
const MAX_IN_PANEL: usize = 8;
const MAX_NAMED: usize = 16;
/// Maximum number of characters of a plot's name: file systems allow 255 bytes.
const MAX_PLOT_NAME: usize = 120;

pub(crate) struct ReportContents<'a> {
    pub(crate) input: &'a ReportInput,
    pub(crate) records: Vec<&'a Record>,
    pub(crate) protocol: Vec<String>,
    pub(crate) warnings: Vec<String>,
    /// Means over scenes, of quality and of cost.
    pub(crate) overviews: [Table; 2],
    pub(crate) published: Option<Table>,
    pub(crate) claims: Vec<TestedClaim>,
    pub(crate) figures: Vec<Figure>,
    /// Table of scenes for each quantity that was measured; empty for a single scene.
    pub(crate) tables: Vec<Table>,
    pub(crate) scenes: Vec<SceneContents<'a>>,
    pub(crate) notes: Vec<(String, String)>,
    pub(crate) missing: Vec<String>,
}

pub(crate) struct SceneContents<'a> {
    pub(crate) gallery: SceneGallery<'a>,
    pub(crate) figures: Vec<Figure>,
    /// Label of each run that has a page with its scene in 3D, and the path of the page relative to the report.
    pub(crate) viewers: Vec<(String, String)>,
}

impl<'a> ReportContents<'a> {
    pub(crate) fn gather(input: &'a ReportInput, root: &Path) -> Result<Self, ReportError> {
        let records = input.shown_records();
        let mut missing = Vec::new();
        let names = distinct(&records, |record| record.scene.clone());
        let several = names.len() > 1;
        let tables = Quantity::all().into_iter().filter(|quantity| several && measured(&records, *quantity));
        // The protocol is printed once, above all tables.
        let bare = |table: Table, title: String| Table { title, protocol: Vec::new(), ..table };
        let (variants, left_out) = shown_variants(&records);
        let best = format!("images and curves of all but the {} variants with the highest PSNR", variants.len());
        missing.extend((left_out > 0).then_some(best));
        // Images of a view: the truth, and the render, depth and error of each variant.
        let of_a_view = 3 * variants.len() + 1;
        let most = (MAX_IMAGES / (of_a_view * names.len().max(1))).clamp(1, MAX_VIEWS);
        let mut left = MAX_IMAGES / of_a_view;
        let mut scenes = Vec::new();
        for name in names {
            let views = most.min(left);
            let left_out = || format!("{name}: images of {} of {MAX_VIEWS} test views", MAX_VIEWS - views);
            missing.extend((views < MAX_VIEWS).then(left_out));
            left -= views;
            let gallery = SceneGallery::collect(&variants, root, name, |all| evenly_spaced(all, views), &mut missing);
            scenes.push(SceneContents::gather(gallery, root, &mut missing)?);
        }
        let overview = |name: &str, quantities: &[Quantity]| {
            let table = overview_table(&records, quantities);
            let title = format!("{name}, {}", table.title);
            bare(table, title)
        };
        Ok(Self {
            input,
            protocol: protocol_lines(&records),
            warnings: warnings(input, &records),
            overviews: [overview("Quality", &Quantity::quality()), overview("Cost", &Quantity::cost())],
            published: input.published.as_ref().and_then(|published| published.table(&records)),
            claims: input.tested_claims(),
            figures: comparison_figures(&records)?.into_iter().chain(input.figures.iter().cloned()).collect(),
            tables: tables.map(|quantity| bare(scene_table(&records, quantity), quantity.heading())).collect(),
            scenes,
            notes: notes(&records),
            missing,
            records,
        })
    }

    pub(crate) fn write_plots(&self, root: &Path) -> Result<(), ReportError> {
        let path = root.join("figure.png");
        match self.panel()? {
            Some(panel) => save_png(&panel, &path)?,
            // An earlier figure is of fewer scenes or variants.
            None if path.exists() => fs::remove_file(&path).map_err(ReportError::io("remove", &path))?,
            None => {}
        }
        // Variants that differ in punctuation alone would share a name.
        let mut names = BTreeSet::new();
        for figure in self.figures.iter().chain(self.scenes.iter().flat_map(|scene| &scene.figures)) {
            let mut name = plot_name(figure);
            while !names.insert(name.clone()) {
                name.push_str("-2");
            }
            write_atomically(&root.join(format!("plots/{name}.svg")), standalone(&figure.svg).as_bytes())?;
        }
        Ok(())
    }

    /// Draws the first view of each scene; `None` for too many scenes or variants, or without images.
    fn panel(&self) -> Result<Option<RgbImage>, ReportError> {
        let galleries: Vec<&SceneGallery> = self.scenes.iter().map(|scene| &scene.gallery).collect();
        let is_small =
            galleries.iter().map(|gallery| gallery.runs.len()).chain([galleries.len()]).all(|n| n <= MAX_IN_PANEL);
        if is_small { compose(&galleries) } else { Ok(None) }
    }
}

impl<'a> SceneContents<'a> {
    /// Adds the curves and 3D pages of a gallery's runs to the gallery. Events that cannot be read are named in `missing`.
    fn gather(gallery: SceneGallery<'a>, root: &Path, missing: &mut Vec<String>) -> Result<Self, ReportError> {
        let (mut curves, mut viewers) = (Vec::new(), Vec::new());
        for (label, record) in &gallery.runs {
            let folder = record.directory();
            let page = folder.join(VIEWER_PAGE);
            viewers.extend(root.join(&page).is_file().then(|| (label.clone(), with_forward_slashes(&page))));
            // A run that trained several fields shows the first one's events.
            let found = ["", "member0"].map(|field| folder.join(field).join(EVENTS_FILE));
            let path = found.iter().find(|path| root.join(path).exists()).unwrap_or(&found[0]);
            let name = with_forward_slashes(path);
            let events = match fs::read(root.join(path)) {
                Ok(bytes) => Events::parse(&String::from_utf8_lossy(&bytes)),
                Err(error) => {
                    missing.push(format!("{name}: {error}"));
                    continue;
                }
            };
            let skipped = || format!("{name}: cannot read {}", counted(events.skipped, "line"));
            missing.extend((events.skipped > 0).then(skipped));
            curves.push((label.clone(), events));
        }
        let figures = curve_figures(&gallery.scene, &curves)?;
        Ok(Self { gallery, figures, viewers })
    }
}

/// Returns the name of a plot in ASCII: λ₁ becomes `lambda1`, and all but letters, digits, `-` and `_` becomes `-`. A long name
/// loses its middle, since plots of one scene begin alike.
fn plot_name(figure: &Figure) -> String {
    let name = figure.name.replace('λ', "lambda").replace('₁', "1").replace('₂', "2");
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_') { c } else { '-' };
    let name: String = name.chars().map(safe).collect();
    let kept = MAX_PLOT_NAME / 2 - 1;
    if name.len() > MAX_PLOT_NAME { format!("{}--{}", &name[..kept], &name[name.len() - kept..]) } else { name }
}

fn warnings(input: &ReportInput, records: &[&Record]) -> Vec<String> {
    let left_out = (records.len() < input.records.len()).then(|| {
        let [shown, all] = [groups(records.iter().copied()).len(), groups(input.records.iter()).len()];
        format!("Shown are the {shown} variants with the highest PSNR, of {all}: the others are in results.json.")
    });
    let collapsed = records.iter().filter(|record| record.collapsed).map(|record| record.run_label());
    let collapsed = match collapsed.clone().count() {
        count if count > MAX_NAMED => vec![format!("{count} runs collapsed: their fields went empty")],
        _ => collapsed.map(|run| format!("{run} collapsed: its field went empty")).collect(),
    };
    let mut presets: BTreeMap<PathBuf, Vec<&str>> = BTreeMap::new();
    for record in records {
        presets.entry(record.directory()).or_default().push(&record.preset);
    }
    let shared = presets.into_iter().filter(|(_, presets)| presets.len() > 1).map(|(folder, presets)| {
        format!("{} holds the images and curves of one of its runs only: {}", folder.display(), presets.join(", "))
    });
    input.warnings.iter().cloned().chain(left_out).chain(collapsed).chain(shared).collect()
}

/// Returns distinct notes in order of appearance, each with the runs that have it.
fn notes(records: &[&Record]) -> Vec<(String, String)> {
    let mut notes: IndexMap<&String, Vec<String>> = IndexMap::new();
    for record in records {
        for note in &record.notes {
            notes.entry(note).or_default().push(record.run_label());
        }
    }
    let bearers = |of: Vec<String>| match of.len() {
        count if count == records.len() => "all runs".to_owned(),
        count if count > MAX_NAMED => format!("{count} runs"),
        _ => of.join(", "),
    };
    notes.into_iter().map(|(note, of)| (note.clone(), bearers(of))).collect()
}
