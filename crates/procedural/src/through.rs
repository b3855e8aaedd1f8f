//! Transparency: the surfaces that a ray meets in order, and their compositing.

use glam::DVec3;

use super::convex::HalfLine;
use super::model::{Medium, SceneModel, SceneObject};
use super::shade::{cover, surface};
use super::shape::Hit;

/// Max number of surfaces that a ray passes.
const MAX_SURFACES: usize = 64;
/// Transmittance below which everything behind counts as hidden.
const MIN_TRANSMITTANCE: f64 = 1e-3;

/// Surface or matter that a ray meets.
enum Encounter<'a> {
    Surface(Hit, &'a SceneObject),
    /// Matter from one distance to another.
    Matter(f64, f64, &'a Medium),
}

/// Calls `visit` for each encounter of the line from front to back, until it returns false or an opaque surface is met.
fn for_each_encounter<'a>(model: &'a SceneModel, line: &HalfLine, mut visit: impl FnMut(Encounter<'a>) -> bool) {
    let mut start = 0.0;
    for _ in 0..MAX_SURFACES {
        let found = model.nearest(&HalfLine { origin: line.at(start), ..*line }, 0.0);
        let end = found.as_ref().map_or(f64::INFINITY, |(hit, _)| start + hit.t);
        let within = |volume: &'a Medium| {
            let span = volume.solid.span(line)?;
            let (from, to) = (span.enter.max(start), span.exit.min(end));
            (from < to).then_some((from, to, volume))
        };
        let mut matter: Vec<_> = model.volumes.iter().filter_map(within).collect();
        matter.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (from, to, volume) in matter {
            if !visit(Encounter::Matter(from, to, volume)) {
                return;
            }
        }
        let Some((hit, object)) = found else { return };
        if !visit(Encounter::Surface(Hit { t: end, ..hit }, object)) || object.material.opacity >= 1.0 {
            return;
        }
        start = end;
    }
}

/// Returns linear RGB seen along `line`, premultiplied by coverage, and the coverage: 1 at any opaque surface, 0 if nothing is
/// met. `sample` chooses among the positions over the lamps.
pub(super) fn light(model: &SceneModel, line: &HalfLine, sample: usize) -> (DVec3, f64) {
    let lit = |(hit, object): (Hit, &SceneObject)| surface(model, line, &hit, &object.material, sample, true);
    if !model.is_translucent {
        return model.nearest(line, 0.0).map_or((DVec3::ZERO, 0.0), lit);
    }
    let (mut colour, mut passes) = (DVec3::ZERO, 1.0);
    for_each_encounter(model, line, |part| {
        let (light, hidden) = match part {
            Encounter::Surface(hit, object) => lit((hit, object)),
            Encounter::Matter(from, to, volume) => {
                let hidden = 1.0 - (-(to - from) * volume.density).exp();
                (volume.colour * hidden, hidden)
            }
        };
        colour += passes * light;
        passes *= 1.0 - hidden;
        passes > MIN_TRANSMITTANCE
    });
    (colour, if passes > MIN_TRANSMITTANCE { 1.0 - passes } else { 1.0 })
}

/// Returns the distance at which half of the light from behind is hidden, and whether the subject hides it. In opaque
/// scenes this is the first surface.
pub(super) fn half_hidden_distance(model: &SceneModel, line: &HalfLine) -> Option<(f64, bool)> {
    if !model.is_translucent {
        return model.nearest(line, 0.0).map(|(hit, object)| (hit.t, !object.backdrop));
    }
    let (mut passes, mut found) = (1.0, None);
    for_each_encounter(model, line, |part| {
        match part {
            Encounter::Surface(hit, object) => {
                passes *= 1.0 - cover(&object.material, hit.normal.dot(line.direction));
                if passes <= 0.5 {
                    found = Some((hit.t, !object.backdrop));
                }
            }
            Encounter::Matter(from, to, volume) => {
                let left = passes * (-(to - from) * volume.density).exp();
                if left <= 0.5 {
                    found = Some((from + (2.0 * passes).ln() / volume.density, true));
                }
                passes = left;
            }
        }
        found.is_none()
    });
    found
}
