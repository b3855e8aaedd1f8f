//! A procedural scene: objects with materials, in a form that rays can be traced through.

use glam::{DVec2, DVec3};

use super::bvh::Bvh;
use super::convex::{Convex, HalfLine, Kind, LocalFrame};
use super::shape::{Hit, Knot, Shape};
use super::texture::Texture;

/// Reflectance above which surfaces show mirror images.
pub(super) const MIRRORS_ABOVE: f64 = 0.03;

/// Number of slices between two points of an outline.
const SLICES: usize = 5;

/// Reflection properties of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    pub texture: Texture,
    /// Reflectance at normal incidence (Schlick's F₀).
    pub reflectance: f64,
    /// Exponent of the highlight: larger is sharper.
    pub gloss: f64,
    /// Whether the highlight and mirror image take the surface's own colour.
    pub metal: bool,
    /// Opacity at normal incidence. Below 1, rays pass straight through (thin glass: no refraction) and no shadow is cast.
    pub opacity: f64,
}

/// Builds an opaque material.
fn opaque(texture: impl Into<Texture>, reflectance: f64, gloss: f64, metal: bool) -> Material {
    Material { texture: texture.into(), reflectance, gloss, metal, opacity: 1.0 }
}

/// Builds a material with almost no highlight.
pub(super) fn matt(texture: impl Into<Texture>) -> Material {
    opaque(texture, 0.02, 12.0, false)
}

/// Builds polished stone: a highlight, no mirror image.
pub(super) fn satin(texture: impl Into<Texture>) -> Material {
    opaque(texture, MIRRORS_ABOVE, 60.0, false)
}

/// Builds a coat of varnish.
pub(super) fn glossy(texture: impl Into<Texture>) -> Material {
    opaque(texture, 0.06, 120.0, false)
}

/// Builds metal polished to a mirror.
pub(super) fn mirror(colour: impl Into<Texture>) -> Material {
    opaque(colour, 0.82, 160.0, true)
}

/// Builds polished metal of the given colour.
pub(super) fn metal(colour: impl Into<Texture>) -> Material {
    opaque(colour, 0.6, 70.0, true)
}

/// Builds thin glass that stops `opacity` of the light from behind.
pub(super) fn glass(colour: impl Into<Texture>, opacity: f64) -> Material {
    Material { opacity, ..opaque(colour, 0.05, 300.0, false) }
}

pub(super) struct SceneObject {
    pub shape: Shape,
    pub material: Material,
    /// Whether the object belongs to the surroundings. These receive shadows but cast none (walls would block all
    /// light), and are not in the object mask.
    pub backdrop: bool,
}

/// A homogeneous, uniformly lit medium in a solid: water, mist. The volumes of a scene do not overlap.
pub(super) struct Medium {
    pub solid: Convex,
    /// Linear colour where it is optically thick.
    pub colour: DVec3,
    /// Optical depth per unit length.
    pub density: f64,
}

/// Collects the objects of a scene.
#[derive(Default)]
pub(super) struct Builder {
    objects: Vec<SceneObject>,
    volumes: Vec<Medium>,
    backdrop: bool,
}

impl Builder {
    pub fn solid(&mut self, base: Convex, material: Material) {
        self.carved(base, Vec::new(), material);
    }

    /// Adds a convex solid for each of `values`.
    pub fn each<T>(&mut self, values: impl IntoIterator<Item = T>, solid: impl Fn(T) -> Convex, material: Material) {
        values.into_iter().for_each(|value| self.solid(solid(value), material));
    }

    /// Adds a convex solid with others cut out of it.
    pub fn carved(&mut self, base: Convex, cuts: Vec<Convex>, material: Material) {
        self.push(Shape::Solid { base, cuts }, material);
    }

    pub fn block(&mut self, centre: DVec3, size: DVec3, material: Material) {
        self.solid(Convex::block(centre, size), material);
    }

    pub fn sphere(&mut self, centre: DVec3, radius: f64, material: Material) {
        self.solid(Convex::sphere(centre, radius), material);
    }

