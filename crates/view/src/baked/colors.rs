//! Colours that are linear in the direction of view.
//!
//! A point's colour is `a + b·d` along the unit direction d from the eye, kept within [0, [`MOST_COLOR`]]: spherical harmonics of
//! degree 1. It is fitted to the field's colours seen from a few [`eyes`](Ask::eyes): with means c̄ and d̄, and eyes K,
//! `b = (Σ (d − d̄)(d − d̄)ᵀ + ε K)⁻¹ Σ (d − d̄)(c − c̄)` and `a = c̄ − b·d̄`. ε keeps slopes small in directions in which the eyes do
//! not differ.
//!
//! A number is `low + step · byte`. Steps are as coarse as is invisible, which halves the size of what is irregular, such as
//! fog; with many points they are coarser.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::ask::Ask;
use super::bricks::Bricks;
use super::lattice::{Lattice, POINTS};

/// The greatest colour: Neural Volumes' exceed 1, which shows through thin parts.
pub(super) const MOST_COLOR: f32 = 2.0;
/// ε.
const RIDGE: f32 = 3e-3;
/// The greatest slope; colours in [0, 1] hardly exceed it.
const MOST_SLOPE: f32 = 1.0;
/// The least steps of a and b; half a step is the greatest error.
const FINE: [f32; 4] = [1.0 / 255.0, 1.0 / 64.0, 1.0 / 64.0, 1.0 / 64.0];
/// The same where there are more than [`MANY`] points.
const COARSE: [f32; 4] = [1.0 / 64.0, 1.0 / 16.0, 1.0 / 16.0, 1.0 / 16.0];
const MANY: usize = 1_000_000;
/// Points per query: bounds the memory.
const CHUNK: usize = 1 << 16;

/// Colours of some points of a lattice.
pub(super) struct Colors {
    /// Ascending.
    points: Vec<usize>,
    /// a and b of red, green and blue.
    pub(super) channels: [Channel; 3],
}

/// A colour's four numbers in 8 bits.
pub(super) struct Channel {
    /// `[points, 4]`.
    bytes: Vec<u8>,
    /// The value of byte 0 of each number.
    pub(super) low: [f32; 4],
    /// How much larger the value of byte 255 is.
    pub(super) range: [f32; 4],
}

impl Colors {
    /// Colours of `points`, which ascend.
    pub(super) fn of(ask: &Ask<'_>, lattice: &Lattice, points: &[usize]) -> Self {
        let mut tables: [Vec<f32>; 3] = Default::default();
        for points in points.chunks(CHUNK) {
            let positions: Vec<Vec3> = points.iter().map(|&point| lattice.position(point)).collect();
            let looks = ask.colors(&positions, lattice.voxel);
            let fits: Vec<[[f32; 4]; 3]> = looks.par_chunks(ask.eyes.len()).map(fit).collect();
            for (channel, table) in tables.iter_mut().enumerate() {
                table.extend(fits.iter().flat_map(|fit| fit[channel]));
            }
        }
        let steps = if points.len() > MANY { COARSE } else { FINE };
        Self { points: points.to_vec(), channels: tables.map(|table| Channel::of(&table, steps)) }
    }

    /// The four bytes of a channel at each point of the bricks, one plane `[bricks, 9, 9, 9]` after another. Where no colour
    /// is seen, the previous one of its row is repeated.
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
    /// The numbers `[points, 4]` in `steps`, or larger ones if that takes more than 255.
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

/// a and b of each channel from directions with colours.
fn fit(looks: &[(Vec3, Vec3)]) -> [[f32; 4]; 3] {
    let count = looks.len() as f32;
    let colors: Vec<Vec3> = looks.iter().map(|(_, color)| color.max(Vec3::ZERO).min(Vec3::splat(MOST_COLOR))).collect();
    let color = colors.iter().sum::<Vec3>() / count;
    let direction = looks.iter().map(|(direction, _)| direction).sum::<Vec3>() / count;
    let mut spread = Mat3::from_diagonal(Vec3::splat(RIDGE * count));
    // Columns: what each channel's colour has to do with the direction.
    let mut together = Mat3::ZERO;
    for ((d, _), c) in looks.iter().zip(&colors) {
        let (d, c) = (*d - direction, *c - color);
        spread += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
        together += Mat3::from_cols(d * c.x, d * c.y, d * c.z);
    }
    let slopes = spread.inverse() * together;
    let most = Vec3::splat(MOST_SLOPE);
    [0, 1, 2].map(|channel| {
        let slope = slopes.col(channel).clamp(-most, most);
        [color[channel] - slope.dot(direction), slope.x, slope.y, slope.z]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_colour_is_found() {
        let directions = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, Vec3::new(0.6, 0.0, -0.8)];
        let of = |d: Vec3| Vec3::new(0.5 + 0.3 * d.x, 0.4 - 0.2 * d.y, 0.25);
        let looks: Vec<(Vec3, Vec3)> = directions.iter().map(|&d| (d, of(d))).collect();
        let found = fit(&looks);
        for d in directions {
            for (channel, expected) in found.iter().zip(of(d).to_array()) {
                let shown = channel[0] + Vec3::from_slice(&channel[1..]).dot(d);
                assert!((shown - expected).abs() < 0.01, "{d}: {shown} for {expected}");
            }
        }
    }

    #[test]
    fn numbers_come_back_within_half_a_step() {
        let table: Vec<f32> = (0..400).map(|i| (i as f32 * 0.37).sin() * [3.0, 0.4, 0.1, 1.0][i % 4]).collect();
        let channel = Channel::of(&table, FINE);
        for (index, (number, byte)) in table.iter().zip(&channel.bytes).enumerate() {
            let (low, step) = (channel.low[index % 4], channel.range[index % 4] / 255.0);
            assert!((low + step * f32::from(*byte) - number).abs() <= 0.501 * step, "{index}");
            assert!(step >= 0.999 * FINE[index % 4], "{index}: {step}");
        }
        assert_eq!(Channel::of(&[], COARSE).low, [0.0; 4]);
    }

    #[test]
    fn one_eye_and_faults_do_no_harm() {
        assert_eq!(fit(&[(Vec3::Z, Vec3::splat(0.5))]), [[0.5, 0.0, 0.0, 0.0]; 3]);
        let numbers = fit(&[(Vec3::Z, Vec3::splat(f32::NAN)), (Vec3::X, Vec3::splat(f32::INFINITY))]);
        assert!(numbers.iter().flatten().all(|number| number.is_finite() && number.abs() <= 4.0), "{numbers:?}");
    }
}
