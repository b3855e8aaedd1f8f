//! Layout of the report in headless Chromium: `cargo test` alone leaves it out, as it needs a browser.

use std::{fs, process::Command};

use infonerf_report::{ReportInput, write_report};

use crate::report::example;

/// Script that names the headings, images, charts and table titles that are cut at the right or left.
const CUT: &str = include_str!("browser/cut.js");

#[test]
#[ignore = "needs a browser: just test-view"]
fn nothing_is_cut_at_any_width() {
    let root = tempfile::tempdir().unwrap();
    let mut records = example(root.path());
    for record in &mut records {
        record.notes.push("`render.residuals` with a-very-long-name-that-no-line-of-a-narrow-screen-can-hold".into());
    }
    let input = ReportInput::new("synthetic-4view", "Few-shot-radiance-fields-of-procedural-scenes", records);
    let report = write_report(&input, root.path()).unwrap();
    let page = fs::read_to_string(&report).unwrap().replace("</body>", &format!("<script>{CUT}</script></body>"));
    fs::write(&report, page).unwrap();
    for width in [390, 1000, 1400] {
        let wrapper = format!(
            "<script>addEventListener('message', (event) => document.body.dataset.found = JSON.stringify(event.data));</script>
             <iframe src=\"report.html\" style=\"width:{width}px;height:900px;border:0\"></iframe>"
        );
        let file = root.path().join("wrapper.html");
        fs::write(&file, wrapper).unwrap();
        let chosen = std::env::var("CHROMIUM").ok();
        let known = ["chromium", "chromium-browser", "google-chrome"];
        let run = |name: &str| {
            let mut command = Command::new(name);
            command.args(["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1500,1000", "--dump-dom"]);
            command.arg("--virtual-time-budget=10000");
            command.arg(format!("--user-data-dir={}", root.path().join("profile").display()));
            command.arg(format!("file://{}", file.display())).output().ok()
        };
        let ran = chosen.iter().map(String::as_str).chain(known).find_map(run);
        let output = ran.expect("Chromium: install it (Debian: apt-get install chromium) or set CHROMIUM to its path");
        let document = String::from_utf8_lossy(&output.stdout);
        let found = document.split_once("data-found=\"").expect("the page's script ran").1.split_once('"').unwrap().0;
        let found: serde_json::Value = serde_json::from_str(&found.replace("&quot;", "\"")).unwrap();
        assert_eq!((&found["width"], &found["scrolls"]), (&width.into(), &false.into()), "{found}");
        assert!(found["cut"].as_array().unwrap().is_empty() && found["count"].as_u64().unwrap() > 20, "{found}");
        assert_eq!(found["figureFirst"], true, "{found}");
    }
}
