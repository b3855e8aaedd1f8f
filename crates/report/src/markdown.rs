//! `report.md`: the report for a repository, with links to the pictures of the runs.

use crate::{
    Figure, Table, TestedClaim,
    contents::{Contents, PANEL, Scene, plot_path},
    gallery::{KINDS, Picture, View},
    text::{escape_html, escape_markdown, escape_url},
};

pub(crate) fn page(contents: &Contents) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(&contents.input.heading()))];
    blocks.push(format!("Experiment {}", escape_markdown(&contents.input.experiment)));
    blocks.extend(protocol(&contents.protocol));
    blocks.extend(contents.warnings.iter().map(|warning| format!("> **Note:** {}", escape_markdown(warning))));
    blocks.push("## Results".into());
    blocks.extend(contents.overviews.iter().chain(&contents.published).map(Table::to_markdown));
    if contents.panel.is_some() {
        blocks.push(format!("![truth, render and depth of every variant]({PANEL})"));
    }
    if !contents.claims.is_empty() {
        blocks.extend(["## What the paper says, and what was found here".to_owned(), claims(&contents.claims)]);
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

/// How the numbers were obtained, a line each; nothing without runs.
pub(crate) fn protocol(lines: &[String]) -> Option<String> {
    let lines: Vec<String> = lines.iter().map(|line| escape_markdown(line)).collect();
    (!lines.is_empty()).then(|| lines.join("  \n"))
}

/// A list of claims with a table of findings below each.
pub(crate) fn claims(claims: &[TestedClaim]) -> String {
    let one = |claim: &TestedClaim| {
        let row = |finding: &crate::Finding| {
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

/// A chart whose file is in `folder`, below that of the page.
pub(crate) fn figure(figure: &Figure, folder: &str) -> String {
    let path = match folder {
        "" => plot_path(figure),
        folder => format!("{folder}/{}", plot_path(figure)),
    };
    let image = format!("![{}]({})", escape_markdown(&figure.title), escape_url(&path));
    if figure.caption.is_empty() { image } else { format!("{image}\n\n{}", escape_markdown(&figure.caption)) }
}

/// A table with the truth and each run as columns; render, depth and error as rows.
fn view(scene: &Scene, view: &View) -> String {
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

fn image(picture: &Option<Picture>) -> String {
    picture.as_ref().map_or(String::new(), |picture| {
        let path = escape_url(&picture.path);
        format!("<img src=\"{path}\" alt=\"{}\" width=\"220\">", escape_html(&picture.path))
    })
}
