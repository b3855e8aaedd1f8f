use crate::host::distribution::Distributions;
use crate::host::rays::{Group, RayKernel};

/// Number of outputs per ray: entropy in bits, and Σα.
pub(super) const COLUMNS: usize = 2;

/// Input: τ. Output: entropy and Σα of each ray, `[R, 2]`.
#[derive(Debug)]
pub(super) struct EntropyKernel {
    pub(super) epsilon: f32,
}

impl RayKernel<1> for EntropyKernel {
    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau]: [&[f32]; 1], out: &mut [f32]) {
        let distributions = Distributions::new::<FMA>(tau, &group);
        for (range, row) in group.ranges().zip(out.chunks_exact_mut(COLUMNS)) {
            row[1] = distributions.opacity.alpha[range].iter().sum::<f64>() as f32;
        }
        distributions.entropies::<FMA>(self.epsilon, |ray, nats| {
            out[ray * COLUMNS] = (nats * std::f64::consts::LOG2_E) as f32;
        });
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
        let transmittance = &distributions.opacity.transmittance;
        for (range, row) in group.ranges().zip(grad.chunks_exact(COLUMNS)).filter(|(_, row)| row[1] != 0.0) {
            for (dtau, transmittance) in dtau[range.clone()].iter_mut().zip(&transmittance[range]) {
                *dtau = (f64::from(row[1]) * transmittance) as f32;
            }
        }
        let scale = |ray: usize| f64::from(grad[ray * COLUMNS]) * std::f64::consts::LOG2_E;
        distributions.add_entropy_gradients::<FMA>(self.epsilon, scale, dtau);
    }
}
