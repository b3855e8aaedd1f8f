use crate::numeric::SampleOpacity;
use crate::ray_kernel::{Group, RayKernel};

/// Inputs: τ, m and δ. Output: the distortion of each ray, `[R]`.
#[derive(Debug)]
pub(super) struct DistortionKernel;

#[derive(Clone, Copy)]
struct Sample {
    w: f64,
    middle: f64,
    length: f64,
    /// Transmittance behind the sample.
    behind: f64,
}

#[inline(always)]
fn samples<'a>(
    opacity: &'a SampleOpacity,
    [middle, length]: [&'a [f32]; 2],
    range: std::ops::Range<usize>,
) -> impl Iterator<Item = Sample> + 'a {
    let mut trans = 1.0;
    range.map(move |i| {
        let w = trans * opacity.alpha[i];
        trans *= opacity.through[i];
        Sample { w, middle: f64::from(middle[i]), length: f64::from(length[i]), behind: trans }
    })
}

impl RayKernel<3> for DistortionKernel {
    #[inline(always)]
    fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, middle, length]: [&[f32]; 3], out: &mut [f32]) {
        let opacity = SampleOpacity::new::<FMA>(tau);
        for (range, out) in group.ranges().zip(out) {
            let (mut weight, mut moment, mut sum) = (0.0, 0.0, 0.0);
            for s in samples(&opacity, [middle, length], range) {
                sum += s.w * (2.0 * (s.middle * weight - moment) + s.w * s.length / 3.0);
                weight += s.w;
                moment += s.w * s.middle;
            }
            *out = sum as f32;
        }
    }

    #[inline(always)]
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        [tau, middle, length]: [&[f32]; 3],
        grad: &[f32],
        [mut dtau, mut dmiddle, mut dlength]: [Option<&mut [f32]>; 3],
    ) {
        let opacity = SampleOpacity::new::<FMA>(tau);
        let mut ray = Vec::new();
        for (range, grad) in group.ranges().zip(grad).filter(|(_, grad)| **grad != 0.0) {
            let grad = f64::from(*grad);
            ray.clear();
            ray.extend(samples(&opacity, [middle, length], range.clone()));
            let (mut weight, mut moment) =
                ray.iter().fold((0.0, 0.0), |(weight, moment), s| (weight + s.w, moment + s.w * s.middle));
            let (mut weight_behind, mut moment_behind, mut pulled) = (0.0, 0.0, 0.0);
            for (i, s) in range.zip(&ray).rev() {
                weight -= s.w;
                moment -= s.w * s.middle;
                let away = (s.middle * weight - moment) + (moment_behind - s.middle * weight_behind);
                let dw = 2.0 * away + 2.0 / 3.0 * s.w * s.length;
                if let Some(dtau) = &mut dtau {
                    dtau[i] = (grad * (s.behind * dw - pulled)) as f32;
                }
                if let Some(dmiddle) = &mut dmiddle {
                    dmiddle[i] = (grad * 2.0 * s.w * (weight - weight_behind)) as f32;
                }
                if let Some(dlength) = &mut dlength {
                    dlength[i] = (grad * s.w * s.w / 3.0) as f32;
                }
                pulled += s.w * dw;
                weight_behind += s.w;
                moment_behind += s.w * s.middle;
            }
        }
    }
}
