//! Steps of one length along rays, less those that a grid knows to be empty or hidden, packed on the device: nothing of them
//! passes through the host, which does not even learn how many there are.

use burn::tensor::Tensor;

use crate::dispatch::dispatch;
use crate::random::Stream;
use crate::sampling::Streams;
use crate::{Segments, from_host, to_host, upload};

/// The part of a ray in which there can be content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// Between two distances.
    Distances {
        /// The first.
        near: f32,
        /// The second.
        far: f32,
    },
    /// Within `radius` of the point that is nearest to `centre`.
    Sphere {
        /// The sphere's centre.
        centre: [f32; 3],
        /// Its radius.
        radius: f32,
    },
}

/// How rays are marched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct March {
    /// Where there can be content.
    pub reach: Reach,
    /// The box that rays are cut to, its least and its largest corner.
    pub bounds: Option<[[f32; 3]; 2]>,
    /// Length of a step at most: a ray has as many equal ones as it takes.
    pub step: f32,
    /// Whether the samples of a ray are shifted alike, by its random number; they are in the middle of their steps without.
    pub jittered: bool,
    /// Optical depth, by the densities of the grid, behind which there are no more samples.
    pub hidden_depth: f32,
    /// Room for so many samples. Rays that find none left have less.
    pub capacity: usize,
}

/// A grid of what is empty.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Density of each cell, x fastest, `[n³]`; −1 of one that is empty. Outside there is nothing known, and nothing skipped.
    pub density: Tensor<1>,
    /// n.
    pub resolution: usize,
    /// The corner of the first cell.
    pub corner: [f32; 3],
    /// Cells per scene unit along each axis.
    pub per_unit: [f32; 3],
}

/// Packed samples, in a tail behind which all is 0.
#[derive(Clone, Debug)]
pub struct Marched {
    /// Which samples belong to which ray.
    pub segments: Segments,
    /// Distance of each along its ray, `[M]`.
    pub distance: Tensor<1>,
    /// Length of each one's step, `[M]`.
    pub delta: Tensor<1>,
    /// o + t d of each, `[M, 3]`.
    pub positions: Tensor<2>,
}

/// Marches along rays given by their `origins` and unit `directions`, `[R, 3]`. No tensor is in a graph.
///
/// # Panics
/// If there are no rays, or there is no room for any sample.
pub fn march(
    [origins, directions]: [Tensor<2>; 2],
    streams: &Streams,
    cells: Option<&Cells>,
    march: &March,
) -> Marched {
    assert!(origins.dims()[0] > 0 && march.capacity > 0, "there are rays, and there is room for samples");
    dispatch! {
        &origins.device();
        host => on_host([origins, directions], streams, cells, march),
        cube => crate::cube::march([origins, directions], streams, cells, march),
        plain => on_host([origins, directions], streams, cells, march),
    }
}

impl March {
    /// How many numbers [`Self::numbers`] gives.
    #[cfg_attr(not(feature = "cube"), allow(dead_code, reason = "only GPUs are given them"))]
    pub(crate) const NUMBERS: usize = 21;

    /// All of it for a kernel, with where the cells are.
    #[cfg_attr(not(feature = "cube"), allow(dead_code, reason = "only GPUs are given them"))]
    pub(crate) fn numbers(&self, cells: Option<&Cells>) -> [f32; Self::NUMBERS] {
        let (is_sphere, reach) = match self.reach {
            Reach::Distances { near, far } => (0.0, [near, far, 0.0, 0.0]),
            Reach::Sphere { centre: [x, y, z], radius } => (1.0, [x, y, z, radius]),
        };
        let mut numbers = [0.0; Self::NUMBERS];
        numbers[0] = is_sphere;
        numbers[1..5].copy_from_slice(&reach);
        numbers[5] = self.step;
        numbers[6] = self.hidden_depth;
        if let Some(cells) = cells {
            numbers[7..10].copy_from_slice(&cells.corner);
            numbers[10..13].copy_from_slice(&cells.per_unit);
            numbers[13] = cells.resolution as f32;
        }
        if let Some([least, largest]) = self.bounds {
            numbers[14..17].copy_from_slice(&least);
            numbers[17..20].copy_from_slice(&largest);
            numbers[20] = 1.0;
        }
        numbers
    }

