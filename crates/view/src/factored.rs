//! Factored field in a package: its tables as 8-bit textures, its MLP as matrices.

use std::fmt::Write;

use anyhow::Result;
use glam::Vec3;
use infonerf_field::{FactoredField, FieldConfig};
use infonerf_ops::factored::{FactoredLayout, Level};
use infonerf_ops::to_host;
use infonerf_render::OccupancyGrid;
use infonerf_schedule::Moment;
use serde_json::{Value, json};

use crate::blob::{Blob, bits, floats};
use crate::network::{PackedNetwork, Place};
use crate::package::Subjects;
use crate::shader::{FieldMarch, clips, vector};

const FIELD: &str = include_str!("../assets/tables.glsl");
/// Number of bytes of uniforms that fit into graphics cards in practice; WebGL2 guarantees a quarter of it.
const MAX_NETWORK: usize = 1 << 16;

/// Returns whether a page evaluates fields of this kind exactly. Other fields are baked, which takes seconds to minutes, as is
/// a factored field whose MLP does not fit into a shader's uniforms.
pub fn is_exact(field: &FieldConfig) -> bool {
    matches!(field, FieldConfig::Factored(_))
}

/// Makes the shader and the arrays of a factored field; `None` if its MLP is larger than a graphics card's uniforms.
pub(crate) fn package(field: &FactoredField, subjects: &Subjects<'_>) -> Result<Option<Value>> {
    let Subjects { scene, renderer, config, trained } = subjects;
    let (layout, parts) = (field.layout(), TableTextures::of(field, trained.at));
    let network = PackedNetwork::pack(&to_host(field.weights()), layout, field.view_dependence(), &parts.inputs);
    if size_of::<f32>() * (network.matrices.len() + network.biases.len()) > MAX_NETWORK {
        return Ok(None);
    }
    let grid = trained.occupancy.as_ref();
    let [low, high] = field.bounds().map(Vec3::from_array);
    // Without a grid there is one cell, which is never empty.
    let cells = grid.map_or(1, OccupancyGrid::resolution);
    let clips = clips(config, renderer.warp());
    let march = FieldMarch {
        scene,
        config,
        warp: renderer.warp(),
        clip: clips.then_some(scene.space.bounds),
        low,
        cell: (high - low) / cells as f32,
        cells: [cells; 3],
        step: renderer.step_length(trained.at),
        stop: config.early_stop_transmittance,
        detail: (high - low).max_element() / finest(layout) as f32,
    };
    let mut blob = Blob::default();
    for (level, planes) in parts.planes.iter().enumerate() {
        blob.add(&format!("planes{level}"), planes);
    }
    blob.add("lines", &parts.lines);
    blob.add("occupied", &grid.map_or(vec![1], |grid| bits(grid.state().1)));
    blob.add("network", &floats(network.matrices.iter().chain(&network.biases)));
    blob.add("offsets", &floats(&parts.offsets));
    Ok(Some(json!({
        "shader": march.shader(&shader(layout, &network, high - low)),
        "levels": layout.levels.iter().map(|level| level.resolution).collect::<Vec<_>>(),
        "layers": 3 * texture_groups(layout),
        "lineWidth": finest(layout),
        "grid": [cells, cells, cells],
        "closed": clips,
        "parts": blob.parts,
        "data": blob.deflated()?,
    })))
}

fn finest(layout: &FactoredLayout) -> usize {
    layout.levels.iter().map(|level| level.resolution).max().unwrap_or(1)
}

/// Returns the number of textures of each plane, and of each line.
fn texture_groups(layout: &FactoredLayout) -> usize {
    layout.levels.first().map_or(1, |level| level.channels.div_ceil(4))
}

/// Writes the field's part of the shader; the field covers a box of `size`.
fn shader(layout: &FactoredLayout, network: &PackedNetwork, size: Vec3) -> String {
    let samplers = (0..layout.levels.len()).map(|l| format!("uniform sampler2DArray planes{l};\n"));
    FIELD
        .replace("{{constants}}\n", &constants(layout, network, size))
        .replace("{{samplers}}\n", &samplers.collect::<String>())
        .replace("{{features}}\n", &features(layout))
        .replace("{{layers}}\n", &layers(&network.layers))
}

fn constants(layout: &FactoredLayout, network: &PackedNetwork, size: Vec3) -> String {
    let rows = 3 * layout.levels.len() * texture_groups(layout);
    let mut text = String::new();
    for (name, value) in [
        ("GROUPS", texture_groups(layout)),
        ("FREQUENCIES", layout.frequencies),
        ("INPUTS", network.layers[0].0),
        ("OUTPUTS", network.layers[network.layers.len() - 1].1),
        ("MATRICES", network.matrices.len() / 16),
        ("BIASES", network.biases.len() / 4),
        ("OFFSETS", 2 * rows),
        ("LINE_WIDTH", finest(layout)),
        ("LINE_ROWS", rows),
    ] {
        let _ = writeln!(text, "#define {name} {value}");
    }
    for (name, value) in [("DENSITY_SCALE", layout.density_scale), ("DENSITY_BIAS", layout.density_bias)] {
        let _ = writeln!(text, "const float {name} = {value:?};");
    }
    let _ = writeln!(text, "const vec3 SIZE = {};", vector(size));
    text
}

