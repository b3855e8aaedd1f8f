//! Errors of intersections of rays with the box of a scene, and of renders by the whole renderer.

use anyhow::Result;
use burn::tensor::Device;
use fastrand::Rng;
use infonerf_experiment::RunPlan;
use infonerf_ops::to_host;
use infonerf_render::RenderRequest;
use infonerf_scene::{Aabb, Range, Ray, Space};
use infonerf_schedule::Moment;
use infonerf_train::Trainer;

use super::errors::Errors;
use crate::trial::with_settings;
use crate::values::wide;

/// Draws origin and direction of a ray for a box around the origin with half edge 1.
type Draw = fn(&mut Rng) -> ([f32; 3], [f32; 3]);

/// Kinds of rays, in units of half the box's edge.
pub(super) const RAY_KINDS: [(&str, Draw); 7] = [
    ("from outside", |rng| (on_sphere(rng, 3.0), on_sphere(rng, 1.0))),
    ("missing the box", |rng| {
        let origin = on_sphere(rng, 3.0);
        (origin, origin)
    }),
    ("from inside", |rng| ([signed(rng), signed(rng), signed(rng)], on_sphere(rng, 1.0))),
    ("parallel to a face", |rng| ([-3.0, signed(rng), 1.5 * signed(rng)], [1.0, 0.0, 0.0])),
    ("in a face", |rng| ([-3.0, signed(rng), 1.0], [1.0, 0.0, 0.0])),
    ("nearly parallel", |rng| ([-3.0, signed(rng), 0.0], [1.0, 1e-30 * signed(rng), 1e-42])),
    ("from far away", |rng| {
        let origin = on_sphere(rng, 1e4);
        (origin, origin.map(|x| -x))
    }),
];

/// Values of half the box's edge, scene units.
pub(super) const SCALES: [f32; 5] = [1e-6, 1e-3, 1.0, 1e3, 1e6];

fn signed(rng: &mut Rng) -> f32 {
    2.0 * rng.f32() - 1.0
}

pub(super) fn on_sphere(rng: &mut Rng, radius: f32) -> [f32; 3] {
    let p = [signed(rng), signed(rng), signed(rng) + 1e-3];
    let length = p.iter().map(|x| x * x).sum::<f32>().sqrt();
    p.map(|x| radius * x / length)
}

fn rays(draw: Draw, scale: f32, count: usize, rng: &mut Rng) -> Vec<Ray> {
    let ray = |(origin, direction): ([f32; 3], [f32; 3])| {
        let length = direction.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt() as f32;
        Ray::new(origin.map(|x| scale * x).into(), direction.map(|x| x / length).into())
    };
    (0..count).map(|_| ray(draw(rng))).collect()
}

/// Measures entry and exit distances of rays against `f64`.
pub(super) fn bounds(draw: Draw, scale: f32, count: usize, rng: &mut Rng) -> Errors {
    /// Share of the distance below which an overlap is within the rounding of the distance itself.
    const GRAZING: f64 = 1e-5;
    let bounds = Aabb::cube([0.0; 3].into(), scale);
    let mut errors = Errors::default();
    for ray in rays(draw, scale, count, rng) {
        let (enter, leave) = slabs(&bounds, &ray);
        let overlap = leave - enter;
        match bounds.intersect(&ray) {
            Some((got_enter, got_leave)) if overlap >= 0.0 => {
                // Rays that start in a face enter at 0.
                if enter > GRAZING * leave {
                    errors.value(got_enter, enter);
                }
                errors.value(got_leave, leave);
            }
            found => {
                let agreed = found.is_none() == (overlap < 0.0) || overlap.abs() <= GRAZING * leave.abs();
                errors.value(if agreed { 1.0 } else { 0.0 }, 1.0);
            }
        }
    }
    errors
}

/// Computes entry and exit distances in `f64`; a ray that misses the box has an exit before its entry.
fn slabs(bounds: &Aabb, ray: &Ray) -> (f64, f64) {
    let (mut enter, mut leave) = (0f64, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (f64::from(ray.origin[axis]), f64::from(ray.direction[axis]));
        let (low, high) = (f64::from(bounds.min[axis]), f64::from(bounds.max[axis]));
        if d == 0.0 {
            if o < low || o > high {
                return (1.0, -1.0);
            }
            continue;
        }
        let (a, b) = ((low - o) / d, (high - o) / d);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter, leave)
}

/// Measures opacity and depth of an untrained field in a box of half edge `scale` along `count` rays, given its optical depths.
pub(super) fn rendered(
    plan: &RunPlan,
    device: &Device,
    draw: Draw,
    scale: f32,
    count: usize,
    rng: &mut Rng,
) -> Result<Errors> {
    let plan =
        with_settings(plan, ["scene.size=8", "train.downscale=1", "field.resolutions=[4,8]", "render.samples=48"])?;
    let mut scene = plan.load()?;
    let (near, far) = (0.0, 1e5 * scale);
    let (range, bounds) = (Range::Distance { near, far }, Aabb::cube([0.0; 3].into(), scale));
    scene.space = Space { near, far, range, bounds, ..scene.space };
    let trainer = Trainer::new(&plan.config, scene, plan.seed, None, device)?;
    let rays = trainer.renderer().rays(rays(draw, scale, count, rng), device);
    let request = RenderRequest { color: true, hidden: true };
    let output = trainer.renderer().render(&trainer.model(), &rays, request, None, Moment::START).fine;
    let [acc, depth] = [&output.acc, &output.depth].map(|tensor| to_host(tensor.clone()));
    let tau = to_host(output.tau.clone());
    let mut errors = Errors::default();
    for (ray, range) in output.segments().ranges().enumerate() {
        let row = wide(&tau[range.clone()]);
        let w = infonerf_oracle::weights(&row);
        errors.value(acc[ray], infonerf_oracle::opacity(&row));
        errors.value(depth[ray], w.iter().zip(&output.samples.t()[range]).map(|(w, &t)| w * f64::from(t)).sum());
    }
    if let Some(color) = &output.color {
        for got in to_host(color.clone()) {
            errors.value(if (-1e-6..=1.0 + 1e-6).contains(&got) { 1.0 } else { got }, 1.0);
        }
    }
    Ok(errors)
}
