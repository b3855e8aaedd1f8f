//! The shapes of objects: convex solids minus others, tori, and pieces of bent tubes.

use glam::{DVec2, DVec3};

use super::convex::{Convex, HalfLine, Kind, LocalFrame};

/// Min distance of a hit: nearer hits are on the surface from which the ray starts.
const MIN_DISTANCE: f64 = 1e-6;

/// Intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub t: f64,
    /// Outward normal, unit length, world axes.
    pub normal: DVec3,
    /// Point at which textures are looked up: the local point, or (length along, angle, 0) on a tube.
    pub texture_point: DVec3,
    /// Normal in the coordinates of `texture_point`.
    pub texture_normal: DVec3,
}

/// A surface that rays can hit.
pub(super) enum Shape {
    /// `base` with every one of `cuts` taken away.
    Solid { base: Convex, cuts: Vec<Convex> },
    /// A torus about local z.
    Ring { frame: LocalFrame, radius: f64, tube: f64 },
    /// A piece of a tube of radius `tube` about a smooth curve: a rod with a ball at its start,
    /// whose normals follow the curve, so that no joint shows.
    Piece { rod: Convex, from: Knot, to: Knot, tube: f64 },
    /// A slice of a solid of revolution: a frustum whose side's normals go from `lower` to `upper` (outwards, along the
    /// axis), so that no joint shows. `height` is the height of its middle.
    Slice { cone: Convex, lower: DVec2, upper: DVec2, height: f64 },
}

/// A point of a curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    pub point: DVec3,
    /// Direction of the curve, unit length.
    pub tangent: DVec3,
    /// Direction at which the angle about the tube is 0: unit length, perpendicular to the tangent.
    pub side: DVec3,
    /// Length along the curve.
    pub length: f64,
}

impl Shape {
    pub fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Self::Solid { base, .. } => base.bounds(),
            Self::Piece { rod, .. } => rod.bounds(),
            Self::Slice { cone, .. } => cone.bounds(),
            Self::Ring { frame, radius, tube } => {
                let axis = frame.rotation.z_axis;
                let half = DVec3::from(axis.to_array().map(|c| radius * (1.0 - c * c).max(0.0).sqrt() + tube));
                (frame.origin - half, frame.origin + half)
            }
        }
    }

    /// Returns the nearest hit in `(MIN_DISTANCE, farthest)`.
    pub fn hit(&self, line: &HalfLine, farthest: f64) -> Option<Hit> {
        let first = |base, cuts: &[Convex]| carve(base, cuts, line, farthest).filter(|&(t, _)| t < farthest);
        match self {
            Self::Solid { base, cuts } => {
                let (t, normal) = first(base, cuts)?;
                let texture_point = base.frame.point_to_local(line.at(t));
                Some(Hit { t, normal, texture_point, texture_normal: base.frame.rotation.transpose() * normal })
            }
            Self::Ring { frame, radius, tube } => {
                let local = frame.to_local(line);
                let t = ring(&local, *radius, *tube, farthest)?;
                let p = local.at(t);
                let flat = DVec2::new(p.x, p.y);
                let heart = (flat.normalize_or(DVec2::X) * *radius).extend(0.0);
                let normal = (p - heart).normalize_or(DVec3::Z);
                let around = normal.z.atan2(flat.length() - radius);
                let texture_point = DVec3::new(flat.y.atan2(flat.x) * radius, around, 0.0);
                Some(Hit { t, normal: frame.rotation * normal, texture_point, texture_normal: DVec3::Z })
            }
            Self::Piece { rod, from, to, tube } => {
                let (t, _) = first(rod, &[])?;
                Some(piece_hit(line.at(t), t, from, to, *tube))
            }
            Self::Slice { cone, lower, upper, height } => {
                let (t, flat) = first(cone, &[])?;
                Some(slice_hit(line.at(t), t, flat, cone, (*lower, *upper), *height))
            }
        }
    }
}

