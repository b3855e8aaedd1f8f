//! `report.md`: the report for a repository, with links to the pictures of the runs.

use crate::{
    Figure, Table,
    gallery::{KINDS, Picture, View},
    report::{Contents, Scene, plot_path},
    text::{escape_html, escape_markdown, escape_url},
};

pub(crate) fn page(contents: &Contents) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(&contents.input.title))];
    blocks.push(format!("Experiment {}", escape_markdown(&contents.input.experiment)));
    blocks.extend(contents.warnings.iter().map(|warning| format!("> **Note:** {}", escape_markdown(warning))));
    blocks.push("## Results".into());
    blocks.extend(contents.overviews.iter().map(Table::to_markdown));
    blocks.extend(contents.figures.iter().map(figure));
    blocks.extend(contents.tables.iter().map(Table::to_markdown));
    for scene in &contents.scenes {
        blocks.push(format!("## {}", escape_markdown(&scene.name)));
        blocks.extend(scene.gallery.views.iter().map(|one| view(scene, one)));
        blocks.extend(scene.figures.iter().map(figure));
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

fn figure(figure: &Figure) -> String {
    let image = format!("![{}]({})", escape_markdown(&figure.title), escape_url(&plot_path(figure)));
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
