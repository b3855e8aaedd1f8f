//! `report.md`, the report for a repository, with links to the images of the runs; and the document of several
//! experiments.

use indexmap::IndexSet;

use crate::{
    Figure, Finding, Quantity, ReportInput, Table, TestedClaim,
    contents::{PANEL, ReportContents, SceneContents, plot_path},
    gallery::{GalleryImage, GalleryView, KINDS},
    overview_table, protocol_lines, scene_table,
    text::{escape_html, escape_markdown, escape_url},
};

/// Heading of the claims.
const CLAIMS: &str = "## Claims of the paper, tested here";

pub(crate) fn page(contents: &ReportContents) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(&contents.input.heading()))];
    blocks.push(format!("Experiment {}", escape_markdown(&contents.input.experiment)));
    blocks.extend(protocol(&contents.protocol));
    blocks.extend(warnings(contents));
    blocks.push("## Results".into());
    if contents.panel.is_some() {
        blocks.push(format!("![truth, render and depth of every variant]({PANEL})"));
    }
    blocks.extend(contents.overviews.iter().chain(&contents.published).map(Table::to_markdown));
    if !contents.claims.is_empty() {
        blocks.extend([CLAIMS.to_owned(), claims(&contents.claims)]);
    }
    blocks.extend(contents.figures.iter().map(|one| figure(one, "")));
    blocks.extend(contents.tables.iter().map(Table::to_markdown));
    for scene in &contents.scenes {
        blocks.push(format!("## {}", escape_markdown(&scene.name)));
        blocks.extend(scene.gallery.views.iter().map(|one| view(scene, one)));
        blocks.extend(scene.figures.iter().map(|one| figure(one, "")));
    }
    if !contents.notes.is_empty() || !contents.missing.is_empty() {
        blocks.push("## Notes".into());
        let notes = contents
            .notes
            .iter()
            .map(|(note, runs)| format!("- {} ({})", escape_markdown(note), escape_markdown(runs)));
        let missing = contents.missing.iter().map(|line| format!("- left out: {}", escape_markdown(line)));
        blocks.push(notes.chain(missing).collect::<Vec<_>>().join("\n"));
    }
    blocks.join("\n\n") + "\n"
}

/// Makes `report.md` of several experiments.
pub(crate) fn collection_page(title: &str, introduction: &str, chapters: &[ReportContents]) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(title)), escape_markdown(introduction), CLAIMS.into()];
    let mut summary = vec!["| | statement | experiment |".to_owned(), "| --- | --- | --- |".to_owned()];
    for contents in chapters {
        let experiment = escape_markdown(&contents.input.experiment);
        let line = |claim: &TestedClaim| {
            format!("| **{}** | {} | {experiment} |", claim.verdict, escape_markdown(&claim.statement))
        };
        summary.extend(contents.claims.iter().map(line));
    }
    blocks.push(summary.join("\n"));
    for contents in chapters {
        let experiment = &contents.input.experiment;
        blocks.push(format!("## {}", escape_markdown(&contents.input.heading())));
        blocks.extend(protocol(&contents.protocol));
        blocks.extend(warnings(contents));
        blocks.extend(contents.overviews.iter().take(1).chain(&contents.published).map(Table::to_markdown));
        blocks.extend((!contents.claims.is_empty()).then(|| claims(&contents.claims)));
        blocks.extend(contents.figures.iter().map(|one| figure(one, experiment)));
        let report = escape_url(&format!("{experiment}/report.html"));
        blocks.push(format!("[The whole report of {}]({report})", escape_markdown(experiment)));
    }
    blocks.join("\n\n") + "\n"
}

/// Makes one Markdown document of the results of several experiments, so that no figure in it is typed by hand: for
/// each its command and protocol, the notes of its records, the means over scenes, each scene's PSNR, and its claims.
pub fn results_document(title: &str, experiments: &[ReportInput]) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(title))];
    blocks.push("Written by `infonerf collect` from results files; not edited by hand.".into());
    // The protocol stands above all tables.
    let markdown = |table: Table| Table { protocol: Vec::new(), ..table }.to_markdown();
    for input in experiments {
        let runs = &input.runs;
        blocks.push(format!("## {}", escape_markdown(&input.heading())));
        blocks.extend(input.command.as_ref().map(|command| format!("```sh\n{command}\n```")));
        blocks.extend(protocol(&protocol_lines(runs)));
        let notes: IndexSet<&String> = runs.iter().flat_map(|run| &run.record.notes).collect();
        let notes: Vec<String> = notes.into_iter().map(|note| format!("- {}", escape_markdown(note))).collect();
        blocks.extend((!notes.is_empty()).then(|| notes.join("\n")));
        blocks.push(markdown(overview_table(runs, &Quantity::all())));
        if runs.iter().any(|run| run.record.scene != runs[0].record.scene) {
            blocks.push(markdown(scene_table(runs, Quantity::PSNR)));
        }
        let tested = input.tested_claims();
        blocks.extend((!tested.is_empty()).then(|| claims(&tested)));
    }
    blocks.join("\n\n") + "\n"
}

