//! Images that tests in Rust and in Python generate by the same rule.

use infonerf_metrics::Picture;

/// Generates render and truth by the rule of `reference.py`.
pub fn pictures(width: usize, height: usize) -> (Picture, Picture) {
    let truth = |x: usize, y: usize, c: usize| (3 * x * x + 5 * y * y + x * y * (c + 1)) / 4 % 256;
    let render = |x: usize, y: usize, c: usize| 3 * truth(x, y, c) / 4 + (5 * x + 3 * y + 11 * c) % 64;
    let picture = |rule: &dyn Fn(usize, usize, usize) -> usize| {
        let pixel = |i: usize| std::array::from_fn(|c| rule(i % width, i / width, c) as f32 / 255.0);
        Picture::new((0..width * height).map(pixel).collect(), width, height).unwrap()
    };
    (picture(&render), picture(&truth))
}
