//! Marching along rays on the device: one thread per ray, which walks twice, to count its samples and to write them.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, DType, Shape};
use burn_cubecl::tensor::CubeTensor;

use crate::Segments;
use crate::cube::outputs::Outputs;
use crate::cube::random::{Bits, uniform};
use crate::cube::{CubeKernel, Pass, apply, empty};
use crate::sampling::Streams;
use crate::sampling::march::{Cells, March, Marched};

/// [`march`](crate::sampling::march::march).
pub(crate) fn march(
    [origins, directions]: [tensor::Tensor<2>; 2],
    streams: &Streams,
    cells: Option<&Cells>,
    march: &March,
) -> Marched {
    let (rays, capacity) = (origins.dims()[0], march.capacity);
    let segments = Segments::unknown(rays, capacity);
    let outputs = Outputs::new([[capacity, 1], [capacity, 1], [capacity, 3], [rays + 1, 1]].map(Shape::new));
    let kernel = Marching {
        numbers: march.numbers(cells),
        jittered: march.jittered,
        has_cells: cells.is_some(),
        capacity,
        segments: segments.clone(),
        outputs: outputs.clone(),
    };
    let density = cells.map_or_else(|| origins.clone().flatten(0, 1), |cells| cells.density.clone());
    let buffer: tensor::Tensor<1> = apply(kernel, (origins, directions, streams.0.clone(), density));
    let [distance, delta] = [0, 1].map(|index| outputs.output::<2>(&buffer, index).flatten(0, 1));
    Marched { segments, distance, delta, positions: outputs.output(&buffer, 2) }
}

#[derive(Debug)]
struct Marching {
    numbers: [f32; March::NUMBERS],
    jittered: bool,
    has_cells: bool,
    capacity: usize,
    /// Whose offsets are made.
    segments: Segments,
    outputs: Arc<Outputs<4>>,
}

impl CubeKernel for Marching {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [origins, directions, streams, density] = inputs else { unreachable!("marching has four inputs") };
        let of_type = |tensor: &CubeTensor, dtype| CubeTensor { dtype, ..tensor.clone() };
        let (rays, streams) = (self.segments.rays(), of_type(streams, DType::U32));
        let numbers = crate::cube::numbers(&self.numbers, origins);
        let counts = of_type(&empty(origins, [rays]), DType::I32);
        launch!(
            count::launch, rays;
            origins, directions, &streams, density, &numbers, &counts;
            self.jittered, self.has_cells
        );
        let buffer = self.outputs.buffer(origins);
        let [distance, delta, positions, offsets] = self.outputs.parts(&buffer);
        let offsets = of_type(&burn_cubecl::ops::reshape(offsets, Shape::new([rays + 1])), DType::I32);
        launch!(
            write::launch, rays;
            origins, directions, &streams, density, &numbers, &counts, &distance, &delta, &positions, &offsets;
            self.capacity, self.jittered, self.has_cells
        );
        self.segments.on_gpu.get_or_init(|| offsets);
        buffer
    }

    fn backward(&self, _pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        vec![None; 4]
    }
}

/// The steps of a ray.
#[derive(CubeType, Clone, Copy)]
struct Steps {
    near: f32,
    length: f32,
    count: usize,
    shift: f32,
}

/// The steps of a ray of which `numbers` says as [`March::numbers`]; none if it passes nothing.
#[cube]
fn steps(
    origins: &Tensor<f32>,
    directions: &Tensor<f32>,
    streams: &Tensor<u32>,
    numbers: &Tensor<f32>,
    ray: usize,
    #[comptime] jittered: bool,
) -> Steps {
    let mut near = numbers[1];
    let mut far = numbers[2];
    if numbers[0] == 1.0f32 {
        let mut middle = 0.0f32;
        #[unroll]
        for axis in 0..3usize {
            middle += (numbers[1 + axis] - origins[3 * ray + axis]) * directions[3 * ray + axis];
        }
        near = middle - numbers[4];
        far = middle + numbers[4];
    }
    near = f32::max(near, 0.0f32);
    let mut is_hit = true;
    if numbers[20] == 1.0f32 {
        #[unroll]
        for axis in 0..3usize {
            let o = origins[3 * ray + axis];
            let d = directions[3 * ray + axis];
            if d == 0.0f32 {
                is_hit = is_hit && o >= numbers[14 + axis] && o <= numbers[17 + axis];
            } else {
                let a = (numbers[14 + axis] - o) / d;
                let b = (numbers[17 + axis] - o) / d;
                near = f32::max(near, f32::min(a, b));
                far = f32::min(far, f32::max(a, b));
            }
        }
    }
    let mut count = 0.0f32;
    let mut length = 0.0f32;
    if is_hit && near < far {
        count = f32::max(f32::ceil((far - near) / numbers[5]), 1.0f32);
        length = (far - near) / count;
    }
    let mut shift = 0.5f32;
    if comptime!(jittered) {
        let key = Bits { high: streams[3 * ray + 1], low: streams[3 * ray] };
        shift = uniform(&key, streams[3 * ray + 2], 0u32);
    }
    Steps { near, length, count: usize::cast_from(count), shift }
}

