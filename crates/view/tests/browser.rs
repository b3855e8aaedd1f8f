//! Pages in headless Chromium. `just test-view` runs them; `cargo test` alone leaves them out, as they need a browser.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::common::{TINY, device, plan, plan_of, serve, train};
use base64::prelude::{BASE64_STANDARD, Engine};
use glam::DVec3;
use infonerf_experiment::{RunPlan, Trained};
use infonerf_render::{RenderedImage, render_image};
use infonerf_view::{TrainingControl, page};
use serde_json::{Value, json};

const SIZE: u32 = 64;

/// Returns the document of a page after `budget_ms` of the browser's virtual time, which skips idle periods.
fn document(address: &str, budget_ms: u32, flags: &[&str]) -> String {
    let chosen = std::env::var("CHROMIUM").ok();
    let known = ["chromium", "chromium-browser", "google-chrome"];
    let profile = tempfile::tempdir().unwrap();
    for name in chosen.iter().map(String::as_str).chain(known) {
        let output = Command::new(name)
            .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--window-size=300,200", "--dump-dom"])
            .args(flags)
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

fn attribute<'a>(document: &'a str, name: &str) -> Option<&'a str> {
    document.split_once(&format!("{name}=\""))?.1.split_once('"').map(|(value, _)| value)
}

fn json_attribute(document: &str, name: &str) -> Value {
    serde_json::from_str(&attribute(document, name).expect("the script ended").replace("&quot;", "\"")).unwrap()
}

fn read(folder: &Path) -> Trained {
    Trained::read(RunPlan::of_run(folder).unwrap(), folder, &device()).unwrap()
}

fn trained_page(plan: &RunPlan) -> (tempfile::TempDir, Trained, PathBuf) {
    let out = tempfile::tempdir().unwrap();
    let folder = train(out.path(), plan, None);
    let run = read(&folder);
    let file = out.path().join("page.html");
    fs::write(&file, page(&run, &folder, None).unwrap()).unwrap();
    (out, run, file)
}

/// Trains a small run on `scene`, and writes its page with `script` inserted before `place`.
fn scripted_page(scene: &str, place: &str, script: &str) -> (tempfile::TempDir, Trained, String) {
    let (out, run, file) = trained_page(&plan_of(scene, "fast-losses", "infonerf", TINY));
    let text = fs::read_to_string(&file).unwrap();
    assert_eq!(text.matches(place).count(), 1);
    fs::write(&file, text.replace(place, &format!("{script}{place}"))).unwrap();
    (out, run, format!("file://{}", file.display()))
}

/// Place of a page's script at which its stage is complete and does not draw any more.
const STOPPED: &str = "root.dataset.pixels";

/// Returns the pixels that each stage of a page drew, `[SIZE², 3]` bytes.
fn drawn(document: &str) -> Vec<Vec<u8>> {
    let rgb = |rgba: Vec<u8>| rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let stages = document.split("data-pixels=\"").skip(1).filter_map(|rest| rest.split('"').next());
    stages.map(|pixels| rgb(BASE64_STANDARD.decode(pixels).unwrap())).collect()
}

/// Returns the pixels that a page draws of a camera.
fn pixels(page: &Path, query: &str) -> Vec<u8> {
    let document = document(&format!("file://{}#{query}&size={SIZE}", page.display()), 600_000, &[]);
    let words = || document.split_once("class=\"message\"").map(|(_, rest)| rest.chars().take(300).collect::<String>());
    drawn(&document).pop().unwrap_or_else(|| panic!("no pixels: {:?}", words()))
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    -10.0 * (squares.sum::<f64>() / a.len() as f64 / 255f64.powi(2)).log10()
}

fn rendered(run: &Trained, view: usize) -> (Vec<u8>, RenderedImage) {
    let camera = run.scene().train[view].camera.resized(SIZE, SIZE);
    let image = render_image(run.renderer(), &run.fields(), &camera);
    (infonerf_metrics::to_rgb8(&image.rgb, SIZE, SIZE).unwrap().into_raw(), image)
}