/// Returns the first point after the start where the line goes from outside `base − cuts` to its surface.
fn carve(base: &Convex, cuts: &[Convex], line: &HalfLine, farthest: f64) -> Option<(f64, DVec3)> {
    let span = base.span(line)?;
    if span.exit <= MIN_DISTANCE || span.enter >= farthest {
        return None;
    }
    let (mut t, mut normal) = (span.enter, span.enter_normal);
    let mut holes: Vec<_> = cuts.iter().filter_map(|c| c.span(line)).collect();
    holes.sort_unstable_by(|a, b| a.enter.total_cmp(&b.enter));
    // Solid intervals are what the holes leave of the span; walk them in order.
    for hole in &holes {
        if hole.enter > t {
            // Solid from t up to the hole: a front face at t, or the inside of its far wall.
            if t > MIN_DISTANCE {
                return Some((t, normal));
            }
            if hole.enter > MIN_DISTANCE && hole.enter < span.exit {
                return Some((hole.enter, -hole.enter_normal));
            }
        }
        if hole.exit > t {
            (t, normal) = (hole.exit, -hole.exit_normal);
        }
        if t >= span.exit {
            return None;
        }
    }
    if t > MIN_DISTANCE { Some((t, normal)) } else { Some((span.exit, span.exit_normal)) }
}

/// Finds the hit of a torus by sphere tracing within the ball that holds the torus. The field is a true distance, so no step
/// is too long.
fn ring(line: &HalfLine, radius: f64, tube: f64, farthest: f64) -> Option<f64> {
    let ball = Kind::Sphere { radius: radius + tube }.span(line)?;
    let end = ball.exit.min(farthest);
    let mut t = ball.enter.max(MIN_DISTANCE);
    let distance = |p: DVec3| {
        let across = DVec2::new(p.x, p.y).length() - radius;
        DVec2::new(across, p.z).length() - tube
    };
    // Rays that start on the surface step off it first.
    if t <= MIN_DISTANCE && distance(line.at(t)) < 1e-4 {
        t += 1e-3;
    }
    for _ in 0..200 {
        if t >= end {
            return None;
        }
        let d = distance(line.at(t)).abs();
        if d < 1e-9 {
            return Some(t);
        }
        t += d;
    }
    None
}

fn piece_hit(p: DVec3, t: f64, from: &Knot, to: &Knot, tube: f64) -> Hit {
    let chord = to.point - from.point;
    let s = ((p - from.point).dot(chord) / chord.length_squared()).clamp(0.0, 1.0);
    let tangent = from.tangent.lerp(to.tangent, s).normalize_or(from.tangent);
    let from_axis = p - from.point.lerp(to.point, s);
    let normal = (from_axis - tangent * from_axis.dot(tangent)).normalize_or(from_axis / tube);
    let side = from.side.lerp(to.side, s);
    let angle = normal.dot(tangent.cross(side)).atan2(normal.dot(side));
    let length = from.length + (to.length - from.length) * s;
    Hit { t, normal, texture_point: DVec3::new(length, angle, 0.0), texture_normal: DVec3::Z }
}

fn slice_hit(p: DVec3, t: f64, flat: DVec3, cone: &Convex, (lower, upper): (DVec2, DVec2), height: f64) -> Hit {
    let p = cone.frame.point_to_local(p);
    let half = if let Kind::Cone { half, .. } = cone.kind { half } else { f64::INFINITY };
    let on_cap = half - p.z.abs() < 1e-9;
    let local = if on_cap {
        cone.frame.rotation.transpose() * flat
    } else {
        let facing = lower.lerp(upper, 0.5 + 0.5 * p.z / half);
        (p.truncate().normalize_or(DVec2::X) * facing.x).extend(facing.y).normalize_or(DVec3::Z)
    };
    let texture_point = p + DVec3::Z * height;
    Hit { t, normal: cone.frame.rotation * local, texture_point, texture_normal: local }
}