fn features(layout: &FactoredLayout) -> String {
    let level = |(l, level): (usize, &Level)| {
        let before = if l == 0 { String::new() } else { format!(" + {l} * 3 * GROUPS") };
        format!("            x[k{before}] = product(planes{l}, {l}, {:?}, p, g, u);\n", level.resolution as f32)
    };
    layout.levels.iter().enumerate().map(level).collect()
}

fn layers(layers: &[(usize, usize)]) -> String {
    let (mut matrix, mut bias, mut from) = (0, 0, "x".to_owned());
    let mut text = String::new();
    for (index, &(inputs, outputs)) in (1..).zip(layers) {
        let last = index == layers.len();
        let (to, result) = if last { ("y".to_owned(), "sum") } else { (format!("h{index}"), "max(sum, 0.0)") };
        if !last {
            let _ = writeln!(text, "    vec4 {to}[{outputs}];");
        }
        let _ = writeln!(text, "    LAYER({to}, {outputs}, {from}, {inputs}, {matrix}, {bias}, {result})");
        (matrix, bias, from) = (matrix + inputs * outputs, bias + outputs, to);
    }
    text
}

#[derive(Default)]
struct TableTextures {
    /// Array of RGBA textures of each level, `[3 · groups, res, res, 4]`.
    planes: Vec<Vec<u8>>,
    /// RGBA texture of the lines of all levels, `[levels · 3 · groups, finest, 4]`.
    lines: Vec<u8>,
    /// Quotient low/range of each channel of each plane's texture, and of its line's texture.
    offsets: Vec<f32>,
    /// Inputs of the MLP in the shader's order, with factors that undo the quantisation and apply the levels' weights.
    inputs: Vec<Place>,
}

impl TableTextures {
    fn of(field: &FactoredField, at: Moment) -> Self {
        let (layout, tables) = (field.layout(), to_host(field.tables()));
        let (frequency_weights, level_weights) = field.detail(at);
        let inputs = vec![Some((0, 1.0)), Some((1, 1.0)), Some((2, 1.0)), None];
        let mut parts = Self { inputs, ..Self::default() };
        for (frequency, &weight) in frequency_weights.iter().enumerate() {
            let first = 3 + 6 * frequency;
            let of = |input: usize| Some((input, weight));
            parts.inputs.extend([of(first), of(first + 2), of(first + 4), None]);
            parts.inputs.extend([of(first + 1), of(first + 3), of(first + 5), None]);
        }
        for (level, &weight) in layout.levels.iter().zip(&level_weights) {
            let mut textures = Vec::new();
            for p in 0..3 {
                let plane = quantise(&tables[level.plane(p)..][..level.plane_len()], level.channels);
                let line = quantise(&tables[level.line(p)..][..level.line_len()], level.channels);
                textures.extend(plane.textures.concat());
                for texture in &line.textures {
                    parts.lines.extend(texture);
                    parts.lines.resize(parts.lines.len() + 4 * (finest(layout) - level.resolution), 0);
                }
                for group in 0..texture_groups(layout) {
                    let channels = [0, 1, 2, 3].map(|k| Some(4 * group + k).filter(|&k| k < level.channels));
                    let offset = |of: &Quantised| channels.map(|k| k.map_or(0.0, |k| of.low[k] / of.range[k]));
                    parts.offsets.extend([offset(&plane), offset(&line)].concat());
                    let input = |k| (level.feature + p * level.channels + k, weight * plane.range[k] * line.range[k]);
                    parts.inputs.extend(channels.map(|k| k.map(input)));
                }
            }
            parts.planes.push(textures);
        }
        parts
    }
}

/// Table `[texels, channels]` as textures of four channels with 8 bits each; a last texture is filled up with zeros.
///
/// A channel's value is `low + range · byte/255`, off by at most half of `range/255`.
struct Quantised {
    /// Bytes `[texels, 4]` of each texture.
    textures: Vec<Vec<u8>>,
    /// Minimum value of each channel.
    low: Vec<f32>,
    /// Range of each channel's values, or 1 if they are all equal.
    range: Vec<f32>,
}

/// Quantises `table`, `[texels, channels]` row-major.
fn quantise(table: &[f32], channels: usize) -> Quantised {
    let of_channel = |k: usize| table.iter().skip(k).step_by(channels).copied();
    let low: Vec<f32> = (0..channels).map(|k| of_channel(k).fold(f32::INFINITY, f32::min)).collect();
    let high = (0..channels).map(|k| of_channel(k).fold(f32::NEG_INFINITY, f32::max));
    let range: Vec<f32> = high.zip(&low).map(|(high, low)| if high > *low { high - low } else { 1.0 }).collect();
    let byte = |value: f32, k: usize| ((value - low[k]) / range[k] * 255.0).round() as u8;
    let texture = |group: usize| {
        let texel = |row: &[f32]| [0, 1, 2, 3].map(|k| row.get(4 * group + k).map_or(0, |&v| byte(v, 4 * group + k)));
        table.chunks_exact(channels).flat_map(texel).collect()
    };
    Quantised { textures: (0..channels.div_ceil(4)).map(texture).collect(), low, range }
}
