use crate::host::numeric::SampleOpacity;
use crate::host::rays::{Group, RayKernel};

/// Inputs: τ and values. Output: the integrated values and Σw of each ray, `[R, C + 1]`.
#[derive(Debug)]
pub(super) struct CompositeKernel {
    pub(super) channels: usize,
}

impl RayKernel<2> for CompositeKernel {
    fn widths(&self) -> [usize; 2] {
        [1, self.channels]
    }

    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, values]: [&[f32]; 2], out: &mut [f32]) {
        let channels = self.channels;
        let opacity = SampleOpacity::new::<FMA>(tau);
        let mut sums = vec![0f64; channels];
        for (range, out) in group.ranges().zip(out.chunks_exact_mut(channels + 1)) {
            sums.fill(0.0);
            // Σw is a sum of positive numbers, which keeps digits that 1 − T would lose.
            let (mut trans, mut acc) = (1f64, 0f64);
            for i in range {
                let w = trans * opacity.alpha[i];
                trans *= opacity.transmittance[i];
                acc += w;
                for (sum, &value) in sums.iter_mut().zip(&values[i * channels..]) {
                    *sum += w * f64::from(value);
                }
            }
            for (out, sum) in out.iter_mut().zip(&sums) {
                *out = *sum as f32;
            }
            out[channels] = acc as f32;
        }
    }

    #[inline(always)]
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        [tau, values]: [&[f32]; 2],
        grad: &[f32],
        [mut dtau, mut dvalues]: [Option<&mut [f32]>; 2],
    ) {
        let channels = self.channels;
        let opacity = SampleOpacity::new::<FMA>(tau);
        // T_{i+1} and uᵢ = ∂L/∂wᵢ (`dw`) of each sample.
        let mut trans_after = vec![0f64; tau.len()];
        let mut dw = vec![0f64; tau.len()];
        for (range, grad) in group.ranges().zip(grad.chunks_exact(channels + 1)) {
            let (integrated, dacc) = (&grad[..channels], f64::from(grad[channels]));
            let mut trans = 1f64;
            for i in range.clone() {
                let w = (trans * opacity.alpha[i]) as f32;
                trans *= opacity.transmittance[i];
                trans_after[i] = trans;
                let of_sample = i * channels..(i + 1) * channels;
                let products = values[of_sample.clone()].iter().zip(integrated);
                dw[i] = products.fold(dacc, |u, (&value, &g)| u + f64::from(g) * f64::from(value));
                if let Some(dvalues) = &mut dvalues {
                    dvalues[of_sample].iter_mut().zip(integrated).for_each(|(dvalue, g)| *dvalue = g * w);
                }
            }
            let Some(dtau) = &mut dtau else { continue };
            // ∂L/∂τᵢ = uᵢ T_{i+1} − Σ_{j>i} uⱼ wⱼ = T_{i+1} eᵢ with the recurrence eᵢ = uᵢ − uᵢ₊₁ + e^−τᵢ₊₁ eᵢ₊₁, where u
            // and e are 0 behind the last sample. No sum is subtracted from another, so small gradients behind an opaque
            // sample keep their digits.
            let (mut behind, mut excess) = (0f64, 0f64);
            for i in range.rev() {
                excess += dw[i] - behind;
                behind = dw[i];
                dtau[i] = (trans_after[i] * excess) as f32;
                excess *= opacity.transmittance[i];
            }
        }
    }
}
