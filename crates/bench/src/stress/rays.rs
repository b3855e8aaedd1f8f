//! Extreme rays for a renderer, by family: optical depths of their samples.

use fastrand::Rng;

pub(super) type DrawRay = fn(&mut Rng) -> Vec<f32>;
/// Function that draws a ray and its neighbour, with equally many samples.
pub(super) type DrawPair = fn(&mut Rng) -> (Vec<f32>, Vec<f32>);

const MAX_SAMPLES: usize = 48;
const VERY_LONG: usize = 4096;

/// Families with their shares of the requested number of rays: long rays are fewer.
pub(super) const FAMILIES: [(&str, f64, DrawRay); 16] = [
    ("everyday, 1e-6 to 100", 1.0, |rng| many(rng, everyday)),
    ("empty", 1.0, |rng| many(rng, |_| 0.0)),
    ("subnormal, to 1e-38", 1.0, |rng| many(rng, |rng| log_uniform(rng, -44.9, -38.0))),
    ("thin, 1e-38 to 1e-12", 1.0, |rng| many(rng, |rng| log_uniform(rng, -38.0, -12.0))),
    ("all sizes, 1e-38 to 1e38", 1.0, |rng| many(rng, |rng| log_uniform(rng, -38.0, 38.0))),
    ("near infinity", 1.0, |rng| {
        many(rng, |rng| match rng.u8(0..4) {
            0 => f32::MAX,
            1 => f32::INFINITY,
            2 => log_uniform(rng, 37.0, 38.0),
            _ => everyday(rng),
        })
    }),
    ("one opaque, first", 1.0, |rng| one_opaque(rng, |_, _| 0)),
    ("one opaque, between", 1.0, |rng| one_opaque(rng, |rng, n| rng.usize(0..n))),
    ("one opaque, last", 1.0, |rng| one_opaque(rng, |_, n| n - 1)),
    ("one opaque, nothing else", 1.0, |rng| {
        let mut ray = many(rng, |_| 0.0);
        let at = rng.usize(0..ray.len());
        ray[at] = log_uniform(rng, -6.0, 30.0);
        ray
    }),
    ("coincident samples (0)", 1.0, |rng| many(rng, |rng| if rng.bool() { 0.0 } else { everyday(rng) })),
    ("last interval 1e10", 1.0, |rng| {
        let mut ray = many(rng, everyday);
        ray.push(1e10 * log_uniform(rng, -30.0, 2.0));
        ray
    }),
    ("nearly uniform", 1.0, |rng| {
        let even = log_uniform(rng, -9.0, 1.0);
        many(rng, |rng| even * (1.0 + 1e-6 * (rng.f32() - 0.5)))
    }),
    ("uniform", 1.0, |rng| {
        let even = log_uniform(rng, -9.0, 1.5);
        many(rng, |_| even)
    }),
    ("one sample", 1.0, |rng| vec![log_uniform(rng, -38.0, 38.0)]),
    ("4096 samples", 0.002, very_long),
];

/// Draws 10 to a power that is uniform between `low` and `high`.
pub(super) fn log_uniform(rng: &mut Rng, low: f64, high: f64) -> f32 {
    10f64.powf(low + (high - low) * rng.f64()) as f32
}

pub(super) fn everyday(rng: &mut Rng) -> f32 {
    log_uniform(rng, -6.0, 2.0)
}

fn many(rng: &mut Rng, mut draw: impl FnMut(&mut Rng) -> f32) -> Vec<f32> {
    let count = rng.usize(1..=MAX_SAMPLES);
    (0..count).map(|_| draw(rng)).collect()
}

fn one_opaque(rng: &mut Rng, place: fn(&mut Rng, usize) -> usize) -> Vec<f32> {
    let least = -38.0 * rng.f64();
    let mut ray = many(rng, |rng| log_uniform(rng, least, least + 1.0));
    let at = place(rng, ray.len());
    ray[at] = log_uniform(rng, 1.0, 30.0);
    ray
}

/// Draws a ray of constant, exponentially falling, or random density.
fn very_long(rng: &mut Rng) -> Vec<f32> {
    let (kind, total) = (rng.u8(0..3), log_uniform(rng, -3.0, 1.6));
    let draw = |i: usize| match kind {
        0 => total / VERY_LONG as f32,
        1 => total * 8.0 / VERY_LONG as f32 * (-8.0 * i as f32 / VERY_LONG as f32).exp(),
        _ => log_uniform(rng, -8.0, -3.0),
    };
    (0..VERY_LONG).map(draw).collect()
}

/// Relations of a ray to its neighbour.
pub(super) const RELATIONS: [(&str, DrawPair); 8] = [
    ("equal", |rng| {
        let ray = many(rng, everyday);
        (ray.clone(), ray)
    }),
    ("nearly equal", |rng| {
        let spread = log_uniform(rng, -7.0, -2.0);
        pair(rng, everyday, |rng, tau| tau * (1.0 + spread * (rng.f32() - 0.5)))
    }),
    ("independent", |rng| pair(rng, everyday, |rng, _| everyday(rng))),
    ("all sizes", |rng| pair(rng, |rng| log_uniform(rng, -38.0, 38.0), |rng, _| log_uniform(rng, -38.0, 38.0))),
    ("disjoint", |rng| disjoint(rng, 0.0)),
    ("disjoint and thin", |rng| disjoint(rng, -25.0)),
    ("neighbour empty", |rng| pair(rng, everyday, |_, _| 0.0)),
    ("opaque elsewhere", |rng| {
        let (mut ray, mut near) = pair(rng, |rng| log_uniform(rng, -12.0, -3.0), |_, tau| tau);
        let (a, b) = (rng.usize(0..ray.len()), rng.usize(0..ray.len()));
        ray[a] = log_uniform(rng, 1.0, 30.0);
        near[b] = log_uniform(rng, 1.0, 30.0);
        (ray, near)
    }),
];

fn pair(
    rng: &mut Rng,
    draw: impl FnMut(&mut Rng) -> f32,
    mut near: impl FnMut(&mut Rng, f32) -> f32,
) -> (Vec<f32>, Vec<f32>) {
    let ray = many(rng, draw);
    let near = ray.iter().map(|&tau| near(rng, tau)).collect();
    (ray, near)
}

/// Draws a pair of rays of which each is empty exactly where the other is not.
fn disjoint(rng: &mut Rng, power: f64) -> (Vec<f32>, Vec<f32>) {
    let count = rng.usize(1..=MAX_SAMPLES);
    let sample = |_| {
        let drawn = log_uniform(rng, power - 3.0, power + 1.0);
        if rng.bool() { (drawn, 0.0) } else { (0.0, drawn) }
    };
    (0..count).map(sample).unzip()
}
