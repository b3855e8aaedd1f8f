//! The kernels: one thread per ray, which walks along its samples.
//!
//! The same formulas as the host's, in `f32`: what would cancel is computed by series, and sums are of numbers of one
//! sign where that can be.

use burn::cubecl::{self, prelude::*};

/// 1 − e^−τ: by its series below 0.1, where the difference would cancel.
#[cube]
pub(crate) fn alpha_of(tau: f32) -> f32 {
    let mut alpha = 1.0f32 - f32::exp(-tau);
    if tau < 0.1f32 {
        let t = tau;
        alpha = t * (1.0f32 - t / 2.0f32 * (1.0f32 - t / 3.0f32 * (1.0f32 - t / 4.0f32 * (1.0f32 - t / 5.0f32))));
    }
    alpha
}

/// ln(1 + x) for x > −1.
#[cube]
pub(crate) fn ln_1p(x: f32) -> f32 {
    let mut ln = f32::ln(1.0f32 + x);
    if f32::abs(x) < 0.1f32 {
        let tail = 1.0f32 / 5.0f32 - x * (1.0f32 / 6.0f32 - x * (1.0f32 / 7.0f32 - x / 8.0f32));
        ln = x * (1.0f32 - x * (1.0f32 / 2.0f32 - x * (1.0f32 / 3.0f32 - x * (1.0f32 / 4.0f32 - x * tail))));
    }
    ln
}

/// (1 + r) ln(1 + r) − r ≥ 0, of second order in r.
#[cube]
fn bregman(r: f32, ln: f32) -> f32 {
    let mut excess = (1.0f32 + r) * ln - r;
    if f32::abs(r) < 0.1f32 {
        let tail = 1.0f32 / 20.0f32 - r * (1.0f32 / 30.0f32 - r * (1.0f32 / 42.0f32 - r / 56.0f32));
        excess = r * r * (1.0f32 / 2.0f32 - r * (1.0f32 / 6.0f32 - r * (1.0f32 / 12.0f32 - r * tail)));
    }
    excess
}

/// ln((p + ε)/(q + ε)), given r = (p − q)/(q + ε).
#[cube]
fn ln_ratio(p: f32, q: f32, r: f32, epsilon: f32) -> f32 {
    let mut ln = ln_1p(r);
    if f32::abs(r) >= 0.5f32 {
        ln = f32::ln((p + epsilon) / (q + epsilon));
    }
    ln
}

/// What makes a ray's opacities a distribution. Comparisons are such that a sum that is not a number counts as a hit, and
/// reaches the result.
#[derive(CubeType)]
struct Ray {
    /// Σα.
    sum: f32,
    /// Σα without the most opaque sample's.
    rest: f32,
    /// Place of that sample.
    top: usize,
}

#[cube]
fn ray_of(tau: &Tensor<f32>, start: usize, end: usize) -> Ray {
    let mut most = 0.0f32;
    let mut rest = 0.0f32;
    let mut top = start;
    for i in start..end {
        let alpha = alpha_of(tau[i]);
        if alpha > most {
            rest += most;
            most = alpha;
            top = i;
        } else {
            rest += alpha;
        }
    }
    Ray { sum: most + rest, rest, top }
}

/// ln(p + ε) of a sample. Without ε an empty one counts as the smallest normal `f32`.
#[cube]
fn ln_density(alpha: f32, place: usize, ray: &Ray, epsilon: f32) -> f32 {
    let mut ln = f32::ln(alpha / ray.sum + epsilon);
    if epsilon == 0.0f32 {
        ln = f32::ln(f32::max(alpha, 1.175_494_4e-38f32)) - f32::ln(ray.sum);
    }
    if place == ray.top && 2.0f32 * ray.rest < ray.sum {
        ln = ln_1p(epsilon - ray.rest / ray.sum);
    }
    ln
}

/// The first sample of a ray among those of the rays that `offsets` are of: a part of more offsets, they need not begin at 0.
#[cube]
fn own(offsets: &Tensor<i32>, ray: usize) -> usize {
    usize::cast_from(offsets[ray] - offsets[0])
}

