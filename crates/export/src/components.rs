use glam::Vec3;
use petgraph::unionfind::UnionFind;

/// Share of the largest component's area below which a component is small.
const SMALL: f32 = 1e-3;

/// Removes small components and vertices that no triangle uses; returns the number of components removed as well.
pub(crate) fn without_small(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> (Vec<Vec3>, Vec<[u32; 3]>, usize) {
    let mut components = UnionFind::<u32>::new(positions.len());
    for [a, b, c] in &triangles {
        components.union(*a, *b);
        components.union(*b, *c);
    }
    let labels = components.into_labeling();
    let mut areas = vec![0f32; positions.len()];
    for triangle in &triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        areas[labels[triangle[0] as usize] as usize] += 0.5 * (b - a).cross(c - a).length();
    }
    let largest = areas.iter().copied().fold(0.0, f32::max);
    let is_kept = |vertex: u32| areas[labels[vertex as usize] as usize] >= SMALL * largest;
    let dropped = areas.iter().filter(|&&area| area > 0.0 && area < SMALL * largest).count();

    let mut places = vec![u32::MAX; positions.len()];
    let mut kept = Vec::with_capacity(positions.len());
    let mut place = |vertex: u32| {
        let place = &mut places[vertex as usize];
        if *place == u32::MAX {
            *place = kept.len() as u32;
            kept.push(positions[vertex as usize]);
        }
        *place
    };
    let triangles = triangles.into_iter().filter(|triangle| is_kept(triangle[0]));
    let triangles = triangles.map(|triangle| triangle.map(&mut place)).collect();
    (kept, triangles, dropped)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(x: f32, size: f32) -> [Vec3; 3] {
        [Vec3::X * x, Vec3::X * x + Vec3::Y * size, Vec3::X * x + Vec3::Z * size]
    }

    #[test]
    fn small_components_and_unused_vertices_go() {
        // A square of two triangles, a small triangle, an unused vertex, and a triangle that is large enough.
        let (corner, unused) = ([Vec3::new(0.0, 1.0, 1.0)], [Vec3::splat(9.0)]);
        let positions = [&triangle(0.0, 1.0)[..], &corner, &triangle(5.0, 0.03), &unused, &triangle(7.0, 0.1)].concat();
        let triangles = vec![[0, 1, 2], [4, 5, 6], [2, 1, 3], [8, 9, 10]];
        let (kept, triangles, dropped) = without_small(positions, triangles);
        assert_eq!((kept.len(), dropped), (7, 1));
        assert_eq!(triangles, [[0, 1, 2], [2, 1, 3], [4, 5, 6]]);
        assert_eq!(kept[4..], triangle(7.0, 0.1));
        assert!(kept.iter().all(|p| p.x != 5.0 && p.x != 9.0));
    }
}
