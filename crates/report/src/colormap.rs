//! Colour maps as polynomials, and the pictures of depth and error made with them.

use image::RgbImage;
use infonerf_metrics::MetricError;

/// Error at which [`error_image`] reaches the end of its scale.
const ERROR_FULL_SCALE: f32 = 0.5;

/// Maps `t` in `[0, 1]` to RGB in `[0, 1]`, from dark blue to yellow in even perceptual steps.
///
/// A least-squares polynomial of degree 6 through the 256 colours of `viridis`, off by at most 0.017. `t` is clamped, NaN counts as 0.
pub(crate) fn viridis(t: f32) -> [f32; 3] {
    let coefficients = [
        [0.274, 0.006, 0.333],
        [0.108, 1.396, 1.387],
        [-0.327, 0.215, 0.092],
        [-4.600, -5.758, -19.292],
        [6.204, 14.154, 56.656],
        [4.752, -13.749, -65.321],
        [-5.432, 4.642, 26.272],
    ];
    polynomial(t, &coefficients)
}

/// Maps `t` in `[0, 1]` to RGB in `[0, 1]`, a rainbow from blue to red that shows small differences.
///
/// A least-squares polynomial of degree 7 through the 256 colours of `turbo`, off by at most 0.052. `t` is clamped, NaN counts as 0.
pub fn turbo(t: f32) -> [f32; 3] {
    let coefficients = [
        [0.163, 0.077, 0.273],
        [2.154, 2.703, 4.517],
        [-0.121, 1.173, 32.900],
        [-143.997, -9.031, -332.612],
        [693.509, 24.893, 953.560],
        [-1262.856, -68.346, -1264.361],
        [1017.845, 76.603, 803.768],
        [-306.269, -28.052, -198.010],
    ];
    polynomial(t, &coefficients)
}

/// Draws a depth map: near is red, far is blue ([`turbo`]), faded to white where little was hit.
///
/// `colour = A · turbo((far − d) / (far − near)) + (1 − A)` with `A` the accumulated weight `acc`. `depth` and `acc`
/// are row-major `[height × width]`; `depth`, `near` and `far` share a unit. A pixel whose depth or `acc` is not
/// finite is white; when `near < far` does not hold, every hit has the middle colour.
///
/// # Errors
/// When `depth` or `acc` does not hold `width × height` values.
pub fn depth_image(
    depth: &[f32],
    acc: &[f32],
    width: u32,
    height: u32,
    near: f32,
    far: f32,
) -> Result<RgbImage, MetricError> {
    let range = far - near;
    drawn(["depth", "acc"], depth, acc, [width, height], |depth, &acc| {
        let nearness = if range > 0.0 { (far - depth) / range } else { 0.5 };
        (depth.is_finite() && acc.is_finite()).then(|| faded(turbo(nearness), acc))
    })
}

/// Draws normals in the usual colours: red is x, green y and blue z of (n + 1)/2, faded to white where little was hit.
///
/// `colour = A (n/|n| + 1)/2 + (1 − A)` with `A` the accumulated weight `acc`. `normals` of any length and `acc` are
/// row-major `[height × width]`. A pixel without a normal is white.
///
/// # Errors
/// When `normals` or `acc` does not hold `width × height` values.
pub fn normal_image(normals: &[[f32; 3]], acc: &[f32], width: u32, height: u32) -> Result<RgbImage, MetricError> {
    drawn(["normals", "acc"], normals, acc, [width, height], |normal, &acc| {
        let length = normal.iter().map(|n| n * n).sum::<f32>().sqrt();
        let defined = length > 0.0 && length.is_finite() && acc.is_finite();
        defined.then(|| faded(normal.map(|n| 0.5 * (n / length + 1.0)), acc))
    })
}

/// Draws the absolute error, the mean over channels, in viridis: dark is 0, yellow 0.5 or more, white not finite.
///
/// Images are row-major `[height × width]`, values in `[0, 1]`.
///
/// # Errors
/// When an image does not hold `width × height` pixels.
pub fn error_image(render: &[[f32; 3]], truth: &[[f32; 3]], width: u32, height: u32) -> Result<RgbImage, MetricError> {
    drawn(["render", "truth"], render, truth, [width, height], |render, truth| {
        let error = render.iter().zip(truth).map(|(r, t)| (r - t).abs()).sum::<f32>() / 3.0;
        error.is_finite().then(|| viridis(error / ERROR_FULL_SCALE))
    })
}

