use glam::Vec3;
use infonerf_scene::Aabb;

/// Radiance field that is queried at points of the world, many at a time.
pub trait Volume {
    /// Returns the box that is exported, scene units.
    fn bounds(&self) -> Aabb;

    /// Evaluates the density σ ≥ 0 at each of `points`, 1/scene unit.
    fn density(&self, points: &[Vec3]) -> Vec<f32>;

    /// Evaluates the display-encoded colour in [0, 1]³ at each point, along its unit direction from the eye.
    fn color(&self, points: &[Vec3], directions: &[Vec3]) -> Vec<[f32; 3]>;
}

#[cfg(test)]
pub(crate) mod testing {
    //! A field whose surface is known.

    use std::f32::consts::LN_2;

    use super::*;
    use crate::grid::DensityGrid;
    use crate::surface::Surface;

    /// Ball about the origin whose density rises smoothly through the surface: `σ = sharpness · softplus(sharpness ·
    /// (radius − |p|))`. Red, green and blue grow with x, y and z; red grows with the direction's y as well.
    pub struct Ball {
        pub radius: f32,
        pub sharpness: f32,
    }

    impl Ball {
        /// Extracts the sphere of the ball's radius.
        pub fn surface(&self, resolution: usize) -> Surface {
            Surface::extract(&DensityGrid::sample(self, resolution, self.sharpness * LN_2).unwrap()).unwrap()
        }

        /// Returns the distance from the origin at which the density is `level`.
        pub fn radius_at(&self, level: f32) -> f32 {
            self.radius - (level / self.sharpness).exp_m1().ln() / self.sharpness
        }
    }

    impl Volume for Ball {
        fn bounds(&self) -> Aabb {
            Aabb::cube(Vec3::ZERO, 1.5)
        }

        fn density(&self, points: &[Vec3]) -> Vec<f32> {
            let x = |p: &Vec3| self.sharpness * (self.radius - p.length());
            points.iter().map(|p| self.sharpness * (x(p).max(0.0) + (-x(p).abs()).exp().ln_1p())).collect()
        }

        fn color(&self, points: &[Vec3], directions: &[Vec3]) -> Vec<[f32; 3]> {
            let color = |(p, d): (&Vec3, &Vec3)| {
                let base = 0.5 + 0.3 * *p / self.radius;
                (base + Vec3::X * (0.1 * d.y)).clamp(Vec3::ZERO, Vec3::ONE).to_array()
            };
            points.iter().zip(directions).map(color).collect()
        }
    }
}
