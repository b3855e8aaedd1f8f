//! Mesh simplification.

use glam::Vec3;
use meshopt::{SimplifyOptions, simplify_decoder};

use crate::components::without_small;
use crate::surface::{Surface, normals};

impl Surface {
    /// Simplifies the surface to at most `triangles` triangles if its shape allows, by collapsing the edges that change
    /// it least (quadric error metrics, Garland and Heckbert 1997, by meshoptimizer). It stays closed. A surface with
    /// no more triangles is returned unchanged.
    #[must_use]
    pub fn simplified(self, triangles: usize) -> Self {
        if self.triangles.len() <= triangles {
            return self;
        }
        let vertices: Vec<[f32; 3]> = self.positions.iter().map(Vec3::to_array).collect();
        let target = 3 * triangles;
        // Any error: the number of triangles decides.
        let options = SimplifyOptions::None;
        let indices = simplify_decoder(self.triangles.as_flattened(), &vertices, target, f32::MAX, options, None);
        let triangles = indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let (positions, triangles, dropped) = without_small(self.positions, triangles);
        let normals = normals(&positions, &triangles);
        Self { positions, normals, triangles, voxel: self.voxel, dropped: self.dropped + dropped }
    }
}

#[cfg(test)]
mod tests {
    use crate::surface::tests::assert_closed;
    use crate::volume::testing::Ball;

    #[test]
    fn a_ball_stays_a_ball() {
        let ball = Ball { radius: 1.0, sharpness: 40.0 };
        let whole = ball.surface(48);
        let (before, voxel) = (whole.triangles.len(), whole.voxel);
        let surface = whole.clone().simplified(before / 10);
        assert!(surface.triangles.len() <= before / 10 && surface.triangles.len() > before / 12);
        assert_eq!(surface.normals.len(), surface.positions.len());
        for p in surface.sample(2000) {
            assert!((p.length() - 1.0).abs() < 0.5 * voxel, "{p}");
        }
        assert_closed(&surface);
        assert_eq!(whole.clone().simplified(before).triangles, whole.triangles);
    }
}
