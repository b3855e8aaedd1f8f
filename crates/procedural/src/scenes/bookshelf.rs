//! A bookcase that is open on both sides, full of books and things that hide each other.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

const WIDE: f64 = 1.56;
const DEEP: f64 = 0.66;
const LOW: f64 = -1.02;
const SHELVES: usize = 4;
const RISE: f64 = 0.49;

pub(super) fn bookshelf(scene: &mut Builder) {
    carcass(scene);
    let rng = &mut ChaCha8Rng::seed_from_u64(17);
    for shelf in 0..SHELVES {
        for side in [-1.0, 1.0] {
            for half in [-1.0, 1.0] {
                row(scene, rng, shelf, side, half);
            }
        }
    }
    on_top(scene);
}

fn oak() -> Material {
    satin(Planks(rgb(0xaa703e), rgb(0x704220), 0.17, 1.4))
}

fn floor(shelf: usize) -> f64 {
    LOW + 0.06 + RISE * shelf as f64
}

fn carcass(scene: &mut Builder) {
    scene.each(0..=SHELVES, |shelf| Convex::block(v(0.0, 0.0, floor(shelf) - 0.015), v(WIDE, DEEP, 0.035)), oak());
    let height = RISE * SHELVES as f64 + 0.05;
    let board = |x: f64| Convex::block(v(x * (0.5 * WIDE - 0.02), 0.0, LOW + 0.5 * height), v(0.04, DEEP, height));
    scene.solid(board(0.0), oak());
    for x in [-1.0, 1.0] {
        // The ends have windows.
        let mut cuts = Vec::new();
        for shelf in 0..SHELVES {
            for y in [-0.165, 0.165] {
                cuts.extend(arched(v(x * 0.5 * WIDE, y, floor(shelf) + 0.23), DVec3::X, 0.2, 0.23, 0.26));
            }
        }
        scene.carved(board(x), cuts, oak());
    }
    let back = Flowers(rgb(0x607468), rgb(0xc4b082), 8.0, false);
    scene.block(v(0.0, 0.0, LOW + 0.5 * height), v(WIDE - 0.06, 0.02, height - 0.02), matt(back));
    let foot = |(x, y): (f64, f64)| v(x * (0.5 * WIDE - 0.08), y * (0.5 * DEEP - 0.08), LOW - 0.05);
    scene.each(CORNERS, |corner| Convex::sphere(foot(corner), 0.06), glossy(0x462614));
}

/// Adds books along one half of a shelf, seen from `side`; now and then something else.
fn row(scene: &mut Builder, rng: &mut ChaCha8Rng, shelf: usize, side: f64, half: f64) {
    let z = floor(shelf);
    let (mut x, end) = (half.min(0.0) * (0.5 * WIDE - 0.05) + 0.03, half.max(0.0) * (0.5 * WIDE - 0.05) - 0.03);
    let thing = rng.random_range(0..7);
    let mut room = if thing < 5 { 0.24 } else { 0.0 };
    while x < end {
        if room > 0.0 && (rng.random_range(0..5) == 0 || x + 0.30 > end) && x + room <= end {
            curio(scene, v(x + 0.5 * room, side * 0.18, z), thing);
            x += room;
            room = 0.0;
            continue;
        }
        let thick = rng.random_range(0.034..0.075f64).min(end - x);
        if thick < 0.03 {
            break;
        }
        let tall = rng.random_range(0.24..0.41);
        let depth = rng.random_range(0.16..0.23);
        let centre = v(x + 0.5 * thick, side * (0.30 - rng.random_range(0.0..0.05) - 0.5 * depth), z + 0.5 * tall);
        let a = rgb(COLOURS[rng.random_range(0..COLOURS.len())]);
        let b = if rng.random() { rgb(0xdeb660) } else { rgb(0xf0e8d6) };
        let cover = match rng.random_range(0..3) {
            0 => Plain(a),
            1 => Stripes(a, a * 0.45, v(0.0, 0.0, rng.random_range(3.0..6.0))),
            _ => Flowers(a, a.lerp(b, 0.6), 18.0, false),
        };
        let lean = if rng.random_range(0..9) == 0 { 7.0 } else { 0.0 };
        let lean = |c: Convex| c.swung(v(x, 0.0, z), DVec3::Y, lean);
        scene.solid(lean(Convex::block(centre, v(thick - 0.005, depth, tall))), satin(cover));
        let part = lean(Convex::block(centre + v(0.0, -side * 0.004, 0.004), v(thick - 0.016, depth - 0.012, tall)));
        scene.solid(part, matt(Stripes(rgb(0xf0e8d4), rgb(0xcec4ac), v(60.0, 0.0, 0.0))));
        // A label and two bands on the spine.
        let spine = centre + v(0.0, side * 0.5 * depth, 0.0);
        let label = satin(b);
        let high = rng.random_range(0.06..0.12);
        scene.solid(lean(Convex::block(spine + v(0.0, 0.0, 0.22 * tall), v(thick - 0.012, 0.006, high))), label);
        scene.solid(lean(Convex::block(spine - v(0.0, 0.0, 0.36 * tall), v(thick - 0.004, 0.006, 0.014))), label);
        x += thick;
    }
}

