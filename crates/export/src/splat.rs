//! Gaussian splats (3D Gaussian Splatting, Kerbl et al. 2023).

use glam::{DVec3, Quat, Vec3};

use crate::ply::{header, position_properties, push_position};
use crate::shading::{frame, harmonics};
use crate::surface::Surface;
use crate::volume::Volume;

/// Standard deviation along the surface in voxels: neighbours a voxel apart leave no holes. `THICKNESS` is that across it.
const WIDTH: f32 = 0.7;
const THICKNESS: f32 = 0.2;
/// Opacity of a gaussian at its centre, the maximum that renderers allow.
const OPACITY: f32 = 0.99;

/// Properties of a gaussian in the layout of 3DGS, without its position.
const PROPERTIES: &str = "nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 \
                          f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

/// Flat gaussian with a colour that is linear in the direction of view.
#[derive(Clone, Copy, Debug)]
pub struct Gaussian {
    /// Centre, scene units.
    pub position: Vec3,
    /// Standard deviations along the gaussian's own axes, scene units.
    pub scale: Vec3,
    /// Rotation of the axes; the third is the surface's normal.
    pub rotation: Quat,
    /// Opacity at the centre.
    pub opacity: f32,
    /// Spherical harmonics of red, green and blue, degrees 0 and 1, in the order and with the signs of 3DGS: along the unit
    /// direction (x, y, z) from the eye `½ + √(1/4π) sh₀ + √(3/4π) (−y sh₁ + z sh₂ − x sh₃)`, see [`Gaussian::color`].
    pub sh: [[f32; 4]; 3],
}

/// Places a gaussian with the colours of `volume` at each vertex, tangent to the surface: a start for [`refine`](crate::refine).
pub fn gaussians(surface: &Surface, volume: &dyn Volume) -> Vec<Gaussian> {
    let colors = harmonics(surface, volume);
    let scale = surface.voxel * Vec3::new(WIDTH, WIDTH, THICKNESS);
    let place = |((&position, &normal), sh)| {
        let rotation = Quat::from_mat3(&frame(normal)).normalize();
        Gaussian { position, scale, rotation, opacity: OPACITY, sh }
    };
    surface.positions.iter().zip(&surface.normals).zip(colors).map(place).collect()
}

/// Harmonic of degree 0, √(1/4π), and factor of the harmonics of degree 1, √(3/4π).
pub(crate) const DEGREE_0: f32 = 0.282_094_8;
pub(crate) const DEGREE_1: f32 = 0.488_602_5;

impl Gaussian {
    /// Evaluates the colour along the unit `direction` from the eye, display-encoded RGB, at least 0.
    pub fn color(&self, direction: Vec3) -> Vec3 {
        let shown = self.sh.map(|[constant, y, z, x]| {
            0.5 + DEGREE_0 * constant + DEGREE_1 * (direction.z * z - direction.y * y - direction.x * x)
        });
        Vec3::from_array(shown).max(Vec3::ZERO)
    }
}

/// Encodes gaussians as PLY in the layout of 3DGS: positions, normals, `f_dc`, `f_rest` (channel by channel),
/// the logit of the opacity, the logarithm of the scales, and rotations as (w, x, y, z). `origin`, the position of the
/// scene's origin in the world, is added to positions, which are then in double precision.
pub fn ply_splats(gaussians: &[Gaussian], origin: DVec3) -> Vec<u8> {
    let others = PROPERTIES.split(' ').map(|name| format!("float {name}"));
    let names: Vec<String> = position_properties(origin).map(str::to_owned).into_iter().chain(others).collect();
    let properties: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut file = header(&[("vertex", gaussians.len(), &properties)]);
    for gaussian in gaussians {
        let Gaussian { position, scale, rotation, opacity, sh } = gaussian;
        let constant = sh.iter().map(|channel| channel[0]);
        let linear = sh.iter().flat_map(|channel| channel[1..].iter().copied());
        let [x, y, z, w] = rotation.to_array();
        push_position(&mut file, *position, origin);
        let (normal, logit) = ((*rotation * Vec3::Z).to_array(), (opacity / (1.0 - opacity)).ln());
        let shape = scale.to_array().map(f32::ln).into_iter().chain([w, x, y, z]);
        let values = normal.into_iter().chain(constant).chain(linear).chain([logit]).chain(shape);
        values.for_each(|value| file.extend(value.to_le_bytes()));
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shading::endpoints;
    use crate::volume::testing::Ball;

    #[test]
    fn gaussians_are_tangent_and_show_the_volumes_colour() {
        let ball = Ball { radius: 1.0, sharpness: 100.0 };
        let surface = ball.surface(24);
        let splats = gaussians(&surface, &ball);
        assert_eq!(splats.len(), surface.positions.len());
        let ends = endpoints(&surface, &ball);
        for ((splat, normal), end) in splats.iter().zip(&surface.normals).zip(&ends) {
            assert!((splat.rotation * Vec3::Z - *normal).length() < 1e-5);
            assert!(splat.scale.z < splat.scale.x && splat.scale.x == splat.scale.y);
            // Four directions determine a linear function.
            for d in [Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.0, 0.6, -0.8), Vec3::new(-0.6, 0.0, -0.8)] {
                let d = frame(*normal) * d;
                let (shown, expected) = (splat.color(d), Vec3::from_array(ball.color(&[*end], &[d])[0]));
                assert!(shown.abs_diff_eq(expected, 3e-4), "{shown} for {expected} along {d}");
            }
        }
    }
}
