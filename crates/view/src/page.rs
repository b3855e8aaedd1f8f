//! Pages of HTML with style, script and data inside.

use infonerf_report::escape_html;
use serde_json::Value;

const PAGE: &str = include_str!("../assets/page.html");
const LIVE: &str = include_str!("../assets/live.html");
const STAGE: &str = include_str!("../assets/stage.html");
const STYLE: &str = include_str!("../assets/style.css");
pub(crate) const VIEWER: &str = concat!(
    include_str!("../assets/camera.js"),
    include_str!("../assets/tables.js"),
    include_str!("../assets/bricks.js"),
    include_str!("../assets/viewer.js"),
    include_str!("../assets/overlay.js"),
    include_str!("../assets/stage.js")
);
const LIVE_SCRIPT: &str = concat!(include_str!("../assets/curves.js"), include_str!("../assets/live.js"));

/// Makes a self-contained page of one field. `poster` is an image for browsers that cannot draw the field.
pub(crate) fn of_package(package: &Value, poster: &str) -> String {
    let title = package["title"].as_str().unwrap_or_default();
    // A tag or a comment within a script could change where the script ends. In JSON, `<` is in strings alone.
    let data = package.to_string().replace('<', "\\u003c");
    let poster = format!("<img class=\"poster\" alt=\"A view of the scene\" src=\"{poster}\">");
    let stage = STAGE.replace("{{poster}}", &poster);
    PAGE.replace("{{style}}", STYLE)
        .replace("{{script}}", VIEWER)
        .replace("{{stage}}", &stage)
        .replace("{{title}}", &escape_html(title))
        .replace("{{data}}", &data)
}

/// Makes the server's page, which requests all else from the server and sends `token` with commands.
pub(crate) fn live(token: &str) -> String {
    let stage = STAGE.replace("  {{poster}}\n", "");
    LIVE.replace("{{style}}", STYLE)
        .replace("{{script}}", &format!("{VIEWER}{LIVE_SCRIPT}"))
        .replace("{{stage}}", &stage)
        .replace("{{token}}", token)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn pages_are_whole_and_self_contained() {
        let package = json!({ "title": "<b>", "note": "</script>" });
        for page in [of_package(&package, "data:image/jpeg;base64,AAAA"), live("t")] {
            assert!(!page.contains("{{") && !page.contains("http"), "{page}");
            let loaded = page.split("src=\"").skip(1).filter(|rest| !rest.starts_with("data:"));
            assert_eq!(loaded.count(), 0);
        }
        let page = of_package(&package, "data:,");
        assert!(page.contains("<title>&lt;b&gt;</title>") && page.contains("\\u003c/script>"));
        assert_eq!(page.matches("</script>").count(), 2);
    }
}
