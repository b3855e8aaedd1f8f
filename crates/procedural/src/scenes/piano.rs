//! A black grand piano with its lid up on a dark rug: dark matter with faint mirror images.

use super::*;

const TOP: f64 = -0.10;
const RUG: f64 = -0.98;

pub(super) fn piano(scene: &mut Builder) {
    scene.cylinder(v(0.0, 0.0, RUG - 0.05), 0.98, 0.05, matt(Flowers(rgb(0x24161e), rgb(0x4a1e22), 4.2, false)));
    scene.ring(v(0.0, 0.0, RUG - 0.02), 0.98, 0.026, matt(0x342a1c));
    case(scene);
    keyboard(scene);
    lid(scene);
    legs(scene);
    bench(scene);
}

fn lacquer() -> Material {
    Material { reflectance: 0.045, ..glossy(0x161618) }
}

/// Returns a grand piano's outline from `y` back, `shrink` smaller: a block with its bent side hollowed out, and the tail.
fn outline(low: f64, high: f64, y: f64, shrink: f64) -> [(Convex, Vec<Convex>); 2] {
    let (front, back) = (y + shrink, 0.62);
    let size = v(1.36 - 2.0 * shrink, back - front, high - low);
    let bent = Convex::cylinder(v(0.95, 0.85, low - 1.0), 0.75 + shrink, 2.0);
    let block = Convex::block(v(0.0, 0.5 * (front + back), 0.5 * (low + high)), size);
    [(block, vec![bent]), (Convex::cylinder(v(-0.24, 0.60, low), 0.44 - shrink, high - low), Vec::new())]
}

fn case(scene: &mut Builder) {
    for (part, cuts) in outline(TOP - 0.24, TOP, -0.49, 0.0) {
        scene.carved(part, cuts, lacquer());
    }
    let board = Planks(rgb(0x784e24), rgb(0x543216), 0.09, 0.9);
    for (part, cuts) in outline(TOP, TOP + 0.004, -0.49, 0.035) {
        scene.carved(part, cuts, satin(board));
    }
    let iron = metal(0x967030);
    scene.block(v(0.0, -0.33, TOP + 0.02), v(1.24, 0.07, 0.03), iron);
    let strut = |(x, y): (f64, f64)| Convex::rod(v(x, -0.30, TOP + 0.03), v(x, y, TOP + 0.03), 0.018);
    scene.each([(-0.56, 0.70), (-0.30, 0.92), (-0.02, 0.74), (0.20, 0.46), (0.46, 0.14)], strut, iron);
    for k in 0..22 {
        let s = f64::from(k) / 21.0;
        let x = -0.58 + 1.14 * s;
        let length = if s < 0.45 { 1.04 } else { 1.04 - 1.25 * (s - 0.45) };
        scene.rod(v(x, -0.30, TOP + 0.02), v(x + 0.04, -0.30 + length, TOP + 0.02), 0.006, metal(0xbebab0));
    }
    scene.block(v(0.0, -0.22, TOP + 0.035), v(1.14, 0.035, 0.03), matt(0x5a181a));
}

fn keyboard(scene: &mut Builder) {
    let key = TOP - 0.10;
    scene.block(v(0.0, -0.60, key - 0.09), v(1.36, 0.26, 0.12), lacquer());
    scene.each([-0.645, 0.645], |x| Convex::block(v(x, -0.60, key - 0.02), v(0.07, 0.26, 0.16)), lacquer());
    scene.block(v(0.0, -0.50, key - 0.01), v(1.22, 0.02, 0.05), matt(0x6e1016));
    for k in 0..28 {
        let x = -0.594 + 0.044 * f64::from(k);
        scene.block(v(x, -0.615, key - 0.01), v(0.039, 0.21, 0.04), glossy(0xe2dccc));
        if ![2, 6].contains(&(k % 7)) {
            scene.block(v(x + 0.022, -0.575, key + 0.018), v(0.024, 0.13, 0.03), lacquer());
        }
    }
    // The music desk with an open book.
    let desk = |c: Convex| c.swung(v(0.0, -0.38, TOP + 0.02), DVec3::X, -18.0);
    scene.solid(desk(Convex::block(v(0.0, -0.38, TOP + 0.15), v(0.70, 0.02, 0.26))), lacquer());
    let page = Stripes(rgb(0xe8e2d2), rgb(0x969086), v(0.0, 0.0, 26.0));
    scene.each([-0.105, 0.105], |x| desk(Convex::block(v(x, -0.40, TOP + 0.16), v(0.195, 0.012, 0.24))), matt(page));
}

fn lid(scene: &mut Builder) {
    // Hinged along the straight side.
    let hinge = v(-0.68, 0.0, TOP + 0.02);
    let swing = |part: Convex| part.swung(hinge, DVec3::Y, -38.0);
    for (part, cuts) in outline(TOP + 0.02, TOP + 0.05, -0.20, 0.0) {
        scene.carved(swing(part), cuts.into_iter().map(swing).collect(), lacquer());
    }
    scene.rod(v(0.54, 0.02, TOP), v(0.36, 0.02, TOP + 0.82), 0.014, metal(0x967030));
}

fn legs(scene: &mut Builder) {
    let brass = metal(0xb0863c);
    for at in [v(-0.54, -0.50, RUG), v(0.54, -0.50, RUG), v(-0.28, 0.66, RUG)] {
        scene.sphere(at + DVec3::Z * 0.035, 0.035, brass);
        let outline = [0.035, 0.06, 0.05, 0.12, 0.04, 0.20, 0.07, 0.46, 0.09, 0.54, 0.07, 0.58, 0.09, 0.66];
        scene.lathe(at, &outline, lacquer());
    }
    scene.each([-0.04, 0.04], |x| Convex::rod(v(x, -0.25, RUG + 0.05), v(0.5 * x, -0.20, TOP - 0.2), 0.014), lacquer());
    scene.each([-0.07, 0.0, 0.07], |x| Convex::block(v(x, -0.30, RUG + 0.06), v(0.03, 0.14, 0.02)), brass);
}

fn bench(scene: &mut Builder) {
    let at = v(0.0, -0.90, RUG);
    let leather = Checker(rgb(0x281412), rgb(0x341a16), v(14.0, 14.0, 0.1));
    scene.block(at + DVec3::Z * 0.42, v(0.52, 0.22, 0.07), satin(leather));
    scene.block(at + DVec3::Z * 0.36, v(0.54, 0.24, 0.05), lacquer());
    let leg = |(x, y): (f64, f64)| Convex::taper(at + v(x, y, 0.0), at + v(x, y, 0.35), 0.02, 0.035);
    scene.each([(-0.23, -0.08), (0.23, -0.08), (0.23, 0.08), (-0.23, 0.08)], leg, lacquer());
}
