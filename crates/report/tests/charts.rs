//! Charts of ordinary and of impossible numbers.

use infonerf_report::chart::{
    Axis, Bar, Frame, Series, bar_chart, heat_map, line_chart, power_law_chart, scatter_chart, standalone,
};
use proptest::prelude::*;

fn series(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points }
}

/// Every chart of the same numbers.
fn all_charts(points: Vec<(f64, f64)>, log: bool) -> Vec<String> {
    let axis = |label: &str| Axis { label: label.into(), log };
    let frame = Frame { title: "Title".into(), x: axis("x"), y: axis("y") };
    let bars = points.iter().map(|&(x, y)| Bar { label: "b".into(), value: x, spread: Some(y) }).collect::<Vec<_>>();
    let grid = vec![points.iter().map(|point| Some(point.0)).collect(), vec![None]];
    let labels = ["p".to_owned(), "q".to_owned()];
    let all = [series("a", points.clone()), series("b", points)];
    vec![
        line_chart(&frame, &all).unwrap(),
        power_law_chart(&frame, &all).unwrap(),
        scatter_chart(&frame, &all, true).unwrap(),
        bar_chart(&frame, &bars).unwrap(),
        heat_map(&frame, &labels, &labels, &grid).unwrap(),
    ]
}

#[test]
fn the_exponent_is_in_the_legend() {
    let cost = series("rays", (0..5).map(|i| (2f64.powi(i), 3.0 * 2f64.powi(2 * i))).collect());
    let svg = power_law_chart(&Frame::new("Cost", "rays", "ms"), &[cost]).unwrap();
    assert!(svg.contains("rays: x^2.00"), "{svg}");
}

#[test]
fn ink_follows_the_page_and_a_file_has_its_own() {
    let svg = bar_chart(&Frame::new("T", "", "y"), &[Bar { label: "<a>".into(), value: 1.5, spread: None }]).unwrap();
    assert!(svg.contains("currentColor") && !svg.contains("#010203"));
    assert!(svg.contains("&lt;a&gt;") && svg.contains("1.50"));
    assert!(standalone(&svg).starts_with("<svg style="));
}

#[test]
fn no_numbers_make_an_empty_chart() {
    for svg in all_charts(Vec::new(), true) {
        assert!(svg.contains("Title") && svg.trim_end().ends_with("</svg>"));
    }
}

proptest! {
    #[test]
    fn any_numbers_make_a_chart(points in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY), 0..6), log: bool) {
        for svg in all_charts(points, log) {
            prop_assert!(svg.trim_end().ends_with("</svg>"));
            prop_assert!(!svg.contains("NaN"));
        }
    }
}