/// The density that the cells have at distance `t` of a ray, −1 where they are empty; 0 outside, or without cells.
#[cube]
fn density_at(
    origins: &Tensor<f32>,
    directions: &Tensor<f32>,
    density: &Tensor<f32>,
    numbers: &Tensor<f32>,
    ray: usize,
    t: f32,
    #[comptime] has_cells: bool,
) -> f32 {
    let mut found = 0.0f32;
    if comptime!(has_cells) {
        let n = numbers[13];
        let mut cell = 0usize;
        let mut stride = 1usize;
        let mut is_inside = true;
        #[unroll]
        for axis in 0..3usize {
            let p = origins[3 * ray + axis] + t * directions[3 * ray + axis];
            let place = f32::floor((p - numbers[7 + axis]) * numbers[10 + axis]);
            is_inside = is_inside && place >= 0.0f32 && place < n;
            cell += stride * usize::cast_from(f32::max(place, 0.0f32));
            stride *= usize::cast_from(n);
        }
        if is_inside {
            found = density[cell];
        }
    }
    found
}

/// How many samples each ray has.
#[cube(launch)]
fn count(
    origins: &Tensor<f32>,
    directions: &Tensor<f32>,
    streams: &Tensor<u32>,
    density: &Tensor<f32>,
    numbers: &Tensor<f32>,
    counts: &mut Tensor<i32>,
    #[comptime] jittered: bool,
    #[comptime] has_cells: bool,
) {
    let ray = ABSOLUTE_POS;
    if ray >= counts.len() {
        terminate!();
    }
    let steps = steps(origins, directions, streams, numbers, ray, jittered);
    let mut depth = 0.0f32;
    let mut kept = 0i32;
    for i in 0..steps.count {
        let t = steps.near + (f32::cast_from(i) + steps.shift) * steps.length;
        let found = density_at(origins, directions, density, numbers, ray, t, has_cells);
        if found >= 0.0f32 && depth < numbers[6] {
            depth += found * steps.length;
            kept += 1i32;
        }
    }
    counts[ray] = kept;
}

/// The samples of each ray behind those of the rays before it, as many as there is room for, and zeros behind the last ones.
#[cube(launch)]
fn write(
    origins: &Tensor<f32>,
    directions: &Tensor<f32>,
    streams: &Tensor<u32>,
    density: &Tensor<f32>,
    numbers: &Tensor<f32>,
    counts: &Tensor<i32>,
    distance: &mut Tensor<f32>,
    delta: &mut Tensor<f32>,
    positions: &mut Tensor<f32>,
    offsets: &mut Tensor<i32>,
    capacity: usize,
    #[comptime] jittered: bool,
    #[comptime] has_cells: bool,
) {
    let ray = ABSOLUTE_POS;
    let rays = counts.len();
    if ray >= rays {
        terminate!();
    }
    let mut start = 0usize;
    for before in 0..ray {
        start += usize::cast_from(counts[before]);
    }
    let mut total = start;
    for other in ray..rays {
        total += usize::cast_from(counts[other]);
    }
    start = usize::min(start, capacity);
    total = usize::min(total, capacity);
    let end = usize::min(start + usize::cast_from(counts[ray]), capacity);
    if ray == 0 {
        offsets[0] = 0i32;
    }
    offsets[ray + 1] = i32::cast_from(end);

    let steps = steps(origins, directions, streams, numbers, ray, jittered);
    let mut depth = 0.0f32;
    let mut at = start;
    for i in 0..steps.count {
        let t = steps.near + (f32::cast_from(i) + steps.shift) * steps.length;
        let found = density_at(origins, directions, density, numbers, ray, t, has_cells);
        if found >= 0.0f32 && depth < numbers[6] && at < end {
            depth += found * steps.length;
            distance[at] = t;
            delta[at] = steps.length;
            #[unroll]
            for axis in 0..3usize {
                positions[3 * at + axis] = origins[3 * ray + axis] + t * directions[3 * ray + axis];
            }
            at += 1;
        }
    }
    let mut behind = total + ray;
    while behind < capacity {
        distance[behind] = 0.0f32;
        delta[behind] = 0.0f32;
        #[unroll]
        for axis in 0..3usize {
            positions[3 * behind + axis] = 0.0f32;
        }
        behind += rays;
    }
}
