//! glTF 2.0 in its binary container.

use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};

use crate::ExportError;
use crate::mesh::Mesh;

/// Component types and buffer targets of the specification.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Encodes a mesh as `.glb`. `up` is the world's up direction, which the file's node rotates to glTF's +y; vertices keep the
/// scene's coordinates. `origin`, the position of the scene's origin in the world, becomes the node's translation, since
/// single precision is too coarse far from 0.
///
/// Colours are stored linear, as in all of glTF. They include the lighting, so the material is `KHR_materials_unlit`.
///
/// # Errors
/// If the mesh is larger than the format allows, 4 GB.
pub fn glb(mesh: &Mesh, up: Vec3, origin: DVec3) -> Result<Vec<u8>, ExportError> {
    let surface = &mesh.surface;
    let mut buffer = Buffer::default();
    let vectors = |vectors: &[Vec3]| -> Vec<u8> {
        vectors.iter().flat_map(|v| v.to_array().map(f32::to_le_bytes)).flatten().collect()
    };
    let count = surface.positions.len();
    let position = buffer.add(&vectors(&surface.positions), ARRAY_BUFFER, count, "VEC3", FLOAT);
    for (name, pick) in [("min", Vec3::min as fn(Vec3, Vec3) -> Vec3), ("max", Vec3::max)] {
        let corner = surface.positions.iter().copied().reduce(pick).unwrap_or(Vec3::ZERO);
        buffer.accessors[position][name] = json!(corner.to_array());
    }
    let normal = buffer.add(&vectors(&surface.normals), ARRAY_BUFFER, count, "VEC3", FLOAT);
    let color = buffer.add(&colors(&mesh.colors), ARRAY_BUFFER, count, "VEC4", UNSIGNED_SHORT);
    buffer.accessors[color]["normalized"] = json!(true);
    let corners: Vec<u8> = surface.triangles.iter().flatten().flat_map(|vertex| vertex.to_le_bytes()).collect();
    let count = 3 * surface.triangles.len();
    let indices = buffer.add(&corners, ELEMENT_ARRAY_BUFFER, count, "SCALAR", UNSIGNED_INT);
    let turn = DQuat::from_rotation_arc(up.as_dvec3().normalize_or(DVec3::Y), DVec3::Y);
    let mut node = json!({"mesh": 0, "rotation": turn.as_quat().to_array()});
    if origin != DVec3::ZERO {
        node["translation"] = json!((turn * origin).to_array());
    }
    let document = json!({
        "asset": {"version": "2.0", "generator": "infonerf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": position, "NORMAL": normal, "COLOR_0": color},
            "indices": indices,
            "material": 0,
        }]}],
        "materials": [{"doubleSided": true, "extensions": {"KHR_materials_unlit": {}}}],
        "extensionsUsed": ["KHR_materials_unlit"],
        "buffers": [{"byteLength": buffer.bytes.len()}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    });
    container(document.to_string().into_bytes(), buffer.bytes)
}

/// Encodes linear colours in 16 bits, with an alpha of 1 so that each takes 8 bytes, for alignment.
fn colors(colors: &[[f32; 3]]) -> Vec<u8> {
    let of_color = |color: &[f32; 3]| {
        let [r, g, b] = color.map(|channel| (linear(channel) * f32::from(u16::MAX)).round() as u16);
        [r, g, b, u16::MAX]
    };
    colors.iter().flat_map(of_color).flat_map(u16::to_le_bytes).collect()
}

/// Returns the linear value of a display-encoded channel (sRGB, IEC 61966-2-1).
fn linear(channel: f32) -> f32 {
    let channel = channel.clamp(0.0, 1.0);
    if channel <= 0.040_45 { channel / 12.92 } else { ((channel + 0.055) / 1.055).powf(2.4) }
}

#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Appends `bytes`, `count` elements of a `shape` of `component`s, and returns the index of their accessor.
    fn add(&mut self, bytes: &[u8], target: u32, count: usize, shape: &str, component: u32) -> usize {
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": target});
        let accessor =
            json!({"bufferView": self.views.len(), "count": count, "type": shape, "componentType": component});
        self.bytes.extend(bytes);
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Joins header, document and buffer, each padded to a multiple of four bytes.
fn container(mut document: Vec<u8>, mut buffer: Vec<u8>) -> Result<Vec<u8>, ExportError> {
    document.resize(document.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let length = 12 + 8 + document.len() + 8 + buffer.len();
    let length = u32::try_from(length).map_err(|_| ExportError("glb: expected at most 4 GB".into()))?;
    let size = |chunk: &[u8]| (chunk.len() as u32).to_le_bytes();
    let head = [*b"glTF", 2u32.to_le_bytes(), length.to_le_bytes()].concat();
    let [json, bin] = [(*b"JSON", &document), (*b"BIN\0", &buffer)].map(|(kind, chunk)| [size(chunk), kind].concat());
    Ok([head, json, document, bin, buffer].concat())
}
