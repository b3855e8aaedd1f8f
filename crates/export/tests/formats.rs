//! Exported files, read back by third-party libraries.

use std::io::BufReader;

use glam::{DQuat, DVec3, Quat, Vec3};
use goth_gltf::default_extensions::Extensions;
use goth_gltf::{AccessorType, ComponentType, Gltf};
use infonerf_export::{Gaussian, Mesh, Surface, glb, ply_mesh, ply_points, ply_splats};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Ply, Property};
use serde_json::Value;

/// Returns a tetrahedron in four colours.
fn mesh() -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y * 2.0, Vec3::Z * 0.1];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let normals = vec![-Vec3::ONE.normalize(), Vec3::X, Vec3::Y, Vec3::Z];
    let colors = vec![[0.0, 0.5, 1.0], [1.0, 0.0, 0.0], [0.2, 0.4, 0.6], [0.01, 1.0, 0.99]];
    Mesh { surface: Surface { positions, normals, triangles, voxel: 0.1, dropped: 0 }, colors }
}

fn read_ply(bytes: &[u8]) -> Ply<DefaultElement> {
    Parser::<DefaultElement>::new().read_ply(&mut BufReader::new(bytes)).unwrap()
}

fn float(element: &DefaultElement, name: &str) -> f32 {
    match element[name] {
        Property::Float(value) => value,
        ref other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn ply_holds_a_mesh_or_points() {
    let mesh = mesh();
    for (bytes, faces) in [(ply_mesh(&mesh, DVec3::ZERO), 4), (ply_points(&mesh, DVec3::ZERO), 0)] {
        let ply = read_ply(&bytes);
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 4);
        for (i, vertex) in vertices.iter().enumerate() {
            let vector = |names: [&str; 3]| Vec3::from_array(names.map(|name| float(vertex, name)));
            assert_eq!(vector(["x", "y", "z"]), mesh.surface.positions[i]);
            assert_eq!(vector(["nx", "ny", "nz"]), mesh.surface.normals[i]);
            for (name, channel) in ["red", "green", "blue"].into_iter().zip(mesh.colors[i]) {
                assert_eq!(vertex[name], Property::UChar((channel * 255.0).round() as u8));
            }
        }
        let found: Vec<&DefaultElement> = ply.payload.get("face").into_iter().flatten().collect();
        assert_eq!(found.len(), faces);
        for (face, triangle) in found.into_iter().zip(&mesh.surface.triangles) {
            assert_eq!(face["vertex_indices"], Property::ListInt(triangle.map(|vertex| vertex as i32).to_vec()));
        }
    }
}

#[test]
fn glb_stands_upright_in_linear_colours() {
    let mesh = mesh();
    let bytes = glb(&mesh, Vec3::Z, DVec3::ZERO).unwrap();
    assert_eq!((bytes.len() as u32).to_le_bytes(), bytes[8..12]);
    let (document, buffer) = Gltf::<Extensions>::from_bytes(&bytes).unwrap();
    let buffer = buffer.unwrap();
    assert_eq!(buffer.len(), document.buffers[0].byte_length);
    let node = &document.nodes[document.scenes[document.scene].nodes[0]];
    let up = Quat::from_array(node.rotation.unwrap()) * Vec3::Z;
    assert!((up - Vec3::Y).length() < 1e-6, "{up}");
    let primitive = &document.meshes[node.mesh.unwrap()].primitives[0];
    let material = &document.materials[primitive.material.unwrap()];
    assert!(material.double_sided && material.extensions.khr_materials_unlit.is_some());

    let read = |index: usize, kind: AccessorType, component: ComponentType| {
        let accessor = &document.accessors[index];
        assert_eq!((accessor.accessor_type, accessor.component_type), (kind, component));
        let view = &document.buffer_views[accessor.buffer_view.unwrap()];
        assert_eq!(accessor.byte_length(view), view.byte_length);
        assert_eq!(view.byte_offset % 4, 0);
        &buffer[view.byte_offset..view.byte_offset + view.byte_length]
    };
    let words = |bytes: &[u8]| -> Vec<u32> {
        bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect()
    };
    let vectors = |index: Option<usize>| -> Vec<Vec3> {
        let words = words(read(index.unwrap(), AccessorType::Vec3, ComponentType::Float));
        words.chunks_exact(3).map(|v| Vec3::from_array([v[0], v[1], v[2]].map(f32::from_bits))).collect()
    };
    assert_eq!(vectors(primitive.attributes.position), mesh.surface.positions);
    assert_eq!(vectors(primitive.attributes.normal), mesh.surface.normals);
    let bounds = &document.accessors[primitive.attributes.position.unwrap()];
    assert_eq!((bounds.min.as_deref(), bounds.max.as_deref()), (Some(&[0.0; 3][..]), Some(&[1.0, 2.0, 0.1][..])));
    let indices = read(primitive.indices.unwrap(), AccessorType::Scalar, ComponentType::UnsignedInt);
    assert_eq!(words(indices), mesh.surface.triangles.concat());

    // The reader does not know vertex colours, so they are read through their accessor.
    let color = document.accessors.iter().position(|accessor| accessor.normalized).unwrap();
    let colors = read(color, AccessorType::Vec4, ComponentType::UnsignedShort);
    for (color, expected) in colors.chunks_exact(8).zip(&mesh.colors) {
        let channel = |i: usize| f32::from(u16::from_le_bytes([color[2 * i], color[2 * i + 1]])) / 65535.0;
        assert_eq!(channel(3), 1.0);
        for (i, encoded) in expected.iter().enumerate() {
            let linear = channel(i);
            let back = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            assert!((back - encoded).abs() < 1e-3, "{back} for {encoded}");
        }
    }
}

#[test]
fn splats_with_the_properties_of_3dgs() {
    let gaussian = Gaussian {
        position: Vec3::new(1.0, 2.0, 3.0),
        scale: Vec3::new(0.1, 0.2, 0.3),
        rotation: Quat::from_rotation_x(0.5),
        opacity: 0.75,
        sh: [[0.1, 0.2, 0.3, 0.4], [1.1, 1.2, 1.3, 1.4], [2.1, 2.2, 2.3, 2.4]],
    };
    let ply = read_ply(&ply_splats(&[gaussian, gaussian], DVec3::ZERO));
    let names: Vec<&str> = ply.header.elements["vertex"].properties.keys().map(String::as_str).collect();
    let expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 \
                    f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    assert_eq!(names.join(" "), expected);
    let splats = &ply.payload["vertex"];
    assert_eq!(splats.len(), 2);
    let values = |name: &str, count: usize| -> Vec<f32> {
        (0..count).map(|i| float(&splats[1], &format!("{name}_{i}"))).collect()
    };
    assert_eq!(values("f_dc", 3), [0.1, 1.1, 2.1]);
    assert_eq!(values("f_rest", 9), [0.2, 0.3, 0.4, 1.2, 1.3, 1.4, 2.2, 2.3, 2.4]);
    assert!((float(&splats[1], "opacity") - 3f32.ln()).abs() < 1e-6);
    for (log, scale) in values("scale", 3).iter().zip([0.1f32, 0.2, 0.3]) {
        assert!((log.exp() - scale).abs() < 1e-6);
    }
    // (w, x, y, z)
    let half = 0.25f32;
    for (value, expected) in values("rot", 4).iter().zip([half.cos(), half.sin(), 0.0, 0.0]) {
        assert!((value - expected).abs() < 1e-6);
    }
}

/// World coordinates of 4.6e6, which single precision would round to multiples of 0.5, are exported exactly.
#[test]
fn exports_are_where_the_world_has_them() {
    let (mesh, origin) = (mesh(), DVec3::new(448_262.125, 4_649_776.375, 85.0625));
    let (scale, rotation, sh) = (Vec3::ONE, Quat::IDENTITY, [[0.1; 4]; 3]);
    let gaussian = |&position: &Vec3| Gaussian { position, scale, rotation, opacity: 0.5, sh };
    let splats: Vec<Gaussian> = mesh.surface.positions.iter().map(gaussian).collect();
    for bytes in [ply_mesh(&mesh, origin), ply_points(&mesh, origin), ply_splats(&splats, origin)] {
        let ply = read_ply(&bytes);
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 4);
        for (vertex, position) in vertices.iter().zip(&mesh.surface.positions) {
            let world = ["x", "y", "z"].map(|name| match vertex[name] {
                Property::Double(value) => value,
                ref other => panic!("{name}: {other:?}"),
            });
            assert_eq!(DVec3::from_array(world), position.as_dvec3() + origin);
        }
    }
    let bytes = glb(&mesh, Vec3::Z, origin).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let numbers = |key: &str| -> Vec<f64> {
        document["nodes"][0][key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let turn = DQuat::from_slice(&numbers("rotation")).normalize();
    let world = turn.inverse() * DVec3::from_slice(&numbers("translation"));
    assert!(world.distance(origin) < 2.0, "{world}");
    let exact = DQuat::from_rotation_arc(DVec3::Z, DVec3::Y).inverse() * DVec3::from_slice(&numbers("translation"));
    assert!(exact.distance(origin) < 1e-6, "{exact}");
}
