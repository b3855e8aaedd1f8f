//! Colours that vary over a surface. All are linear RGB.

use std::f64::consts::TAU;

use glam::DVec3;

/// Dependence of a surface's colour on position.
#[derive(Clone, Copy, Debug)]
pub(super) enum Texture {
    /// One colour with a faint grain.
    Plain(DVec3),
    /// Cells of two colours, and their number per unit along each axis.
    Checker(DVec3, DVec3, DVec3),
    /// Stripes of two colours across a direction, whose length is their number per unit.
    Stripes(DVec3, DVec3, DVec3),
    /// Courses of bricks on upright faces: colours of bricks and mortar, width, height, and whether they wrap about z.
    Bricks(DVec3, DVec3, f64, f64, bool),
    /// Colour, colour of the veins in it, and features per unit.
    Marble(DVec3, DVec3, f64),
    /// Wavy bands of three colours along local z, as on a gas planet, and their number per unit.
    Bands(DVec3, DVec3, DVec3, f64),
    /// Patches of two colours with a smooth border, and features per unit.
    Patches(DVec3, DVec3, f64),
    /// Patches of land and sea, and the height on a unit sphere from which on both poles are white.
    Globe(DVec3, DVec3, f64, f64),
    /// Scales or shingles between two colours in courses along local z: their number around z, and courses per unit.
    Shingles(DVec3, DVec3, f64, f64),
    /// Boards with grain between two colours, their width and length; on upright faces they stand on end.
    Planks(DVec3, DVec3, f64, f64),
    /// Colours of ground and flowers, their number per unit along each axis of the face, and whether they wrap about z.
    Flowers(DVec3, DVec3, f64, bool),
}

/// Converts a display colour, `0xRRGGBB`, to linear RGB.
pub(super) fn rgb(colour: u32) -> DVec3 {
    let [_, r, g, b] = colour.to_be_bytes();
    DVec3::new(f64::from(r), f64::from(g), f64::from(b)).map(|c| (c / 255.0).powf(2.2))
}

impl From<u32> for Texture {
    /// Returns one display colour, `0xRRGGBB`.
    fn from(colour: u32) -> Self {
        Self::Plain(rgb(colour))
    }
}

impl From<DVec3> for Texture {
    fn from(colour: DVec3) -> Self {
        Self::Plain(colour)
    }
}

impl Texture {
    /// Returns the colour at local point `p` of a surface that faces `n` there.
    pub fn at(&self, p: DVec3, n: DVec3) -> DVec3 {
        match *self {
            Self::Plain(a) => a * (0.92 + 0.16 * noise(p * 30.0)),
            Self::Checker(a, b, per_unit) => {
                // Shifted by an odd amount, so that no cell boundary falls on a face.
                let q = (p * per_unit + DVec3::splat(0.137)).floor();
                let odd = (q.x + q.y + q.z).rem_euclid(2.0) >= 1.0;
                (if odd { a } else { b }) * (0.85 + 0.3 * noise(p * 24.0))
            }
            Self::Stripes(a, b, direction) => {
                let phase = (p.dot(direction) + 0.071).rem_euclid(1.0);
                (if phase < 0.5 { a } else { b }) * (0.88 + 0.24 * noise(p * 24.0))
            }
            Self::Bricks(brick, mortar, width, height, round) => {
                let (u, v) = wrap(p, n, round);
                bricks(brick, mortar, u / width, v / height) * (0.8 + 0.4 * noise(p * 40.0))
            }
            Self::Marble(a, b, per_unit) => {
                let q = p * per_unit;
                let vein = (TAU * (0.35 * q.x + 0.5 * q.z + 1.3 * fractal(q))).sin().abs();
                a.lerp(b, (1.0 - vein).powi(3))
            }
            Self::Bands(a, b, c, per_unit) => {
                let z = p.z * per_unit + 0.35 * fractal(p * per_unit * DVec3::new(0.8, 0.8, 0.4));
                let first = a.lerp(b, smooth(0.5 + 0.5 * (TAU * z).sin()));
                first.lerp(c, smooth(0.5 + 0.5 * (TAU * 0.37 * z + 1.0).sin()) * 0.7)
            }
            Self::Patches(a, b, per_unit) => patches(a, b, p * per_unit),
            Self::Globe(land, sea, per_unit, cap) => {
                let edge = p.normalize_or(DVec3::Z).z.abs() + 0.15 * fractal(p * per_unit) - cap;
                patches(land, sea, p * per_unit).lerp(DVec3::splat(0.9), (edge * 12.0).clamp(0.0, 1.0))
            }
            Self::Shingles(a, b, around, per_unit) => {
                let v = p.z * per_unit;
                let row = v.floor();
                let u = p.y.atan2(p.x) / TAU * around + 0.5 * row.rem_euclid(2.0);
                let (fu, fv) = (u.rem_euclid(1.0) - 0.5, v - row);
                let shade = hash([u.floor() as i64, row as i64, 7]);
                let edge = if fv + 0.6 * fu * fu * 4.0 < 0.28 || fu.abs() > 0.46 { 0.35 } else { 1.0 };
                a.lerp(b, shade) * edge
            }
            Self::Planks(a, b, width, length) => {
                let (u, v) = wrap(p, n, false);
                planks(a, b, u / width, v / length)
            }
            Self::Flowers(ground, petal, per_unit, round) => {
                let (u, v) = wrap(p, n, round);
                flowers(ground, petal, u * per_unit, v * per_unit) * (0.96 + 0.08 * noise(p * 30.0))
            }
        }
    }
}

