//! Exported files, read back by third-party libraries.

use std::io::{BufReader, Cursor, Read};

use glam::{Quat, UVec3, Vec3};
use goth_gltf::default_extensions::Extensions;
use goth_gltf::{AccessorType, ComponentType, Gltf};
use infonerf_export::{Gaussian, Grid, Mesh, Surface, Volume, glb, npz, obj, ply_mesh, ply_points, ply_splats};
use infonerf_scene::Aabb;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Ply, Property};

/// A tetrahedron in four colours.
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

fn byte(element: &DefaultElement, name: &str) -> u8 {
    match element[name] {
        Property::UChar(value) => value,
        ref other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn ply_of_a_mesh_and_of_points() {
    let mesh = mesh();
    for (bytes, faces) in [(ply_mesh(&mesh), 4), (ply_points(&mesh), 0)] {
        let ply = read_ply(&bytes);
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 4);
        for (i, vertex) in vertices.iter().enumerate() {
            let vector = |names: [&str; 3]| Vec3::from_array(names.map(|name| float(vertex, name)));
            assert_eq!(vector(["x", "y", "z"]), mesh.surface.positions[i]);
            assert_eq!(vector(["nx", "ny", "nz"]), mesh.surface.normals[i]);
            let color = ["red", "green", "blue"].map(|name| byte(vertex, name));
            assert_eq!(color, mesh.colors[i].map(|channel| (channel * 255.0).round() as u8));
        }
        let indices: Vec<&Property> =
            ply.payload.get("face").into_iter().flatten().map(|face| &face["vertex_indices"]).collect();
        assert_eq!(indices.len(), faces);
        for (index, triangle) in indices.iter().zip(&mesh.surface.triangles) {
            assert_eq!(**index, Property::ListInt(triangle.map(|vertex| vertex as i32).to_vec()));
        }
    }
}

#[test]
fn obj_with_vertex_colours() {
    let mesh = mesh();
    let text = obj(&mesh);
    let options = tobj::LoadOptions { single_index: true, ..tobj::LoadOptions::default() };
    let (models, _) =
        tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Err(tobj::LoadError::OpenFileFailed)).unwrap();
    let read = &models[0].mesh;
    assert_eq!(models.len(), 1);
    let vectors = |values: &[f32]| -> Vec<Vec3> { values.chunks_exact(3).map(Vec3::from_slice).collect() };
    // The reader numbers vertices in the order in which triangles use them.
    let (positions, normals, colors) = (vectors(&read.positions), vectors(&read.normals), vectors(&read.vertex_color));
    assert_eq!(read.indices.len(), 12);
    for (index, expected) in read.indices.iter().zip(mesh.surface.triangles.iter().flatten()) {
        let (index, expected) = (*index as usize, *expected as usize);
        assert_eq!(positions[index], mesh.surface.positions[expected]);
        assert!((normals[index] - mesh.surface.normals[expected]).length() < 1e-4);
        assert!((colors[index] - Vec3::from_array(mesh.colors[expected])).length() < 1e-3);
    }
}

#[test]
fn glb_that_stands_upright() {
    let mesh = mesh();
    let bytes = glb(&mesh, Vec3::Z).unwrap();
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
        let numbers: Vec<f32> = words(read(index.unwrap(), AccessorType::Vec3, ComponentType::Float))
            .into_iter()
            .map(f32::from_bits)
            .collect();
        numbers.chunks_exact(3).map(Vec3::from_slice).collect()
    };
    assert_eq!(vectors(primitive.attributes.position), mesh.surface.positions);
    assert_eq!(vectors(primitive.attributes.normal), mesh.surface.normals);
    let bounds = &document.accessors[primitive.attributes.position.unwrap()];
    assert_eq!((bounds.min.as_deref(), bounds.max.as_deref()), (Some(&[0.0; 3][..]), Some(&[1.0, 2.0, 0.1][..])));
    let indices = read(primitive.indices.unwrap(), AccessorType::Scalar, ComponentType::UnsignedInt);
    assert_eq!(words(indices), mesh.surface.triangles.concat());

    // The reader knows no vertex colours, but the accessor.
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
    let ply = read_ply(&ply_splats(&[gaussian, gaussian]));
    let names: Vec<&String> = ply.header.elements["vertex"].properties.keys().collect();
    let mut expected: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    for (name, count) in [("f_dc", 3), ("f_rest", 9), ("opacity", 0), ("scale", 3), ("rot", 4)] {
        match count {
            0 => expected.push(name.into()),
            count => expected.extend((0..count).map(|i| format!("{name}_{i}"))),
        }
    }
    assert_eq!(names, expected.iter().collect::<Vec<_>>());
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

/// Density 10 x in a box twice as wide as deep, coloured by position.
struct Ramp;

impl Volume for Ramp {
    fn bounds(&self) -> Aabb {
        Aabb { min: Vec3::ZERO, max: Vec3::new(2.0, 1.0, 0.5) }
    }

    fn density(&self, points: &[Vec3]) -> Vec<f32> {
        points.iter().map(|p| if p.x > 1.0 { 10.0 * p.x } else { 0.0 }).collect()
    }

    fn color(&self, points: &[Vec3], directions: &[Vec3]) -> Vec<[f32; 3]> {
        points.iter().zip(directions).map(|(p, d)| [0.5 * p.x, p.y, 0.5 + 0.5 * d.z]).collect()
    }
}

#[test]
fn npz_of_a_grid() {
    let grid = Grid::sample(&Ramp, 8, 5.0).unwrap();
    assert_eq!(grid.size, UVec3::new(8, 4, 2));
    let bytes = npz(&grid, &Ramp).unwrap();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut array = |name: &str| {
        let mut bytes = Vec::new();
        archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    };
    let density = npyz::NpyFile::new(Cursor::new(array("density"))).unwrap();
    assert_eq!((density.shape(), density.order()), (&[2, 4, 8][..], npyz::Order::C));
    assert_eq!(density.into_vec::<f32>().unwrap(), grid.density);
    let color = npyz::NpyFile::new(Cursor::new(array("color"))).unwrap();
    assert_eq!(color.shape(), [2, 4, 8, 3]);
    let color = color.into_vec::<u8>().unwrap();
    for index in 0..grid.len() {
        let p = grid.point(index);
        // The direction averages out.
        let expected = if p.x > 1.0 { [0.5 * p.x, p.y, 0.5].map(|c| (c * 255.0).round() as u8) } else { [0; 3] };
        let found = &color[3 * index..3 * index + 3];
        assert!(found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "{found:?} for {expected:?}");
    }
    let numbers = |bytes: Vec<u8>| npyz::NpyFile::new(Cursor::new(bytes)).unwrap().into_vec::<f32>().unwrap();
    assert_eq!(numbers(array("origin")), grid.origin.to_array());
    assert_eq!(numbers(array("voxel")), [0.25]);
}
