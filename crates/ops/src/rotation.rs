//! Rotation of vectors by small rotation vectors.

use burn::tensor::Tensor;

/// Rotates each row by Rodrigues' formula, `v + a ω×v + b ω×(ω×v)` with θ = |ω|, `a = sin θ/θ` and `b = (1 − cos θ)/θ²`.
///
/// `rotations` ω `[R, 3]` in radians, `vectors` v `[R, 3]` → `[R, 3]`; differentiable in both, also at ω = 0: a and b are
/// polynomials in θ² of degree 4 (Taylor), within 3e-8 up to θ = 1 and 3e-5 up to θ = 2.
pub fn rotate(vectors: Tensor<2>, rotations: Tensor<2>) -> Tensor<2> {
    let squared = rotations.clone().square().sum_dim(1);
    let a = polynomial(&squared, [1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0]);
    let b = polynomial(&squared, [0.5, -1.0 / 24.0, 1.0 / 720.0, -1.0 / 40_320.0, 1.0 / 3_628_800.0]);
    let once = rotations.clone().cross(vectors.clone(), 1);
    let twice = rotations.cross(once.clone(), 1);
    vectors + once * a + twice * b
}

fn polynomial(x: &Tensor<2>, coefficients: [f64; 5]) -> Tensor<2> {
    let [rest @ .., last] = coefficients;
    rest.into_iter().rev().fold(x.zeros_like() + last, |sum, c| sum * x.clone() + c)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::{to_host, upload_rows};

    fn exact(v: [f64; 3], w: [f64; 3]) -> [f64; 3] {
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let angle = w.iter().map(|w| w * w).sum::<f64>().sqrt();
        let (a, b) =
            if angle > 1e-6 { (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle)) } else { (1.0, 0.5) };
        let (once, twice) = (cross(w, v), cross(w, cross(w, v)));
        [0, 1, 2].map(|i| v[i] + a * once[i] + b * twice[i])
    }

    #[test]
    fn value_and_gradient_match_the_formula_and_its_differences() {
        let vectors = [[0.3, -0.8, 0.52], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8]];
        let rotations = [[0.0, 0.0, 0.0], [0.3, -0.7, 0.5], [0.02, 0.0, -0.01]];
        let weights = [0.7, -1.1, 0.4];
        let device = Device::flex().autodiff();
        let rows = |rows: &[[f64; 3]]| {
            upload_rows(&rows.as_flattened().iter().map(|x| *x as f32).collect::<Vec<_>>(), 3, &device)
        };
        let (v, w) = (rows(&vectors).require_grad(), rows(&rotations).require_grad());
        let rotated = rotate(v.clone(), w.clone());
        let gradients = (rotated.clone() * rows(&[weights; 3])).sum().backward();
        let found = [to_host(v.grad(&gradients).unwrap()), to_host(w.grad(&gradients).unwrap())];
        let loss = |v, w| exact(v, w).iter().zip(weights).map(|(x, weight)| x * weight).sum::<f64>();
        for (row, value) in to_host(rotated).chunks_exact(3).enumerate() {
            let (v, w) = (vectors[row], rotations[row]);
            for (axis, want) in exact(v, w).into_iter().enumerate() {
                approx::assert_abs_diff_eq!(f64::from(value[axis]), want, epsilon = 2e-7);
                let nudged = |of: [f64; 3], by: f64| std::array::from_fn(|i| of[i] + if i == axis { by } else { 0.0 });
                let difference = |f: &dyn Fn(f64) -> f64| (f(1e-4) - f(-1e-4)) / 2e-4;
                let want = [difference(&|h| loss(nudged(v, h), w)), difference(&|h| loss(v, nudged(w, h)))];
                for (found, want) in found.iter().zip(want) {
                    approx::assert_abs_diff_eq!(f64::from(found[3 * row + axis]), want, epsilon = 2e-6);
                }
            }
        }
    }
}
