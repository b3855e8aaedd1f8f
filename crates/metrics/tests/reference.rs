//! Metrics against scikit-image and NumPy (`reference.json`, made by `reference.py`), and on arbitrary input.

use crate::common::pictures;
use approx::assert_abs_diff_eq;
use infonerf_metrics::protocol::{Ssim, SsimWindow};
use infonerf_metrics::{Depths, Mask, Networks, Pair, Picture, Protocol, depth_error, evaluate, silhouette_iou, ssim};
use proptest::prelude::*;
use serde_json::Value;

/// Generates the mask by the rule of `reference.py`.
fn mask(width: usize, height: usize) -> Mask {
    let inside = |i: usize| (3 * (i % width) + 2 * (i / width)) % 7 < 3;
    Mask::new((0..width * height).map(inside).collect(), width, height).unwrap()
}

#[test]
fn metrics_agree_with_the_reference() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("reference.json")).unwrap();
    assert_eq!(cases.len(), 4);
    for case in cases {
        let size = |key: &str| case[key].as_u64().unwrap() as usize;
        let (width, height) = (size("width"), size("height"));
        let (render, truth) = pictures(width, height);
        let mask = mask(width, height);
        let pair = Pair { mask: Some(&mask), ..Pair::new(&render, &truth) };
        // The images have 8-bit values, so that rounding changes nothing.
        let set = evaluate(&[pair], &Networks::none(), &Protocol::default()).unwrap().set;
        for key in ["psnr", "psnr_masked", "ssim", "ssim_masked", "sharpness"] {
            let epsilon = if key.starts_with("psnr") { 1e-5 } else { 1e-6 };
            assert_abs_diff_eq!(set[key].unwrap(), case[key].as_f64().unwrap(), epsilon = epsilon);
        }
        for (key, data_range) in [("ssim_uniform", 1.0), ("ssim_uniform_range_2", 2.0)] {
            let value = ssim(&render, &truth, Ssim { window: SsimWindow::Uniform7, data_range }).unwrap();
            assert_abs_diff_eq!(value, case[key].as_f64().unwrap(), epsilon = 1e-6);
        }
    }
}

proptest! {
    #[test]
    fn no_input_panics(
        render in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..200),
        truth in prop::collection::vec(prop::array::uniform3(-1f32..2.0), 0..200),
        inside in prop::collection::vec(any::<bool>(), 0..200),
        sizes in prop::array::uniform3((1usize..14, prop_oneof![0usize..14, Just(usize::MAX)])),
    ) {
        let picture = |pixels: &[[f32; 3]], (width, height): (usize, usize)| {
            Picture::new(pixels[..pixels.len().min(width.saturating_mul(height))].to_vec(), width, height)
        };
        let depth = [render.as_flattened(), truth.as_flattened()];
        let _ = (depth_error(depth[0], depth[1]), silhouette_iou(depth[0], depth[1]));
        let _ = picture(&render, sizes[0]);
        let (Ok(render), Ok(truth)) = (picture(&truth, sizes[0]), picture(&truth, sizes[1])) else { return Ok(()) };
        let mask = Mask::new(inside, sizes[2].0, sizes[2].1).ok();
        let depths = Some(Depths { render: depth[0], truth: depth[1] });
        for depths in [None, depths] {
            for protocol in [Protocol::INFONERF, Protocol::REGNERF, Protocol::NEURAL_BODY] {
                let pair = Pair { mask: mask.as_ref(), depths, ..Pair::new(&render, &truth) };
                let _ = evaluate(&[pair, Pair::new(&render, &render)], &Networks::none(), &protocol);
            }
        }
    }
}
