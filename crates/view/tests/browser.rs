//! Pages in headless Chromium. `just test-view` runs them; `cargo test` alone leaves them out, as they need a browser.

mod common;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use base64::prelude::{BASE64_STANDARD, Engine};
use common::{device, plan, plan_of, read, train};
use infonerf_experiment::{Resume, Trained};
use infonerf_render::{RenderedImage, render_image};
use infonerf_view::{Server, page};

const SIZE: u32 = 64;

/// The document of a page as it is after `budget_ms` of the browser's own time, which passes faster where nothing is due.
fn document(address: &str, budget_ms: u32) -> String {
    let chosen = std::env::var("CHROMIUM").ok();
    let known = ["chromium", "chromium-browser", "google-chrome"];
    let profile = tempfile::tempdir().unwrap();
    for name in chosen.iter().map(String::as_str).chain(known) {
        let output = Command::new(name)
            .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--window-size=300,200", "--dump-dom"])
            .arg(format!("--virtual-time-budget={budget_ms}"))
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(address)
            .output();
        if let Ok(output) = output {
            return String::from_utf8_lossy(&output.stdout).into_owned();
        }
    }
    panic!("no Chromium found: install it (Debian: apt-get install chromium) or set CHROMIUM to its path");
}

/// The value of an attribute in a document.
fn attribute<'a>(document: &'a str, name: &str) -> Option<&'a str> {
    document.split_once(&format!("{name}=\""))?.1.split_once('"').map(|(value, _)| value)
}

/// What a page draws of a camera, `[SIZE², 3]` bytes.
fn pixels(page: &Path, query: &str) -> Vec<u8> {
    let document = document(&format!("file://{}#{query}&size={SIZE}", page.display()), 600_000);
    let words = || document.split_once("class=\"message\"").map(|(_, rest)| rest.chars().take(300).collect::<String>());
    let pixels = attribute(&document, "data-pixels").unwrap_or_else(|| panic!("no pixels: {:?}", words()));
    let rgba = BASE64_STANDARD.decode(pixels).unwrap();
    rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    -10.0 * (squares.sum::<f64>() / a.len() as f64 / 255f64.powi(2)).log10()
}

/// A training view as the page draws it and as the program renders it, and how far apart they are, in dB.
fn drawn_and_rendered(page: &Path, run: &Trained, view: usize) -> (Vec<u8>, RenderedImage, f64) {
    let camera = run.scene().train[view].camera.resized(SIZE, SIZE);
    let image = render_image(run.renderer(), &run.models(), &camera);
    let rendered = infonerf_metrics::to_rgb8(&image.rgb, SIZE, SIZE).unwrap();
    let drawn = pixels(page, &format!("camera={view}"));
    let apart = psnr(&drawn, &rendered);
    (drawn, image, apart)
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn the_page_draws_what_the_program_renders() {
    let out = tempfile::tempdir().unwrap();
    let set = ["train.iterations=300", "scene.size=64", "eval.test=first-1"];
    let folder = train(out.path(), &plan("infonerf+", &set), Resume::Never, None);
    let run = read(&folder);
    let file = folder.join("page.html");
    fs::write(&file, page(&run, None).unwrap()).unwrap();
    let length = fs::metadata(&file).unwrap().len();
    for view in [0, 2] {
        let (drawn, image, colour) = drawn_and_rendered(&file, &run, view);
        eprintln!("camera {view}: {colour:.1} dB, page of {length} bytes");
        assert!(colour > 35.0, "camera {view}: {colour} dB");
        // Depth as the report shows it.
        let (near, far) = (run.scene().near, run.scene().far);
        let depth = infonerf_report::depth_image(&image.depth, &image.acc, SIZE, SIZE, near, far).unwrap();
        let of_depth = psnr(&pixels(&file, &format!("camera={view}&mode=depth")), &depth);
        eprintln!("camera {view}: depth {of_depth:.1} dB");
        assert!(of_depth > 25.0, "camera {view}: depth {of_depth} dB");
        assert!(pixels(&file, &format!("camera={view}&mode=normals")) != drawn);
    }
    assert!(length <= 1_000_000, "{length} bytes");
}

/// NeRF's MLP, mip-NeRF's and Neural Volumes, none of which the page can evaluate.
#[test]
#[ignore = "needs a browser: just test-view"]
fn the_page_draws_what_is_baked() {
    for (experiment, variant) in
        [("integration", "infonerf"), ("integration", "mipnerf"), ("baselines", "neural-volumes")]
    {
        let out = tempfile::tempdir().unwrap();
        let set = ["train.iterations=300", "eval.test=first-1"];
        let folder = train(out.path(), &plan_of(experiment, variant, &set), Resume::Never, None);
        let run = read(&folder);
        let file = folder.join("page.html");
        let start = Instant::now();
        fs::write(&file, page(&run, None).unwrap()).unwrap();
        let (seconds, length) = (start.elapsed().as_secs_f64(), fs::metadata(&file).unwrap().len());
        for view in [0, 2] {
            let (drawn, _, colour) = drawn_and_rendered(&file, &run, view);
            eprintln!("{variant}, camera {view}: {colour:.1} dB, page of {length} bytes in {seconds:.1} s");
            assert!(colour > 30.0, "{variant}, camera {view}: {colour} dB");
            for mode in ["depth", "normals"] {
                assert!(pixels(&file, &format!("camera={view}&mode={mode}")) != drawn, "{variant}: {mode}");
            }
        }
        assert!(length <= 12_000_000, "{variant}: {length} bytes");
    }
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn the_live_page_shows_a_run() {
    let out = tempfile::tempdir().unwrap();
    train(out.path(), &plan("infonerf", common::TINY), Resume::Never, None);
    let server = Server::start(out.path(), "127.0.0.1:0".parse().unwrap(), device(), None).unwrap();
    let url = server.url();
    std::thread::spawn(move || server.wait());
    let document = document(&url, 20_000);
    for part in ["synthetic-4view/crane/infonerf/seed0", "<h1>crane/infonerf/seed0</h1>", "4 steps", "at step 4"] {
        assert!(document.contains(part), "{part}: {document}");
    }
    assert_eq!(document.matches("alt=\"photograph ").count(), 4);
}
