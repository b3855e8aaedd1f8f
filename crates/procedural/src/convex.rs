//! Convex solids, and the part of a ray inside one.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

/// A half-line in double precision; `direction` has unit length.
#[derive(Clone, Copy, Debug)]
pub(super) struct HalfLine {
    pub origin: DVec3,
    pub direction: DVec3,
}

impl HalfLine {
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// A rigid placement: local to world is `rotation · p + origin`.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalFrame {
    pub rotation: DMat3,
    pub origin: DVec3,
}

impl LocalFrame {
    /// Returns the frame at `origin` whose z axis is along `axis`.
    pub fn along(origin: DVec3, axis: DVec3) -> Self {
        let z = axis.normalize_or(DVec3::Z);
        let (x, y) = z.any_orthonormal_pair();
        Self { rotation: DMat3::from_cols(x, y, z), origin }
    }

    pub fn to_local(self, line: &HalfLine) -> HalfLine {
        HalfLine { origin: self.point_to_local(line.origin), direction: self.rotation.transpose() * line.direction }
    }

    pub fn point_to_local(self, p: DVec3) -> DVec3 {
        self.rotation.transpose() * (p - self.origin)
    }
}

impl From<DVec3> for LocalFrame {
    /// Returns the frame at `origin` with the world's axes.
    fn from(origin: DVec3) -> Self {
        Self { rotation: DMat3::IDENTITY, origin }
    }
}

/// Entry and exit of a line through a convex solid, with outward normals. `enter` may be negative.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub enter: f64,
    pub enter_normal: DVec3,
    pub exit: f64,
    pub exit_normal: DVec3,
}

/// A convex solid about its local origin.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    /// Ball of this radius.
    Sphere { radius: f64 },
    /// Block with half-extents `half`.
    Block { half: DVec3 },
    /// Axis z, `|z| ≤ half`, radius from `bottom` at `−half` to `top` at `half`.
    Cone { bottom: f64, top: f64, half: f64 },
    /// A cylinder about z, `|z| ≤ half`, with a ball of its radius about its lower end.
    Bullet { radius: f64, half: f64 },
}

/// A placed convex solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Convex {
    pub frame: LocalFrame,
    pub kind: Kind,
}

impl Convex {
    pub fn sphere(centre: DVec3, radius: f64) -> Self {
        Self { frame: LocalFrame::from(centre), kind: Kind::Sphere { radius } }
    }

    /// Returns an axis-aligned block with edges `size`.
    pub fn block(centre: DVec3, size: DVec3) -> Self {
        Self { frame: LocalFrame::from(centre), kind: Kind::Block { half: 0.5 * size } }
    }

    /// Returns an upright cylinder that stands on `foot`.
    pub fn cylinder(foot: DVec3, radius: f64, height: f64) -> Self {
        Self::cone(foot, radius, radius, height)
    }

    /// Returns an upright frustum that stands on `foot`.
    pub fn cone(foot: DVec3, bottom: f64, top: f64, height: f64) -> Self {
        let half = 0.5 * height;
        Self { frame: LocalFrame::from(foot + DVec3::Z * half), kind: Kind::Cone { bottom, top, half } }
    }

    /// Returns a cylinder from `a` to `b` with flat ends.
    pub fn rod(a: DVec3, b: DVec3, radius: f64) -> Self {
        Self::taper(a, b, radius, radius)
    }

    /// Returns a frustum from `a` to `b` with radii `bottom` and `top`.
    pub fn taper(a: DVec3, b: DVec3, bottom: f64, top: f64) -> Self {
        let half = 0.5 * a.distance(b);
        Self { frame: LocalFrame::along(0.5 * (a + b), b - a), kind: Kind::Cone { bottom, top, half } }
    }

    /// Rotates the solid about `axis` through `pivot`.
    pub fn swung(mut self, pivot: DVec3, axis: DVec3, degrees: f64) -> Self {
        let turn = DMat3::from_axis_angle(axis, degrees * PI / 180.0);
        self.frame.rotation = turn * self.frame.rotation;
        self.frame.origin = pivot + turn * (self.frame.origin - pivot);
        self
    }

    /// Rotates the solid about the vertical axis through its own centre.
    pub fn turned(mut self, degrees: f64) -> Self {
        self.frame.rotation = DMat3::from_rotation_z(degrees * PI / 180.0) * self.frame.rotation;
        self
    }

