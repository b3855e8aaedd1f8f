//! Fit of colours that are linear in the direction of view.
//!
//! A point's colour is `a + b·d` along the unit direction d from the eye, kept within [0, [`MAX_COLOR`]]: spherical
//! harmonics of degree 1. It is fitted to the field's colours seen from a few [`viewpoints`](FieldProbe::viewpoints): with means
//! c̄ and d̄, and K viewpoints, `b = (Σ (d − d̄)(d − d̄)ᵀ + ε K)⁻¹ Σ (d − d̄)(c − c̄)` and `a = c̄ − b·d̄`. ε keeps
//! derivatives small in directions in which the viewpoints do not differ.
//!
//! A coefficient is `low + step · byte`. Steps are as coarse as possible without a visible difference, which halves the size of
//! irregular fields such as fog; with many points they are coarser.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::bricks::Bricks;
use super::lattice::{Lattice, POINTS};
use super::probe::FieldProbe;

/// Maximum colour. Colours of Neural Volumes exceed 1, which is visible through thin parts.
pub(super) const MAX_COLOR: f32 = 2.0;
/// Ridge ε of the fit.
const RIDGE: f32 = 3e-3;
/// Maximum derivative of a colour by direction, which colours in [0, 1] hardly exceed.
const MAX_DERIVATIVE: f32 = 1.0;
/// Minimum steps of a and b; the maximum error is half a step.
const FINE: [f32; 4] = [1.0 / 255.0, 1.0 / 64.0, 1.0 / 64.0, 1.0 / 64.0];
/// Minimum steps for more than [`MANY`] points.
const COARSE: [f32; 4] = [1.0 / 64.0, 1.0 / 16.0, 1.0 / 16.0, 1.0 / 16.0];
const MANY: usize = 1_000_000;
/// Number of points per query, which bounds the memory.
const CHUNK: usize = 1 << 16;

pub(super) struct Colors {
    /// Indices of the points, ascending.
    points: Vec<usize>,
    /// Coefficients a and b of red, green and blue.
    pub(super) channels: [Channel; 3],
}

/// Four coefficients of a colour in 8 bits.
pub(super) struct Channel {
    /// Bytes `[points, 4]`.
    bytes: Vec<u8>,
    /// Value of byte 0 of each coefficient.
    pub(super) low: [f32; 4],
    /// Difference between the values of byte 255 and byte 0 of each coefficient.
    pub(super) range: [f32; 4],
}

impl Colors {
    /// Fits colours of `points`, which are ascending.
    pub(super) fn of(probe: &FieldProbe<'_>, lattice: &Lattice, points: &[usize]) -> Self {
        let mut tables: [Vec<f32>; 3] = Default::default();
        for points in points.chunks(CHUNK) {
            let positions: Vec<Vec3> = points.iter().map(|&point| lattice.position(point)).collect();
            let looks = probe.colors(&positions, lattice.voxel);
            let fits: Vec<[[f32; 4]; 3]> = looks.par_chunks(probe.viewpoints.len()).map(fit).collect();
            for (channel, table) in tables.iter_mut().enumerate() {
                table.extend(fits.iter().flat_map(|fit| fit[channel]));
            }
        }
        let steps = if points.len() > MANY { COARSE } else { FINE };
        Self { points: points.to_vec(), channels: tables.map(|table| Channel::of(&table, steps)) }
    }

    /// Returns the four bytes of a channel at each point of the bricks, one plane `[bricks, 9, 9, 9]` after another.
    /// Hidden points repeat the previous one of their row.
    pub(super) fn planes(&self, channel: usize, bricks: &Bricks) -> Vec<u8> {
        let points = bricks.cells.par_iter().flat_map_iter(|&cell| bricks.lattice.points(cell));
        let places: Vec<Option<usize>> = points.map(|point| self.points.binary_search(&point).ok()).collect();
        let bytes = &self.channels[channel].bytes;
        let of_row = |row: &[Option<usize>], number: usize| -> Vec<u8> {
            let mut last = row.iter().flatten().next().map_or(0, |place| bytes[4 * place + number]);
            let byte = |place: &Option<usize>| {
                last = place.map_or(last, |place| bytes[4 * place + number]);
                last
            };
            row.iter().map(byte).collect()
        };
        (0..4).flat_map(|number| places.chunks(POINTS).flat_map(move |row| of_row(row, number))).collect()
    }
}

impl Channel {
    /// Quantises coefficients `[points, 4]` in `steps`, or in larger steps if more than 255 would be needed.
    fn of(table: &[f32], steps: [f32; 4]) -> Self {
        let numbers = |k: usize| table.iter().skip(k).step_by(4).copied();
        let low = [0, 1, 2, 3].map(|k| numbers(k).reduce(f32::min).unwrap_or(0.0));
        let high = [0, 1, 2, 3].map(|k| numbers(k).reduce(f32::max).unwrap_or(0.0));
        let range = [0, 1, 2, 3].map(|k| (high[k] - low[k]).max(255.0 * steps[k]));
        let byte = |(index, number): (usize, &f32)| {
            let k = index % 4;
            ((number - low[k]) / range[k] * 255.0).round() as u8
        };
        Self { bytes: table.iter().enumerate().map(byte).collect(), low, range }
    }
}

/// Fits a and b of each channel to directions with colours.
fn fit(looks: &[(Vec3, Vec3)]) -> [[f32; 4]; 3] {
    let count = looks.len() as f32;
    let colors: Vec<Vec3> = looks.iter().map(|(_, color)| color.max(Vec3::ZERO).min(Vec3::splat(MAX_COLOR))).collect();
    let color = colors.iter().sum::<Vec3>() / count;
    let direction = looks.iter().map(|(direction, _)| direction).sum::<Vec3>() / count;
    let mut spread = Mat3::from_diagonal(Vec3::splat(RIDGE * count));
    // Columns: covariance of each channel's colour with the direction.
    let mut together = Mat3::ZERO;
    for ((d, _), c) in looks.iter().zip(&colors) {
        let (d, c) = (*d - direction, *c - color);
        spread += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
        together += Mat3::from_cols(d * c.x, d * c.y, d * c.z);
    }
    let derivatives = spread.inverse() * together;
    let limit = Vec3::splat(MAX_DERIVATIVE);
    [0, 1, 2].map(|channel| {
        let b = derivatives.col(channel).clamp(-limit, limit);
        [color[channel] - b.dot(direction), b.x, b.y, b.z]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_is_finite_for_one_eye_and_for_faulty_colours() {
        assert_eq!(fit(&[(Vec3::Z, Vec3::splat(0.5))]), [[0.5, 0.0, 0.0, 0.0]; 3]);
        let numbers = fit(&[(Vec3::Z, Vec3::splat(f32::NAN)), (Vec3::X, Vec3::splat(f32::INFINITY))]);
        assert!(numbers.iter().flatten().all(|number| number.is_finite() && number.abs() <= 4.0), "{numbers:?}");
    }
}