fn warnings(contents: &ReportContents) -> impl Iterator<Item = String> {
    contents.warnings.iter().map(|warning| format!("> **Note:** {}", escape_markdown(warning)))
}

/// Describes how the numbers were obtained, a line each; `None` without runs.
fn protocol(lines: &[String]) -> Option<String> {
    let lines: Vec<String> = lines.iter().map(|line| escape_markdown(line)).collect();
    (!lines.is_empty()).then(|| lines.join("  \n"))
}

/// Lists claims with a table of findings below each.
fn claims(claims: &[TestedClaim]) -> String {
    let one = |claim: &TestedClaim| {
        let row = |finding: &Finding| {
            let cells = [finding.formula.clone(), finding.found(), finding.in_paper(), finding.verdict.to_string()];
            format!("| {} |", cells.map(|cell| escape_markdown(&cell)).join(" | "))
        };
        let head =
            ["| comparison | left − right, here | in the paper | |", "| --- | ---: | ---: | --- |"].map(str::to_owned);
        let rows: Vec<String> = head.into_iter().chain(claim.findings.iter().map(row)).collect();
        format!("**{}**: {}\n\n{}", claim.verdict, escape_markdown(&claim.statement), rows.join("\n"))
    };
    claims.iter().map(one).collect::<Vec<_>>().join("\n\n")
}

/// Links a chart whose file is in `folder`, below that of the page.
fn figure(figure: &Figure, folder: &str) -> String {
    let path = match folder {
        "" => plot_path(figure),
        folder => format!("{folder}/{}", plot_path(figure)),
    };
    let image = format!("![{}]({})", escape_markdown(&figure.title), escape_url(&path));
    if figure.caption.is_empty() { image } else { format!("{image}\n\n{}", escape_markdown(&figure.caption)) }
}

/// Makes a table with the truth and each run as columns; render, depth and error as rows.
fn view(scene: &SceneContents, view: &GalleryView) -> String {
    let headings = scene.labels.iter().map(|label| format!(" {} |", escape_markdown(label))).collect::<String>();
    let mut lines = vec![
        format!("| view {} | truth |{headings}", escape_markdown(&view.name)),
        format!("| --- | --- |{}", " --- |".repeat(scene.labels.len())),
    ];
    for (name, kind) in KINDS {
        let truth = if name == "render" { image(&view.truth) } else { String::new() };
        let cells = view.shots.iter().map(|shots| format!(" {} |", image(kind(shots)))).collect::<String>();
        lines.push(format!("| {name} | {truth} |{cells}"));
    }
    lines.join("\n")
}

fn image(picture: &Option<GalleryImage>) -> String {
    picture.as_ref().map_or(String::new(), |picture| {
        let path = escape_url(&picture.path);
        format!("<img src=\"{path}\" alt=\"{}\" width=\"220\">", escape_html(&picture.path))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Record;

    #[test]
    fn results_document_has_command_protocol_and_tables() {
        let run = |scene: &str, variant: &str, psnr| Record {
            scene: scene.into(),
            variant: variant.into(),
            metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(),
            notes: vec!["procedural scene".into()],
            ..Record::default()
        };
        let records = vec![run("lego", "nerf", 15.0), run("lego", "infonerf", 19.0), run("mic", "nerf", 14.0)];
        let command = Some("infonerf exp synthetic-4view".to_owned());
        let input = ReportInput { command, ..ReportInput::new("exp", "Four views", records) };
        let document = results_document("Results", &[input]);
        for part in ["# Results", "## Four views", "infonerf exp synthetic-4view", "**19.00**", "| mic |", "seed 0"] {
            assert!(document.contains(part), "{part}: {document}");
        }
        // Once for all runs and tables.
        for part in ["- procedural scene", "seed 0"] {
            assert_eq!(document.matches(part).count(), 1, "{part}: {document}");
        }
    }
}
