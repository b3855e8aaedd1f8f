//! The fragment shader of a field.

use std::fmt::Write;

use glam::{Mat4, Vec3};
use infonerf_ops::factored::Layout;
use infonerf_render::{OccupancyGrid, RenderConfig, Renderer, Warp};
use infonerf_report::turbo;
use infonerf_scene::{Range, Scene};
use infonerf_schedule::Moment;

use crate::network::Network;
use crate::tables::groups;

const TEMPLATE: &str = include_str!("../assets/field.frag");
/// Colours of the depth map that the shader interpolates between.
const COLOURS: usize = 33;

/// What the shader of a field depends on beside its parameters.
pub(crate) struct Subject<'a> {
    pub(crate) layout: &'a Layout,
    pub(crate) network: &'a Network,
    /// Corners of the box that the tables and the occupancy grid lie over.
    pub(crate) bounds: [[f32; 3]; 2],
    /// Cells of the occupancy grid along each axis.
    pub(crate) grid: usize,
    pub(crate) config: &'a RenderConfig,
    pub(crate) renderer: &'a Renderer,
    pub(crate) scene: &'a Scene,
}

/// GLSL ES 3.00.
pub(crate) fn shader(subject: &Subject<'_>) -> String {
    let samplers = (0..subject.layout.levels.len()).map(|l| format!("uniform sampler2DArray planes{l};\n"));
    TEMPLATE
        .replace("{{constants}}\n", &constants(subject))
        .replace("{{samplers}}\n", &samplers.collect::<String>())
        .replace("{{features}}\n", &features(subject.layout))
        .replace("{{layers}}\n", &layers(&subject.network.layers))
        .replace("{{space}}\n", &space(subject.renderer.warp()))
}

/// Cells along each axis of what skips empty space; one that is never empty without a grid.
pub(crate) fn cells(occupancy: Option<&OccupancyGrid>) -> usize {
    occupancy.map_or(1, OccupancyGrid::resolution)
}

/// Whether rays end at the box.
pub(crate) fn clips(config: &RenderConfig, warp: &Warp) -> bool {
    config.clip_to_bounds && warp.is_identity()
}

fn constants(subject: &Subject<'_>) -> String {
    let Subject { layout, network, bounds: [low, high], config, renderer, scene, .. } = subject;
    let (low, high) = (Vec3::from_array(*low), Vec3::from_array(*high));
    let warp = renderer.warp();
    let finest = layout.levels.iter().map(|level| level.resolution).max().unwrap_or(1);
    let channels = layout.levels.first().map_or(4, |level| level.channels);
    let rows = 3 * layout.levels.len() * groups(channels);
    let (inputs, outputs) = (network.layers[0].0, network.layers[network.layers.len() - 1].1);
    let step = match warp {
        Warp::Identity => format!("{:?}", (high - low).max_element() / finest as f32),
        Warp::Contraction { radius, .. } => format!("{:?}", 4.0 * radius / finest as f32),
        Warp::Ndc { .. } => "(0.005 * (t))".to_owned(),
    };
    let integers = [
        ("GROUPS", groups(channels)),
        ("FREQUENCIES", layout.frequencies),
        ("INPUTS", inputs),
        ("OUTPUTS", outputs),
        ("MATRICES", network.matrices.len() / 16),
        ("BIASES", network.biases.len() / 4),
        ("OFFSETS", 2 * rows),
        ("LINE_WIDTH", finest),
        ("LINE_ROWS", rows),
        ("GRID", subject.grid),
        ("CLIPS", usize::from(clips(config, warp))),
        ("STRAIGHT", usize::from(warp.is_identity())),
        ("TURBO_LAST", COLOURS - 1),
    ];
    let floats = [
        ("DENSITY_SCALE", layout.density_scale),
        ("DENSITY_BIAS", layout.density_bias),
        ("STEP", renderer.step_length(Moment::END)),
        ("STOP", config.early_stop_transmittance),
    ];
    let mut text = String::new();
    for (name, value) in integers {
        let _ = writeln!(text, "#define {name} {value}");
    }
    for (name, value) in floats {
        let _ = writeln!(text, "const float {name} = {value:?};");
    }
    let _ = writeln!(text, "#define NORMAL_STEP(t) {step}");
    let _ = writeln!(text, "const vec3 LOW = {};\nconst vec3 SIZE = {};", vector(low), vector(high - low));
    text += &range(&scene.range);
    let colours = (0..COLOURS).map(|i| vector(turbo(i as f32 / (COLOURS - 1) as f32).into()));
    let colours = colours.collect::<Vec<_>>().join(", ");
    let _ = writeln!(text, "const vec3 TURBO[{COLOURS}] = vec3[{COLOURS}]({colours});");
    text
}

