//! Page of several experiments.

use super::{claims, document, figures, scene, table};
use crate::{
    contents::ReportContents,
    text::{escape_html, escape_url, html_prose},
};

pub(crate) fn page(title: &str, introduction: &str, chapters: &[ReportContents]) -> String {
    let links = chapters.iter().enumerate();
    let links =
        links.map(|(i, chapter)| format!("<a href=\"#chapter-{i}\">{}</a>", escape_html(&chapter.input.experiment)));
    let header = format!(
        "<header>\n<h1>{}</h1>\n<p>{}</p>\n<nav><a href=\"#claims\">Claims</a>{}</nav>\n</header>\n",
        escape_html(title),
        html_prose(introduction),
        links.collect::<String>(),
    );
    let main = summary(chapters) + &chapters.iter().enumerate().map(chapter).collect::<String>();
    document(title, &header, &main)
}

/// Lists all claims, a line each.
fn summary(chapters: &[ReportContents]) -> String {
    let rows = chapters.iter().enumerate().flat_map(|(index, chapter)| {
        chapter.claims.iter().map(move |claim| {
            format!(
                "<tr><th scope=\"row\">{}</th><td class=\"name\">{}</td><td><a href=\"#chapter-{index}\">{}</a></td></tr>\n",
                claims::tag(claim.verdict),
                html_prose(&claim.statement),
                escape_html(&chapter.input.experiment),
            )
        })
    });
    format!(
        "<section id=\"claims\">\n<h2>Claims of the paper, tested here</h2>\n\
         <div class=\"scroll\"><table class=\"claims\">\n<tbody>\n{}</tbody>\n</table></div>\n</section>\n",
        rows.collect::<String>()
    )
}

fn chapter((index, contents): (usize, &ReportContents)) -> String {
    let images = contents.scenes.first().map_or(String::new(), scene::first_view);
    let experiment = &contents.input.experiment;
    format!(
        "<section id=\"chapter-{index}\">\n<h2>{}</h2>\n{}{}{}{}{}{images}\
         <p><a href=\"{}\">The whole report of {}</a></p>\n</section>\n",
        escape_html(&contents.input.heading()),
        super::protocol(contents),
        super::warnings(contents),
        contents.overviews.iter().take(1).chain(&contents.published).map(table::table).collect::<String>(),
        claims::list(&contents.claims),
        figures(&contents.figures),
        escape_url(&format!("{experiment}/report.html")),
        escape_html(experiment),
    )
}
