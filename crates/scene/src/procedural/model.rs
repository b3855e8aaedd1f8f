//! A procedural scene: objects with materials, ready to be hit by rays.

use glam::DVec3;

use super::bvh::Bvh;
use super::convex::{Convex, Frame, Line};
use super::shape::{Hit, Knot, Shape};
use super::texture::Texture;

/// Surfaces that reflect more than this show mirror images.
pub(super) const MIRRORS_ABOVE: f64 = 0.03;

/// How a surface answers light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    pub texture: Texture,
    /// Share of light mirrored at right angles (Schlick's F₀).
    pub reflectance: f64,
    /// Exponent of the highlight: larger is sharper.
    pub gloss: f64,
    /// Whether the highlight and mirror image take the surface's own colour.
    pub metal: bool,
}

impl Material {
    /// No highlight to speak of.
    pub fn matt(texture: Texture) -> Self {
        Self { texture, reflectance: 0.02, gloss: 12.0, metal: false }
    }

    /// Polished stone: a highlight, no mirror image.
    pub fn satin(texture: Texture) -> Self {
        Self { texture, reflectance: MIRRORS_ABOVE, gloss: 60.0, metal: false }
    }

    /// A coat of varnish.
    pub fn glossy(texture: Texture) -> Self {
        Self { texture, reflectance: 0.06, gloss: 120.0, metal: false }
    }

    /// Polished metal of the given colour.
    pub fn metal(colour: DVec3) -> Self {
        Self { texture: Texture::Plain(colour), reflectance: 0.6, gloss: 70.0, metal: true }
    }
}

/// A shape and its material.
#[derive(Clone, Debug)]
pub(super) struct Object {
    pub shape: Shape,
    pub material: Material,
}

/// Objects being put together.
#[derive(Clone, Debug, Default)]
pub(super) struct Builder {
    objects: Vec<Object>,
}

impl Builder {
    /// A convex solid.
    pub fn solid(&mut self, base: Convex, material: Material) -> &mut Self {
        self.carved(base, Vec::new(), material)
    }

    /// A convex solid with others cut out of it.
    pub fn carved(&mut self, base: Convex, cuts: Vec<Convex>, material: Material) -> &mut Self {
        self.push(Shape::Solid { base, cuts }, material)
    }

    /// A torus about the z axis of `frame`.
    pub fn ring(&mut self, frame: Frame, radius: f64, tube: f64, material: Material) -> &mut Self {
        self.push(Shape::Ring { frame, radius, tube }, material)
    }

    /// A tube of radius `tube` about the closed curve `curve(s)`, `s` in `[0, 1]`, in `pieces`.
    pub fn closed_tube(
        &mut self,
        curve: impl Fn(f64) -> DVec3,
        pieces: usize,
        tube: f64,
        material: Material,
    ) -> &mut Self {
        let mut knots: Vec<Knot> = Vec::with_capacity(pieces + 1);
        for i in 0..=pieces {
            let s = i as f64 / pieces as f64;
            let point = curve(s);
            let tangent = (curve(s + 1e-4) - curve(s - 1e-4)).normalize_or(DVec3::X);
            let (length, side) = match knots.last() {
                Some(last) => (last.length + point.distance(last.point), last.side),
                None => (0.0, DVec3::Z),
            };
            let side = (side - tangent * side.dot(tangent)).normalize_or(tangent.any_orthonormal_vector());
            knots.push(Knot { point, tangent, side, length });
        }
        for pair in knots.windows(2) {
            let &[from, to] = pair else { continue };
            let rod = Convex::bullet(from.point, to.point, tube);
            self.push(Shape::Piece { rod, from, to, tube }, material);
        }
        self
    }

    fn push(&mut self, shape: Shape, material: Material) -> &mut Self {
        self.objects.push(Object { shape, material });
        self
    }

    /// Sorts the objects for rays and places them: scaled by `scale`, then raised by `rise`, so that
    /// every camera sees all of them.
    pub fn build(self, scale: f64, rise: f64) -> Model {
        let shapes: Vec<&Shape> = self.objects.iter().map(|o| &o.shape).collect();
        let bvh = Bvh::new(&shapes);
        Model { objects: self.objects, bvh, scale, rise }
    }
}

/// Objects sorted for rays.
#[derive(Clone, Debug)]
pub(super) struct Model {
    objects: Vec<Object>,
    bvh: Bvh,
    scale: f64,
    rise: f64,
}

impl Model {
    /// A line of the world, in the coordinates that the objects were put together in. Distances
    /// along it are [`Model::scale`] times smaller.
    pub fn line(&self, origin: DVec3, direction: DVec3) -> Line {
        Line { origin: (origin - DVec3::Z * self.rise) / self.scale, direction }
    }

    /// World units in one unit of the objects' coordinates.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The nearest hit and the material there.
    pub fn nearest(&self, line: &Line) -> Option<(Hit, &Material)> {
        let (i, hit) = self.bvh.nearest(|i, t| self.objects[i].shape.hit(line, t), line, f64::INFINITY)?;
        Some((hit, &self.objects[i].material))
    }

    /// Whether anything lies on the line.
    pub fn blocked(&self, line: &Line) -> bool {
        self.bvh.any(|i, t| self.objects[i].shape.hit(line, t), line, f64::INFINITY)
    }

    /// A box around all objects, in the world.
    #[cfg(test)]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (lo, hi) = self
            .objects
            .iter()
            .map(|o| o.shape.bounds())
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), (a, b)| (lo.min(a), hi.max(b)));
        (lo * self.scale + DVec3::Z * self.rise, hi * self.scale + DVec3::Z * self.rise)
    }
}
