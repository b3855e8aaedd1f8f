//! Marching along rays on the device: one thread per ray, which walks twice, to count its samples and to write them.

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};

use super::kernels::uniform;
use super::{integers, streams_or};
use crate::cube::buffers::Outputs;
use crate::cube::{apply_without_gradient, empty, launch, uploaded};
use crate::sampling::PackedSamples;
use crate::sampling::march::{Cells, MarchSettings, MarchedRays};
use crate::segments::Segments;
use crate::traffic::to_host;

pub(in crate::sampling) fn march(rays: &MarchedRays, cells: Option<&Cells>, march: MarchSettings) -> PackedSamples {
    let geometry: tensor::Tensor<2> =
        tensor::Tensor::cat(vec![rays.origins.clone(), rays.directions.clone(), rays.ends.clone()], 1);
    let streams = streams_or(rays.jitter.as_ref(), &geometry);
    let density = cells.map_or_else(|| geometry.clone().flatten(0, 1), |cells| cells.density.clone());
    let ([x, y, z], [per_x, per_y, per_z], resolution) =
        cells.map_or(([0.0; 3], [0.0; 3], 0), |cells| (cells.corner, cells.per_unit, cells.resolution));
    // Kernels read them by index: step, hidden depth, corner from 2 on, cells per unit from 5 on, resolution.
    let settings = [march.step, march.hidden_depth, x, y, z, per_x, per_y, per_z, resolution as f32];
    let (jittered, has_cells) = (rays.jitter.is_some(), cells.is_some());
    let inputs = [geometry.clone().into_dispatch(), streams.into_dispatch(), density.into_dispatch()];
    let counts: tensor::Tensor<1> = apply_without_gradient(inputs.clone(), move |[rays, streams, density]| {
        let (streams, settings) = (integers(streams), uploaded(&settings, rays));
        let rows = rays.meta.shape()[0];
        let counts = empty(rays, [rows]);
        launch!(count::launch, rows; rays, &streams, density, &settings, &counts; jittered, has_cells);
        counts
    });
    // Counts are whole numbers below 2^24, which f32 holds exactly.
    let segments = Segments::from_counts(to_host(counts).into_iter().map(|count| count as usize));
    let samples = segments.samples();
    if samples == 0 {
        let none = tensor::Tensor::<1>::empty([0], &geometry.device());
        let positions = tensor::Tensor::empty([0, 3], &geometry.device());
        return PackedSamples { segments, distance: none.clone(), delta: none, positions, on_host: None };
    }
    let shapes = [Shape::new([samples]), Shape::new([samples]), Shape::new([samples, 3])];
    let counted = segments.clone();
    let outputs = Outputs::new(shapes, inputs, move |[rays, streams, density], [distance, delta, positions]| {
        let (streams, settings) = (integers(streams), uploaded(&settings, rays));
        let offsets = counted.offsets_on_device_of(rays);
        launch!(
            write::launch, counted.rays();
            rays, &streams, density, &settings, &offsets, &distance, &delta, &positions;
            jittered, has_cells
        );
    });
    let [distance, delta] = [0, 1].map(|index| outputs.output(index));
    PackedSamples { segments, distance, delta, positions: outputs.output(2), on_host: None }
}

#[derive(CubeType, Clone, Copy)]
struct RaySteps {
    near: f32,
    length: f32,
    count: usize,
    shift: f32,
}

/// Returns the steps of a ray, a row of `rays`: origin, direction, near and far. There are none if near ≥ far.
#[cube]
fn steps(
    rays: &Tensor<f32>,
    streams: &Tensor<u32>,
    settings: &Tensor<f32>,
    ray: usize,
    #[comptime] jittered: bool,
) -> RaySteps {
    let (near, far) = (rays[8 * ray + 6], rays[8 * ray + 7]);
    let mut count = 0.0f32;
    let mut length = 0.0f32;
    if near < far {
        count = f32::max(f32::ceil((far - near) / settings[0]), 1.0f32);
        length = (far - near) / count;
    }
    let mut shift = 0.5f32;
    if comptime!(jittered) {
        shift = uniform(streams, ray, 0);
    }
    RaySteps { near, length, count: usize::cast_from(count), shift }
}

/// Returns the density of the cell at distance `t` of a ray, −1 if it is empty; 0 outside, or without cells.
#[cube]
fn density_at(
    rays: &Tensor<f32>,
    density: &Tensor<f32>,
    settings: &Tensor<f32>,
    ray: usize,
    t: f32,
    #[comptime] has_cells: bool,
) -> f32 {
    let mut found = 0.0f32;
    if comptime!(has_cells) {
        let n = settings[8];
        let mut cell = 0usize;
        let mut stride = 1usize;
        let mut is_inside = true;
        #[unroll]
        for axis in 0..3usize {
            let p = rays[8 * ray + axis] + t * rays[8 * ray + 3 + axis];
            let place = f32::floor((p - settings[2 + axis]) * settings[5 + axis]);
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

#[cube(launch)]
fn count(
    rays: &Tensor<f32>,
    streams: &Tensor<u32>,
    density: &Tensor<f32>,
    march_settings: &Tensor<f32>,
    counts: &mut Tensor<f32>,
    #[comptime] jittered: bool,
    #[comptime] has_cells: bool,
) {
    let ray = ABSOLUTE_POS;
    if ray >= counts.len() {
        terminate!();
    }
    let steps = steps(rays, streams, march_settings, ray, jittered);
    let mut depth = 0.0f32;
    let mut kept = 0.0f32;
    for i in 0..steps.count {
        let t = steps.near + (f32::cast_from(i) + steps.shift) * steps.length;
        let found = density_at(rays, density, march_settings, ray, t, has_cells);
        if found >= 0.0f32 && depth < march_settings[1] {
            depth += found * steps.length;
            kept += 1.0f32;
        }
    }
    counts[ray] = kept;
}

/// Writes the samples of each ray. Rounding may differ between both kernels: a counted sample that is not found again is
/// written at the far end with length 0.
#[cube(launch)]
fn write(
    rays: &Tensor<f32>,
    streams: &Tensor<u32>,
    density: &Tensor<f32>,
    march_settings: &Tensor<f32>,
    offsets: &Tensor<i32>,
    distance: &mut Tensor<f32>,
    delta: &mut Tensor<f32>,
    positions: &mut Tensor<f32>,
    #[comptime] jittered: bool,
    #[comptime] has_cells: bool,
) {
    let ray = ABSOLUTE_POS;
    if ray >= rays.shape(0) {
        terminate!();
    }
    let mut at = usize::cast_from(offsets[ray]);
    let end = usize::cast_from(offsets[ray + 1]);
    let steps = steps(rays, streams, march_settings, ray, jittered);
    let mut depth = 0.0f32;
    for i in 0..steps.count {
        let t = steps.near + (f32::cast_from(i) + steps.shift) * steps.length;
        let found = density_at(rays, density, march_settings, ray, t, has_cells);
        if found >= 0.0f32 && depth < march_settings[1] && at < end {
            depth += found * steps.length;
            distance[at] = t;
            delta[at] = steps.length;
            #[unroll]
            for axis in 0..3usize {
                positions[3 * at + axis] = rays[8 * ray + axis] + t * rays[8 * ray + 3 + axis];
            }
            at += 1;
        }
    }
    let far = steps.near + f32::cast_from(steps.count) * steps.length;
    while at < end {
        distance[at] = far;
        delta[at] = 0.0f32;
        #[unroll]
        for axis in 0..3usize {
            positions[3 * at + axis] = rays[8 * ray + axis] + far * rays[8 * ray + 3 + axis];
        }
        at += 1;
    }
}
