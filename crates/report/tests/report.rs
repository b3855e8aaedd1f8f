//! Reports of runs on disk, whole and damaged.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use image::{Rgb, RgbImage};
use infonerf_metrics::{Folders, METRICS, Networks, Protocol, Summary, compare_folders, select};
use infonerf_report::chart::ChartFrame;
use infonerf_report::{
    Figure, Panel, PictureComparison, Published, PublishedRow, Quantity, Record, ReportInput, TestViews, VIEWER_PAGE,
    panel, run_directory, write_report,
};
use serde_json::json;

/// Writes two scenes, two variants and two seeds, with images and events.
pub(crate) fn example(root: &Path) -> Vec<Record> {
    let mut records = Vec::new();
    for (variant, offset) in [("nerf", 0.0), ("infonerf", 2.6)] {
        for (scene, psnr) in [("knot", 16.4), ("rods-holes", 15.1)] {
            for seed in 0..2 {
                let record = record(scene, variant, seed, psnr + offset + 0.3 * seed as f64);
                pictures(root, &record);
                events(root, &record);
                records.push(record);
            }
        }
    }
    records
}

fn folder(root: &Path, record: &Record) -> PathBuf {
    root.join(run_directory(&record.scene, &record.variant, record.seed))
}

/// Makes a record with all metrics, some of them not measured.
fn record(scene: &str, variant: &str, seed: u64, psnr: f64) -> Record {
    let value = |key: &str| match key {
        "psnr" => Some(psnr),
        "ssim" => Some(0.4 + psnr / 50.0),
        "sharpness" => Some(0.04 * psnr),
        "depth_error" => Some(6.0 / psnr),
        _ => None,
    };
    Record {
        scene: scene.into(),
        variant: variant.into(),
        seed,
        preset: "fast".into(),
        train_views: vec![26, 86, 2, 55],
        test_views: TestViews { protocol: "every-8".into(), count: 25, ids: (0..200).step_by(8).collect() },
        train_seconds: if variant == "nerf" { 48.2 } else { 55.9 },
        metrics: METRICS.iter().map(|metric| (metric.key().to_owned(), value(metric.key()))).collect(),
        ray_entropy_bits: Some(60.0 / psnr),
        notes: vec!["lpips_alex: no weights".into()],
        ..Record::default()
    }
}

fn pictures(root: &Path, record: &Record) {
    let kinds = [("test", [217, 140, 70]), ("truth", [210, 120, 80]), ("depth", [60, 90, 200]), ("error", [70, 0, 85])];
    for (kind, colour) in kinds {
        let folder = folder(root, record).join(kind);
        fs::create_dir_all(&folder).unwrap();
        for view in ["000", "008", "016"] {
            RgbImage::from_pixel(64, 64, Rgb(colour)).save(folder.join(format!("{view}.png"))).unwrap();
        }
    }
}

fn events(root: &Path, record: &Record) {
    let losses = json!({ "rgb": 0.01, "kl": 0.1 });
    let event =
        |n: u32| json!({ "event": "step", "step": n, "seconds": n, "psnr": 10 + n, "loss": 0.01, "losses": losses });
    let lines: String = (1..6).map(|step| format!("{}\n", event(step))).collect();
    fs::write(folder(root, record).join("metrics.jsonl"), lines + "{\"event\":\"st").unwrap();
}

#[test]
fn page_holds_everything_and_links_nothing() {
    let root = tempfile::tempdir().unwrap();
    let records = example(root.path());
    let mut input = ReportInput::new("synthetic-4view", "NeRF & InfoNeRF from <few> views", records);
    input.warnings.push("procedural scenes: no data folder was given".into());
    fs::write(folder(root.path(), &input.records[0]).join(VIEWER_PAGE), "<!doctype html>").unwrap();
    let html = fs::read_to_string(write_report(&input, root.path()).unwrap()).unwrap();
    assert!(html.contains("NeRF &#38; InfoNeRF from &#60;few&#62; views, 4 training views</h1>"));
    assert!(html.contains("procedural scenes: no data folder was given"));
    assert_eq!(html.matches("every-8 (25)").count(), 1, "the protocol stands once");
    assert!(html.contains("<td class=\"best\">18.50 ± 0.21</td>"));
    // 2 scenes × 3 views × (truth + 2 variants × render, depth, error), and truth and renders of both scenes at the top
    assert_eq!(html.matches("data:image/png;base64,").count(), 42 + 6);
    assert!(html.find("<img").unwrap() < html.find("<table").unwrap(), "the figure stands before the tables");
    // Three charts of all scenes; for each scene PSNR, loss, and the loss terms of each variant.
    let charts = 3 + 2 * (2 + 2);
    assert_eq!(html.matches("<svg ").count(), charts);
    assert_eq!(fs::read_dir(root.path().join("plots")).unwrap().count(), charts);
    assert!(root.path().join("figure.png").is_file());
    let pages: Vec<&str> = html.split("<iframe loading=\"lazy\"").skip(1).collect();
    assert_eq!(pages.len(), 1, "of the runs shown only one has a page in 3D");
    let path = pages[0].split_once("src=\"").unwrap().1.split('"').next().unwrap();
    assert!(root.path().join(path).is_file(), "{path}");
    for link in ["src=\"http", "href=\"http", "url(", "@import", "<link"] {
        assert!(!html.contains(link), "{link}");
    }
    assert!(html.contains("<li>knot/nerf/seed0/metrics.jsonl: cannot read 1 line</li>"));
}

