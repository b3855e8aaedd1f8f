//! Functions that kernels along rays share, and kernels that copy or sum rows and compute points.

use burn::cubecl::{self, prelude::*};

/// Computes 1 − e^−τ: by its series below 0.1, where the difference would cancel.
#[cube]
pub(crate) fn alpha_of(tau: f32) -> f32 {
    let mut alpha = 1.0f32 - f32::exp(-tau);
    if tau < 0.1f32 {
        let t = tau;
        alpha = t * (1.0f32 - t / 2.0f32 * (1.0f32 - t / 3.0f32 * (1.0f32 - t / 4.0f32 * (1.0f32 - t / 5.0f32))));
    }
    alpha
}

/// Computes ln(1 + x) for x > −1.
#[cube]
pub(crate) fn ln_1p(x: f32) -> f32 {
    let mut ln = f32::ln(1.0f32 + x);
    if f32::abs(x) < 0.1f32 {
        let tail = 1.0f32 / 5.0f32 - x * (1.0f32 / 6.0f32 - x * (1.0f32 / 7.0f32 - x / 8.0f32));
        ln = x * (1.0f32 - x * (1.0f32 / 2.0f32 - x * (1.0f32 / 3.0f32 - x * (1.0f32 / 4.0f32 - x * tail))));
    }
    ln
}

/// Sum of a ray's opacities, and its most opaque sample. Comparisons treat a sum that is NaN as a hit, so that it reaches
/// the result.
#[derive(CubeType)]
pub(crate) struct RayMass {
    /// Σα.
    pub(crate) sum: f32,
    /// Σα without the most opaque sample's.
    pub(crate) rest: f32,
    /// Index of the most opaque sample.
    pub(crate) top: usize,
}

/// Sums the opacities of samples `start..end`.
#[cube]
pub(crate) fn mass_of(tau: &Tensor<f32>, start: usize, end: usize) -> RayMass {
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
    RayMass { sum: most + rest, rest, top }
}

/// Returns the first sample of a ray. `offsets` may be a part of longer offsets, and then does not begin at 0.
#[cube]
pub(crate) fn first_sample(offsets: &Tensor<i32>, ray: usize) -> usize {
    usize::cast_from(offsets[ray] - offsets[0])
}

/// Copies the row of each ray to its samples: one thread per value.
#[cube(launch)]
pub(super) fn spread(rows: &Tensor<f32>, offsets: &Tensor<i32>, out: &mut Tensor<f32>) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let columns = out.shape(1);
    let ray = owner(offsets, ABSOLUTE_POS / columns);
    out[ABSOLUTE_POS] = rows[ray * columns + ABSOLUTE_POS % columns];
}

/// Returns the ray of a sample: the last that begins at or before it, as earlier rays that begin there too are empty.
#[cube]
fn owner(offsets: &Tensor<i32>, sample: usize) -> usize {
    let mut ray = sample - sample;
    let mut behind = offsets.shape(0) - 1;
    while behind - ray > 1 {
        let middle = (ray + behind) / 2;
        if first_sample(offsets, middle) <= sample {
            ray = middle;
        } else {
            behind = middle;
        }
    }
    ray
}

/// Writes o + t d of each sample: one thread per coordinate.
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

/// Writes Σ g and Σ t g over a ray's samples: one thread per coordinate of a ray.
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
    for sample in first_sample(offsets, ray)..first_sample(offsets, ray + 1) {
        let g = grad[3 * sample + axis];
        sum += g;
        turned += t[sample] * g;
    }
    dorigins[at] = sum;
    ddirections[at] = turned;
}

/// Sums the rows of a ray's samples: one thread per value.
#[cube(launch)]
pub(super) fn gather(rows: &Tensor<f32>, offsets: &Tensor<i32>, out: &mut Tensor<f32>) {
    if ABSOLUTE_POS >= out.len() {
        terminate!();
    }
    let columns = out.shape(1);
    let (ray, column) = (ABSOLUTE_POS / columns, ABSOLUTE_POS % columns);
    let mut sum = 0.0f32;
    for sample in first_sample(offsets, ray)..first_sample(offsets, ray + 1) {
        sum += rows[sample * columns + column];
    }
    out[ABSOLUTE_POS] = sum;
}