    pub fn rod(&mut self, a: DVec3, b: DVec3, radius: f64, material: Material) {
        self.solid(Convex::rod(a, b, radius), material);
    }

    pub fn cylinder(&mut self, foot: DVec3, radius: f64, height: f64, material: Material) {
        self.solid(Convex::cylinder(foot, radius, height), material);
    }

    pub fn cone(&mut self, foot: DVec3, bottom: f64, top: f64, height: f64, material: Material) {
        self.solid(Convex::cone(foot, bottom, top, height), material);
    }

    /// Adds a torus about the z axis of `frame`.
    pub fn ring(&mut self, frame: impl Into<LocalFrame>, radius: f64, tube: f64, material: Material) {
        self.push(Shape::Ring { frame: frame.into(), radius, tube }, material);
    }

    /// Adds a torus about the vertical through each centre, with its radius and the radius of its tube.
    pub fn rings(&mut self, rings: impl IntoIterator<Item = (DVec3, f64, f64)>, material: Material) {
        rings.into_iter().for_each(|(centre, radius, tube)| self.ring(centre, radius, tube, material));
    }

    /// Adds a tube about the curve `curve(s)`, `s` in `[0, 1]`, in `pieces`. Its start is round, its end flat.
    pub fn tube(&mut self, curve: impl Fn(f64) -> DVec3, pieces: usize, radius: f64, material: Material) {
        let mut knots: Vec<Knot> = Vec::with_capacity(pieces + 1);
        for i in 0..=pieces {
            let s = i as f64 / pieces as f64;
            let point = curve(s);
            let tangent = (curve(s + 1e-4) - curve(s - 1e-4)).normalize_or(DVec3::X);
            let after = |last: &Knot| (last.length + point.distance(last.point), last.side);
            let (length, side) = knots.last().map_or((0.0, DVec3::Z), after);
            let side = (side - tangent * side.dot(tangent)).normalize_or(tangent.any_orthonormal_vector());
            knots.push(Knot { point, tangent, side, length });
        }
        for (&from, &to) in knots.iter().zip(&knots[1..]) {
            let kind = Kind::Bullet { radius, half: 0.5 * from.point.distance(to.point) };
            let rod = Convex { kind, ..Convex::rod(from.point, to.point, radius) };
            self.push(Shape::Piece { rod, from, to, tube: radius }, material);
        }
    }

    /// Adds a solid of revolution about the z axis of `frame` whose outline is a smooth curve through points, from the
    /// lowest to the highest. `outline` has the radius and the height of each.
    pub fn lathe(&mut self, frame: impl Into<LocalFrame>, outline: &[f64], material: Material) {
        let frame = frame.into();
        let outline: Vec<(f64, f64)> = outline.chunks_exact(2).map(|point| (point[0], point[1])).collect();
        let slants = slants(&outline);
        for (points, slants) in outline.windows(2).zip(slants.windows(2)) {
            let (&[(r0, z0), (r1, z1)], &[m0, m1]) = (points, slants) else { continue };
            let point = |s: f64| {
                // A cubic with these ends and derivatives, and its own derivative.
                let (h, s2, s3) = (z1 - z0, s * s, s * s * s);
                let radius = (2.0 * s3 - 3.0 * s2 + 1.0) * r0
                    + (s3 - 2.0 * s2 + s) * h * m0
                    + (3.0 * s2 - 2.0 * s3) * r1
                    + (s3 - s2) * h * m1;
                let slant =
                    6.0 * (s2 - s) * (r0 - r1) / h + (3.0 * s2 - 4.0 * s + 1.0) * m0 + (3.0 * s2 - 2.0 * s) * m1;
                (radius.max(1e-4), z0 + s * h, DVec2::new(1.0, -slant).normalize_or(DVec2::X))
            };
            for k in 0..SLICES {
                let (bottom, low, lower) = point(k as f64 / SLICES as f64);
                let (top, high, upper) = point((k + 1) as f64 / SLICES as f64);
                let height = 0.5 * (low + high);
                let place = LocalFrame { origin: frame.origin + frame.rotation.z_axis * height, ..frame };
                let cone = Convex { frame: place, kind: Kind::Cone { bottom, top, half: 0.5 * (high - low) } };
                self.push(Shape::Slice { cone, lower, upper, height }, material);
            }
        }
    }