/// A panel has a row per scene with the truth, and the render and depth of two variants.
#[test]
fn panel_has_a_row_for_each_scene() {
    let root = tempfile::tempdir().unwrap();
    let mut records = example(root.path());
    records.retain(|record| record.scene == "knot" || record.variant == "nerf");
    let Panel { picture: figure, left_out, .. } = panel(&records, root.path(), Some(8)).unwrap();
    assert_eq!(left_out, 0);
    assert_eq!(figure.dimensions(), (5 * 248 + 8, 2 * 264 + 8));
    let truth = RgbImage::from(image::open(root.path().join("knot/nerf/seed0/truth/008.png")).unwrap());
    let (shown, own) = (figure.get_pixel(8 + 120, 24 + 120).0, truth.get_pixel(32, 32).0);
    assert!(shown.iter().zip(own).all(|(a, b)| a.abs_diff(b) < 8), "{shown:?} {own:?}");
    let dark = |left: u32, top: u32| (0..160 * 20).any(|i| figure.get_pixel(left + i % 160, top + i / 160).0[0] < 128);
    assert!(dark(8, 0) && dark(8 + 248, 0) && dark(8, 264), "labels of the scenes and of the first column");
    let blank = |left: u32| (0..240).all(|y| figure.get_pixel(left + 120, 264 + 24 + y).0 == [255; 3]);
    assert!(blank(8 + 3 * 248) && !blank(8), "the second scene has no infonerf");
    let error = panel(&records, root.path(), Some(7)).unwrap_err().to_string();
    assert!(error.ends_with("no run has an image of test view 7; there are those of 000, 008, 016"), "{error}");
    fs::remove_file(root.path().join("knot/infonerf/seed0/test/008.png")).unwrap();
    assert_eq!(panel(&records, root.path(), Some(8)).unwrap().missing, ["knot/infonerf"]);
}

#[test]
fn missing_files_are_named_and_the_rest_is_shown() {
    let root = tempfile::tempdir().unwrap();
    let mut records = example(root.path());
    records[0].collapsed = true;
    let run = root.path().join("knot/nerf/seed0");
    fs::remove_dir_all(run.join("depth")).unwrap();
    fs::write(run.join("error/000.png"), b"\x89PNG\r\n").unwrap();
    fs::remove_file(run.join("metrics.jsonl")).unwrap();
    fs::remove_dir_all(root.path().join("rods-holes")).unwrap();

    let input = ReportInput::new("e", "Report", records);
    let html = fs::read_to_string(write_report(&input, root.path()).unwrap()).unwrap();
    assert!(html.contains("knot / nerf / seed 0 collapsed: its field went empty"));
    for start in [
        "knot/nerf/seed0/depth/000.png: ",
        "knot/nerf/seed0/error/000.png: ",
        "knot/nerf/seed0/metrics.jsonl: ",
        "rods-holes/infonerf/seed0/test: no images",
    ] {
        assert!(html.contains(&format!("<li>{start}")), "{start}");
    }
    let mut records = input.records;
    let other = Record { preset: "other".into(), ..records[1].clone() };
    records.push(other);
    let html =
        fs::read_to_string(write_report(&ReportInput::new("e", "Report", records), root.path()).unwrap()).unwrap();
    let one_of_two = "holds the images and curves of one of its runs only: ";
    assert!(html.contains(&format!("knot/nerf/seed1 {one_of_two}")) && html.matches(one_of_two).count() == 1);
}

