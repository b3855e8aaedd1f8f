//! Charts of ordinary, extreme and non-finite numbers.

use infonerf_report::chart::{
    Axis, AxisScale, Bar, ChartFrame, Mark, Series, bar_chart, frontier_chart, heat_map, line_chart, marked_chart,
    standalone,
};
use proptest::prelude::*;

fn series(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points }
}

/// Draws every chart of the same numbers.
fn all_charts(points: Vec<(f64, f64)>, scale: AxisScale) -> Vec<String> {
    let axis = |label: &str| Axis { label: label.into(), scale };
    let frame = ChartFrame { title: "Title".into(), x: axis("x"), y: axis("y") };
    let bars = points.iter().map(|&(x, y)| Bar { label: "b".into(), value: x, spread: Some(y) }).collect::<Vec<_>>();
    let grid = vec![points.iter().map(|point| Some(point.0)).collect(), vec![None]];
    let labels = ["p".to_owned(), "q".to_owned()];
    let marks: Vec<Mark> = points.iter().map(|&point| Mark { label: "m".into(), point }).collect();
    let all = [series("a", points.clone()), series("b", points)];
    vec![
        line_chart(&frame, &all).unwrap(),
        frontier_chart(&frame, &all).unwrap(),
        bar_chart(&frame, &bars).unwrap(),
        heat_map(&frame, &labels, &labels, &grid).unwrap(),
        marked_chart(&frame, &all, &marks).unwrap().svg,
    ]
}

/// Published figures next to curves, as SVG and as an image.
#[test]
fn marks_have_their_labels() {
    let frame = ChartFrame {
        title: "PSNR over training time".into(),
        x: Axis::log("training (s)"),
        y: Axis::linear("PSNR (dB)"),
    };
    let curve = |name, gain| series(name, [10.0, 20.0, 60.0, 300.0].map(|s: f64| (s, gain + 0.8 * s.log10())).to_vec());
    let mark = |label: &str, x, y| Mark { label: label.into(), point: (x, y) };
    let marks = [
        mark("InfoNeRF (RTX 2080 Ti)", 18_000.0, 18.92),
        mark("FreeNeRF (a GPU, 8 scenes)", 10_800.0, 18.81),
        mark("SplatFields (RTX 3090)", 4200.0, 18.89),
        mark("3DGS + hull (RTX 3090)", 600.0, 16.44),
        mark("ZeroRF (A100, 8 scenes)", 1500.0, 21.94),
    ];
    let drawing = marked_chart(&frame, &[curve("infonerf", 18.4), curve("nerf", 17.0)], &marks).unwrap();
    if let Ok(kept) = std::env::var("KEEP_CHART") {
        drawing.picture.save(kept).unwrap();
    }
    assert!(marks.iter().all(|mark| drawing.svg.contains(&mark.label)), "{}", drawing.svg);
    assert_eq!(drawing.picture.dimensions(), (1040, 640));
    // Blue of the first curve, and ink.
    let has = |wanted: [u8; 3]| drawing.picture.pixels().any(|pixel| pixel.0 == wanted);
    assert!(has([0, 126, 196]) && has([1, 2, 3]));
}

#[test]
fn ink_follows_the_page_and_a_file_has_its_own() {
    let svg =
        bar_chart(&ChartFrame::new("T", "", "y"), &[Bar { label: "<a>".into(), value: 1.5, spread: None }]).unwrap();
    assert!(svg.contains("currentColor") && !svg.contains("#010203"));
    assert!(svg.contains("&lt;a&gt;") && svg.contains("1.50"));
    assert!(standalone(&svg).starts_with("<svg style="));
}

#[test]
fn no_numbers_make_an_empty_chart() {
    for svg in all_charts(Vec::new(), AxisScale::Log) {
        assert!(svg.contains("Title") && svg.trim_end().ends_with("</svg>"));
    }
}

proptest! {
    #[test]
    fn any_numbers_make_a_chart(points in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY), 0..6), scale in 0usize..3) {
        for svg in all_charts(points, [AxisScale::Linear, AxisScale::Log, AxisScale::SymmetricLog][scale]) {
            prop_assert!(svg.trim_end().ends_with("</svg>"));
            prop_assert!(!svg.contains("NaN"));
        }
    }
}
