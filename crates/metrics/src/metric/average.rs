use super::{LPIPS_VGG, Measure, Metric, PSNR, SSIM};
use crate::descriptor::{Better, Descriptor};

pub(super) const AVERAGE: Metric = Metric {
    descriptor: Descriptor { key: "average", name: "Average", unit: "", decimals: 3, better: Better::Lower },
    definition: "geometric mean of MSE, √(1 − SSIM) and LPIPS (VGG) (mip-NeRF, RegNeRF)",
    measure: Measure::Values(&[&PSNR, &SSIM, &LPIPS_VGG], |values| average(values[0], values[1], values[2])),
};

/// Computes the geometric mean of three errors (mip-NeRF: Barron et al. 2021, Sec. 4; RegNeRF: Niemeyer et al. 2022, Sec. 5):
///
/// `(MSE · √(1 − SSIM) · LPIPS)^⅓`, `MSE = 10^(−PSNR/10)`
///
/// The value is 0 for identical images; larger is worse.
pub fn average(psnr: f64, ssim: f64, lpips: f64) -> f64 {
    (10.0_f64.powf(-psnr / 10.0) * (1.0 - ssim).max(0.0).sqrt() * lpips.max(0.0)).cbrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with FreeNeRF's LLFF results for three views (19.63, 0.612, 0.308, 0.134), each a mean over eight scenes.
    #[test]
    fn average_is_the_geometric_mean_of_three_errors() {
        // Errors 0.01, 0.5 and 0.2.
        approx::assert_relative_eq!(average(20.0, 0.75, 0.2), 0.1, epsilon = 1e-12);
        assert_eq!(average(f64::INFINITY, 1.0, 0.0), 0.0);
        approx::assert_abs_diff_eq!(average(19.63, 0.612, 0.308), 0.134, epsilon = 0.01);
    }
}
