use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::shading::{colors_along_normals, endpoints};
use crate::surface::Surface;
use crate::volume::Volume;

/// Surface with a colour at each vertex.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Shape of the mesh.
    pub surface: Surface,
    /// Display-encoded RGB of each vertex in [0, 1], as seen along its normal from outside.
    pub colors: Vec<[f32; 3]>,
}

impl Mesh {
    /// Makes a mesh of `surface` with the colours of `volume`.
    pub fn new(surface: Surface, volume: &dyn Volume) -> Self {
        Self { colors: colors_along_normals(&surface, &endpoints(&surface, volume), volume), surface }
    }
}

impl Surface {
    /// Draws `count` points, evenly by area and at random within triangles, from a fixed seed; none without any area.
    pub fn sample(&self, count: usize) -> Vec<Vec3> {
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| self.positions[vertex as usize]);
        let areas = self.triangles.iter().map(corners).map(|[a, b, c]| f64::from((b - a).cross(c - a).length()));
        let (mut total, mut ends) = (0.0, Vec::with_capacity(self.triangles.len()));
        for area in areas {
            total += area;
            ends.push(total);
        }
        if total <= 0.0 {
            return Vec::new();
        }
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let point = |i: usize| {
            let place = total * (i as f64 + 0.5) / count as f64;
            let triangle = ends.partition_point(|&end| end <= place).min(ends.len() - 1);
            let [a, b, c] = corners(&self.triangles[triangle]);
            let (u, v) = (rng.random::<f32>().sqrt(), rng.random::<f32>());
            (1.0 - u) * a + u * (1.0 - v) * b + u * v * c
        };
        (0..count).map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_by_area() {
        // Two triangles in the plane z = 0, one of three times the other's area.
        let surface = Surface {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X * 5.0, Vec3::X * 8.0, Vec3::new(5.0, 1.0, 0.0)],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..Surface::default()
        };
        let points = surface.sample(1000);
        assert_eq!(points.len(), 1000);
        assert_eq!(points.iter().filter(|p| p.x <= 1.0).count(), 250);
        assert!(points.iter().all(|p| p.z == 0.0 && p.y >= 0.0 && p.y <= 1.0));
        // The mean of a triangle's points is its centre.
        let mean = points[..250].iter().sum::<Vec3>() / 250.0;
        assert!((mean - Vec3::new(1.0, 1.0, 0.0) / 3.0).length() < 0.05, "{mean}");
        assert_eq!(points, surface.sample(1000));
        assert!(Surface::default().sample(10).is_empty());
    }
}