    pub fn fill(&mut self, solid: Convex, colour: DVec3, density: f64) {
        self.volumes.push(Medium { solid, colour, density });
    }

    /// Sets whether objects added from here on belong to the surroundings.
    pub fn backdrop(&mut self, backdrop: bool) {
        self.backdrop = backdrop;
    }

    fn push(&mut self, shape: Shape, material: Material) {
        self.objects.push(SceneObject { shape, material, backdrop: self.backdrop });
    }

    /// Builds a hierarchy of the objects, scaled by `scale` and then raised by `rise`, so that every camera sees all.
    pub fn build(self, scale: f64, rise: f64) -> SceneModel {
        let shapes: Vec<&Shape> = self.objects.iter().map(|o| &o.shape).collect();
        let bvh = Bvh::new(&shapes);
        let is_translucent = !self.volumes.is_empty() || self.objects.iter().any(|o| o.material.opacity < 1.0);
        SceneModel { objects: self.objects, volumes: self.volumes, is_translucent, bvh, scale, rise }
    }
}

/// Returns the derivatives of the radius by the height at the points of an outline, so that the curve has no new extrema.
fn slants(outline: &[(f64, f64)]) -> Vec<f64> {
    let secants: Vec<f64> = outline.windows(2).map(|w| (w[1].0 - w[0].0) / (w[1].1 - w[0].1)).collect();
    let slant = |i: usize| match (i.checked_sub(1).and_then(|i| secants.get(i)), secants.get(i)) {
        (Some(&a), Some(&b)) if a * b <= 0.0 => 0.0,
        (Some(&a), Some(&b)) => (0.5 * (a + b)).clamp(-3.0 * a.abs().min(b.abs()), 3.0 * a.abs().min(b.abs())),
        (Some(&a), None) | (None, Some(&a)) => a,
        (None, None) => 0.0,
    };
    (0..outline.len()).map(slant).collect()
}

/// Objects in a hierarchy for ray tracing.
pub(super) struct SceneModel {
    objects: Vec<SceneObject>,
    pub volumes: Vec<Medium>,
    pub is_translucent: bool,
    bvh: Bvh,
    /// World units in one unit of the objects' coordinates.
    pub scale: f64,
    rise: f64,
}

impl SceneModel {
    /// Maps a line of the world to the coordinates of the objects. Distances along it are `scale` times smaller.
    pub fn line(&self, origin: DVec3, direction: DVec3) -> HalfLine {
        HalfLine { origin: (origin - DVec3::Z * self.rise) / self.scale, direction }
    }

    /// Finds the nearest hit of an object of at least this opacity.
    pub fn nearest(&self, line: &HalfLine, opacity: f64) -> Option<(Hit, &SceneObject)> {
        let seen = |i: usize| Some(&self.objects[i]).filter(|object| object.material.opacity >= opacity);
        let (i, hit) = self.bvh.nearest(|i, t| seen(i)?.shape.hit(line, t), line)?;
        Some((hit, &self.objects[i]))
    }

    /// Returns whether anything that casts a shadow lies on the line.
    pub fn blocked(&self, line: &HalfLine) -> bool {
        let casts = |object: &&SceneObject| !object.backdrop && object.material.opacity >= 1.0;
        self.bvh.any(|i, t| Some(&self.objects[i]).filter(casts)?.shape.hit(line, t), line)
    }

    /// Returns a box around all objects, in the world.
    #[cfg(test)]
    pub fn bounds(&self) -> [DVec3; 2] {
        let corners = self.objects.iter().map(|object| object.shape.bounds()).reduce(super::bvh::join);
        corners.map_or([DVec3::ZERO; 2], |(lo, hi)| [lo, hi].map(|corner| corner * self.scale + DVec3::Z * self.rise))
    }
}
