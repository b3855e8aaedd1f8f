//! Quality against training time: every variant with every budget, each an independent run.

use std::time::Duration;

use anyhow::Result;
use infonerf_experiment::execute::cores;
use infonerf_experiment::{RunPlan, Watch};
use infonerf_report::chart::{ChartFrame, Series, line_chart, pareto_frontier, standalone};
use infonerf_report::{Quantity, Record, Table, TableRow, overview_table};
use serde_json::json;

use crate::context::{Bench, distinct};
use crate::output::number;
use crate::trial::measured_with;

/// Keys of the metrics that have a chart.
const CHARTS: [&str; 4] = ["psnr", "ssim", "lpips_alex", "lpips_vgg"];

const PROTOCOL: &str = "each row is an independent run whose schedule follows the clock; train_seconds is training alone, \
                        without loading and evaluation; points are means over scenes and seeds";

/// Measures quality after each of the training times `budgets`, and prints the Pareto frontier.
pub fn run(bench: &Bench, budgets: &[Duration], print: &mut dyn FnMut(&str), watch: &mut Watch<'_>) -> Result<()> {
    print(&format!("{}\n", bench.heading()));
    let mut records: Vec<Record> = Vec::new();
    for plan in &bench.plans {
        for budget in budgets {
            let budget = budget.as_secs_f64();
            let record = bench.trial(&RunPlan { budget: Some(budget), ..plan.clone() }, watch)?;
            let (label, psnr, steps) = (plan.label(), number(Quantity::PSNR.value(&record), 2), record.iterations);
            print(&format!("{label} in {budget} s: {psnr} dB after {steps} steps"));
            records.push(measured_with(record, "budget", format!("{budget} s")));
            save(bench, &records)?;
        }
    }
    let table = table(&records);
    print(&format!("\n{}\nfrontier: {}", table.to_text(), frontier(&table)));
    Ok(())
}

fn table(records: &[Record]) -> Table {
    overview_table(records, &[vec![Quantity::TRAIN_SECONDS], Quantity::quality()].concat())
}

/// Returns training time and mean of each row that has both.
fn points(table: &Table, quantity: Quantity) -> Vec<(&TableRow, (f64, f64))> {
    let mean = |row: &TableRow, wanted: Quantity| {
        let column = table.columns.iter().position(|column| column.quantity == wanted)?;
        Some(row.cells[column].summary?.mean)
    };
    let point = |row| Some((mean(row, Quantity::TRAIN_SECONDS)?, mean(row, quantity)?));
    table.rows.iter().filter_map(|row| Some((row, point(row)?))).collect()
}

/// Lists the variants and budgets that no other beats in both time and PSNR.
fn frontier(table: &Table) -> String {
    let points = points(table, Quantity::PSNR);
    let best = pareto_frontier(&points.iter().map(|(_, point)| *point).collect::<Vec<_>>());
    let on_frontier = points.iter().filter(|(_, point)| best.contains(point));
    let names = on_frontier.map(|(row, _)| format!("{} in {}", row.label, row.settings.join(" ")));
    names.collect::<Vec<_>>().join(", ")
}

/// Writes all results so far, so that they stay if the rest is interrupted.
fn save(bench: &Bench, records: &[Record]) -> Result<()> {
    bench.save_results(PROTOCOL, records, json!({}))?;
    let table = table(records);
    bench.save("pareto.csv", &table.to_csv())?;
    let all = distinct(records, |record| record.scene.clone()).join(", ");
    for quantity in CHARTS.into_iter().filter_map(Quantity::named) {
        let points = points(&table, quantity);
        if points.is_empty() {
            continue;
        }
        let name = quantity.name();
        let title = format!("{name} over training time, {all}, {} CPU cores", cores());
        let frame = ChartFrame { log_x: true, ..ChartFrame::new(&title, "training (s)", &name) };
        let series = |name: String| {
            let own = points.iter().filter(|(row, _)| row.label == name);
            Series { points: own.map(|(_, point)| *point).collect(), name }
        };
        let series: Vec<Series> = distinct(&points, |(row, _)| row.label.clone()).into_iter().map(series).collect();
        bench.save(&format!("pareto-{}.svg", quantity.key), &standalone(&line_chart(&frame, &series)?))?;
    }
    Ok(())
}
