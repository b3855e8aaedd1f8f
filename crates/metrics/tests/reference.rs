//! Metrics against scikit-image, SciPy and NumPy (`reference.json`, made by `reference.py`), and on arbitrary input.

use approx::assert_abs_diff_eq;
use infonerf_metrics::{MetricError, compare, depth_rmse, gmsd, psnr, sharpness, ssim};
use proptest::prelude::*;
use serde_json::Value;

type Pixels = Vec<[f32; 3]>;

/// Render and truth by the rule of `reference.py`.
fn images(width: usize, height: usize) -> (Pixels, Pixels) {
    let truth = |x: usize, y: usize, c: usize| (3 * x * x + 5 * y * y + x * y * (c + 1)) / 4 % 256;
    let render = |x: usize, y: usize, c: usize| 3 * truth(x, y, c) / 4 + (5 * x + 3 * y + 11 * c) % 64;
    let pixels = |rule: &dyn Fn(usize, usize, usize) -> usize| {
        let pixel = |i: usize| std::array::from_fn(|c| rule(i % width, i / width, c) as f32 / 255.0);
        (0..width * height).map(pixel).collect()
    };
    (pixels(&render), pixels(&truth))
}

#[test]
fn image_metrics_agree_with_the_reference() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("reference.json")).unwrap();
    assert_eq!(cases.len(), 4);
    for case in cases {
        let size = |key: &str| case[key].as_u64().unwrap() as usize;
        let expected = |key: &str| case[key].as_f64().unwrap();
        let (width, height) = (size("width"), size("height"));
        let (render, truth) = images(width, height);

        assert_abs_diff_eq!(psnr(&render, &truth).unwrap(), expected("psnr"), epsilon = 1e-5);
        assert_abs_diff_eq!(ssim(&render, &truth, width, height).unwrap(), expected("ssim"), epsilon = 1e-6);
        assert_abs_diff_eq!(gmsd(&render, &truth, width, height).unwrap(), expected("gmsd"), epsilon = 1e-6);
        let ratio = sharpness(&render, &truth, width, height).unwrap().unwrap();
        assert_abs_diff_eq!(ratio, expected("sharpness"), epsilon = 1e-6);
    }
}

#[test]
fn the_protocol_keeps_eight_bit_images_as_they_are() {
    let (render, truth) = images(20, 15);
    let comparison = compare(&render, &truth, 20, 15).unwrap();
    assert_abs_diff_eq!(comparison.psnr, psnr(&render, &truth).unwrap(), epsilon = 1e-5);
    assert_abs_diff_eq!(comparison.ssim.unwrap(), ssim(&render, &truth, 20, 15).unwrap(), epsilon = 1e-6);
}

proptest! {
    #[test]
    fn metrics_never_panic(
        render in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..200),
        truth in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..200),
        width in 0usize..20,
        height in prop_oneof![0usize..20, Just(usize::MAX)],
    ) {
        let _ = compare(&render, &truth, width, height);
        let _ = ssim(&render, &truth, width, height);
        let _ = gmsd(&render, &truth, width, height);
        let _ = sharpness(&render, &truth, width, height);
        let _ = depth_rmse(render.as_flattened(), truth.as_flattened());
    }

    #[test]
    fn metrics_are_in_range(seed in 0usize..1000, width in 11usize..20, height in 11usize..20) {
        let (render, truth) = images(width + seed % 7, height);
        let (width, pixels) = (width + seed % 7, truth.len());
        let similarity = ssim(&render, &truth, width, height).unwrap();
        prop_assert!((-1.0..=1.0).contains(&similarity));
        prop_assert!((0.0..=1.0).contains(&gmsd(&render, &truth, width, height).unwrap()));
        prop_assert_eq!(ssim(&truth, &render, width, height).unwrap(), similarity);
        let wrong = MetricError::Length { what: "truth", found: pixels, expected: pixels + width };
        prop_assert_eq!(gmsd(&render, &truth, width, height + 1), Err(wrong));
    }
}
