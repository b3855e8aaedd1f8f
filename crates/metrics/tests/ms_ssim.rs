//! MS-SSIM against SciPy (`ms_ssim.json`, made by `ms_ssim.py`).

use crate::common::pictures;
use infonerf_metrics::{Networks, Pair, Protocol, evaluate};
use serde_json::Value;

#[test]
fn agrees_with_the_reference() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("ms_ssim.json")).unwrap();
    assert_eq!(cases.len(), 2);
    for case in cases {
        let size = |key: &str| case[key].as_u64().unwrap() as usize;
        let (render, truth) = pictures(size("width"), size("height"));
        let pair = [Pair::new(&render, &truth)];
        let set = evaluate(&pair, &Networks::none(), &Protocol::default()).unwrap().set;
        approx::assert_abs_diff_eq!(set["ms_ssim"].unwrap(), case["ms_ssim"].as_f64().unwrap(), epsilon = 1e-6);
    }
}
