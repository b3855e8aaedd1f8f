//! Every table of the paper in one report, at a size that takes seconds.

use crate::common::{Invocation, Workplace, records};

/// Settings of a network of a few neurons, trained for a few steps of a few rays.
pub(crate) const TINY: &str = "--set scene.size=16 --set field.layers=1 --set field.width=8 --set field.density=softplus \
                    --set render.samples=8 --set render.occupancy.warmup=2 --set train.iterations=3 --set train.rays=16 \
                    --set eval.test=first-1 --set eval.information_rays=16";

fn tiny(place: &Workplace, args: &str) -> Invocation {
    place.run("reproduce").args(TINY).args(args)
}

#[test]
fn statements_are_tested_beside_the_papers_figures() {
    let place = Workplace::new();
    let args = "--only baseline --only information --scene knot --seed 0";
    let statement = "On a narrow baseline: both losses ≥ entropy alone > none";
    tiny(&place, args).succeeds_with(&[statement, "PSNR (dB): narrow-entropy > narrow-none", "(paper +3.58)"]);
    let root = place.path("runs/reproduce");
    assert_eq!((records(&root.join("baseline")).len(), records(&root.join("information")).len()), (8, 3));
    let html = place.read("runs/reproduce/report.html");
    // The page has the paper's figure, a difference of protocol, and a verdict.
    assert!(html.contains("18.41") && html.contains("Images: 16 pixels here; 800 pixels in the paper."));
    assert!(["holds", "does not hold", "undecided"].iter().any(|verdict| html.contains(verdict)));
    assert!(html.contains("href=\"baseline/report.html\"") && root.join("baseline/report.html").is_file());

    // Rows are in the order of the file, and narrow and wide variants have different views.
    let list = records(&root.join("baseline"));
    let order: Vec<&str> = list.iter().map(|record| record["variant"].as_str().unwrap()).collect();
    let rows = ["none", "kl", "entropy", "both"];
    let expected: Vec<String> = ["narrow", "wide"].iter().flat_map(|b| rows.map(|row| format!("{b}-{row}"))).collect();
    assert_eq!(order, expected);
    assert_ne!(list[0]["train_views"], list[4]["train_views"]);

    tiny(&place, args).succeeds_with(&["(8 runs, 8 finished before)"]);
}

#[test]
fn bad_input() {
    let place = Workplace::new();
    tiny(&place, "--only nonsense").fails_with(&["nonsense", "baseline"]);
    tiny(&place, "--only views --scene nonsense").fails_with(&["--scene nonsense"]);
    assert!(!place.path("runs").exists(), "nothing is written before the plan is whole");
    tiny(&place, "--only information --scene knot --seed 0").succeeds();
    let other = "--only information --scene knot --seed 0 --set train.rays=17";
    tiny(&place, other).fails_with(&["config.toml", "another config"]);
}
