//! The page of several experiments.

use super::{claims, document, figures, scene, table};
use crate::{collection::ChapterContents, text::escape_html, text::escape_url};

pub(crate) fn page(title: &str, introduction: &[String], chapters: &[ChapterContents]) -> String {
    let links = chapters.iter().enumerate();
    let links =
        links.map(|(i, chapter)| format!("<a href=\"#chapter-{i}\">{}</a>", escape_html(&chapter.input().experiment)));
    let header = format!(
        "<header>\n<h1>{}</h1>\n{}<nav><a href=\"#claims\">Claims</a>{}</nav>\n</header>\n",
        escape_html(title),
        introduction.iter().map(|line| format!("<p>{}</p>\n", escape_html(line))).collect::<String>(),
        links.collect::<String>(),
    );
    let main = summary(chapters) + &chapters.iter().enumerate().map(chapter).collect::<String>();
    document(title, &header, &main)
}

/// One line a claim.
fn summary(chapters: &[ChapterContents]) -> String {
    let rows = chapters.iter().enumerate().flat_map(|(index, chapter)| {
        chapter.contents.claims.iter().map(move |claim| {
            format!(
                "<tr><th scope=\"row\">{}</th><td class=\"name\">{}</td><td><a href=\"#chapter-{index}\">{}</a></td></tr>\n",
                claims::tag(claim.verdict),
                escape_html(&claim.statement),
                escape_html(&chapter.input().experiment),
            )
        })
    });
    format!(
        "<section id=\"claims\">\n<h2>What the paper says, and what was found here</h2>\n\
         <div class=\"scroll\"><table class=\"claims\">\n<tbody>\n{}</tbody>\n</table></div>\n</section>\n",
        rows.collect::<String>()
    )
}

fn chapter((index, chapter): (usize, &ChapterContents)) -> String {
    let contents = &chapter.contents;
    let warnings = contents.warnings.iter().map(|text| format!("<p class=\"warning\">{}</p>\n", escape_html(text)));
    let pictures = contents.scenes.first().map_or(String::new(), scene::first_view);
    format!(
        "<section id=\"chapter-{index}\">\n<h2>{}</h2>\n{}{}{}{}{}{pictures}\
         <p><a href=\"{}\">The whole report of {}</a></p>\n</section>\n",
        escape_html(&chapter.input().heading()),
        super::protocol(contents),
        warnings.collect::<String>(),
        contents.overviews.iter().take(1).chain(&contents.published).map(table::table).collect::<String>(),
        claims::list(&contents.claims),
        figures(&contents.figures),
        escape_url(&chapter.report),
        escape_html(&chapter.input().experiment),
    )
}
