//! Charts of ordinary, extreme and non-finite numbers.

use infonerf_report::chart::{Bar, ChartFrame, Series, bar_chart, frontier_chart, heat_map, line_chart, standalone};
use proptest::prelude::*;

fn all_charts(points: &[(f64, f64)], log: bool) -> Vec<String> {
    let frame = ChartFrame { log_x: log, log_y: log, ..ChartFrame::new("Title", "x", "y") };
    let bars = points.iter().map(|&(x, y)| Bar { label: "b".into(), value: x, spread: Some(y) }).collect::<Vec<_>>();
    let grid = vec![points.iter().map(|point| Some(point.0)).collect(), vec![None]];
    let labels = ["p".to_owned(), "q".to_owned()];
    let all = ["a", "b"].map(|name| Series { name: name.into(), points: points.to_vec() });
    vec![
        line_chart(&frame, &all).unwrap(),
        frontier_chart(&frame, &all).unwrap(),
        bar_chart(&frame, &bars).unwrap(),
        heat_map(&frame, &labels, &labels, &grid).unwrap(),
    ]
}

#[test]
fn ink_follows_the_page_and_a_file_has_its_own() {
    let svg =
        bar_chart(&ChartFrame::new("T", "", "y"), &[Bar { label: "<a>".into(), value: 1.5, spread: None }]).unwrap();
    assert!(svg.contains("currentColor") && !svg.contains("#010203"));
    assert!(svg.contains("&lt;a&gt;") && svg.contains("1.50"));
    assert!(standalone(&svg).starts_with("<svg style="));
}

proptest! {
    #[test]
    fn any_numbers_make_a_chart(points in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY), 0..6), log in prop::bool::ANY) {
        for svg in all_charts(&points, log) {
            prop_assert!(svg.contains("Title") && svg.trim_end().ends_with("</svg>"));
            prop_assert!(!svg.contains("NaN"));
        }
    }
}
