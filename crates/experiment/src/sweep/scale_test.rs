//! Ten thousand runs: planned and merged in seconds, into a page that a browser opens.

use std::fs;
use std::time::Instant;

use infonerf_report::{Record, TestViews};

use super::*;
use crate::Selection;

/// Leaves what a finished run leaves, pictures and log aside.
fn finish(folder: &Path, plan: &RunPlan, psnr: f64) {
    let record = Record {
        experiment: plan.experiment.clone(),
        scene: plan.scene.clone(),
        variant: plan.variant.clone(),
        seed: plan.seed,
        preset: plan.preset.name().into(),
        device: "flex".into(),
        train_views: vec![26, 86, 2, 55],
        test_views: TestViews { protocol: "every-8".into(), count: 25, ids: (0..200).step_by(8).collect() },
        image_size: [200, 200],
        metrics: [("psnr".to_owned(), Some(psnr)), ("lpips_alex".to_owned(), None)].into_iter().collect(),
        notes: vec!["lpips_alex: no weights".into()],
        ..Record::default()
    };
    let run = folder.join(plan.directory());
    fs::create_dir_all(&run).unwrap();
    fs::write(run.join("config.toml"), plan.to_toml().unwrap()).unwrap();
    fs::write(plan.record_path(&run), serde_json::to_vec(&[record]).unwrap()).unwrap();
    let identity = Identity::of(plan, DeviceName::Flex.name()).unwrap();
    fs::write(run.join("identity.json"), serde_json::to_vec(&identity).unwrap()).unwrap();
}

#[test]
fn ten_thousand_runs() {
    let out = tempfile::tempdir().unwrap();
    let values = |exponent: i32| (1..=100).map(|i| format!("{i}e{exponent}")).collect::<Vec<_>>().join(",");
    let selection =
        Selection { scenes: vec!["knot".into()], variants: vec!["infonerf".into()], ..Selection::default() };
    let grids = vec![format!("loss.entropy.weight={}", values(-5)), format!("loss.kl.weight={}", values(-6))];
    let options = SweepOptions { grids, selection, ..SweepOptions::default() };

    let start = Instant::now();
    let sweep = Sweep::plan("fast-losses", &options).unwrap();
    let prepared = sweep.prepare(out.path(), DeviceName::Flex).unwrap();
    let planning = start.elapsed().as_secs_f64();
    assert_eq!((sweep.len(), prepared.state().missing.len()), (10_000, 10_000));

    let folder = out.path().join("sweep-fast-losses");
    for (index, item) in sweep.items.iter().enumerate().skip(1) {
        finish(&folder, &item.plan, 15.0 + 5.0 * (index as f64).sin());
    }
    let start = Instant::now();
    let merged = sweep.merge(out.path(), DeviceName::Flex).unwrap();
    let merging = start.elapsed().as_secs_f64();
    assert_eq!(merged.missing, [sweep.items[0].plan.label()]);
    assert_eq!(read_records(&folder.join("results.json")).unwrap().len(), 9_999);
    let csv = fs::read_to_string(folder.join("table.csv")).unwrap();
    assert_eq!(csv.lines().filter(|line| line.starts_with("infonerf,")).count(), 9_999);
    assert!(csv.contains("\nvariant,λ₁,λ₂,PSNR") && csv.contains("\ninfonerf,7e-5,13e-6,"), "{}", &csv[..500]);
    assert_eq!(merged.outcome.unwrap().table.rows.len(), 64, "the terminal is shown the best");
    let megabytes = |name: &str| fs::metadata(folder.join(name)).unwrap().len() as f64 / 1e6;
    let (page, text) = (megabytes("report.html"), megabytes("report.md"));
    eprintln!(
        "10,000 runs: planned in {planning:.2} s, merged in {merging:.2} s; report.html {page:.2} MB, report.md {text:.2} MB"
    );
    assert!(page < 20.0 && text < 2.0, "report.html {page} MB, report.md {text} MB");
    // Meant are 2 s and 10 s. Machines that run tests are busy with other ones; what grows with the square takes minutes.
    assert!(planning < 20.0, "planned in {planning} s");
    assert!(merging < 100.0, "merged in {merging} s");
}
