//! PLY (Turk 1994), binary and little-endian.

use glam::{DVec3, Vec3};

use crate::mesh::Mesh;

const NORMAL: [&str; 3] = ["float nx", "float ny", "float nz"];
const COLOR: [&str; 3] = ["uchar red", "uchar green", "uchar blue"];

/// Encodes a mesh: vertices with positions, normals and colours, and triangles. `origin`, the position of the scene's origin
/// in the world, is added to positions, which are then in double precision.
pub fn ply_mesh(mesh: &Mesh, origin: DVec3) -> Vec<u8> {
    let triangles = &mesh.surface.triangles;
    let mut file = vertices(mesh, origin, &[("face", triangles.len(), &["list uchar int vertex_indices"])]);
    for triangle in triangles {
        file.push(3);
        triangle.iter().for_each(|&vertex| file.extend((vertex as i32).to_le_bytes()));
    }
    file
}

/// Encodes a point cloud: the vertices of a mesh as [`ply_mesh`] writes them.
pub fn ply_points(mesh: &Mesh, origin: DVec3) -> Vec<u8> {
    vertices(mesh, origin, &[])
}

/// Name, count and properties (each a type and a name) of the elements of a kind.
type Elements<'a> = (&'a str, usize, &'a [&'a str]);

pub(crate) fn header(elements: &[Elements]) -> Vec<u8> {
    let element = |(name, count, properties): &Elements| {
        let properties: String = properties.iter().map(|property| format!("property {property}\n")).collect();
        format!("element {name} {count}\n{properties}")
    };
    let elements: String = elements.iter().map(element).collect();
    format!("ply\nformat binary_little_endian 1.0\ncomment infonerf\n{elements}end_header\n").into_bytes()
}

/// Returns the properties that [`push_position`] writes.
pub(crate) fn position_properties(origin: DVec3) -> [&'static str; 3] {
    if origin == DVec3::ZERO { ["float x", "float y", "float z"] } else { ["double x", "double y", "double z"] }
}

/// Appends the world coordinates of a position: in double precision, unless the scene's origin is the world's.
pub(crate) fn push_position(file: &mut Vec<u8>, position: Vec3, origin: DVec3) {
    if origin == DVec3::ZERO {
        return push(file, position);
    }
    (position.as_dvec3() + origin).to_array().iter().for_each(|value| file.extend(value.to_le_bytes()));
}

/// Encodes the header, with `others` after the vertices, and the vertices of a mesh.
fn vertices(mesh: &Mesh, origin: DVec3, others: &[Elements]) -> Vec<u8> {
    let properties: Vec<&str> = position_properties(origin).into_iter().chain(NORMAL).chain(COLOR).collect();
    let mut file = header(&[&[("vertex", mesh.colors.len(), &properties[..])], others].concat());
    let surface = &mesh.surface;
    for ((&position, &normal), color) in surface.positions.iter().zip(&surface.normals).zip(&mesh.colors) {
        push_position(&mut file, position, origin);
        push(&mut file, normal);
        file.extend(color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8));
    }
    file
}

/// Appends a vector, little-endian.
pub(crate) fn push(bytes: &mut Vec<u8>, v: Vec3) {
    v.to_array().iter().for_each(|value| bytes.extend(value.to_le_bytes()));
}
