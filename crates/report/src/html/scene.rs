//! Section of one scene: images in a grid, then its curves.

use base64::prelude::{BASE64_STANDARD, Engine};

use crate::{
    Quantity, Run,
    colormap::{to_bytes, turbo, viridis},
    contents::SceneContents,
    gallery::{GalleryImage, GalleryView, ImageKind, KINDS, Shots},
    text::{escape_html, escape_url},
};

/// Returns the id of the section of the scene at `index`.
pub(super) fn anchor(index: usize) -> String {
    format!("scene-{index}")
}

pub(super) fn section((index, scene): (usize, &SceneContents)) -> String {
    let grid = |view: &GalleryView| grid(scene, view);
    let gallery = match scene.gallery.views.as_slice() {
        [] => "<p class=\"muted\">No images.</p>\n".to_owned(),
        [first, more @ ..] => grid(first) + &legend(scene) + &folded(more, grid),
    };
    format!(
        "<section id=\"{}\">\n<h2>{}</h2>\n{gallery}{}{}</section>\n",
        anchor(index),
        escape_html(&scene.name),
        viewers(scene),
        super::figures(&scene.figures),
    )
}

/// Embeds the runs' pages in 3D, each behind a line: a browser loads a page once its line is opened.
fn viewers(scene: &SceneContents) -> String {
    let viewer = |(label, path): (&String, &Option<String>)| {
        let (label, path) = (escape_html(label), path.as_ref()?);
        Some(format!(
            "<details class=\"viewer\"><summary>In 3D: {label}</summary>\n\
             <iframe loading=\"lazy\" title=\"{label} in 3D\" src=\"{}\"></iframe>\n</details>\n",
            escape_url(path)
        ))
    };
    scene.labels.iter().zip(&scene.gallery.viewers).filter_map(viewer).collect()
}

/// Lays out one view with the meaning of its colours, for a page of several experiments; empty without images.
pub(super) fn first_view(scene: &SceneContents) -> String {
    scene.gallery.views.first().map_or(String::new(), |view| grid(scene, view) + &legend(scene))
}

fn grid(scene: &SceneContents, view: &GalleryView) -> String {
    let columns = scene.labels.len() + 1;
    format!(
        "<div class=\"scroll\"><div class=\"view\" style=\"--columns:{columns}\">\n{}{}</div></div>\n",
        headings(scene),
        rows(view),
    )
}

/// Maximum number of scenes in the figure at the top of a page.
const MAX_PANEL_SCENES: usize = 4;

/// Lays out the figure at the top of a page: truth and render of every variant, one view of each of the first scenes.
pub(super) fn panel(scenes: &[SceneContents]) -> String {
    let figure = |picture: &GalleryImage, class: &str, label: &str, note: &str| {
        let picture = image(picture, class, &picture.path);
        format!(
            "<figure>{picture}<figcaption>{}<small>{}</small></figcaption></figure>\n",
            escape_html(label),
            escape_html(note)
        )
    };
    let of_scene = |scene: &SceneContents| {
        let view = scene.gallery.views.first()?;
        let truth = view.truth.as_ref().map(|truth| figure(truth, "truth", "Truth", &scene.name));
        let runs = scene.labels.iter().zip(&scene.gallery.runs).zip(&view.shots);
        let renders = runs.filter_map(|((label, run), shots)| {
            let psnr = Quantity::PSNR.value(&run.record).map(|psnr| format!("{} dB", Quantity::PSNR.format(psnr)));
            Some(figure(shots.render.as_ref()?, "render", label, &psnr.unwrap_or_default()))
        });
        let images: Vec<String> = truth.into_iter().chain(renders).collect();
        let panel = format!("<div class=\"panel\" style=\"--images:{}\">\n{}</div>\n", images.len(), images.concat());
        (!images.is_empty()).then_some(panel)
    };
    scenes.iter().filter_map(of_scene).take(MAX_PANEL_SCENES).collect()
}

