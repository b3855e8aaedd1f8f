use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{
    Claim, Events, Figure, Published, Quantity, Record, ReportError, Run, Table, TestedClaim,
    chart::standalone,
    figures::{comparison_figures, curve_figures},
    files::write_atomically,
    gallery::Gallery,
    html, markdown, overview_table, protocol_lines, scene_table,
    table::{distinct, groups},
};

/// What a report is made of.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportInput {
    /// Name of the experiment.
    pub experiment: String,
    /// Heading of the report.
    pub title: String,
    /// The runs, variants in the order in which they are to be shown.
    pub runs: Vec<Run>,
    /// What a reader must know before the numbers, such as `procedural scenes`; shown at the top.
    pub warnings: Vec<String>,
    /// Charts beyond those that every report has.
    pub figures: Vec<Figure>,
    /// What a paper found, to stand beside the runs.
    pub published: Option<Published>,
    /// What it says about the order of the variants, to be tested on the runs.
    pub claims: Vec<Claim>,
    /// How many test views of each scene are shown.
    pub views: usize,
}

impl ReportInput {
    /// A report of `records`, each in its usual folder, with three views a scene.
    #[must_use]
    pub fn new(experiment: &str, title: &str, records: Vec<Record>) -> Self {
        Self {
            experiment: experiment.into(),
            title: title.into(),
            runs: records.into_iter().map(Run::from).collect(),
            warnings: Vec::new(),
            figures: Vec::new(),
            published: None,
            claims: Vec::new(),
            views: 3,
        }
    }

    /// The claims with what the runs say of them.
    #[must_use]
    pub fn tested_claims(&self) -> Vec<TestedClaim> {
        let records: Vec<Record> = self.runs.iter().map(|run| run.record.clone()).collect();
        self.claims.iter().map(|claim| claim.test(&records, self.published.as_ref())).collect()
    }
}

/// Where a report was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportFiles {
    /// `report.html`, which needs no other file.
    pub html: PathBuf,
    /// `report.md`, which links the pictures of the runs and `plots/*.svg`.
    pub markdown: PathBuf,
    /// What was left out and why, one line each; the report lists it as well.
    pub missing: Vec<String>,
}

/// Writes `report.html`, `report.md` and `plots/*.svg` into `root`, the experiment's folder, below which the runs lie.
///
/// Pictures and events that are missing or cannot be read are left out and named in the report.
///
/// # Errors
/// [`ReportError::Io`] when a file cannot be written, [`ReportError::Chart`].
pub fn write_report(input: &ReportInput, root: &Path) -> Result<ReportFiles, ReportError> {
    let contents = Contents::gather(input, root)?;
    contents.write_plots(root)?;
    let (html, markdown) = (root.join("report.html"), root.join("report.md"));
    write_atomically(&markdown, markdown::page(&contents).as_bytes())?;
    write_atomically(&html, html::page(&contents).as_bytes())?;
    Ok(ReportFiles { html, markdown, missing: contents.missing })
}

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
        let scenes: Result<Vec<Scene>, ReportError> =
            names.into_iter().map(|name| scene(input, &records, root, name, &mut missing)).collect();
        Ok(Self {
            input,
            protocol: protocol_lines(&records),
            warnings: warnings(input),
            overviews: [("Quality", Quantity::quality()), ("Cost", Quantity::cost())].map(|(name, quantities)| {
                let table = overview_table(&records, &quantities);
                Table { title: format!("{name}, {}", table.title), ..table }
            }),
            published: input.published.as_ref().and_then(|published| published.table(&records)),
            claims: input.tested_claims(),
            figures: comparison_figures(&records)?.into_iter().chain(input.figures.iter().cloned()).collect(),
            tables: tables.map(|quantity| scene_table(&records, quantity)).collect(),
            scenes: scenes?,
            notes: notes(&input.runs),
            missing,
        })
    }

    /// Writes `plots/*.svg` into `root`.
    pub(crate) fn write_plots(&self, root: &Path) -> Result<(), ReportError> {
        for figure in self.all_figures() {
            write_atomically(&root.join(plot_path(figure)), standalone(&figure.svg).as_bytes())?;
        }
        Ok(())
    }

    fn all_figures(&self) -> impl Iterator<Item = &Figure> {
        self.figures.iter().chain(self.scenes.iter().flat_map(|scene| &scene.figures))
    }
}

/// `plots/<name>.svg`, with what a file name might not bear replaced by `-`.
pub(crate) fn plot_path(figure: &Figure) -> String {
    let safe = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_') { c } else { '-' };
    format!("plots/{}.svg", figure.name.chars().map(safe).collect::<String>())
}

/// Pictures and curves of a scene, of the lowest seed of each variant.
fn scene<'a>(
    input: &'a ReportInput,
    records: &[Record],
    root: &Path,
    name: String,
    missing: &mut Vec<String>,
) -> Result<Scene<'a>, ReportError> {
    let (mut labels, mut runs) = (Vec::new(), Vec::new());
    for group in groups(records) {
        let is_member = |run: &&Run| run.record.scene == name && group.records.contains(&&run.record);
        if let Some(run) = input.runs.iter().filter(is_member).min_by_key(|run| run.record.seed) {
            labels.push(group.label);
            runs.push(run);
        }
    }
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
    let gallery = Gallery::collect(root, runs, input.views, missing);
    Ok(Scene { name, labels, gallery, figures })
}

fn warnings(input: &ReportInput) -> Vec<String> {
    let collapsed = input.runs.iter().filter(|run| run.record.collapsed);
    let collapsed = collapsed.map(|run| format!("{} collapsed: its field went empty", run.label()));
    let mut presets: BTreeMap<&Path, Vec<&str>> = BTreeMap::new();
    for run in &input.runs {
        presets.entry(&run.directory).or_default().push(&run.record.preset);
    }
    let shared = presets.into_iter().filter(|(_, presets)| presets.len() > 1).map(|(folder, presets)| {
        format!("{} holds the pictures and curves of one of its runs only: {}", folder.display(), presets.join(", "))
    });
    input.warnings.iter().cloned().chain(collapsed).chain(shared).collect()
}

/// Distinct notes in order of appearance, each with the runs that bear it.
fn notes(runs: &[Run]) -> Vec<(String, String)> {
    let mut notes: Vec<(&String, Vec<String>)> = Vec::new();
    for run in runs {
        for note in &run.record.notes {
            match notes.iter_mut().find(|(known, _)| *known == note) {
                Some((_, bearers)) => bearers.push(run.label()),
                None => notes.push((note, vec![run.label()])),
            }
        }
    }
    let bearers = |of: Vec<String>| if of.len() == runs.len() { "all runs".to_owned() } else { of.join(", ") };
    notes.into_iter().map(|(note, of)| (note.clone(), bearers(of))).collect()
}