/// Returns the surface coordinates for masonry: length along the wall and height.
fn wrap(p: DVec3, n: DVec3, round: bool) -> (f64, f64) {
    let n = n.abs();
    if n.z > 0.7 {
        (p.x, p.y)
    } else if round {
        (p.y.atan2(p.x) * p.truncate().length(), p.z)
    } else if n.x > n.y {
        (p.y, p.z)
    } else {
        (p.x, p.z)
    }
}

fn bricks(brick: DVec3, mortar: DVec3, u: f64, v: f64) -> DVec3 {
    let row = v.floor();
    let u = u + 0.5 * row.rem_euclid(2.0);
    let (fu, fv) = (u.rem_euclid(1.0), v - row);
    if fu < 0.08 || fv < 0.14 {
        return mortar;
    }
    brick * (0.55 + 0.9 * hash([u.floor() as i64, row as i64, 3]))
}

fn patches(a: DVec3, b: DVec3, q: DVec3) -> DVec3 {
    let share = smooth(((fractal(q) - 0.5) * 14.0 + 0.5).clamp(0.0, 1.0));
    b.lerp(a * (0.6 + 0.8 * fractal(q * 3.0)), share)
}

fn planks(a: DVec3, b: DVec3, u: f64, v: f64) -> DVec3 {
    let board = u.floor();
    let v = v + hash([board as i64, 11, 5]);
    let cell = [board as i64, v.floor() as i64, 13];
    let (fu, fv) = (u - board, v - v.floor());
    if !(0.04..0.96).contains(&fu) || fv < 0.015 {
        return b * 0.35;
    }
    let grain = fractal(DVec3::new(u * 5.0, v * 1.3, 9.0 * hash(cell)));
    let fibre = smooth((0.5 + 2.2 * (fractal(DVec3::new(u * 17.0, v * 1.1, 40.0 * hash(cell))) - 0.5)).clamp(0.0, 1.0));
    a.lerp(b, 0.5 * grain + 0.35 * fibre + 0.3 * (hash(cell) - 0.3)) * (0.8 + 0.4 * hash(cell))
}

/// Paints five petals about a heart in every other cell, a leaf in the rest.
fn flowers(ground: DVec3, petal: DVec3, u: f64, v: f64) -> DVec3 {
    let (cu, cv) = (u.floor(), v.floor());
    let (x, y) = (u - cu - 0.5, v - cv - 0.5);
    let (r, angle) = (x.hypot(y), y.atan2(x));
    if (cu + cv).rem_euclid(2.0) < 1.0 {
        let edge = 0.30 + 0.13 * (5.0 * angle + 1.5).cos();
        if (0.09..edge).contains(&r) { petal } else { ground }
    } else {
        let leaf = (x - 1.2 * y * y).abs() < 0.03 && y.abs() < 0.4;
        if leaf || (r > 0.12 && r < 0.16) { ground.lerp(petal, 0.6) } else { ground }
    }
}

fn smooth(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}

/// Returns three octaves of [`noise`], in `[0, 1]`.
fn fractal(p: DVec3) -> f64 {
    (4.0 * noise(p) + 2.0 * noise(p * 2.03) + noise(p * 4.11)) / 7.0
}

/// Returns smooth value noise in `[0, 1]` with features of size 1.
fn noise(p: DVec3) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (DVec3::splat(3.0) - 2.0 * f);
    let [x, y, z] = cell.to_array().map(|c| c as i64);
    let corner = |dx: i64, dy: i64, dz: i64| hash([x + dx, y + dy, z + dz]);
    let mix = |a: f64, b: f64, s: f64| a + (b - a) * s;
    let face =
        |dz| mix(mix(corner(0, 0, dz), corner(1, 0, dz), f.x), mix(corner(0, 1, dz), corner(1, 1, dz), f.x), f.y);
    mix(face(0), face(1), f.z)
}

/// Returns a number in `[0, 1)` that looks random, from a lattice point.
fn hash([x, y, z]: [i64; 3]) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ (z as u64).wrapping_mul(0x1656_67b1_9e37_79f9);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (h >> 11) as f64 / (1u64 << 53) as f64
}
