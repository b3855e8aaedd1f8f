use crate::host::distribution::Distributions;
use crate::host::numeric::log_ratio;
use crate::host::rays::{Group, RayKernel};

/// Inputs: τ and τ̃. Output: the divergence of each pair of rays, `[R]`; 0 if either hits nothing.
#[derive(Debug)]
pub(super) struct DivergenceKernel {
    pub(super) epsilon: f32,
}

impl RayKernel<2> for DivergenceKernel {
    /// Computes KL(p ‖ q) = Σ p ln((p + ε)/(q + ε)) in nats.
    ///
    /// Σ (p − q) = 0 is subtracted term by term, which leaves a sum of Bregman divergences: each is ≥ 0, and of second
    /// order where p ≈ q, so nothing cancels. With a = p + ε, b = q + ε: Σ [a ln(a/b) − (a − b)] − ε Σ ln(a/b).
    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, near]: [&[f32]; 2], out: &mut [f32]) {
        let [p, q] = [Distributions::new::<FMA>(tau, &group), Distributions::new::<FMA>(near, &group)];
        let epsilon = f64::from(self.epsilon);
        let logs = log_ratio::<FMA>(&p.p, &q.p, epsilon);
        for (out, (masses, other)) in out.iter_mut().zip(p.rays.iter().zip(&q.rays)) {
            if masses.hits() && other.hits() {
                let term = |i: usize| ((p.p[i] + epsilon) * logs[i] - (p.p[i] - q.p[i])) - epsilon * logs[i];
                *out = masses.range.clone().map(term).sum::<f64>() as f32;
            }
        }
    }

    #[inline(always)]
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        [tau, near]: [&[f32]; 2],
        grad: &[f32],
        [mut dtau, mut dnear]: [Option<&mut [f32]>; 2],
    ) {
        let [p, q] = [Distributions::new::<FMA>(tau, &group), Distributions::new::<FMA>(near, &group)];
        let epsilon = f64::from(self.epsilon);
        // ∂KL/∂p − 1 = ln((p + ε)/(q + ε)) − ε/(p + ε) and ∂KL/∂q + 1 = 1 − p/(q + ε): both keep their digits where p ≈
        // q. The constants cancel by normalisation.
        let mut dp = log_ratio::<FMA>(&p.p, &q.p, epsilon);
        let mut dq = vec![0.0; dp.len()];
        for (((dp, dq), &p), &q) in dp.iter_mut().zip(&mut dq).zip(&p.p).zip(&q.p) {
            *dp -= epsilon / (p + epsilon);
            *dq = (epsilon - (p - q)) / (q + epsilon);
        }
        for (ray, &grad) in grad.iter().enumerate().filter(|(ray, _)| p.rays[*ray].hits() && q.rays[*ray].hits()) {
            let grad = f64::from(grad);
            if let Some(dtau) = &mut dtau {
                p.through_normalisation(ray, &dp, |i, g| dtau[i] = (grad * g) as f32);
            }
            if let Some(dnear) = &mut dnear {
                q.through_normalisation(ray, &dq, |i, g| dnear[i] = (grad * g) as f32);
            }
        }
    }
}