/// Where along a ray content lies; its ends, which move with the camera, are uniforms.
fn range(range: &Range) -> String {
    match range {
        Range::Distance { .. } => "#define RANGE 0\n".to_owned(),
        Range::Depth { .. } => "#define RANGE 1\n".to_owned(),
        Range::Sphere { centre, radius } => format!(
            "#define RANGE 2\nconst vec3 RANGE_CENTRE = {};\nconst float RANGE_RADIUS = {radius:?};\n",
            vector(*centre)
        ),
    }
}

fn features(layout: &Layout) -> String {
    let level = |(l, level): (usize, &infonerf_ops::factored::Level)| {
        let before = if l == 0 { String::new() } else { format!(" + {l} * 3 * GROUPS") };
        format!("            x[k{before}] = product(planes{l}, {l}, {:?}, p, g, u);\n", level.resolution as f32)
    };
    layout.levels.iter().enumerate().map(level).collect()
}

fn layers(layers: &[(usize, usize)]) -> String {
    let (mut matrix, mut bias) = (0, 0);
    let mut text = String::new();
    for (index, &(inputs, outputs)) in layers.iter().enumerate() {
        let from = if index == 0 { "x".to_owned() } else { format!("h{index}") };
        let last = index + 1 == layers.len();
        let to = if last { "y".to_owned() } else { format!("h{}", index + 1) };
        if !last {
            let _ = writeln!(text, "    vec4 {to}[{outputs}];");
        }
        let result = if last { "sum" } else { "max(sum, 0.0)" };
        let _ = writeln!(
            text,
            "    for (int o = 0; o < {outputs}; o++) {{\n        vec4 sum = biases[{bias} + o];\n        \
             for (int i = 0; i < {inputs}; i++) sum += matrices[{matrix} + o * {inputs} + i] * {from}[i];\n        \
             {to}[o] = {result};\n    }}"
        );
        matrix += inputs * outputs;
        bias += outputs;
    }
    text
}

/// [`Warp`]'s `point`, `coordinate` and `distance`.
fn space(warp: &Warp) -> String {
    match warp {
        Warp::Identity => "vec3 warp(vec3 p) { return p; }\n\
                           float coordinate(float t) { return t; }\n\
                           float distanceAt(float s) { return s; }\n"
            .to_owned(),
        Warp::Ndc { to_camera, scale, near } => format!(
            "const mat4 TO_CAMERA = {};\n\
             vec3 warp(vec3 p) {{\n    vec3 q = (TO_CAMERA * vec4(p, 1.0)).xyz;\n    \
             float z = max(-q.z, {:?});\n    \
             return vec3({:?} * q.x / z, {:?} * q.y / z, 1.0 - {:?} / z);\n}}\n\
             float coordinate(float t) {{ return 4.0 * (1.0 - {near:?} / max(t, {:?})); }}\n\
             float distanceAt(float s) {{ return {near:?} / max(1.0 - s / 4.0, 1e-4); }}\n",
            matrix(to_camera),
            0.5 * near,
            scale.x,
            scale.y,
            2.0 * near,
            1e-3 * near
        ),
        Warp::Contraction { centre, radius } => format!(
            "#define HORIZON {:?}\n\
             vec3 warp(vec3 p) {{\n    vec3 x = (p - {}) / {radius:?};\n    float r = sqrt(dot(x, x));\n    \
             return r <= 1.0 ? x : x * ((2.0 - 1.0 / r) / r);\n}}\n\
             float coordinate(float t) {{ float u = t / {radius:?}; return u <= 2.0 ? u : 4.0 - 4.0 / u; }}\n\
             float distanceAt(float s) {{ return {radius:?} * (s <= 2.0 ? s : 4.0 / max(4.0 - s, 4e-4)); }}\n",
            radius * 1e4,
            vector(*centre)
        ),
    }
}

fn vector(v: Vec3) -> String {
    format!("vec3({:?}, {:?}, {:?})", v.x, v.y, v.z)
}

fn matrix(m: &Mat4) -> String {
    let numbers: Vec<String> = m.to_cols_array().iter().map(|x| format!("{x:?}")).collect();
    format!("mat4({})", numbers.join(", "))
}
