//! Oracle for packing: a package read back and evaluated as the shader does.

use std::io::Read;

use base64::prelude::{BASE64_STANDARD, Engine};
use flate2::read::ZlibDecoder;
use glam::Vec3;
use infonerf_experiment::{DeviceName, open};
use infonerf_field::{Extent, Field, FieldConfig, FieldSetup, Points, RadianceField};
use infonerf_ops::{to_host, upload_rows};
use infonerf_render::{Model, OccupancyGrid, RenderConfig, Renderer, TrainedModel};
use infonerf_scene::Scene;
use infonerf_schedule::Moment;
use infonerf_train::{Config, Preset};
use serde_json::Value;

use crate::package::{Subjects, of_field};

const PLANES: [[usize; 3]; 3] = [[0, 1, 2], [0, 2, 1], [1, 2, 0]];

pub(crate) struct DecodedPackage {
    pub(crate) package: Value,
    bytes: Vec<u8>,
}

impl DecodedPackage {
    pub(crate) fn part(&self, name: &str) -> &[u8] {
        let [from, length] = [0, 1].map(|i| self.package["parts"][name][i].as_u64().unwrap() as usize);
        &self.bytes[from..from + length]
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.part(name).chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    /// Reads `#define NAME value` or `const float NAME = value;` of the shader.
    pub(crate) fn constant(&self, name: &str) -> f32 {
        self.line(name).trim_end_matches(';').rsplit(' ').next().unwrap().parse().unwrap()
    }

    /// Reads `const vec3 NAME = vec3(…);` of the shader, or another vector.
    pub(crate) fn vector(&self, name: &str) -> Vec<f32> {
        let (_, numbers) = self.line(name).trim_end_matches(");").split_once('(').unwrap();
        numbers.split(", ").map(|number| number.parse().unwrap()).collect()
    }

    fn line(&self, name: &str) -> &str {
        let shader = self.package["shader"].as_str().unwrap();
        shader.lines().find(|line| line.split([' ', '=']).any(|word| word == name)).unwrap()
    }

    /// Computes the MLP's input at `u` ∈ [0, 1]³.
    fn input(&self, u: [f32; 3]) -> Vec<f32> {
        let mut x: Vec<f32> = u.iter().map(|u| 2.0 * u - 1.0).chain([0.0]).collect();
        for frequency in 0..self.constant("FREQUENCIES") as usize {
            let phase = u.map(|u| (1u32 << frequency) as f32 * std::f32::consts::PI * (u - 0.5));
            x.extend(phase.iter().map(|p| p.sin()).chain([0.0]));
            x.extend(phase.iter().map(|p| p.cos()).chain([0.0]));
        }
        let offsets = self.floats("offsets");
        let groups = self.constant("GROUPS") as usize;
        let width = self.package["lineWidth"].as_u64().unwrap() as usize;
        for (l, size) in self.package["levels"].as_array().unwrap().iter().enumerate() {
            let size = size.as_u64().unwrap() as usize;
            let planes = self.part(&format!("planes{l}"));
            for (p, axes) in PLANES.into_iter().enumerate() {
                let [(i, a), (j, b), (c, t)] = axes.map(|axis| texel(u[axis], size));
                for g in 0..groups {
                    let row = (3 * l + p) * groups + g;
                    for k in 0..4 {
                        let at = |j: usize, i: usize| {
                            f32::from(planes[(((p * groups + g) * size + j) * size + i) * 4 + k]) / 255.0
                        };
                        let rows = [j, j + 1].map(|j| at(j, i) * (1.0 - a) + at(j, i + 1) * a);
                        let plane = rows[0] * (1.0 - b) + rows[1] * b + offsets[8 * row + k];
                        let line = |i: usize| f32::from(self.part("lines")[(row * width + i) * 4 + k]) / 255.0;
                        let line = line(c) * (1.0 - t) + line(c + 1) * t + offsets[8 * row + 4 + k];
                        x.push(plane * line);
                    }
                }
            }
        }
        x
    }

    fn evaluate(&self, u: [f32; 3], direction: [f32; 3]) -> [f32; 4] {
        let network = self.floats("network");
        let (matrices, biases) = network.split_at(16 * self.constant("MATRICES") as usize);
        let (mut matrices, mut biases) = (matrices.chunks_exact(16), biases.chunks_exact(4));
        let mut x = self.input(u);
        assert_eq!(x.len(), 4 * self.constant("INPUTS") as usize);
        // Widths of the layers follow from the text of the shader.
        let layers = self.package["shader"].as_str().unwrap().split("\n    LAYER(").skip(1);
        let widths: Vec<usize> = layers.map(|rest| rest.split(", ").nth(1).unwrap().parse().unwrap()).collect();
        for (index, width) in widths.iter().enumerate() {
            let mut y = Vec::new();
            for _ in 0..*width {
                let mut sum = biases.next().unwrap().to_vec();
                for column in x.chunks_exact(4) {
                    let matrix = matrices.next().unwrap();
                    for (row, sum) in sum.iter_mut().enumerate() {
                        *sum += (0..4).map(|i| matrix[4 * i + row] * column[i]).sum::<f32>();
                    }
                }
                y.extend(sum.iter().map(|s| if index + 1 < widths.len() { s.max(0.0) } else { *s }));
            }
            x = y;
        }
        assert!(matrices.next().is_none() && biases.next().is_none());
        let raw = x[0] + self.constant("DENSITY_BIAS");
        let sigma = self.constant("DENSITY_SCALE") * (raw.max(0.0) + (-raw.abs()).exp().ln_1p());
        let color = [1, 2, 3].map(|c| {
            let seen = x.get(4 * c..4 * c + 3).map_or(0.0, |v| Vec3::from_slice(v).dot(direction.into()));
            1.0 / (1.0 + (-x[c] - seen).exp())
        });
        [sigma, color[0], color[1], color[2]]
    }
}

/// Returns the texel before `u`, and the distance of `u` from it in texels, clamped at the border.
fn texel(u: f32, size: usize) -> (usize, f32) {
    let v = (u * size as f32 - 0.5).clamp(0.0, size as f32 - 1.0).min(size as f32 - 1.0 - 1e-6);
    (v as usize, v.fract())
}

pub(crate) fn model(field: &FieldConfig) -> TrainedModel {
    let device = open(DeviceName::Flex).unwrap().device;
    let setup = FieldSetup { bounds: [[-1.5; 3], [1.5, 1.0, 1.5]], seed: 3, device: &device, body: None };
    let fine = RadianceField::new(field, &setup).unwrap();
    let at = Moment { step: 50, progress: 0.5 };
    TrainedModel { model: Model::of(fine), occupancy: None, at, frame: None, residuals: None }
}

/// Makes the package of a field in a scene without views; a baked field has at most `voxels` along its box.
pub(crate) fn packed(config: &RenderConfig, trained: &TrainedModel, voxels: usize) -> DecodedPackage {
    let scene = Scene::default();
    let renderer = Renderer::new(config, &scene);
    let subjects = Subjects { scene: &scene, renderer: &renderer, config, trained };
    let package = of_field(&subjects, voxels).unwrap();
    assert!(!package["shader"].as_str().unwrap().contains("{{"));
    let deflated = BASE64_STANDARD.decode(package["data"].as_str().unwrap()).unwrap();
    let mut bytes = Vec::new();
    ZlibDecoder::new(deflated.as_slice()).read_to_end(&mut bytes).unwrap();
    DecodedPackage { package, bytes }
}

pub(crate) fn exact(trained: &TrainedModel, p: Vec3, direction: Vec3) -> (f32, Vec<f32>) {
    let field = &trained.model.fine;
    let [p, direction] = [p, direction].map(|v| upload_rows(&v.to_array(), 3, &field.device()));
    let points = Points::scattered(p, Extent::Ball { variance: 0.0 }).seen_along(direction);
    let sampled = field.evaluate(&points, true, trained.at);
    (to_host(sampled.sigma)[0], to_host(sampled.color.unwrap()))
}

#[test]
fn packed_tables_evaluate_to_the_field() {
    let detail = "field.detail={from=0.0,to=1.0}";
    for set in [
        &["field.resolutions=[4,16]", "field.view_dependence=1"][..],
        &["field.resolutions=[8]", "field.channels=2", "field.view_dependence=0", "field.width=10"],
        &["field.resolutions=[5,7,9]", "field.channels=8", "field.layers=1", detail, "field.view_dependence=0.4"],
        &["field.resolutions=[8]", "field.layers=0", "field.frequencies=0", "field.channels=16"],
    ] {
        let config = Config::of(Preset::Fast, set).unwrap();
        let trained = model(&config.field);
        let decoded = packed(&config.render, &trained, 32);
        let mut random = (0..).map(|i: u32| (i as f32 * 0.618_034).fract());
        let mut draw = || random.next().unwrap();
        for _ in 0..40 {
            let u = [draw(), draw(), draw()];
            let direction = Vec3::new(draw() - 0.5, draw() - 0.5, draw() - 0.7).normalize();
            let position = Vec3::new(3.0 * u[0] - 1.5, 2.5 * u[1] - 1.5, 3.0 * u[2] - 1.5);
            let (density, color) = exact(&trained, position, direction);
            let found = decoded.evaluate(u, direction.to_array());
            assert!((found[0] / density - 1.0).abs() < 0.02, "{set:?} at {u:?}: {found:?} for {density}");
            for (found, expected) in found[1..].iter().zip(&color) {
                assert!((found - expected).abs() < 0.005, "{set:?} at {u:?}: {found} for {expected}");
            }
        }
    }
}

#[test]
fn occupancy_is_a_bit_per_cell() {
    let config = Config::of(Preset::Fast, ["field.resolutions=[8]", "render.occupancy.resolution=6"]).unwrap();
    let mut trained = model(&config.field);
    let mut grid = OccupancyGrid::new(&config.render.occupancy, infonerf_scene::Aabb::cube(Vec3::ZERO, 1.0));
    let occupied: Vec<bool> = (0..216).map(|cell| cell % 7 == 0).collect();
    grid.restore(vec![1.0; 216], occupied.clone(), true).unwrap();
    trained.occupancy = Some(grid);
    let decoded = packed(&config.render, &trained, 32);
    assert_eq!((decoded.vector("GRID"), &decoded.package["grid"]), (vec![6.0; 3], &serde_json::json!([6, 6, 6])));
    let bits = decoded.part("occupied");
    assert_eq!(bits.len(), 27);
    for (cell, occupied) in occupied.iter().enumerate() {
        assert_eq!(bits[cell / 8] >> (cell % 8) & 1 == 1, *occupied, "{cell}");
    }
}

#[test]
fn field_with_too_large_a_network_is_baked() {
    let config = Config::of(Preset::Fast, ["field.resolutions=[4]", "field.width=256"]).unwrap();
    let package = packed(&config.render, &model(&config.field), 16).package;
    assert_eq!((&package["voxels"], package["parts"].get("network")), (&serde_json::json!(16), None));
}
