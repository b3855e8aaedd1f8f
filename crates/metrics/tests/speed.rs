//! Speed of SSIM: 25 views at 400² take less than a second in a release build.

use std::time::Instant;

use infonerf_metrics::{Picture, protocol::Ssim, ssim};

#[test]
#[ignore = "a timing; run with --release -- --ignored --nocapture"]
fn ssim_of_25_views_takes_under_a_second() {
    let view = |shift: usize| {
        let pixels = (0..160_000).map(|i| [((i * 7 + shift) % 256) as f32 / 255.0; 3]).collect();
        Picture::new(pixels, 400, 400).unwrap()
    };
    let (render, truth) = (view(0), view(40));
    let start = Instant::now();
    for _ in 0..25 {
        ssim(&render, &truth, Ssim::default()).unwrap();
    }
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 1.0, "took {seconds:.2} s");
}
