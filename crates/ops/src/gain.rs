//! Information gain between neighbouring rays.

use burn::tensor::{Tensor, TensorData};

use crate::composite::{MIN_ALPHA_SUM, Padding, plain_alpha};
use crate::{Segments, has_host_kernels};

/// KL(P(r) ‖ P(r̃)) of paired rays in nats (InfoNeRF, Eq. 9), `[R]`.
///
/// KL = Σ pᵢ [ln(pᵢ + ε) − ln(qᵢ + ε)] with p = α/Σα of `tau` and q the same of `near`; samples are paired by index.
/// `epsilon` > 0 bounds the divergence of disjoint rays at −ln ε nats (the released code has 1e-10). A pair in which
/// either ray hits nothing (Σα < 1e-30) gives 0 with zero gradient.
///
/// - `tau`, `near`: optical depths, both `[M]` and shared out by the same `segments`.
///
/// For the reverse direction of the released code swap the arguments.
///
/// # Panics
/// If the shapes do not match `segments`, or `epsilon` is not positive.
pub fn information_gain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number a packed sample");
    assert_eq!(near.dims(), [segments.samples()], "near holds one number a packed sample");
    assert!(epsilon > 0.0, "epsilon must be positive: it bounds the divergence");
    #[cfg(feature = "flex")]
    if has_host_kernels(&tau.device()) {
        return crate::kernel::apply2(host::GainKernel { segments: segments.clone(), epsilon }, tau, near);
    }
    let _ = has_host_kernels;
    plain(tau, near, segments, epsilon)
}

/// The same from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::from_data(TensorData::new(vec![0f32; segments.rays()], [segments.rays()]), &device);
    }
    let padding = Padding::new(segments, &device);
    let density = |tau: Tensor<1>| {
        let alpha = plain_alpha(padding.apply(tau));
        let sum = alpha.clone().sum_dim(1);
        let missed = sum.clone().lower_elem(MIN_ALPHA_SUM);
        (alpha / sum.mask_fill(missed.clone(), 1.0), missed)
    };
    let (p, p_missed) = density(tau);
    let (q, q_missed) = density(near);
    let gap = (p.clone() + epsilon).log() - (q + epsilon).log();
    (p * gap).sum_dim(1).mask_fill(p_missed, 0.0).mask_fill(q_missed, 0.0).squeeze_dim(1)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use super::MIN_ALPHA_SUM;
    use crate::Segments;
    use crate::composite::density;
    use crate::kernel::{Kernel, Pass};
    use crate::numeric::alpha;

    #[derive(Debug)]
    pub(super) struct GainKernel {
        pub(super) segments: Segments,
        pub(super) epsilon: f32,
    }

    impl Kernel for GainKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.segments.rays()]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let &[tau, near] = inputs else { unreachable!("information gain has two inputs") };
            (0..self.segments.rays())
                .into_par_iter()
                .with_min_len(64)
                .map(|ray| {
                    let range = self.segments.range(ray);
                    let Some(pair) = Pair::new(&tau[range.clone()], &near[range], self.epsilon) else { return 0.0 };
                    pair.terms().map(|(p, ln_p, _, ln_q)| f64::from(p) * f64::from(ln_p - ln_q)).sum::<f64>() as f32
                })
                .collect()
        }

        fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let Pass { inputs, grad, .. } = pass;
            let &[tau, near] = inputs else { unreachable!("information gain has two inputs") };
            let (mut dtau, mut dnear) = (vec![0.0; tau.len()], vec![0.0; near.len()]);
            self.segments
                .split_mut(&mut dtau, 1)
                .into_par_iter()
                .zip(self.segments.split_mut(&mut dnear, 1))
                .enumerate()
                .with_min_len(64)
                .for_each(|(ray, (dtau, dnear))| {
                    let range = self.segments.range(ray);
                    if let Some(pair) = Pair::new(&tau[range.clone()], &near[range], self.epsilon) {
                        pair.backward(grad[ray], dtau, dnear);
                    }
                });
            vec![wanted[0].then_some(dtau), wanted[1].then_some(dnear)]
        }
    }

    struct Pair<'a> {
        tau: &'a [f32],
        near: &'a [f32],
        sums: [f32; 2],
        epsilon: f32,
    }

    impl<'a> Pair<'a> {
        fn new(tau: &'a [f32], near: &'a [f32], epsilon: f32) -> Option<Self> {
            let sum = |tau: &[f32]| tau.iter().map(|&tau| f64::from(alpha(tau))).sum::<f64>() as f32;
            let sums = [sum(tau), sum(near)];
            (sums[0] >= MIN_ALPHA_SUM && sums[1] >= MIN_ALPHA_SUM).then_some(Self { tau, near, sums, epsilon })
        }

        /// `(p, ln(p + ε), q, ln(q + ε))` of each pair of samples.
        fn terms(&self) -> impl Iterator<Item = (f32, f32, f32, f32)> + '_ {
            let lns = self.sums.map(f32::ln);
            self.tau.iter().zip(self.near).map(move |(&tau, &near)| {
                let (p, ln_p) = density(tau, self.sums[0], lns[0], self.epsilon);
                let (q, ln_q) = density(near, self.sums[1], lns[1], self.epsilon);
                (p, ln_p, q, ln_q)
            })
        }

        /// ∂/∂p = ln(p+ε) + p/(p+ε) − ln(q+ε), ∂/∂q = −p/(q+ε), then through the normalisations p = α/S:
        /// ∂/∂αᵢ = (gᵢ − Σ pⱼ gⱼ)/S, and dα/dτ = e^−τ.
        fn backward(&self, grad: f32, dtau: &mut [f32], dnear: &mut [f32]) {
            let slopes = |(p, ln_p, q, ln_q): (f32, f32, f32, f32)| {
                (ln_p - ln_q + p / (p + self.epsilon), -p / (q + self.epsilon))
            };
            let (mut mean_p, mut mean_q) = (0f64, 0f64);
            for term in self.terms() {
                let (gp, gq) = slopes(term);
                mean_p += f64::from(term.0) * f64::from(gp);
                mean_q += f64::from(term.2) * f64::from(gq);
            }
            for (i, term) in self.terms().enumerate() {
                let (gp, gq) = slopes(term);
                dtau[i] = grad * (f64::from(gp) - mean_p) as f32 * (-self.tau[i]).exp() / self.sums[0];
                dnear[i] = grad * (f64::from(gq) - mean_q) as f32 * (-self.near[i]).exp() / self.sums[1];
            }
        }
    }
}