    /// Near and far of a ray; none if it passes nothing.
    fn interval(&self, o: [f32; 3], d: [f32; 3]) -> Option<(f32, f32)> {
        let (near, far) = match self.reach {
            Reach::Distances { near, far } => (near, far),
            Reach::Sphere { centre, radius } => {
                let middle: f32 = (0..3).map(|axis| (centre[axis] - o[axis]) * d[axis]).sum();
                (middle - radius, middle + radius)
            }
        };
        let (mut near, mut far) = (near.max(0.0), far);
        if let Some([least, largest]) = self.bounds {
            for axis in 0..3 {
                let (o, d) = (o[axis], d[axis]);
                if d == 0.0 {
                    if o < least[axis] || o > largest[axis] {
                        return None;
                    }
                    continue;
                }
                let (a, b) = ((least[axis] - o) / d, (largest[axis] - o) / d);
                (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
            }
        }
        (near < far).then_some((near, far))
    }

    /// `(t, δ)` of a ray's samples. `density` is that at a point, none of an empty one.
    fn samples(
        &self,
        (o, d): ([f32; 3], [f32; 3]),
        shift: f32,
        density: impl Fn([f32; 3]) -> Option<f32>,
    ) -> Vec<(f32, f32)> {
        let Some((near, far)) = self.interval(o, d) else { return Vec::new() };
        let count = ((far - near) / self.step).ceil().max(1.0);
        let length = (far - near) / count;
        let (mut depth, mut kept) = (0.0, Vec::new());
        for i in 0..count as usize {
            let t = near + (i as f32 + shift) * length;
            let Some(density) = density([0, 1, 2].map(|axis| o[axis] + t * d[axis])) else { continue };
            if depth >= self.hidden_depth {
                break;
            }
            depth += density * length;
            kept.push((t, length));
        }
        kept
    }
}

fn on_host([origins, directions]: [Tensor<2>; 2], streams: &Streams, cells: Option<&Cells>, march: &March) -> Marched {
    let (device, streams) = (origins.device(), streams.on_host());
    let [origins, directions] = [origins, directions].map(to_host);
    let grid = cells.map(|cells| (to_host(cells.density.clone()), cells));
    let density = |p: [f32; 3]| {
        let Some((density, cells)) = &grid else { return Some(0.0) };
        let n = cells.resolution as f32;
        let [x, y, z] = [0, 1, 2].map(|axis| ((p[axis] - cells.corner[axis]) * cells.per_unit[axis]).floor());
        let is_inside = [x, y, z].iter().all(|place| (0.0..n).contains(place));
        let found = if is_inside { density[(x + n * (y + n * z)) as usize] } else { 0.0 };
        (found >= 0.0).then_some(found)
    };
    let (mut counts, mut distance, mut delta, mut positions) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (ray, stream) in streams.iter().enumerate() {
        let [o, d] = [&origins, &directions].map(|rows| std::array::from_fn(|axis| rows[3 * ray + axis]));
        let shift = if march.jittered { Stream::uniform(*stream, 0) } else { 0.5 };
        let mut samples = march.samples((o, d), shift, density);
        samples.truncate(march.capacity - distance.len());
        counts.push(samples.len());
        for (t, length) in samples {
            distance.push(t);
            delta.push(length);
            positions.extend([0, 1, 2].map(|axis| o[axis] + t * d[axis]));
        }
    }
    let segments = Segments::with_tail(counts, march.capacity);
    distance.resize(march.capacity, 0.0);
    delta.resize(march.capacity, 0.0);
    positions.resize(3 * march.capacity, 0.0);
    Marched {
        segments,
        distance: upload(distance, [march.capacity], &device),
        delta: upload(delta, [march.capacity], &device),
        positions: from_host(&positions, 3, &device),
    }
}
