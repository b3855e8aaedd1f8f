//! Fragment shader that marches through a field of any kind.

use std::fmt::Write;

use glam::Vec3;
use infonerf_render::{Compositing, LastInterval, RenderConfig, Warp};
use infonerf_report::turbo;
use infonerf_scene::{Aabb, Range, Scene};

pub(crate) const TEMPLATE: &str = include_str!("../assets/field.frag");
/// Number of colours of the depth map that the shader interpolates between.
const COLOURS: usize = 33;

pub(crate) struct FieldMarch<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) config: &'a RenderConfig,
    pub(crate) warp: &'a Warp,
    /// Box that rays are clipped to in unwarped space.
    pub(crate) clip: Option<Aabb>,
    /// Corner of the occupancy grid and size of its cells, in warped space.
    pub(crate) low: Vec3,
    pub(crate) cell: Vec3,
    pub(crate) cells: [usize; 3],
    /// Length of a step in the coordinate of the warp.
    pub(crate) step: f32,
    /// Transmittance at which a ray ends.
    pub(crate) stop: f32,
    /// Size of the field's details, in warped space.
    pub(crate) detail: f32,
}

impl FieldMarch<'_> {
    /// Writes GLSL ES 3.00 around `field`: `float look(vec3 p)`, `float density()` and `vec3 emitted(vec3 direction)`.
    pub(crate) fn shader(&self, field: &str) -> String {
        TEMPLATE.replace("{{constants}}\n", &self.constants()).replace("{{field}}\n", field)
    }

    fn constants(&self) -> String {
        let clip = self.clip.unwrap_or(Aabb { min: Vec3::ZERO, max: Vec3::ZERO });
        let mut text = String::new();
        for (name, value) in [
            ("CLIPS", usize::from(self.clip.is_some())),
            ("ADDITIVE", usize::from(self.config.compositing == Compositing::Additive)),
            ("ENDLESS", usize::from(self.config.last_interval == LastInterval::Infinite)),
            ("TURBO_LAST", COLOURS - 1),
        ] {
            let _ = writeln!(text, "#define {name} {value}");
        }
        for (name, value) in [("STEP", self.step), ("STOP", self.stop), ("DETAIL", self.detail)] {
            let _ = writeln!(text, "const float {name} = {value:?};");
        }
        for (name, value) in [("LOW", self.low), ("CELL", self.cell), ("CLIP_LOW", clip.min), ("CLIP_HIGH", clip.max)] {
            let _ = writeln!(text, "const vec3 {name} = {};", vector(value));
        }
        let _ = writeln!(text, "const ivec3 GRID = {};", integers3(self.cells));
        text += &range(&self.scene.space.range);
        text += &warp_parameters(self.warp);
        let colours = (0..COLOURS).map(|i| vector(turbo(i as f32 / (COLOURS - 1) as f32).into()));
        let colours = colours.collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "const vec3 TURBO[{COLOURS}] = vec3[{COLOURS}]({colours});");
        text
    }
}

pub(crate) fn clips(config: &RenderConfig, warp: &Warp) -> bool {
    config.clip_to_bounds && warp.is_identity()
}

/// Writes the interval of a ray that is marched through; its ends, which depend on the camera, are uniforms.
fn range(range: &Range) -> String {
    match range {
        Range::Distance { .. } => "#define RANGE DISTANCE\n".to_owned(),
        Range::Depth { .. } => "#define RANGE DEPTH\n".to_owned(),
        Range::Sphere { centre, radius } => format!(
            "#define RANGE SPHERE\nconst vec3 RANGE_CENTRE = {};\nconst float RANGE_RADIUS = {radius:?};\n",
            vector(*centre)
        ),
    }
}

/// Writes the parameters of the shader's warp.
fn warp_parameters(warp: &Warp) -> String {
    match warp {
        Warp::Identity => "#define WARP IDENTITY\n".to_owned(),
        Warp::Ndc { to_camera, scale, near } => format!(
            "#define WARP NDC\nconst mat4 TO_CAMERA = mat4({});\nconst vec2 WARP_SCALE = vec2({:?}, {:?});\n\
             const float WARP_NEAR = {near:?};\n",
            to_camera.to_cols_array().map(|x| format!("{x:?}")).join(", "),
            scale.x,
            scale.y
        ),
        Warp::Contraction { centre, radius } => format!(
            "#define WARP CONTRACTION\nconst vec3 WARP_CENTRE = {};\nconst float WARP_RADIUS = {radius:?};\n",
            vector(*centre)
        ),
    }
}

pub(crate) fn vector(v: Vec3) -> String {
    format!("vec3({:?}, {:?}, {:?})", v.x, v.y, v.z)
}

pub(crate) fn integers3([x, y, z]: [usize; 3]) -> String {
    format!("ivec3({x}, {y}, {z})")
}
