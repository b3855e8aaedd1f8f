//! Oracle for baked packing: a package read back and evaluated as the shader does.

use glam::Vec3;
use infonerf_render::OccupancyGrid;
use infonerf_scene::Aabb;
use infonerf_train::{Config, Preset};

use super::CHANNELS;
use super::lattice::{CELLS, POINTS, VOLUME};
use crate::decode::{DecodedPackage, exact, model, packed};

/// Small MLP whose density and colour change slowly, before any training.
const SMOOTH: &str = "field={kind=\"nerf\",layers=2,width=32,skip=9,position_frequencies=2,direction_frequencies=1,\
                      density=\"softplus\",detail=1.0}";

struct PackedBricks {
    decoded: DecodedPackage,
    /// Number of each cell's brick, if it has one.
    numbers: Vec<Option<usize>>,
    cells: [usize; 3],
    opacities: Vec<u8>,
    /// Bytes `[channel, 4, bricks, points]`.
    colors: Vec<Vec<u8>>,
}

impl PackedBricks {
    fn new(decoded: DecodedPackage) -> Self {
        let cells = [0, 1, 2].map(|axis| decoded.package["grid"][axis].as_u64().unwrap() as usize);
        let bits = decoded.part("occupied");
        let mut free = 0..;
        let mut number = |cell: usize| if bits[cell / 8] >> (cell % 8) & 1 == 1 { free.next() } else { None };
        let numbers: Vec<Option<usize>> = (0..cells.iter().product()).map(&mut number).collect();
        let count = numbers.iter().flatten().count();
        let opacities = from_rows(decoded.part("opacities"));
        let colors: Vec<Vec<u8>> = CHANNELS.iter().map(|name| from_rows(decoded.part(&format!("{name}s")))).collect();
        assert_eq!(opacities.len(), count * VOLUME);
        assert!(colors.iter().all(|color| color.len() == 4 * opacities.len()));
        let capacity: f32 = decoded.vector("ATLAS").iter().product();
        assert!(capacity >= count as f32);
        Self { decoded, numbers, cells, opacities, colors }
    }

    /// Returns the brick at `p`, and the place of `p` in it, in voxels.
    fn place(&self, p: Vec3) -> Option<(usize, Vec3)> {
        let voxel = (p - Vec3::from_slice(&self.decoded.vector("LOW"))) / self.decoded.constant("VOXEL");
        let cell = (voxel / CELLS as f32).floor().as_uvec3();
        let [nx, ny, _] = self.cells;
        let number = self.numbers[cell.x as usize + nx * (cell.y as usize + ny * cell.z as usize)]?;
        Some((number, voxel - CELLS as f32 * cell.as_vec3()))
    }

    /// Interpolates a texture of bytes between the eight points around a place in a brick.
    fn read(bytes: &[u8], brick: usize, at: Vec3) -> f32 {
        let first = at.floor().min(Vec3::splat(CELLS as f32 - 1.0));
        let share = at - first;
        let corner = |i: usize| {
            let step = Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
            let weight = (step * share + (1.0 - step) * (1.0 - share)).element_product();
            let [x, y, z] = (first + step).to_array().map(|c| c as usize);
            weight * f32::from(bytes[brick * VOLUME + x + POINTS * (y + POINTS * z)]) / 255.0
        };
        (0..8).map(corner).sum()
    }

    fn density(&self, p: Vec3) -> f32 {
        let root = self.place(p).map_or(0.0, |(brick, at)| Self::read(&self.opacities, brick, at));
        -(1.0 - self.decoded.constant("MAX_OPACITY") * root * root).ln() / self.decoded.constant("VOXEL")
    }

    fn color(&self, p: Vec3, direction: Vec3) -> [f32; 3] {
        let Some((brick, at)) = self.place(p) else { return [0.0; 3] };
        [0, 1, 2].map(|channel| {
            let name = CHANNELS[channel].to_uppercase();
            let [low, range] = ["LOW", "RANGE"].map(|kind| self.decoded.vector(&format!("{name}_{kind}")));
            let terms = [1.0, direction.x, direction.y, direction.z];
            let mut planes = self.colors[channel].chunks_exact(self.opacities.len());
            let mut number = |i: usize| low[i] + range[i] * Self::read(planes.next().unwrap(), brick, at);
            let sum: f32 = (0..4).map(|i| number(i) * terms[i]).sum();
            sum.clamp(0.0, self.decoded.constant("MAX_COLOR"))
        })
    }
}