    /// Returns the part of the line inside, with world normals.
    pub fn span(&self, line: &HalfLine) -> Option<Span> {
        if self.passes_by(line) {
            return None;
        }
        let Span { enter, enter_normal, exit, exit_normal } = self.kind.span(&self.frame.to_local(line))?;
        let rotation = self.frame.rotation;
        Some(Span { enter, enter_normal: rotation * enter_normal, exit, exit_normal: rotation * exit_normal })
    }

    /// Returns whether the line stays farther from the axis of a round solid than its radius: a cheap test that avoids the
    /// exact one for most lines.
    fn passes_by(&self, line: &HalfLine) -> bool {
        let radius = match self.kind {
            Kind::Cone { bottom, top, .. } => bottom.max(top),
            Kind::Bullet { radius, .. } => radius,
            Kind::Sphere { .. } | Kind::Block { .. } => return false,
        };
        let across = line.direction.cross(self.frame.rotation.z_axis);
        let distance = (line.origin - self.frame.origin).dot(across);
        distance * distance > radius * radius * across.length_squared()
    }

    /// Returns the world-space corners of a box around the solid.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let half = match self.kind {
            Kind::Sphere { radius } => DVec3::splat(radius),
            Kind::Block { half } => half,
            Kind::Cone { bottom, top, half } => DVec3::new(bottom.max(top), bottom.max(top), half),
            Kind::Bullet { radius, half } => DVec3::new(radius, radius, half + radius),
        };
        let r = self.frame.rotation;
        let world = r.x_axis.abs() * half.x + r.y_axis.abs() * half.y + r.z_axis.abs() * half.z;
        (self.frame.origin - world, self.frame.origin + world)
    }
}

impl Kind {
    /// Returns the part of a line in local coordinates that lies inside.
    pub fn span(&self, line: &HalfLine) -> Option<Span> {
        match *self {
            Self::Sphere { radius } => sphere(line, DVec3::ZERO, radius),
            Self::Block { half } => block(line, half),
            Self::Cone { bottom, top, half } => cone(line, bottom, top, half),
            Self::Bullet { radius, half } => {
                // The union is convex: its span is the hull of the spans.
                let parts = [sphere(line, DVec3::Z * -half, radius), cone(line, radius, radius, half)];
                parts.into_iter().flatten().reduce(hull)
            }
        }
    }
}

/// Returns the shortest span that holds both.
fn hull(a: Span, b: Span) -> Span {
    let first = if a.enter <= b.enter { a } else { b };
    let last = if a.exit >= b.exit { a } else { b };
    Span { exit: last.exit, exit_normal: last.exit_normal, ..first }
}

/// Returns what both spans have in common.
fn intersection(a: Span, b: Span) -> Option<Span> {
    let first = if b.enter > a.enter { b } else { a };
    let last = if b.exit < a.exit { b } else { a };
    (first.enter < last.exit).then_some(Span { exit: last.exit, exit_normal: last.exit_normal, ..first })
}

fn sphere(line: &HalfLine, centre: DVec3, radius: f64) -> Option<Span> {
    let from = line.origin - centre;
    let middle = -from.dot(line.direction);
    let half2 = radius * radius - (from + middle * line.direction).length_squared();
    if half2 <= 0.0 {
        return None;
    }
    let half = half2.sqrt();
    let (enter, exit) = (middle - half, middle + half);
    let normal = |t: f64| (from + t * line.direction) / radius;
    Some(Span { enter, enter_normal: normal(enter), exit, exit_normal: normal(exit) })
}

fn block(line: &HalfLine, half: DVec3) -> Option<Span> {
    let across = intersection(slab(line, 0, half.x)?, slab(line, 1, half.y)?)?;
    intersection(across, slab(line, 2, half.z)?)
}

/// Returns the part of the line at most `half` away from the origin along `axis`.
fn slab(line: &HalfLine, axis: usize, half: f64) -> Option<Span> {
    let (o, d) = (line.origin[axis], line.direction[axis]);
    let side = DVec3::AXES[axis] * d.signum();
    let (enter, exit) = if d.abs() < 1e-15 {
        if o.abs() > half {
            return None;
        }
        (f64::NEG_INFINITY, f64::INFINITY)
    } else {
        ((-half * d.signum() - o) / d, (half * d.signum() - o) / d)
    };
    Some(Span { enter, enter_normal: -side, exit, exit_normal: side })
}