/// Draws an image with the `colour` of each pixel of two inputs; `None` is white. Errors name the inputs by `names`.
fn drawn<A, B>(
    names: [&'static str; 2],
    first: &[A],
    second: &[B],
    [width, height]: [u32; 2],
    colour: impl Fn(&A, &B) -> Option<[f32; 3]>,
) -> Result<RgbImage, MetricError> {
    let expected = (width as usize).saturating_mul(height as usize);
    for (what, found) in names.into_iter().zip([first.len(), second.len()]) {
        if found != expected {
            return Err(MetricError::length(what, found, expected));
        }
    }
    let pixels = first.iter().zip(second).flat_map(|(a, b)| to_bytes(colour(a, b).unwrap_or([1.0; 3])));
    Ok(RgbImage::from_raw(width, height, pixels.collect()).expect("there is a colour for each pixel"))
}

fn faded(colour: [f32; 3], acc: f32) -> [f32; 3] {
    let acc = acc.clamp(0.0, 1.0);
    colour.map(|channel| acc * channel + 1.0 - acc)
}

fn polynomial(t: f32, coefficients: &[[f32; 3]]) -> [f32; 3] {
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    let horner = |channel: usize| coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c[channel]);
    std::array::from_fn(|channel| horner(channel).clamp(0.0, 1.0))
}

pub(crate) fn to_bytes(colour: [f32; 3]) -> [u8; 3] {
    colour.map(|channel| (255.0 * channel.clamp(0.0, 1.0)).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_maps_pass_near_the_colours_they_stand_for() {
        let of_viridis = [[0.267, 0.005, 0.329], [0.128, 0.567, 0.551], [0.993, 0.906, 0.144]];
        let of_turbo = [[0.19, 0.072, 0.232], [0.644, 0.99, 0.234], [0.48, 0.016, 0.011]];
        let map: fn(f32) -> [f32; 3] = viridis;
        for (map, expected, tolerance) in [(map, of_viridis, 0.018), (turbo, of_turbo, 0.053)] {
            for (t, colour) in [0.0, 128.0 / 255.0, 1.0].into_iter().zip(expected) {
                let close = map(t).iter().zip(colour).all(|(found, expected)| (found - expected).abs() <= tolerance);
                assert!(close, "{t}: {:?} for {colour:?}", map(t));
            }
        }
        assert_eq!(turbo(f32::NAN), turbo(-3.0));
    }

    #[test]
    fn depth_fades_to_white_where_nothing_was_hit() {
        let image = depth_image(&[2.0, 6.0, 3.0, f32::NAN], &[1.0, 1.0, 0.0, 1.0], 2, 2, 2.0, 6.0).unwrap();
        assert_eq!(image.into_raw(), [turbo(1.0), turbo(0.0), [1.0; 3], [1.0; 3]].map(to_bytes).concat());
    }

    #[test]
    fn normals_towards_the_camera_are_blue() {
        let normals = [[0.0, 0.0, 0.2], [3.0, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0; 3]];
        let image = normal_image(&normals, &[1.0, 1.0, 0.5, 1.0], 2, 2).unwrap();
        assert_eq!(image.into_raw(), [[128, 128, 255], [255, 128, 128], [191, 128, 191], [255; 3]].concat());
        assert!(normal_image(&normals, &[1.0], 2, 2).is_err());
        assert!(depth_image(&[1.0], &[1.0], 2, 1, 0.0, 1.0).is_err());
        assert!(depth_image(&[], &[], 0, 0, 0.0, f32::NAN).is_ok());
    }

    #[test]
    fn error_is_dark_where_right() {
        let image = error_image(&[[0.5; 3], [1.0; 3]], &[[0.5; 3], [0.0; 3]], 2, 1).unwrap();
        assert_eq!(image.into_raw(), [viridis(0.0), viridis(1.0)].map(to_bytes).concat());
    }
}