fn from_rows(stored: &[u8]) -> Vec<u8> {
    let row = |row: &[u8]| -> Vec<u8> {
        let sum = |last: &mut u8, byte: &u8| {
            *last = last.wrapping_add(*byte);
            Some(*last)
        };
        row.iter().scan(0, sum).collect()
    };
    stored.chunks(POINTS).flat_map(row).collect()
}

fn config(set: &[&str]) -> Config {
    Config::of(Preset::Paper, [SMOOTH].iter().chain(set)).unwrap()
}

/// Draws points of the cube ±`half`.
fn draw(half: f32) -> impl Iterator<Item = Vec3> {
    (1..60).map(move |i: u32| {
        let [x, y, z] = [0.754_877_7, 0.569_840_3, 0.430_159_7].map(|step: f64| (f64::from(i) * step).fract() as f32);
        half * (2.0 * Vec3::new(x, y, z) - 1.0)
    })
}

#[test]
fn packed_bricks_evaluate_to_the_field() {
    let config = config(&["render.clip_to_bounds=true"]);
    let trained = model(&config.field);
    let bricks = PackedBricks::new(packed(&config.render, &trained, 48));
    assert_eq!((bricks.cells, bricks.opacities.len()), ([6; 3], 216 * VOLUME));
    // Directions from eyes of the fit, and from between them.
    let eyes = [Vec3::X, -Vec3::Z, Vec3::new(0.6, 0.8, 0.0)].map(|eye| 4.0 * eye);
    for p in draw(1.49) {
        for eye in eyes {
            let direction = (p - eye).normalize();
            let (density, color) = exact(&trained, p, direction);
            let found = bricks.density(p);
            assert!((found - density).abs() < 0.02 * density + 0.01, "{p}: {found} for {density}");
            for (found, expected) in bricks.color(p, direction).iter().zip(color) {
                assert!((found - expected).abs() < 0.02, "{p} along {direction}: {found} for {expected}");
            }
        }
    }
}

/// Packs a field with the given cells of its occupancy grid of 4³.
fn packed_cells(occupied: impl Fn(usize) -> bool) -> PackedBricks {
    let occupancy = ["render.occupancy.enabled=true", "render.occupancy.resolution=4"];
    let config = config(&[&["render.clip_to_bounds=true"], &occupancy[..]].concat());
    let mut trained = model(&config.field);
    let mut grid = OccupancyGrid::new(&config.render.occupancy, Aabb::cube(Vec3::ZERO, 1.5));
    grid.restore(vec![1.0; 64], (0..64).map(occupied).collect(), true).unwrap();
    trained.occupancy = Some(grid);
    PackedBricks::new(packed(&config.render, &trained, 32))
}

#[test]
fn empty_bricks_are_left_out() {
    // One octant is occupied.
    let bricks = packed_cells(|cell| cell % 4 < 2 && cell / 4 % 4 < 2 && cell / 16 < 2);
    assert_eq!((bricks.cells, bricks.opacities.len()), ([4; 3], 8 * VOLUME));
    for p in draw(1.49) {
        let found = bricks.density(p);
        if p.max_element() < -0.1 {
            assert!(found > 0.0, "{p}");
        } else if p.max_element() > 0.0 {
            assert_eq!(found, 0.0, "{p}");
        }
    }
}

#[test]
fn empty_fields_and_warped_space_are_packages() {
    let bricks = packed_cells(|_| false);
    assert_eq!((bricks.opacities.len(), bricks.decoded.vector("RED_LOW")), (0, vec![0.0; 4]));

    let contracted = config(&["render.space=\"contraction\""]);
    let trained = model(&contracted.field);
    let bricks = PackedBricks::new(packed(&contracted.render, &trained, 32));
    let shader = bricks.decoded.package["shader"].as_str().unwrap();
    assert!(shader.contains("#define CLIPS 0") && shader.contains("#define WARP CONTRACTION"));
    for p in draw(1.1) {
        let (found, expected) = (bricks.density(p), exact(&trained, p, Vec3::Z).0);
        assert!((found - expected).abs() < 0.03 * expected + 0.01, "{p}: {found} for {expected}");
    }
}
