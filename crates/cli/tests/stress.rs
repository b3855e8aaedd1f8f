//! The stress benchmarks, in small: bounds hold, and every number is finite.

use crate::common::Workplace;
use serde_json::Value;

fn results(place: &Workplace, name: &str) -> Value {
    serde_json::from_str(&place.read(&format!("runs/bench/{name}/results.json"))).unwrap()
}

#[test]
fn every_operation_holds_its_bounds() {
    let place = Workplace::new();
    let stdout = place.run("bench stress --rays 400").succeeds_with(&["flex: compositing", "ndarray: compositing"]);
    assert!(!stdout.contains("preset"), "{stdout}");
    place.run("bench stress --scene knot").fails_with(&["--scene"]);
    let results = results(&place, "stress");
    assert_eq!(results["non_finite"], 0);
    let rows = results["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["holds"] == true), "{stdout}");
    // There are only few exceptions.
    let exceptions = rows.iter().filter(|row| !row["exception"].is_null()).count();
    assert!(exceptions * 20 < rows.len(), "{exceptions} of {}", rows.len());
}

#[test]
fn the_older_backend_agrees_with_flex() {
    let place = Workplace::new();
    let stdout = place.run("bench agreement --device ndarray").stdout();
    let rows = &results(&place, "agreement")["rows"];
    let rows = rows.as_array().unwrap();
    for what in ["compositing", "factored field", "NeRF, a step", "mip-NeRF, 20 steps", "PixelNeRF, 20 steps"] {
        assert!(rows.iter().any(|row| row["what"] == what && row["numbers"].as_u64() > Some(0)), "{what}: {stdout}");
    }
    assert!(rows.iter().all(|row| row["holds"] == true), "{stdout}");
    // The devices implement each operation differently, so that not all results are equal to the last digit.
    assert!(rows.iter().any(|row| row["error"].as_f64() > Some(0.0)), "{stdout}");
    place.run("bench agreement --device flex").fails_with(&["--device flex", "another device"]);
}

#[test]
fn every_setting_trains() {
    let place = Workplace::new();
    place.run("bench stress-training --seeds 1 --steps 3").succeeds();
    for row in results(&place, "stress-training")["rows"].as_array().unwrap() {
        assert_eq!((&row["stopped"], &row["not_finite"]), (&0.into(), &0.into()), "{row}");
    }
}

/// Counts the transfers of a coarse and a fine pass of NeRF with L_RGB alone.
#[test]
fn a_step_moves_each_sample_and_pixel_once() {
    let place = Workplace::new();
    let field = "field={kind=\"nerf\",layers=3,width=16,skip=1,position_frequencies=4,direction_frequencies=2,\
                 density=\"softplus\",detail=1.0}";
    let small = "bench step --preset paper --scene knot --variant factored --steps 3 --warmup 1 --set scene.size=16 \
                 --set train.rays=24 --set render.samples=10 --set render.fine_samples=6 --set loss.entropy.weight=0 \
                 --set loss.kl.weight=0 --set loss.tv.weight=0";
    // Uploads: origins, directions, radii, ends and colours of the rays; for each pass random streams, background, and of each
    // sample its place, distance, length and position. Host bodies read their inputs, and losses are read at the end.
    let counts = "per step: 0.0 launches, 17.0 uploads (16.7 kB), 12.0 reads (8.1 kB)";
    place.run(small).args(format!("--set {field}")).succeeds_with(&[counts]);
}