/// Lays out further views behind a line that opens them.
fn folded(views: &[GalleryView], grid: impl Fn(&GalleryView) -> String) -> String {
    if views.is_empty() {
        return String::new();
    }
    let names: Vec<String> = views.iter().map(|view| escape_html(&view.name)).collect();
    let grids: String = views.iter().map(grid).collect();
    format!("<details><summary>More views: {}</summary>\n{grids}</details>\n", names.join(", "))
}

fn headings(scene: &SceneContents) -> String {
    let heading = |(label, run): (&String, &&Run)| {
        let tag = if run.record.collapsed { " <span class=\"tag\">collapsed</span>" } else { "" };
        format!("<div class=\"head\">{}{tag}<small>{}</small></div>", escape_html(label), scores(run))
    };
    let runs: String = scene.labels.iter().zip(&scene.gallery.runs).map(heading).collect();
    let trained_on = scene.gallery.runs.iter().all(|run| run.record.test_views.protocol == "training");
    let view = if trained_on { "training view" } else { "test view" };
    format!("<div></div><div class=\"head\">Truth<small>{view}</small></div>{runs}\n")
}

/// Formats the run's means, such as `18.92 dB · SSIM 0.788 · seed 0`.
fn scores(run: &Run) -> String {
    let shown = |quantity: Quantity, before: &str, after: &str| {
        Some(format!("{before}{}{after}", quantity.format(quantity.value(&run.record)?)))
    };
    let seed = Some(format!("seed {}", run.record.seed));
    let parts = [shown(Quantity::PSNR, "", " dB"), shown(Quantity::SSIM, "SSIM ", ""), seed];
    parts.into_iter().flatten().collect::<Vec<_>>().join(" · ")
}

/// Lays out rows of render, depth and error, with the truth next to the renders.
fn rows(view: &GalleryView) -> String {
    let kinds = KINDS.iter().filter(|(_, kind)| view.shots.iter().any(|shots| kind(shots).is_some()));
    let row = |(index, (name, kind)): (usize, &ImageKind)| {
        let truth = match (index, &view.truth) {
            (0, Some(truth)) => image(truth, "truth", &format!("view {} of the truth", view.name)),
            (0, None) => "<div class=\"empty\">no truth</div>".to_owned(),
            _ => "<div></div>".to_owned(),
        };
        let cells = view.shots.iter().map(|shots| match kind(shots) {
            Some(picture) => image(picture, name, &picture.path),
            None => "<div class=\"empty\">none</div>".to_owned(),
        });
        let view = if index == 0 { format!("<small>view {}</small>", escape_html(&view.name)) } else { String::new() };
        format!("<div class=\"side\">{name}{view}</div>{truth}{}\n", cells.collect::<String>())
    };
    kinds.enumerate().map(row).collect()
}

fn image(picture: &GalleryImage, class: &str, description: &str) -> String {
    format!(
        "<img class=\"{class}\" alt=\"{}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{}\">",
        escape_html(description),
        picture.width,
        picture.height,
        BASE64_STANDARD.encode(&picture.png),
    )
}

/// Explains the colours of depth and error, and how to compare.
fn legend(scene: &SceneContents) -> String {
    let any = |kind: fn(&Shots) -> &Option<GalleryImage>| {
        scene.gallery.views.iter().flat_map(|view| &view.shots).any(|shots| kind(shots).is_some())
    };
    let bar = |low: &str, map: fn(f32) -> [f32; 3], high: &str| {
        let stops: Vec<String> = (0..=8)
            .map(|i| {
                let [r, g, b] = to_bytes(map(i as f32 / 8.0));
                format!("rgb({r} {g} {b})")
            })
            .collect();
        format!(
            "<span class=\"scale\">{low}<i style=\"background:linear-gradient(90deg,{})\"></i>{high}</span>",
            stops.join(",")
        )
    };
    let depth = if any(|shots| &shots.depth) { bar("Depth: far", turbo, "near") } else { String::new() };
    let error = if any(|shots| &shots.error) { bar("Error: 0", viridis, "0.5") } else { String::new() };
    let comparable = scene.gallery.views.iter().any(|view| view.truth.is_some());
    let hint = if comparable { "<span>Hold a render to see the truth in its place.</span>" } else { "" };
    format!("<p class=\"legend muted\">{depth}{error}{hint}</p>\n")
}
