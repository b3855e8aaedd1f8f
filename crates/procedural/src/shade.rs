//! Lighting: a sun with soft shadows, a sky with ambient occlusion, and mirror reflections of both and of the objects.

use glam::DVec3;

use super::convex::HalfLine;
use super::model::{MIRRORS_ABOVE, Material, SceneModel};
use super::shape::Hit;

/// Positions over the lamps, which the samples of a pixel use in turn.
const JITTER: [(f64, f64); 4] = [(0.6, 0.25), (-0.25, 0.6), (-0.6, -0.25), (0.25, -0.6)];

const SUN: DVec3 = DVec3::new(0.55, -0.45, 0.70);
const SUN_COLOUR: DVec3 = DVec3::new(2.05, 1.92, 1.70);
const SUN_SIZE: f64 = 0.06;
const SKY_COLOUR: DVec3 = DVec3::new(0.62, 0.70, 0.85);
const SKY_SIZE: f64 = 0.85;
const GROUND_COLOUR: DVec3 = DVec3::new(0.30, 0.26, 0.22);
const FILL: DVec3 = DVec3::new(-0.70, 0.50, 0.35);
const FILL_COLOUR: DVec3 = DVec3::new(0.38, 0.42, 0.55);
/// Distance from the surface at which secondary rays start.
const LIFT: f64 = 1e-4;

/// Returns the linear RGB that the surface sends back along `line`, and the share of light from behind that it hides.
/// Diffuse light is multiplied by the opacity of the material; mirror image and highlight are not.
pub(super) fn surface(
    model: &SceneModel,
    line: &HalfLine,
    hit: &Hit,
    material: &Material,
    sample: usize,
    mirror: bool,
) -> (DVec3, f64) {
    let view = -line.direction;
    let normal = if hit.normal.dot(view) < 0.0 { -hit.normal } else { hit.normal };
    let start = line.at(hit.t) + LIFT * normal;
    let albedo = material.texture.at(hit.texture_point, hit.texture_normal);
    let (dx, dy) = JITTER[sample % JITTER.len()];
    let towards = |axis: DVec3, size: f64| {
        let axis = axis.normalize();
        let (u, v) = axis.any_orthonormal_pair();
        (axis + size * (dx * u + dy * v)).normalize()
    };
    let clear = |direction: DVec3| !model.blocked(&HalfLine { origin: start, direction });

    let tint = if material.metal { albedo } else { DVec3::ONE };
    let body = if material.metal { 0.25 * albedo } else { albedo };

    let opacity = opacity(material, normal.dot(view));
    let body = body * opacity;

    let mut light = GROUND_COLOUR * (0.5 - 0.5 * normal.z) * 0.55;
    let up = towards(DVec3::Z, SKY_SIZE);
    // Objects in mirror images have a constant shadow of the sky.
    let overhead = match mirror {
        true if clear(up) => 1.0,
        true => 0.25,
        false => 0.6,
    };
    light += SKY_COLOUR * (0.5 + 0.5 * normal.z) * overhead;
    light += FILL_COLOUR * normal.dot(FILL.normalize()).max(0.0) * (0.4 + 0.6 * overhead);

    let mut highlight = DVec3::ZERO;
    let sun = towards(SUN, SUN_SIZE);
    let facing = normal.dot(sun);
    if facing > 0.0 && clear(sun) {
        light += SUN_COLOUR * facing;
        // Normalised Blinn–Phong.
        let half = (sun + view).normalize_or(normal);
        let lobe = (material.gloss + 8.0) / 25.0 * normal.dot(half).max(0.0).powf(material.gloss);
        highlight += SUN_COLOUR * facing * lobe * fresnel(material.reflectance, half.dot(view));
    }

    let highlight = tint * highlight.min(DVec3::splat(4.0));
    let mut colour = body * light + highlight;
    let mut passes = (1.0 - opacity) * (1.0 - highlight.max_element().min(1.0));
    if mirror && material.reflectance > MIRRORS_ABOVE {
        let share = fresnel(material.reflectance, normal.dot(view));
        let direction = line.direction - 2.0 * line.direction.dot(normal) * normal;
        let reflected = HalfLine { origin: start, direction: direction.normalize_or(normal) };
        let image = match model.nearest(&reflected, 1.0) {
            Some((hit, object)) => surface(model, &reflected, &hit, &object.material, sample, false).0,
            None => sky(reflected.direction),
        };
        colour = colour * (1.0 - share) + tint * image * share;
        passes *= 1.0 - share;
    }
    (colour, 1.0 - passes)
}

/// Returns the share of light from behind that the material stops; slanted paths (small `cosine`) are longer.
fn opacity(material: &Material, cosine: f64) -> f64 {
    if material.opacity >= 1.0 {
        return 1.0;
    }
    1.0 - (1.0 - material.opacity).powf(1.0 / cosine.abs().max(0.15))
}

/// Returns the share of the light from behind that the surface hides, highlights left out.
pub(super) fn cover(material: &Material, cosine: f64) -> f64 {
    let share = if material.reflectance > MIRRORS_ABOVE { fresnel(material.reflectance, cosine.abs()) } else { 0.0 };
    1.0 - (1.0 - opacity(material, cosine)) * (1.0 - share)
}

/// Computes the reflectance at an angle by Schlick's approximation.
fn fresnel(reflectance: f64, cosine: f64) -> f64 {
    reflectance + (1.0 - reflectance) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

/// Returns the light of a reflected ray that hits no object: sky, ground and a bright window.
fn sky(direction: DVec3) -> DVec3 {
    let height = direction.z.clamp(-1.0, 1.0);
    let base = if height > 0.0 {
        DVec3::new(0.85, 0.88, 0.92).lerp(DVec3::new(0.28, 0.45, 0.80), height.sqrt())
    } else {
        DVec3::new(0.45, 0.40, 0.36).lerp(DVec3::new(0.16, 0.14, 0.13), (-height).sqrt())
    };
    let window = direction - SUN * direction.dot(SUN);
    let lit = direction.dot(SUN.normalize()) > 0.0 && window.abs().max_element() < 0.22;
    if lit { base + DVec3::splat(1.6) } else { base }
}

/// Encodes linear light as display values in `[0, 1]`: a filmic shoulder and the sRGB curve.
pub(super) fn encode(linear: DVec3) -> [f64; 3] {
    linear.to_array().map(|c| {
        let c = c.max(0.0);
        let c = (c * (1.0 + 0.15 * c) / (1.0 + 0.40 * c)).min(1.0);
        if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
    })
}
