//! Pixels drawn at random on the device that renders them, with their rays and what they show: a step then moves the bundles'
//! few numbers there, and not those of each ray.

use burn::tensor::{Device, Tensor};

use crate::dispatch::dispatch;
use crate::random::{Stream, below, permuted};
use crate::sampling::Streams;
use crate::{split_rows, to_host, upload};

/// What all bundles draw from: `V` views of cameras that differ in their poses alone, and the pixels of images of one or two
/// sizes, `P` in all.
#[derive(Clone, Debug)]
pub struct PixelTables {
    /// Of each pixel the unit direction of its ray in the camera's frame, and the radius of its cone at distance 1, `[P, 4]`.
    pub rays: Tensor<2>,
    /// Camera to world of each view, the three upper rows, `[V, 12]`.
    pub poses: Tensor<2>,
    /// Red, green and blue of each pixel of each view, and a class of it (0, 1 or 2), `[V A, 4]`, `A` being the pixels of the
    /// images that are shown.
    pub shown: Tensor<2>,
}

/// Which views a bundle is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawnViews {
    /// Each ray of one of them, which the stream draws: pixels are independent.
    All {
        /// The number of views.
        count: usize,
        /// The key of a stream of random numbers.
        key: u64,
    },
    /// All rays of one: pixels are distinct.
    One(usize),
}

/// How the pixels of a bundle of rays are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelDraw {
    /// The number of rays.
    pub rays: usize,
    /// Of which views.
    pub views: DrawnViews,
    /// Keys of the streams of columns and of rows. Distinct pixels are a permutation that the first of them chooses.
    pub keys: [u64; 2],
    /// The first column and their number.
    pub columns: [u32; 2],
    /// The first row and their number.
    pub rows: [u32; 2],
    /// The first pixel of the images in [`PixelTables::rays`].
    pub first: usize,
    /// Width and height of the images.
    pub size: [usize; 2],
    /// How much wider cones are than those of the table.
    pub widening: f32,
    /// The world in which the cameras are, rows of a 3 × 4 matrix: it moves the poses of the views, or the identity.
    pub motion: [f32; 12],
    /// Whether cameras are those of the views; else the motion is the only camera's pose.
    pub has_poses: bool,
    /// Keys of the streams by which the first and the fine samples of each ray are placed.
    pub streams: [u64; 2],
}

/// Number of words that a bundle takes on a GPU.
pub(crate) const WORDS: usize = 36;

impl PixelDraw {
    /// Matrix that moves nothing.
    pub const UNMOVED: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

    /// View, column and row of the pixel of ray `ray`.
    pub fn pixel(&self, ray: usize) -> (usize, usize, usize) {
        let [columns, rows] = [self.columns, self.rows].map(|[_, count]| count as usize);
        let (view, column, row) = match self.views {
            DrawnViews::All { count, key } => {
                let [column, row] = self.keys;
                (below(key, ray, 0, count), below(column, ray, 0, columns), below(row, ray, 0, rows))
            }
            DrawnViews::One(view) => {
                let pixel = permuted(self.keys[0], ray, columns * rows);
                (view, pixel % columns, pixel / columns)
            }
        };
        (view, self.columns[0] as usize + column, self.rows[0] as usize + row)
    }

    /// The same numbers in 32 bits each, as the kernel reads them.
    #[cfg_attr(not(feature = "cube"), allow(dead_code, reason = "only GPUs are given them"))]
    pub(crate) fn words(&self) -> [u32; WORDS] {
        let mut words = [0; WORDS];
        let (is_one, views, key) = match self.views {
            DrawnViews::All { count, key } => (0, count, key),
            DrawnViews::One(view) => (1, view, 0),
        };
        let [columns, rows] = [self.columns, self.rows];
        words[..6].copy_from_slice(&[self.rays as u32, is_one, views as u32, columns[0], columns[1], rows[0]]);
        words[6..12].copy_from_slice(&[
            rows[1],
            self.first as u32,
            self.size[0] as u32,
            self.size[1] as u32,
            self.widening.to_bits(),
            u32::from(self.has_poses),
        ]);
        for (words, motion) in words[12..24].iter_mut().zip(self.motion) {
            *words = motion.to_bits();
        }
        for (words, key) in words[24..34].chunks_exact_mut(2).zip([&[key][..], &self.keys, &self.streams].concat()) {
            words.copy_from_slice(&[key as u32, (key >> 32) as u32]);
        }
        words[34] = crate::random::half_bits(columns[1] as usize * rows[1] as usize);
        words
    }
}

