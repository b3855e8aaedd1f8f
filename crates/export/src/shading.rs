//! Colours of a surface.

use glam::{DMat4, DVec4, Mat3, Vec3};

use crate::splat::{DEGREE_0, DEGREE_1};
use crate::surface::Surface;
use crate::volume::Volume;

/// Samples along the normal: their start in front of the surface and their distance, both in voxels, and their number.
const BEFORE: f32 = 1.0;
const STEP: f32 = 0.5;
const STEPS: usize = 9;
/// Number of vertices per query, which bounds the memory.
const CHUNK: usize = 1 << 14;

/// Returns for each vertex the expected end Σ w x / Σ w of a ray against the normal, over nine samples from one voxel in
/// front of the surface to three behind it, with the weights w of volume rendering. Renders show the colour at this point,
/// while the colour at the vertex is often still that of fog. Without any density, the end is the vertex.
pub(crate) fn endpoints(surface: &Surface, volume: &dyn Volume) -> Vec<Vec3> {
    let step = STEP * surface.voxel;
    let depth = |i: usize| i as f32 * step - BEFORE * surface.voxel;
    let vertices: Vec<(Vec3, Vec3)> = surface.positions.iter().copied().zip(surface.normals.iter().copied()).collect();
    let of_chunk = |vertices: &[(Vec3, Vec3)]| -> Vec<Vec3> {
        let along = |&(p, normal): &(Vec3, Vec3)| (0..STEPS).map(move |i| p - depth(i) * normal);
        let densities = volume.density(&vertices.iter().flat_map(along).collect::<Vec<_>>());
        let end = |(&(p, normal), densities): (&(Vec3, Vec3), &[f32])| {
            let (mut passes, mut weights, mut sum) = (1.0, 0.0, 0.0);
            for (i, density) in densities.iter().enumerate() {
                let weight = passes * -(-density * step).exp_m1();
                passes -= weight;
                weights += weight;
                sum += weight * depth(i);
            }
            if weights > 0.0 { p - sum / weights * normal } else { p }
        };
        vertices.iter().zip(densities.chunks_exact(STEPS)).map(end).collect()
    };
    vertices.chunks(CHUNK).flat_map(of_chunk).collect()
}

/// Evaluates the colour of each vertex as seen along its normal from outside, at its [`endpoints`].
pub(crate) fn colors_along_normals(surface: &Surface, volume: &dyn Volume) -> Vec<[f32; 3]> {
    let ends = endpoints(surface, volume);
    let against: Vec<Vec3> = surface.normals.iter().map(|&normal| -normal).collect();
    let chunks = ends.chunks(CHUNK).zip(against.chunks(CHUNK));
    chunks.flat_map(|(points, directions)| volume.color(points, directions)).collect()
}

/// Directions of view to which a colour is fitted: their angle to the normal in degrees, and their number around it.
const RINGS: [(f32, usize); 3] = [(0.0, 1), (30.0, 6), (60.0, 6)];

/// Fits the colour of each vertex as a linear function of the direction of view, in the coefficients of
/// [`Gaussian::sh`](crate::Gaussian::sh), by least squares over 13 directions from its front, at its [`endpoints`].
pub(crate) fn harmonics(surface: &Surface, volume: &dyn Volume) -> Vec<[[f32; 4]; 3]> {
    let local: Vec<Vec3> = RINGS.iter().flat_map(|&(tilt, count)| ring(tilt.to_radians(), count)).collect();
    let weights = regression(&local);
    let count = local.len();
    let of_chunk = |(points, normals): (&[Vec3], &[Vec3])| -> Vec<[[f32; 4]; 3]> {
        let frames: Vec<Mat3> = normals.iter().map(|&normal| frame(normal)).collect();
        let asked: Vec<Vec3> = points.iter().flat_map(|&p| std::iter::repeat_n(p, count)).collect();
        let directions: Vec<Vec3> = frames.iter().flat_map(|frame| local.iter().map(move |&d| *frame * d)).collect();
        let colors = volume.color(&asked, &directions);
        let fit = |(frame, colors): (&Mat3, &[[f32; 3]])| {
            // Coefficients of red, green and blue: constant, and along the frame's axes.
            let mut sums = [DVec4::ZERO; 3];
            for (weight, color) in weights.iter().zip(colors) {
                for (sum, channel) in sums.iter_mut().zip(color) {
                    *sum += *weight * f64::from(*channel);
                }
            }
            sums.map(|sum| {
                let by_direction = *frame * sum.truncate().as_vec3() / DEGREE_1;
                [(sum.w as f32 - 0.5) / DEGREE_0, -by_direction.y, by_direction.z, -by_direction.x]
            })
        };
        frames.iter().zip(colors.chunks_exact(count)).map(fit).collect()
    };
    let ends = endpoints(surface, volume);
    ends.chunks(CHUNK).zip(surface.normals.chunks(CHUNK)).flat_map(of_chunk).collect()
}

/// Returns axes with z along `normal`.
pub(crate) fn frame(normal: Vec3) -> Mat3 {
    let (x, y) = normal.any_orthonormal_pair();
    Mat3::from_cols(x, y, normal)
}

/// Returns directions of view that meet the xy plane from above at `tilt` from its normal.
fn ring(tilt: f32, count: usize) -> impl Iterator<Item = Vec3> {
    let (sin, cos) = tilt.sin_cos();
    (0..count).map(move |i| {
        let angle = std::f32::consts::TAU * i as f32 / count as f32;
        Vec3::new(sin * angle.cos(), sin * angle.sin(), -cos)
    })
}

/// Returns the columns of `(AᵀA)⁻¹Aᵀ`: the least-squares fit's coefficients of x, y, z and 1.
fn regression(directions: &[Vec3]) -> Vec<DVec4> {
    let rows: Vec<DVec4> = directions.iter().map(|d| d.as_dvec3().extend(1.0)).collect();
    let outer = |v: DVec4| DMat4::from_cols(v * v.x, v * v.y, v * v.z, v * v.w);
    let inverse = rows.iter().map(|&row| outer(row)).sum::<DMat4>().inverse();
    rows.into_iter().map(|row| inverse * row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::testing::Ball;

    #[test]
    fn endpoints_lie_where_light_is_stopped() {
        let surface = Ball { radius: 1.0, sharpness: 300.0 }.surface(32);
        // The light is stopped at the surface, and a voxel behind it.
        for radius in [1.0, 0.9] {
            let ends = endpoints(&surface, &Ball { radius, sharpness: 300.0 });
            for (end, p) in ends.iter().zip(&surface.positions) {
                let behind = radius - end.length();
                assert!((-0.5 * surface.voxel..surface.voxel).contains(&behind), "{end} for {p}");
            }
        }
    }
}
