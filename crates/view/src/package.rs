//! What a page needs to draw a scene, as one JSON object.

use std::io::Write;

use anyhow::{Result, bail};
use base64::prelude::{BASE64_STANDARD, Engine};
use flate2::{Compression, write::ZlibEncoder};
use infonerf_experiment::Trained;
use infonerf_field::{FactoredField, RadianceField};
use infonerf_ops::to_host;
use infonerf_render::{OccupancyGrid, RenderConfig, Renderer, TrainedModel};
use infonerf_scene::{Range, Scene};
use infonerf_schedule::Moment;
use serde_json::{Value, json};

use crate::network::{Network, Place};
use crate::photographs::{cameras, jpeg_url};
use crate::shader::{Subject, cells, clips, shader};
use crate::tables::{groups, quantise};

/// Bytes of uniforms that graphics cards have room for at least in practice; WebGL2 promises a quarter of it.
const LARGEST_NETWORK: usize = 1 << 16;

/// A field with its scene, ready for a browser.
pub(crate) struct Subjects<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) renderer: &'a Renderer,
    pub(crate) config: &'a RenderConfig,
    pub(crate) trained: &'a TrainedModel,
}

/// The JSON object of a run: title, notes, shader, tables, cameras.
///
/// # Errors
/// If the run's field is not one that a page can hold.
pub(crate) fn of_run(run: &Trained, trained: &TrainedModel) -> Result<Value> {
    let (scene, plan) = (run.scene(), &run.plan);
    let subjects = Subjects { scene, renderer: run.renderer(), config: &plan.config.render, trained };
    let mut package = of_field(&subjects)?;
    package["title"] = json!(plan.label());
    package["note"] = json!(note(run));
    package["cameras"] = json!(cameras(scene)?);
    Ok(package)
}

/// How far the field is trained, and which of several it is.
fn note(run: &Trained) -> String {
    let step = run.trainers[0].progress().step;
    let fields = run.plan.members();
    if fields == 1 {
        return format!("{step} steps");
    }
    format!("{step} steps; the first of {fields} fields, whose mean the run's pictures are")
}

/// The part of the object that does not need photographs.
pub(crate) fn of_field(subjects: &Subjects<'_>) -> Result<Value> {
    let Subjects { scene, renderer, config, trained } = subjects;
    let RadianceField::Factored(field) = &trained.model.fine else {
        bail!("field.kind: expected \"factored\", the kind of field that a page can hold");
    };
    let parts = Parts::of(field);
    let network = Network::pack(&to_host(field.weights()), field.layout(), field.view_dependence(), &parts.inputs);
    if network.bytes() > LARGEST_NETWORK {
        bail!(
            "field.width: expected an MLP of at most {LARGEST_NETWORK} bytes for a page, found {} bytes",
            network.bytes()
        );
    }
    let grid = trained.occupancy.as_ref();
    let shader = shader(&Subject {
        layout: field.layout(),
        network: &network,
        bounds: field.bounds(),
        grid: cells(grid),
        config,
        renderer,
        scene,
    });
    let mut blob = Blob::default();
    for (level, planes) in parts.planes.iter().enumerate() {
        blob.add(&format!("planes{level}"), planes);
    }
    blob.add("lines", &parts.lines);
    blob.add("occupied", &occupied_bits(grid));
    blob.add("network", &floats(network.matrices.iter().chain(&network.biases)));
    blob.add("offsets", &floats(&parts.offsets));
    let (near, far) = match scene.range {
        Range::Distance { near, far } | Range::Depth { near, far } => (near, far),
        Range::Sphere { .. } => (scene.near, scene.far),
    };
    Ok(json!({
        "shader": shader,
        "levels": field.layout().levels.iter().map(|level| level.resolution).collect::<Vec<_>>(),
        "layers": 3 * parts.groups,
        "lineWidth": parts.line_width,
        "grid": cells(grid),
        "closed": clips(config, renderer.warp()),
        "parts": blob.parts,
        "data": blob.deflated()?,
        "background": scene.background,
        "near": near,
        "far": far,
        "up": scene.up.to_array(),
        "centre": scene.centre.to_array(),
        "radius": scene.radius,
        "inside": scene.layout == infonerf_scene::Layout::Inside,
    }))
}