/// The rays of several bundles, one bundle after the other, `R` in all. No tensor is in a graph.
#[derive(Clone, Debug)]
pub struct DrawnRays {
    /// Origins, `[R, 3]`, scene units.
    pub origins: Tensor<2>,
    /// Unit directions, `[R, 3]`.
    pub directions: Tensor<2>,
    /// Radii of the pixels' cones at distance 1, `[R]`.
    pub radii: Tensor<1>,
    /// Red, green and blue of the pixels of the first bundle, `[S, 3]`.
    pub colors: Tensor<2>,
    /// Their classes, `[S]`.
    pub classes: Tensor<1>,
    /// By what the first and the fine samples of each ray are jittered.
    pub streams: [Streams; 2],
}

impl DrawnRays {
    /// The number of rays.
    pub fn rays(&self) -> usize {
        self.radii.dims()[0]
    }

    /// The first `counts[0]` rays, the next `counts[1]`, and so on; each part has all colours and classes.
    pub fn split(self, counts: &[usize]) -> Vec<Self> {
        if counts[0] == self.rays() {
            return vec![self];
        }
        let rows = |tensor: Tensor<2>| split_rows(tensor, counts);
        let (origins, directions) = (rows(self.origins), rows(self.directions));
        let radii = split_rows(self.radii, counts);
        let words: Vec<usize> = counts.iter().map(|count| 3 * count).collect();
        let [first, fine] = self.streams.map(|streams| split_rows(streams.0, &words));
        let part = |index: usize| Self {
            origins: origins[index].clone(),
            directions: directions[index].clone(),
            radii: radii[index].clone(),
            colors: self.colors.clone(),
            classes: self.classes.clone(),
            streams: [&first, &fine].map(|streams| Streams(streams[index].clone())),
        };
        (0..counts.len()).map(part).collect()
    }
}

/// Draws the pixels of all `bundles`, the first of which is of photographs.
///
/// # Panics
/// If there is no ray.
pub fn draw_rays(tables: &PixelTables, bundles: &[PixelDraw]) -> DrawnRays {
    dispatch! {
        &tables.rays.device();
        host => on_host(tables, bundles),
        cube => crate::cube::draw_rays(tables, bundles),
        plain => on_host(tables, bundles),
    }
}

fn on_host(tables: &PixelTables, bundles: &[PixelDraw]) -> DrawnRays {
    let device: Device = tables.rays.device();
    let [rays, poses, shown] = [&tables.rays, &tables.poses, &tables.shown].map(|table| to_host(table.clone()));
    let (mut origins, mut directions, mut radii) = (Vec::new(), Vec::new(), Vec::new());
    let (mut colors, mut classes) = (Vec::new(), Vec::new());
    let mut streams = [Vec::new(), Vec::new()];
    for (index, bundle) in bundles.iter().enumerate() {
        let [width, height] = bundle.size;
        for ray in 0..bundle.rays {
            let (view, x, y) = bundle.pixel(ray);
            let pixel = y * width + x;
            let [local @ .., radius]: [f32; 4] = std::array::from_fn(|i| rays[4 * (bundle.first + pixel) + i]);
            let (mut origin, mut direction) = ([0.0; 3], local);
            if bundle.has_poses {
                let pose = std::array::from_fn(|i| poses[12 * view + i]);
                (origin, direction) = moved(&pose, origin, direction);
            }
            (origin, direction) = moved(&bundle.motion, origin, direction);
            origins.extend(origin);
            directions.extend(direction);
            radii.push(radius * bundle.widening);
            if index == 0 {
                let at = 4 * (view * width * height + pixel);
                colors.extend_from_slice(&shown[at..at + 3]);
                classes.push(shown[at + 3]);
            }
            for (streams, key) in streams.iter_mut().zip(bundle.streams) {
                streams.push(Stream { key, item: ray });
            }
        }
    }
    let rows = |numbers: Vec<f32>| {
        let count = numbers.len() / 3;
        upload(numbers, [count, 3], &device)
    };
    let numbers = |numbers: Vec<f32>| {
        let count = numbers.len();
        upload(numbers, [count], &device)
    };
    DrawnRays {
        origins: rows(origins),
        directions: rows(directions),
        radii: numbers(radii),
        colors: rows(colors),
        classes: numbers(classes),
        streams: streams.map(|streams| Streams(numbers(Streams::bits(streams)))),
    }
}

/// A point and a direction after a motion, of which `m` is the 3 × 4 matrix.
fn moved(m: &[f32; 12], [x, y, z]: [f32; 3], [u, v, w]: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let point = std::array::from_fn(|i| m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] * z + m[4 * i + 3]);
    let direction = std::array::from_fn(|i| m[4 * i] * u + m[4 * i + 1] * v + m[4 * i + 2] * w);
    (point, direction)
}