/// Checks a factored field, which the page evaluates, and NeRF's MLP, mip-NeRF's and Neural Volumes, which are baked.
#[test]
#[ignore = "needs a browser: just test-view"]
fn page_draws_the_programs_renders() {
    let settings = "train.iterations=300 eval.test=first-1";
    for (experiment, variant, settings, least, most) in [
        ("fast-losses", "infonerf+", &*format!("{settings} scene.size=64"), 35.0, 1_000_000),
        ("integration", "infonerf", settings, 30.0, 12_000_000),
        ("integration", "mipnerf", settings, 30.0, 12_000_000),
        ("baselines", "neural-volumes", settings, 30.0, 12_000_000),
    ] {
        let (_out, run, file) = trained_page(&plan_of("crane", experiment, variant, settings));
        let length = fs::metadata(&file).unwrap().len();
        for view in [0, 2] {
            let (expected, image) = rendered(&run, view);
            let in_mode = |mode: &str| pixels(&file, &format!("camera={view}{mode}"));
            let [drawn, depth, normals] = ["", "&mode=depth", "&mode=normals"].map(in_mode);
            let color = psnr(&drawn, &expected);
            eprintln!("{variant}, camera {view}: {color:.1} dB, page of {length} bytes");
            assert!(color > least, "{variant}, camera {view}: {color} dB");
            assert!(depth != drawn && normals != drawn, "{variant}, camera {view}");
            if variant == "infonerf+" {
                // Depth is drawn with the colours of the report.
                let (near, far) = (run.scene().space.near, run.scene().space.far);
                let expected = infonerf_report::depth_image(&image.depth, &image.acc, SIZE, SIZE, near, far).unwrap();
                let apart = psnr(&depth, &expected);
                eprintln!("camera {view}: depth {apart:.1} dB");
                assert!(apart > 25.0, "camera {view}: depth {apart} dB");
            }
        }
        assert!(length <= most, "{variant}: {length} bytes");
    }
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn controls_move_the_camera() {
    let (_out, run, address) = scripted_page("crane", STOPPED, include_str!("browser/controls.js"));
    let seen = json_attribute(&document(&format!("{address}#camera=0&size=8"), 60_000, &[]), "data-controls");
    let place = |name: &str, what: &str| {
        let number = |i: usize| seen[name][what][i].as_f64().unwrap_or_else(|| panic!("{name}: {seen}"));
        DVec3::new(number(0), number(1), number(2))
    };
    let (eye, target) = (|name| place(name, "eye"), |name| place(name, "target"));
    let distance = |name| eye(name).distance(target(name));
    let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
    let whole = distance("start");
    for (name, state) in seen.as_object().unwrap() {
        assert!(state["followed"] == true, "the twin stage did not follow: {name}");
    }

    assert!(near(distance("turned"), whole) && target("turned").distance(target("start")) < 1e-6 * whole);
    assert!(eye("turned").distance(eye("start")) > 0.1 * whole);
    assert_eq!(eye("reset"), eye("start"));
    // Panning moves eye and target by the same vector. A pointer that is released moves nothing.
    let by = eye("moved") - eye("start");
    assert!(by.length() > 0.01 * whole && (target("moved") - target("start")).distance(by) < 1e-6 * whole);
    assert_eq!(seen["let go"], seen["moved"]);
    assert!(near(distance("scrolled"), whole * (-0.2f64).exp()), "{}", distance("scrolled") / whole);
    assert!(near(distance("pinched"), 0.5 * whole), "{}", distance("pinched") / whole);
    assert!(near(distance("right"), whole) && eye("right").distance(eye("start")) > 0.05 * whole);
    assert!(near(distance("plus"), 0.9 * whole));
    assert_eq!(seen["another key"], seen["plus"]);
    let third = run.scene().train[2].camera.position().as_dvec3();
    assert!(eye("third image").distance(third) < 1e-4 * whole, "{third}");
    assert_eq!((&seen["third image"]["mode"], &seen["depth"]["mode"]), (&0.into(), &1.into()));
    assert_eq!((&seen["depth"]["frusta"], &seen["frusta"]["frusta"]), (&false.into(), &true.into()));
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn forward_facing_scene_is_turned_no_farther_than_its_cameras() {
    let (_out, _, address) = scripted_page("facade", STOPPED, include_str!("browser/turn.js"));
    let turned = json_attribute(&document(&format!("{address}#size=8"), 60_000, &[]), "data-turned");
    let limit = turned["limit"].as_f64().unwrap();
    assert!(limit < 1.0, "{turned}");
    for angle in turned["angles"].as_array().unwrap() {
        let angle = angle.as_f64().unwrap();
        assert!(angle <= limit && angle > limit - 0.11, "{turned}");
    }
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn image_at_rest_is_whole_where_drawing_is_slow() {
    let end = "} catch (error) {\n  showFallback(root, error, scene);";
    let (_out, _, address) = scripted_page("crane", end, include_str!("browser/slow.js"));
    let document = document(&address, 6_000_000, &["--window-size=300,400"]);
    let cases = json_attribute(&document, "data-cases");
    assert_eq!(cases.as_array().unwrap().len(), 6);
    for case in cases.as_array().unwrap() {
        assert!(case["mixed"] == 0 && case["changed"] != 0, "{case}");
    }
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn browser_without_webgl_shows_the_reason_and_the_images() {
    let (_out, _, address) = scripted_page("crane", STOPPED, "");
    let document = document(&address, 10_000, &["--disable-3d-apis"]);
    let message = document.split_once("<p class=\"message\"").unwrap().1.split_once("</p>").unwrap().0;
    assert!(message.starts_with('>') && message.contains("WebGL"), "{message}");
    assert_eq!(document.matches("alt=\"training image ").count(), 4);
}

#[test]
#[ignore = "needs a browser: just test-view"]
fn live_page_shows_a_run() {
    let out = tempfile::tempdir().unwrap();
    let folder = train(out.path(), &plan("infonerf", TINY), None);
    // Losses of 0 and less are drawn like others.
    let event = |step: u32| {
        let loss = 0.5 - 0.25 * f64::from(step);
        json!({ "event": "step", "step": step, "loss": loss, "losses": { "rgb": 0.01, "kl": loss } }).to_string() + "\n"
    };
    fs::write(folder.join("metrics.jsonl"), (1..=8).map(event).collect::<String>()).unwrap();
    let document = document(&format!("http://{}/", serve(out.path(), None)), 20_000, &[]);
    for part in ["<h1>fast-losses/crane/infonerf/seed0</h1>", "4 steps", "total -1.5"] {
        assert!(document.contains(part), "{part}: {document}");
    }
    assert_eq!(document.matches("alt=\"training image ").count(), 4);
    let curve = |name: &str| {
        let tag = document.split("<path ").find(|tag| tag.contains(&format!("data-name=\"{name}\""))).unwrap();
        attribute(tag, "d").unwrap().replace('L', "M").matches('M').count()
    };
    assert_eq!(["total", "kl", "rgb"].map(curve), [8; 3]);
    for tick in ["0", "-1"] {
        assert!(document.contains(&format!("text-anchor=\"end\">{tick}</text>")), "{tick}");
    }
}

/// A factored field and a baked one are drawn as the program renders them, from the camera that the page gave to both.
#[test]
#[ignore = "needs a browser: just test-view"]
fn two_runs_are_compared_under_one_camera() {
    let out = tempfile::tempdir().unwrap();
    let settings = "train.iterations=150 eval.test=first-1";
    let exact = train(out.path(), &plan("infonerf", &format!("{settings} scene.size=64")), None);
    let baked = train(out.path(), &plan_of("crane", "integration", "mipnerf", settings), None);
    let url = format!("http://{}/", serve(out.path(), None));
    let run = |folder: &Path| format!("0/{}", folder.strip_prefix(out.path()).unwrap().display());
    let query = format!("run={}&beside={}&camera=2&size={SIZE}", run(&exact), run(&baked));
    let document = document(&format!("{url}#{query}"), 600_000, &["--window-size=1400,700"]);
    let drawn = drawn(&document);
    assert_eq!(drawn.len(), 2, "{document}");
    for (folder, drawn) in [exact, baked].iter().zip(&drawn) {
        let apart = psnr(drawn, &rendered(&read(folder), 2).0);
        eprintln!("{}: {apart:.1} dB", folder.display());
        assert!(apart > 28.0, "{}: {apart} dB", folder.display());
    }
}

/// A page of another site, open in the same browser, tries everything that a browser allows.
#[test]
#[ignore = "needs a browser: just test-view"]
fn page_of_another_site_cannot_stop_a_run() {
    let out = tempfile::tempdir().unwrap();
    let training = TrainingControl::default();
    let url = format!("http://{}/", serve(out.path(), Some(training.clone())));
    let evil = include_str!("browser/evil.html").replace("{{url}}", &url);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let elsewhere = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let _ = stream.read(&mut [0; 4096]);
            let head = "HTTP/1.1 200 OK\r\ncontent-type: text/html\r\nconnection: close";
            let answer = format!("{head}\r\ncontent-length: {}\r\n\r\n{evil}", evil.len());
            let _ = stream.write_all(answer.as_bytes());
        }
    });
    // Another name than the server's makes it another site.
    let document = document(&format!("http://localhost:{}/", elsewhere.port()), 10_000, &[]);
    assert_eq!(attribute(&document, "data-ended"), Some("6"), "{document}");
    assert!(!training.is_paused() && !training.is_stopped());
    assert!(!training.is_watched(Duration::from_secs(60)), "the page was framed, or its state asked for");
}
