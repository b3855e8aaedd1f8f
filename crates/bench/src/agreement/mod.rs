//! Agreement of a device with flex, whose kernels are tested against the oracle: operations and their gradients, gradients of
//! whole steps of every kind of field, and a few steps of training.

mod comparison;
mod networks;
mod operations;
mod training;

use anyhow::{Result, ensure};
use fastrand::Rng;
use infonerf_experiment::{DeviceName, open};
use infonerf_report::TextTable;
use serde_json::json;

use crate::context::Bench;
use comparison::{DeviceComparison, DeviceComparisons, mean_difference, worst};
use training::{FIELDS, STEPS, loss_difference};

/// Maximum error of a gradient of a whole step, relative to the largest of its parameter: devices sum in another order.
const GRADIENT: f64 = 2e-3;
/// Maximum relative error of a loss in the following steps, where Adam, which divides by the size of gradients, magnifies it.
const LOSS: f64 = 1e-2;
/// Maximum mean difference of a render's values after those steps.
const COLOR: f64 = 5e-3;

const PROTOCOL: &str = "a device against flex on the same inputs; error of an operation or gradient: the largest |got - want| over \
                        the largest |want| of its array; of a loss: |got - want|/max(|want|, 0.01), the largest of all steps and terms; \
                        of a render: the mean |got - want| of its values in [0, 1]";

/// Compares operations, gradients and training steps of a device with flex.
pub fn run(bench: &Bench, device: DeviceName, print: &mut dyn FnMut(&str)) -> Result<bool> {
    let (tested, flex) = (open(device)?, open(DeviceName::Flex)?);
    ensure!(
        tested.name != flex.name,
        "--device {device}: agreement is with flex; expected another device that is built in"
    );
    print(&bench.machine());
    let plan = &bench.plans[0];
    // Results are saved after each group, so that they stay if the rest is interrupted.
    let save = |rows: &[DeviceComparison]| {
        let more = json!({ "against": flex.name.name(), "adapter": tested.adapter });
        bench.save_results(PROTOCOL, rows, more)
    };
    let mut compare = DeviceComparisons { tested: &tested.device, reference: &flex.device, rows: Vec::new() };
    print("comparing operations");
    let rng = &mut Rng::with_seed(comparison::SEED);
    for group in operations::GROUPS.into_iter().chain([networks::all as operations::Group]) {
        group(rng, &mut compare);
        save(&compare.rows)?;
    }
    let mut rows = compare.rows;
    for field in &FIELDS {
        print(&format!("training: {}", field.name));
        let (got, want) = (field.gradients(plan, &tested.device)?, field.gradients(plan, &flex.device)?);
        let of = format!("gradients of {} parameters", want.len());
        let numbers = want.iter().map(Vec::len).sum();
        rows.push(DeviceComparison::new(&format!("{}, a step", field.name), of, numbers, worst(&got, &want), GRADIENT));
        let (got, want) = (field.course(plan, &tested.device)?, field.course(plan, &flex.device)?);
        let what = format!("{}, {STEPS} steps", field.name);
        let numbers = want.losses.iter().map(|losses| losses.len()).sum();
        rows.push(DeviceComparison::new(&what, "losses".into(), numbers, loss_difference(&got, &want), LOSS));
        let difference = mean_difference(&got.render, &want.render);
        rows.push(DeviceComparison::new(&what, "render".into(), want.render.len(), difference, COLOR));
        save(&rows)?;
    }
    let table = TextTable::new(
        &rows,
        &[
            ("what", |row: &DeviceComparison| row.what.clone()),
            ("of", |row| row.of.clone()),
            ("values", |row| row.numbers.to_string()),
            ("error", |row| row.error.map_or_else(|| "none".into(), |error| format!("{error:.1e}"))),
            ("bound", |row| format!("{:.0e}", row.bound)),
            ("holds", |row| if row.holds { "yes" } else { "NO" }.into()),
        ],
    );
    print(&format!("\n{}", table.to_text()));
    bench.save_csv(&table)?;
    let broken = rows.iter().filter(|row| !row.holds).count();
    print(&format!("{} of {} agree with {}", rows.len() - broken, rows.len(), flex.name));
    Ok(broken == 0)
}
