use crate::host::distribution::Distributions;
use crate::host::rays::{Group, RayKernel};

/// Inputs: τ and τ̃. Output: the divergence of each pair of rays, `[R]`.
#[derive(Debug)]
pub(super) struct DivergenceKernel {
    pub(super) epsilon: f32,
}

impl RayKernel<2> for DivergenceKernel {
    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, near]: [&[f32]; 2], out: &mut [f32]) {
        let [p, q] = [Distributions::new::<FMA>(tau, &group), Distributions::new::<FMA>(near, &group)];
        p.divergences::<FMA>(&q, self.epsilon, out);
    }

    #[inline(always)]
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        [tau, near]: [&[f32]; 2],
        grad: &[f32],
        gradients: [Option<&mut [f32]>; 2],
    ) {
        let [p, q] = [Distributions::new::<FMA>(tau, &group), Distributions::new::<FMA>(near, &group)];
        p.divergence_gradients::<FMA>(&q, self.epsilon, grad, gradients);
    }
}
