use std::f64::consts::LOG2_E;

use crate::host::distribution::Distributions;
use crate::host::numeric::ln;
use crate::host::rays::{Group, RayKernel};

/// Number of outputs per ray: entropy in bits, and Σα.
pub(super) const COLUMNS: usize = 2;

/// Input: τ. Output: entropy and Σα of each ray, `[R, 2]`.
#[derive(Debug)]
pub(super) struct EntropyKernel {
    pub(super) epsilon: f32,
}

/// Computes ln(p + ε) of each sample. If ε is 0, a probability counts as at least the smallest normal `f32` over the ray's
/// sum, so that its gradient is finite.
#[inline(always)]
fn logs<const FMA: bool>(Distributions { p, rays, .. }: &Distributions, epsilon: f64) -> Vec<f64> {
    let mut logs: Vec<f64> = p.iter().map(|p| p + epsilon).collect();
    if epsilon == 0.0 {
        for masses in rays {
            let least = f64::from(f32::MIN_POSITIVE) / if masses.hits() { masses.sum } else { 1.0 };
            logs[masses.range.clone()].iter_mut().for_each(|p| *p = p.max(least));
        }
    }
    for log in &mut logs {
        *log = ln::<FMA>(*log);
    }
    // A probability above ½ is exact to all digits as 1 − rest/sum.
    for masses in rays.iter().filter(|masses| masses.hits() && 2.0 * masses.rest < masses.sum) {
        logs[masses.top] = (epsilon - masses.rest / masses.sum).ln_1p();
    }
    logs
}

impl RayKernel<1> for EntropyKernel {
    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau]: [&[f32]; 1], out: &mut [f32]) {
        let distributions = Distributions::new::<FMA>(tau, &group);
        let logs = logs::<FMA>(&distributions, f64::from(self.epsilon));
        for (masses, out) in distributions.rays.iter().zip(out.chunks_exact_mut(COLUMNS)) {
            let range = masses.range.clone();
            // −Σ p ln(p + ε), 0 for a ray that hits nothing.
            let nats =
                -distributions.p[range.clone()].iter().zip(&logs[range.clone()]).map(|(p, log)| p * log).sum::<f64>();
            out[0] = (nats * LOG2_E) as f32;
            out[1] = distributions.opacity.alpha[range].iter().sum::<f64>() as f32;
        }
    }

    #[inline(always)]
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        [tau]: [&[f32]; 1],
        grad: &[f32],
        [dtau]: [Option<&mut [f32]>; 1],
    ) {
        let Some(dtau) = dtau else { return };
        let distributions = Distributions::new::<FMA>(tau, &group);
        let epsilon = f64::from(self.epsilon);
        // ∂H/∂p + 1 = −ln(p + ε) − p/(p + ε) + 1. The constant cancels by normalisation.
        let mut dp = logs::<FMA>(&distributions, epsilon);
        for (dp, &p) in dp.iter_mut().zip(&distributions.p) {
            *dp = if epsilon > 0.0 { epsilon / (p + epsilon) - *dp } else { -*dp };
        }
        let transmittance = &distributions.opacity.transmittance;
        for (ray, (masses, grad)) in distributions.rays.iter().zip(grad.chunks_exact(COLUMNS)).enumerate() {
            let [dbits, dsum] = [f64::from(grad[0]), f64::from(grad[1])];
            if dsum != 0.0 {
                let range = masses.range.clone();
                for (dtau, transmittance) in dtau[range.clone()].iter_mut().zip(&transmittance[range]) {
                    *dtau = (dsum * transmittance) as f32;
                }
            }
            if masses.hits() {
                let scale = dbits * LOG2_E;
                distributions.through_normalisation(ray, &dp, |i, g| dtau[i] += (scale * g) as f32);
            }
        }
    }
}