/// A render as JPEG in a `data:` URL, for browsers that cannot draw the field.
pub(crate) fn poster(run: &Trained, trained: &TrainedModel) -> Result<String> {
    const SIDE: u32 = 256;
    let camera = &run.scene().train[0].camera;
    let longest = SIDE.min(camera.width.max(camera.height));
    let (width, height) = infonerf_scene::resized_dimensions(camera.width, camera.height, longest);
    let camera = camera.resized(width, height);
    let image = infonerf_render::render_image(run.renderer(), std::slice::from_ref(trained), &camera);
    jpeg_url(&infonerf_metrics::to_rgb8(&image.rgb, width, height)?)
}

/// A field's tables as textures.
struct Parts {
    /// Textures of each plane.
    groups: usize,
    /// Per level an array of RGBA textures, `[3 · groups, res, res, 4]`.
    planes: Vec<Vec<u8>>,
    /// One RGBA texture for the lines of all levels, `[levels · 3 · groups, line_width, 4]`.
    lines: Vec<u8>,
    line_width: usize,
    /// For each plane's texture low/range of the plane, and of its line.
    offsets: Vec<f32>,
    /// The MLP's input as the shader makes it: its factors undo the quantisation and fade levels.
    inputs: Vec<Place>,
}

impl Parts {
    fn of(field: &FactoredField) -> Self {
        let (layout, tables) = (field.layout(), to_host(field.tables()));
        let (frequency_weights, level_weights) = field.detail(Moment::END);
        let line_width = layout.levels.iter().map(|level| level.resolution).max().unwrap_or(1);
        let channels = layout.levels.first().map_or(4, |level| level.channels);
        let mut parts = Self {
            groups: groups(channels),
            planes: Vec::new(),
            lines: Vec::new(),
            line_width,
            offsets: Vec::new(),
            inputs: vec![Some((0, 1.0)), Some((1, 1.0)), Some((2, 1.0)), None],
        };
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
                    parts.lines.resize(parts.lines.len() + 4 * (line_width - level.resolution), 0);
                }
                for group in 0..parts.groups {
                    let of_group = |number: &dyn Fn(usize) -> f32| {
                        [0, 1, 2, 3].map(|k| 4 * group + k).map(|k| if k < level.channels { number(k) } else { 0.0 })
                    };
                    parts.offsets.extend(of_group(&|k| plane.low[k] / plane.range[k]));
                    parts.offsets.extend(of_group(&|k| line.low[k] / line.range[k]));
                    parts.inputs.extend([0, 1, 2, 3].map(|k| 4 * group + k).map(|k| {
                        let input = level.feature + p * level.channels + k;
                        (k < level.channels).then(|| (input, weight * plane.range[k] * line.range[k]))
                    }));
                }
            }
            parts.planes.push(textures);
        }
        parts
    }
}

/// One bit per cell, x fastest, the first in the lowest bit.
fn occupied_bits(grid: Option<&OccupancyGrid>) -> Vec<u8> {
    let Some(grid) = grid else { return vec![1] };
    let byte = |cells: &[bool]| cells.iter().rev().fold(0, |byte, &occupied| byte << 1 | u8::from(occupied));
    grid.state().1.chunks(8).map(byte).collect()
}

fn floats<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    numbers.into_iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Arrays one after another.
#[derive(Default)]
struct Blob {
    bytes: Vec<u8>,
    /// Where each array begins, and how many bytes it has.
    parts: serde_json::Map<String, Value>,
}

impl Blob {
    fn add(&mut self, name: &str, bytes: &[u8]) {
        self.parts.insert(name.to_owned(), json!([self.bytes.len(), bytes.len()]));
        self.bytes.extend(bytes);
    }

    /// Deflated (zlib), as base64.
    fn deflated(&self) -> Result<String> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&self.bytes)?;
        Ok(BASE64_STANDARD.encode(encoder.finish()?))
    }
}