/// Zeros for the samples behind the last ray's, `columns` numbers each: the rays share them.
#[cube]
fn clear_tail(out: &mut Tensor<f32>, offsets: &Tensor<i32>, columns: usize, ray: usize) {
    let rays = offsets.shape(0) - 1;
    let mut at = own(offsets, rays) * columns + ray;
    while at < out.len() {
        out[at] = 0.0f32;
        at += rays;
    }
}

/// What is seen along a ray: its integrated values, on the background as far as it lets through, distances and Σw.
#[cube(launch)]
pub(super) fn composite_forward(
    tau: &Tensor<f32>,
    values: &Tensor<f32>,
    distances: &Tensor<f32>,
    offsets: &Tensor<i32>,
    out: &mut Tensor<f32>,
    depth: &mut Tensor<f32>,
    acc: &mut Tensor<f32>,
    red: f32,
    green: f32,
    blue: f32,
    #[comptime] channels: usize,
    #[comptime] on_background: bool,
    #[comptime] has_distances: bool,
) {
    let place = ABSOLUTE_POS;
    if place >= acc.shape(0) {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    let row = place * channels;
    for c in 0..channels {
        out[row + c] = 0.0f32;
    }
    let mut trans = 1.0f32;
    let mut sum = 0.0f32;
    let mut distance = 0.0f32;
    for i in start..end {
        let w = trans * alpha_of(tau[i]);
        trans *= f32::exp(-tau[i]);
        sum += w;
        for c in 0..channels {
            out[row + c] += w * values[i * channels + c];
        }
        if has_distances {
            distance += w * distances[i];
        }
    }
    if on_background {
        out[row] += (1.0f32 - sum) * red;
        out[row + 1] += (1.0f32 - sum) * green;
        out[row + 2] += (1.0f32 - sum) * blue;
    }
    acc[place] = sum;
    depth[place] = distance;
}

/// Gradients with respect to τ and the values, given those of what is seen as far as it has one.
#[cube(launch)]
pub(super) fn composite_backward(
    tau: &Tensor<f32>,
    values: &Tensor<f32>,
    distances: &Tensor<f32>,
    offsets: &Tensor<i32>,
    dout: &Tensor<f32>,
    ddepth: &Tensor<f32>,
    dacc: &Tensor<f32>,
    dtau: &mut Tensor<f32>,
    dvalues: &mut Tensor<f32>,
    red: f32,
    green: f32,
    blue: f32,
    #[comptime] channels: usize,
    #[comptime] on_background: bool,
    #[comptime] has_dout: bool,
    #[comptime] has_ddepth: bool,
    #[comptime] has_dacc: bool,
) {
    let place = ABSOLUTE_POS;
    if place >= offsets.shape(0) - 1 {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    clear_tail(dtau, offsets, 1, place);
    if comptime!(channels > 0) {
        clear_tail(dvalues, offsets, channels, place);
    }
    let row = place * channels;
    // T_{i+1} is kept in dtau until the second pass replaces it.
    let mut trans = 1.0f32;
    for i in start..end {
        let w = trans * alpha_of(tau[i]);
        for c in 0..channels {
            let mut slope = 0.0f32;
            if has_dout {
                slope = w * dout[row + c];
            }
            dvalues[i * channels + c] = slope;
        }
        trans *= f32::exp(-tau[i]);
        dtau[i] = trans;
    }
    // What each sample is worth whatever it shows.
    let mut common = 0.0f32;
    if has_dacc {
        common += dacc[place];
    }
    if on_background && has_dout {
        common -= dout[row] * red + dout[row + 1] * green + dout[row + 2] * blue;
    }
    // As on the host: how much more a sample is worth than what lies behind it.
    let mut behind = 0.0f32;
    let mut worth = 0.0f32;
    for step in 0..end - start {
        let i = end - 1 - step;
        let mut u = common;
        if has_dout {
            for c in 0..channels {
                u += dout[row + c] * values[i * channels + c];
            }
        }
        if has_ddepth {
            u += ddepth[place] * distances[i];
        }
        worth += u - behind;
        behind = u;
        dtau[i] *= worth;
        worth *= f32::exp(-tau[i]);
    }
}

/// A ray's entropy in bits and Σα.
#[cube(launch)]
pub(super) fn entropy_forward(
    tau: &Tensor<f32>,
    offsets: &Tensor<i32>,
    bits: &mut Tensor<f32>,
    alpha_sum: &mut Tensor<f32>,
    epsilon: f32,
    least: f32,
) {
    let place = ABSOLUTE_POS;
    if place >= bits.shape(0) {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    let ray = ray_of(tau, start, end);
    let missed = ray.sum < least;
    let mut entropy = 0.0f32;
    if !missed {
        for i in start..end {
            let alpha = alpha_of(tau[i]);
            entropy -= alpha / ray.sum * ln_density(alpha, i, &ray, epsilon) * std::f32::consts::LOG2_E;
        }
    }
    bits[place] = entropy;
    alpha_sum[place] = ray.sum;
}

/// Gradient with respect to τ.
#[cube(launch)]
pub(super) fn entropy_backward(
    tau: &Tensor<f32>,
    offsets: &Tensor<i32>,
    dbits: &Tensor<f32>,
    dalpha_sum: &Tensor<f32>,
    dtau: &mut Tensor<f32>,
    epsilon: f32,
    least: f32,
    #[comptime] has_dbits: bool,
    #[comptime] has_dalpha_sum: bool,
) {
    let place = ABSOLUTE_POS;
    if place >= offsets.shape(0) - 1 {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    let ray = ray_of(tau, start, end);
    clear_tail(dtau, offsets, 1, place);
    let mut along = 0.0f32;
    if has_dalpha_sum {
        along = dalpha_sum[place];
    }
    for i in start..end {
        dtau[i] = along * f32::exp(-tau[i]);
    }
    let missed = ray.sum < least;
    if !missed && has_dbits {
        let scale = dbits[place] * std::f32::consts::LOG2_E;
        let common = entropy_slope(tau[ray.top], ray.top, &ray, epsilon);
        let mut mean = 0.0f32;
        for i in start..end {
            let slope = entropy_slope(tau[i], i, &ray, epsilon);
            mean += alpha_of(tau[i]) / ray.sum * (slope - common);
        }
        for i in start..end {
            let slope = entropy_slope(tau[i], i, &ray, epsilon) - common - mean;
            dtau[i] += scale * slope / ray.sum * f32::exp(-tau[i]);
        }
    }
}

/// ∂H/∂p in nats, and 1: what all slopes have in common drops out.
#[cube]
fn entropy_slope(tau: f32, place: usize, ray: &Ray, epsilon: f32) -> f32 {
    let alpha = alpha_of(tau);
    let mut slope = -ln_density(alpha, place, ray, epsilon);
    if epsilon > 0.0f32 {
        slope += epsilon / (alpha / ray.sum + epsilon);
    }
    slope
}

/// KL of each pair of rays, in nats.
#[cube(launch)]
pub(super) fn divergence_forward(
    tau: &Tensor<f32>,
    near: &Tensor<f32>,
    offsets: &Tensor<i32>,
    out: &mut Tensor<f32>,
    epsilon: f32,
    least: f32,
) {
    let place = ABSOLUTE_POS;
    if place >= out.shape(0) {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    let (ray, other) = (ray_of(tau, start, end), ray_of(near, start, end));
    let missed = ray.sum < least || other.sum < least;
    let mut divergence = 0.0f32;
    if !missed {
        for i in start..end {
            let (p, q) = (alpha_of(tau[i]) / ray.sum, alpha_of(near[i]) / other.sum);
            let r = (p - q) / (q + epsilon);
            let ln = ln_ratio(p, q, r, epsilon);
            divergence += (q + epsilon) * bregman(r, ln) - epsilon * ln;
        }
    }
    out[place] = divergence;
}

/// Gradients with respect to both rays' τ.
#[cube(launch)]
pub(super) fn divergence_backward(
    tau: &Tensor<f32>,
    near: &Tensor<f32>,
    offsets: &Tensor<i32>,
    grad: &Tensor<f32>,
    dtau: &mut Tensor<f32>,
    dnear: &mut Tensor<f32>,
    epsilon: f32,
    least: f32,
) {
    let place = ABSOLUTE_POS;
    if place >= grad.shape(0) {
        terminate!();
    }
    let (start, end) = (own(offsets, place), own(offsets, place + 1));
    let (ray, other) = (ray_of(tau, start, end), ray_of(near, start, end));
    let missed = ray.sum < least || other.sum < least;
    clear_tail(dtau, offsets, 1, place);
    clear_tail(dnear, offsets, 1, place);
    // The slopes are kept in the results until their mean is known.
    let mut mean_p = 0.0f32;
    let mut mean_q = 0.0f32;
    for i in start..end {
        let (p, q) = (alpha_of(tau[i]) / ray.sum, alpha_of(near[i]) / other.sum);
        let r = (p - q) / (q + epsilon);
        dtau[i] = 0.0f32;
        dnear[i] = 0.0f32;
        if !missed {
            dtau[i] = ln_ratio(p, q, r, epsilon) - epsilon / (p + epsilon);
            dnear[i] = epsilon / (q + epsilon) - r;
            mean_p += p * dtau[i];
            mean_q += q * dnear[i];
        }
    }
    if !missed {
        for i in start..end {
            dtau[i] = grad[place] * (dtau[i] - mean_p) / ray.sum * f32::exp(-tau[i]);
            dnear[i] = grad[place] * (dnear[i] - mean_q) / other.sum * f32::exp(-near[i]);
        }
    }
}

/// Each sample's row is that of its ray: one thread per number.
#[cube(launch)]
pub(super) fn spread(rows: &Tensor<f32>, offsets: &Tensor<i32>, out: &mut Tensor<f32>) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let columns = out.shape(1);
    let ray = owner(offsets, ABSOLUTE_POS / columns);
    out[ABSOLUTE_POS] = rows[ray * columns + ABSOLUTE_POS % columns];
}

/// The ray of a sample: the last that begins at or before it, as those before that begin there too are empty.
#[cube]
fn owner(offsets: &Tensor<i32>, sample: usize) -> usize {
    let mut ray = sample - sample;
    let mut behind = offsets.shape(0) - 1;
    while behind - ray > 1 {
        let middle = (ray + behind) / 2;
        if own(offsets, middle) <= sample {
            ray = middle;
        } else {
            behind = middle;
        }
    }
    ray
}

/// o + t d of each sample: one thread per coordinate.
#[cube(launch)]
pub(super) fn points_forward(
    origins: &Tensor<f32>,
    directions: &Tensor<f32>,
    t: &Tensor<f32>,
    offsets: &Tensor<i32>,
    out: &mut Tensor<f32>,
) {
    let at = ABSOLUTE_POS;
    if at >= out.len() {
        terminate!();
    }
    let row = 3 * owner(offsets, at / 3) + at % 3;
    out[at] = origins[row] + t[at / 3] * directions[row];
}

/// Σ g and Σ t g over a ray's samples: one thread per coordinate of a ray.
#[cube(launch)]
pub(super) fn points_backward(
    t: &Tensor<f32>,
    offsets: &Tensor<i32>,
    grad: &Tensor<f32>,
    dorigins: &mut Tensor<f32>,
    ddirections: &mut Tensor<f32>,
) {
    let at = ABSOLUTE_POS;
    if at >= dorigins.len() {
        terminate!();
    }
    let (ray, axis) = (at / 3, at % 3);
    let mut sum = 0.0f32;
    let mut turned = 0.0f32;
    for sample in own(offsets, ray)..own(offsets, ray + 1) {
        let g = grad[3 * sample + axis];
        sum += g;
        turned += t[sample] * g;
    }
    dorigins[at] = sum;
    ddirections[at] = turned;
}

/// The sum over a ray's samples: one thread per number.
#[cube(launch)]
pub(super) fn gather(rows: &Tensor<f32>, offsets: &Tensor<i32>, out: &mut Tensor<f32>) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let columns = out.shape(1);
    let (ray, column) = (ABSOLUTE_POS / columns, ABSOLUTE_POS % columns);
    let mut sum = 0.0f32;
    for sample in own(offsets, ray)..own(offsets, ray + 1) {
        sum += rows[sample * columns + column];
    }
    out[ABSOLUTE_POS] = sum;
}
