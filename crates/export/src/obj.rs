use std::fmt::Write;

use crate::Mesh;

/// A mesh as Wavefront OBJ: vertices with colours after their positions (`v x y z r g b`, as MeshLab and Blender read them),
/// normals, and triangles.
pub fn obj(mesh: &Mesh) -> String {
    let surface = &mesh.surface;
    let mut text = "# infonerf\n".to_owned();
    // Writing to a string cannot fail.
    for (p, [r, g, b]) in surface.positions.iter().zip(&mesh.colors) {
        let _ = writeln!(text, "v {} {} {} {r:.4} {g:.4} {b:.4}", p.x, p.y, p.z);
    }
    for n in &surface.normals {
        let _ = writeln!(text, "vn {:.5} {:.5} {:.5}", n.x, n.y, n.z);
    }
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|vertex| vertex + 1);
        let _ = writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}");
    }
    text
}
