//! Several experiments in one report.

use std::path::Path;

use crate::{
    ReportError, ReportFiles, ReportInput, Table,
    contents::Contents,
    files::write_atomically,
    html, markdown,
    text::{escape_markdown, escape_url},
};

/// A report of several experiments.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Collection {
    /// Heading.
    pub title: String,
    /// Paragraphs below it.
    pub introduction: Vec<String>,
    /// The experiments, in their order.
    pub chapters: Vec<Chapter>,
}

/// One experiment of a [`Collection`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chapter {
    /// What its own report is made of.
    pub input: ReportInput,
    /// Its folder below that of the collection.
    pub folder: String,
}

/// A chapter with everything that it shows.
pub(crate) struct ChapterContents<'a> {
    pub(crate) contents: Contents<'a>,
    /// Folder of the experiment, below that of the collection.
    folder: &'a str,
    /// The experiment's own report, likewise.
    pub(crate) report: String,
}

impl ChapterContents<'_> {
    pub(crate) fn input(&self) -> &ReportInput {
        self.contents.input
    }
}

/// Writes `report.html` and `report.md` into `root`, below which the experiments lie with reports of their own: the
/// claims of all, then of each experiment its tables, its charts and a test view.
///
/// # Errors
/// As [`write_report`](crate::write_report).
pub fn write_collection(collection: &Collection, root: &Path) -> Result<ReportFiles, ReportError> {
    let mut chapters = Vec::new();
    let shown: Vec<_> = collection.chapters.iter().map(|chapter| chapter.input.shown()).collect();
    for (chapter, input) in collection.chapters.iter().zip(&shown) {
        let contents = Contents::gather(input, &root.join(&chapter.folder))?;
        let report = format!("{}/report.html", chapter.folder);
        chapters.push(ChapterContents { contents, folder: &chapter.folder, report });
    }
    let (html, markdown) = (root.join("report.html"), root.join("report.md"));
    write_atomically(&markdown, page(collection, &chapters).as_bytes())?;
    let text = html::collection_page(&collection.title, &collection.introduction, &chapters);
    write_atomically(&html, text.as_bytes())?;
    let missing = chapters.into_iter().flat_map(|chapter| chapter.contents.missing).collect();
    Ok(ReportFiles { html, markdown, missing })
}

/// `report.md`.
fn page(collection: &Collection, chapters: &[ChapterContents]) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(&collection.title))];
    blocks.extend(collection.introduction.iter().map(|line| escape_markdown(line)));
    blocks.push("## What the paper says, and what was found here".into());
    let mut summary = vec!["| | statement | experiment |".to_owned(), "| --- | --- | --- |".to_owned()];
    for chapter in chapters {
        let experiment = escape_markdown(&chapter.input().experiment);
        summary.extend(
            chapter.contents.claims.iter().map(|claim| {
                format!("| **{}** | {} | {experiment} |", claim.verdict, escape_markdown(&claim.statement))
            }),
        );
    }
    blocks.push(summary.join("\n"));
    for chapter in chapters {
        let contents = &chapter.contents;
        blocks.push(format!("## {}", escape_markdown(&chapter.input().heading())));
        blocks.extend(markdown::protocol(&contents.protocol));
        blocks.extend(contents.warnings.iter().map(|warning| format!("> **Note:** {}", escape_markdown(warning))));
        blocks.extend(contents.overviews.iter().take(1).chain(&contents.published).map(Table::to_markdown));
        if !contents.claims.is_empty() {
            blocks.push(markdown::claims(&contents.claims));
        }
        blocks.extend(contents.figures.iter().map(|figure| markdown::figure(figure, chapter.folder)));
        let experiment = escape_markdown(&chapter.input().experiment);
        blocks.push(format!("[The whole report of {experiment}]({})", escape_url(&chapter.report)));
    }
    blocks.join("\n\n") + "\n"
}