/// A figure of all scenes is for eight variants at most, and one that is asked for has the twelve with the highest PSNR.
#[test]
fn many_variants_are_left_out_and_leave_no_stale_figure() {
    let root = tempfile::tempdir().unwrap();
    let mut records = example(root.path());
    let figure = root.path().join("figure.png");
    write_report(&ReportInput::new("e", "Report", records.clone()), root.path()).unwrap();
    assert!(figure.is_file());
    records.extend((0..11).map(|i| record("knot", &format!("other{i}"), 0, 10.0)));
    write_report(&ReportInput::new("e", "Report", records.clone()), root.path()).unwrap();
    assert!(!figure.exists());
    assert_eq!(panel(&records, root.path(), Some(8)).unwrap().left_out, 1);
}

#[test]
fn report_without_runs_is_a_page() {
    let root = tempfile::tempdir().unwrap();
    let report = write_report(&ReportInput::default(), root.path()).unwrap();
    assert!(fs::read_to_string(report).unwrap().trim_end().ends_with("</html>"));
}

#[test]
fn text_from_outside_stays_text() {
    let root = tempfile::tempdir().unwrap();
    let hostile = "<script>alert(1)</script>\"'&";
    let mut record = record(hostile, hostile, 0, 10.0);
    record.notes = vec![hostile.into()];
    let other = Record { variant: "nerf".into(), ..record.clone() };
    let mut input = ReportInput::new(hostile, hostile, vec![record, other]);
    input.warnings.push(hostile.into());
    for name in ["../λ₁", &format!("{}end", "x".repeat(300))] {
        input.figures.push(Figure::new(name, ChartFrame::new(hostile, "", ""), "<svg ></svg>".into(), hostile));
    }
    let comparison = json!({ "left": hostile, "is": "better", "right": "nerf" });
    let claim = json!({ "statement": hostile, "metric": "psnr", "comparisons": [comparison] });
    input.claims.push(serde_json::from_value(claim).unwrap());
    let figures = vec![(Quantity::PSNR, Summary { mean: 1.0, std: None, n: 1 })];
    let row = PublishedRow { variant: hostile.into(), figures, ..PublishedRow::default() };
    input.published = Some(Published { source: hostile.into(), rows: vec![row], footnotes: vec![hostile.into()] });
    let html = fs::read_to_string(write_report(&input, root.path()).unwrap()).unwrap();
    assert!(html.contains("Next to the paper: &#60;script&#62;") && html.contains("undecided"));
    assert!(!html.contains("<script>alert"));
    for name in ["---lambda1", &format!("{}--{}end", "x".repeat(59), "x".repeat(56))] {
        assert!(root.path().join(format!("plots/{name}.svg")).is_file(), "{name}");
    }
}

/// A picture that differs from its truth by 51 of 255 everywhere; the second truth is a TIFF, which browsers do not show.
#[test]
fn compared_pictures_are_in_the_page_and_their_values_in_the_json() {
    let root = tempfile::tempdir().unwrap();
    let [renders, truth] = ["renders", "truth"].map(|name| root.path().join(name));
    [&renders, &truth].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    for (name, format) in [("a", "png"), ("b", "tiff")] {
        RgbImage::from_pixel(12, 8, Rgb([151; 3])).save(renders.join(name).with_extension("png")).unwrap();
        RgbImage::from_pixel(12, 8, Rgb([100; 3])).save(truth.join(name).with_extension(format)).unwrap();
    }
    let folders = Folders { renders: &renders, truth: &truth, masks: None, partial: false };
    let (metrics, protocol) = (select(["psnr"]).unwrap(), Protocol::default());
    let compared = compare_folders(folders, &metrics, &Networks::default(), &protocol, |_, _| {}).unwrap();
    let comparison = PictureComparison { title: "ours", protocol: &protocol, compared: &compared };
    let [json, html] = comparison.write(root.path()).unwrap().map(|file| fs::read_to_string(file).unwrap());
    let values: serde_json::Value = serde_json::from_str(&json).unwrap();
    let expected = 20.0 * 5f64.log10();
    for psnr in [&values["mean"]["psnr"], &values["views"]["b"]["psnr"]] {
        assert!((psnr.as_f64().unwrap() - expected).abs() < 1e-3, "{psnr}");
    }
    let embedded = BASE64_STANDARD.encode(fs::read(truth.join("a.png")).unwrap());
    assert!(html.contains(&format!("data:image/png;base64,{embedded}")) && !html.contains("image/tiff"));
    assert_eq!(html.matches("data:image/png;base64,").count(), 4);
    assert!(comparison.to_text().lines().any(|line| line.starts_with("mean") && line.contains("13.98")));
}