const COLOURS: [u32; 9] = [0x961e24, 0x184278, 0x1e6042, 0xd8962c, 0x5a2c60, 0x3c3c42, 0xc45a32, 0x288296, 0xe4d6b4];

fn curio(scene: &mut Builder, at: DVec3, which: u32) {
    match which {
        0 => {
            let glaze = Bands(rgb(0x28828c), rgb(0xe6e2ce), rgb(0x143c5a), 14.0);
            scene.lathe(at, &[0.05, 0.0, 0.09, 0.08, 0.085, 0.17, 0.04, 0.25, 0.06, 0.31], glossy(glaze));
        }
        1 => {
            scene.lathe(at, &[0.07, 0.0, 0.05, 0.03, 0.015, 0.06, 0.012, 0.10], metal(0xc89c4c));
            scene.sphere(at + DVec3::Z * 0.19, 0.095, glossy(Globe(rgb(0x789646), rgb(0x326eaa), 16.0, 0.95)));
            scene.ring(LocalFrame::along(at + DVec3::Z * 0.19, v(1.0, 0.3, 0.3)), 0.11, 0.008, metal(0xc89c4c));
        }
        2 => {
            let box_ = Checker(rgb(0xecbe3c), rgb(0xbe3228), v(16.0, 16.0, 16.0));
            scene.solid(Convex::block(at + DVec3::Z * 0.08, v(0.19, 0.16, 0.16)).turned(12.0), satin(box_));
            scene.sphere(at + DVec3::Z * 0.23, 0.07, metal(0xdee2e8));
        }
        3 => {
            scene.lathe(at, &[0.05, 0.0, 0.075, 0.10, 0.08, 0.13], matt(0xbe603c));
            let leaf = matt(Patches(rgb(0x5aaa3c), rgb(0x286e32), 24.0));
            let tip = |k: i32| at + polar(0.085, f64::from(k) * 40.0, 0.24 + 0.05 * f64::from(k % 3));
            scene.each(0..9, |k| Convex::taper(at + DVec3::Z * 0.11, tip(k), 0.022, 0.006), leaf);
        }
        _ => {
            scene.block(at + DVec3::Z * 0.15, v(0.22, 0.02, 0.30), metal(0xcea656));
            let picture = Patches(rgb(0xe6965a), rgb(0x3c6e96), 11.0);
            scene.block(at + v(0.0, at.y.signum() * 0.01, 0.15), v(0.17, 0.012, 0.25), matt(picture));
        }
    }
}

/// Adds a lamp, a clock and a pile of books.
fn on_top(scene: &mut Builder) {
    let z = floor(SHELVES);
    let mut at = v(0.36, 0.0, z);
    for (k, colour) in [rgb(0x961e24), rgb(0xe4d6b4), rgb(0x184278)].into_iter().enumerate() {
        let size = v(0.40 - 0.05 * k as f64, 0.28, 0.055);
        at.z += 0.031;
        scene.solid(Convex::block(at, size).turned(14.0 * k as f64 - 10.0), satin(colour));
        at.z += 0.028;
    }
    let cat = matt(0x343236);
    scene.lathe(at, &[0.10, -0.005, 0.11, 0.04, 0.07, 0.12, 0.03, 0.155], cat);
    scene.sphere(at + v(-0.03, 0.0, 0.17), 0.05, cat);
    let lamp = v(-0.48, 0.02, z);
    scene.lathe(lamp, &[0.10, 0.0, 0.09, 0.02, 0.02, 0.05], metal(0xcea656));
    let shade = Stripes(rgb(0xfadc96), rgb(0xe29646), v(14.0, 0.0, 0.0));
    scene.lathe(lamp, &[0.018, 0.05, 0.018, 0.09], metal(0xcea656));
    scene.lathe(lamp, &[0.16, 0.08, 0.13, 0.14, 0.085, 0.21], matt(shade));
}
