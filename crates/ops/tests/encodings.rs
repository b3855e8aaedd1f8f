//! Encodings and their gradients with respect to positions and variances: every body against the oracle in `f64`.

use crate::common::{Draws, RayImplementation, floats, wide};
use burn::tensor::Tensor;
use infonerf_ops::{frequency, frequency_encode, integrated_encode, upload_rows};

/// Error of a sine, and of a gradient relative to the highest frequency, by which its terms are scaled.
const WAVE: f64 = 3e-7;
const WINDOW: [f32; 6] = [1.0, 1.0, 0.5, 1.0, 0.25, 0.0];

/// Encodes rows of three means and three variances, of which the encoding without `integrate` ignores the variances.
fn encode(body: RayImplementation, integrate: bool, means: Tensor<2>, variances: Tensor<2>) -> Tensor<2> {
    match (body, integrate) {
        (RayImplementation::Kernel, true) => integrated_encode(means, variances, WINDOW.len(), &WINDOW),
        (RayImplementation::Kernel, false) => frequency_encode(means, WINDOW.len(), &WINDOW),
        _ => frequency::plain(means, integrate.then_some(variances), &WINDOW),
    }
}

#[test]
fn bodies_match_the_oracle_in_value_and_gradient() {
    let mut draws = Draws(8);
    let means: Vec<f32> = (0..300).map(|_| 3.0 * draws.signed()).collect();
    let variances: Vec<f32> = (0..300).map(|_| 10f64.powf(draws.unit() * 4.0 - 4.0) as f32).collect();
    let window = wide(&WINDOW);
    for (body, integrate) in RayImplementation::ALL.into_iter().flat_map(|body| [(body, false), (body, true)]) {
        let device = body.device().autodiff();
        let [m, v] = [&means, &variances].map(|rows| upload_rows(rows, 3, &device).require_grad());
        let out = encode(body, integrate, m.clone(), v.clone());
        let [rows, columns] = out.dims();
        let upstream = draws.row(rows * columns);
        let grads = (out.clone() * upload_rows(&upstream, columns, &device)).sum().backward();
        let (out, dmeans) = (floats(out), floats(m.grad(&grads).unwrap()));
        let dvariances = v.grad(&grads).map(floats);
        assert_eq!(dvariances.is_some(), integrate, "{body:?}");
        // The encoding of points begins with the point itself.
        let first = columns - 6 * WINDOW.len();
        for (i, (&x, &variance)) in means.iter().zip(&variances).enumerate() {
            let (x, variance) = (f64::from(x), if integrate { f64::from(variance) } else { 0.0 });
            let (start, axis) = (i / 3 * columns, i % 3);
            let at = |l: usize, cosine: usize| start + first + 6 * l + 3 * cosine + axis;
            let want = infonerf_oracle::waves(x, variance, &window);
            let u: Vec<[f64; 2]> = (0..want.len()).map(|l| [0, 1].map(|c| f64::from(upstream[at(l, c)]))).collect();
            for (l, want) in want.iter().enumerate() {
                for (cosine, want) in want.iter().enumerate() {
                    assert!((out[at(l, cosine)] - want).abs() <= WAVE, "{body:?}, {x}, frequency {l}");
                }
            }
            let [mut along, fading] = infonerf_oracle::waves_gradient(x, variance, &window, &u);
            if !integrate {
                assert_eq!(out[start + axis], x, "{body:?}");
                along += f64::from(upstream[start + axis]);
            }
            let highest = 2f64.powi(WINDOW.len() as i32);
            assert!((dmeans[i] - along).abs() <= WAVE * highest, "{body:?}, {x}: {} against {along}", dmeans[i]);
            if let Some(dvariances) = &dvariances {
                let got = dvariances[i];
                assert!((got - fading).abs() <= WAVE * highest * highest, "{body:?}, {x}: {got} against {fading}");
            }
        }
    }
}