/// Returns the part of the line inside a frustum: the double cone `x² + y² = (m + k z)²` clipped to `|z| ≤ half`.
fn cone(line: &HalfLine, bottom: f64, top: f64, half: f64) -> Option<Span> {
    let (o, d) = (line.origin, line.direction);
    let span = slab(line, 2, half)?;
    let (m, k) = (0.5 * (bottom + top), 0.5 * (top - bottom) / half);
    // Shift the origin to where the line is nearest to the solid's middle: keeps the quadratic well conditioned.
    let shift = -o.dot(d);
    let p = o + shift * d;
    let (ro, rd) = (m + k * p.z, k * d.z);
    let a = d.x * d.x + d.y * d.y - rd * rd;
    let b = p.x * d.x + p.y * d.y - ro * rd;
    let c = p.x * p.x + p.y * p.y - ro * ro;
    let normal = |t: f64| {
        let q = p + t * d;
        DVec3::new(q.x, q.y, -k * (m + k * q.z)).normalize_or(DVec3::Z)
    };
    // Entry and exit of the side, as distances from the shifted origin; an infinite one clips nothing.
    let clipped = |enter: f64, exit: f64| {
        let [enter_normal, exit_normal] = [enter, exit].map(normal);
        intersection(span, Span { enter: enter + shift, enter_normal, exit: exit + shift, exit_normal })
    };
    if a.abs() < 1e-14 {
        // Parallel to the side.
        if b.abs() < 1e-14 {
            return (c <= 0.0).then_some(span);
        }
        let t = -0.5 * c / b;
        return if b < 0.0 { clipped(t, f64::INFINITY) } else { clipped(f64::NEG_INFINITY, t) };
    }
    let disc = b * b - a * c;
    if disc <= 0.0 {
        return (a < 0.0 && c <= 0.0).then_some(span);
    }
    let root = disc.sqrt();
    let (first, second) = ((-b + root) / a, (-b - root) / a);
    if a > 0.0 {
        return clipped(second, first);
    }
    // a < 0: inside the double cone before the first and after the second root; inside the slab only one of its halves
    // exists (the radius is never negative there).
    let middle = |lo: f64, hi: f64| p.z + 0.5 * (lo + hi) * d.z;
    let (lo, hi) = (span.enter - shift, span.exit - shift);
    if first > lo && middle(lo, first.min(hi)).abs() <= half {
        return clipped(f64::NEG_INFINITY, first);
    }
    if second < hi { clipped(second, f64::INFINITY) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns a number that is negative inside the solid, not a distance.
    fn inside(kind: &Kind, p: DVec3) -> f64 {
        match *kind {
            Kind::Sphere { radius } => p.length() - radius,
            Kind::Block { half } => (p.abs() - half).max_element(),
            Kind::Cone { bottom, top, half } => {
                let radius = bottom + (top - bottom) * (p.z + half) / (2.0 * half);
                (p.truncate().length() - radius).max(p.z.abs() - half)
            }
            Kind::Bullet { radius, half } => {
                let rod = Kind::Cone { bottom: radius, top: radius, half };
                inside(&rod, p).min((p + DVec3::Z * half).length() - radius)
            }
        }
    }

    proptest! {
        #[test]
        fn spans_agree_with_the_implicit_solid(
            which in 0usize..6,
            o in prop::array::uniform3(-3.0f64..3.0),
            target in prop::array::uniform3(-0.8f64..0.8),
        ) {
            let kind = [
                Kind::Sphere { radius: 0.7 },
                Kind::Block { half: DVec3::new(0.3, 0.5, 0.7) },
                Kind::Cone { bottom: 0.4, top: 0.4, half: 0.6 },
                Kind::Cone { bottom: 0.7, top: 0.0, half: 0.5 },
                Kind::Cone { bottom: 0.2, top: 0.6, half: 0.5 },
                Kind::Bullet { radius: 0.2, half: 0.5 },
            ][which];
            let origin = DVec3::from(o);
            let direction = DVec3::from(target) - origin;
            prop_assume!(direction.length() > 0.1);
            let line = HalfLine { origin, direction: direction.normalize() };
            let span = kind.span(&line);
            for i in -600..600 {
                let t = f64::from(i) * 0.01;
                let value = inside(&kind, line.at(t));
                if value.abs() < 1e-3 {
                    continue;
                }
                let within = span.is_some_and(|s| s.enter <= t && t <= s.exit);
                prop_assert_eq!(within, value < 0.0, "t {} value {} span {:?}", t, value, span);
            }
            if let Some(s) = span {
                prop_assert!(inside(&kind, line.at(s.enter)).abs() < 1e-6);
                prop_assert!(inside(&kind, line.at(s.exit)).abs() < 1e-6);
                prop_assert!(s.enter_normal.dot(line.direction) <= 1e-6);
                prop_assert!(s.exit_normal.dot(line.direction) >= -1e-6);
                prop_assert!((s.enter_normal.length() - 1.0).abs() < 1e-6);
            }
        }
    }
}
