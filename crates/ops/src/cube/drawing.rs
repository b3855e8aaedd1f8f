//! Pixels drawn on the device: one thread per ray.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, DType, Shape};
use burn_cubecl::tensor::CubeTensor;

use super::outputs::Outputs;
use super::random::{Bits, below, permuted};
use super::{CubeKernel, Pass, apply};
use crate::drawing::{DrawnRays, PixelDraw, PixelTables, WORDS};
use crate::sampling::Streams;
use crate::upload;

/// [`draw_rays`](crate::drawing::draw_rays).
pub(crate) fn draw_rays(tables: &PixelTables, bundles: &[PixelDraw]) -> DrawnRays {
    let device = tables.rays.device();
    let words: Vec<f32> = bundles.iter().flat_map(PixelDraw::words).map(f32::from_bits).collect();
    let words = upload(words, [bundles.len() * WORDS], &device);
    let rays = bundles.iter().map(|bundle| bundle.rays).sum();
    let seen = bundles[0].rays;
    let shapes = [[rays, 3], [rays, 3], [rays, 1], [seen, 3], [seen, 1], [rays, 3], [rays, 3]];
    let outputs = Outputs::new(shapes.map(Shape::new));
    let kernel = Draw { outputs: outputs.clone(), bundles: bundles.len() };
    let inputs = (words, tables.rays.clone(), tables.poses.clone(), tables.shown.clone());
    let buffer: tensor::Tensor<1> = apply(kernel, inputs);
    DrawnRays {
        origins: outputs.output(&buffer, 0),
        directions: outputs.output(&buffer, 1),
        radii: outputs.output::<2>(&buffer, 2).flatten(0, 1),
        colors: outputs.output(&buffer, 3),
        classes: outputs.output::<2>(&buffer, 4).flatten(0, 1),
        streams: [5, 6].map(|index| Streams(outputs.output::<2>(&buffer, index).flatten(0, 1))),
    }
}

#[derive(Debug)]
struct Draw {
    outputs: Arc<Outputs<7>>,
    bundles: usize,
}

impl CubeKernel for Draw {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let [words, rays, poses, shown] = inputs else { unreachable!("bundles and three tables") };
        let integers = |tensor: &CubeTensor| CubeTensor { dtype: DType::U32, ..tensor.clone() };
        let buffer = self.outputs.buffer(rays);
        let [origins, directions, radii, colors, classes, first, fine] = self.outputs.parts(&buffer);
        launch!(
            draw::launch, radii.meta.num_elements();
            &integers(words), rays, poses, shown, &origins, &directions, &radii, &colors, &classes,
            &integers(&first), &integers(&fine);
            self.bundles
        );
        buffer
    }

    fn backward(&self, _pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        vec![None; 4]
    }
}

/// A key among a bundle's words.
#[cube]
fn key(words: &Tensor<u32>, at: usize) -> Bits {
    Bits { high: words[at + 1], low: words[at] }
}

/// A component of a direction after the rotation that has the row at `at`.
#[cube]
fn turned(m: &Tensor<f32>, at: usize, x: f32, y: f32, z: f32) -> f32 {
    m[at] * x + m[at + 1] * y + m[at + 2] * z
}

/// The same of a row among a bundle's words.
#[cube]
fn turned_by_words(words: &Tensor<u32>, at: usize, x: f32, y: f32, z: f32) -> f32 {
    f32::from_bits(words[at]) * x + f32::from_bits(words[at + 1]) * y + f32::from_bits(words[at + 2]) * z
}

/// Words as [`PixelDraw::words`] has them.
#[cube(launch)]
fn draw(
    words: &Tensor<u32>,
    rays: &Tensor<f32>,
    poses: &Tensor<f32>,
    shown: &Tensor<f32>,
    origins: &mut Tensor<f32>,
    directions: &mut Tensor<f32>,
    radii: &mut Tensor<f32>,
    colors: &mut Tensor<f32>,
    classes: &mut Tensor<f32>,
    first: &mut Tensor<u32>,
    fine: &mut Tensor<u32>,
    #[comptime] bundles: usize,
) {
    let at = ABSOLUTE_POS;
    if at >= radii.len() {
        terminate!();
    }
    // The bundle of this ray.
    let mut bundle = 0usize;
    let mut start = 0usize;
    let mut end = usize::cast_from(words[0]);
    #[unroll]
    for next in 1..bundles {
        if at >= end {
            bundle = next * comptime!(WORDS);
            start = end;
        }
        end += usize::cast_from(words[next * comptime!(WORDS)]);
    }
    let ray = u32::cast_from(at - start);

    let (columns, rows) = (words[bundle + 4], words[bundle + 6]);
    let mut view = words[bundle + 2];
    let mut x = words[bundle + 3];
    let mut y = words[bundle + 5];
    if words[bundle + 1] == 1u32 {
        let pixel = permuted(&key(words, bundle + 26), ray, columns * rows, words[bundle + 34]);
        x += pixel % columns;
        y += pixel / columns;
    } else {
        view = below(&key(words, bundle + 24), ray, view);
        x += below(&key(words, bundle + 26), ray, columns);
        y += below(&key(words, bundle + 28), ray, rows);
    }
    let (width, height) = (words[bundle + 8], words[bundle + 9]);
    let pixel = usize::cast_from(y * width + x);
    let local = 4 * (usize::cast_from(words[bundle + 7]) + pixel);
    radii[at] = rays[local + 3] * f32::from_bits(words[bundle + 10]);

    let mut u = rays[local];
    let mut v = rays[local + 1];
    let mut w = rays[local + 2];
    let mut a = 0.0f32;
    let mut b = 0.0f32;
    let mut c = 0.0f32;
    if words[bundle + 11] == 1u32 {
        let pose = 12 * usize::cast_from(view);
        let along_x = turned(poses, pose, u, v, w);
        let along_y = turned(poses, pose + 4, u, v, w);
        let along_z = turned(poses, pose + 8, u, v, w);
        u = along_x;
        v = along_y;
        w = along_z;
        a = poses[pose + 3];
        b = poses[pose + 7];
        c = poses[pose + 11];
    }
    #[unroll]
    for i in 0..3usize {
        let row = bundle + 12 + 4 * i;
        origins[3 * at + i] = turned_by_words(words, row, a, b, c) + f32::from_bits(words[row + 3]);
        directions[3 * at + i] = turned_by_words(words, row, u, v, w);
    }
    if at < colors.shape(0) {
        let image = 4 * (usize::cast_from(view * width * height) + pixel);
        #[unroll]
        for i in 0..3usize {
            colors[3 * at + i] = shown[image + i];
        }
        classes[at] = shown[image + 3];
    }
    first[3 * at] = words[bundle + 30];
    first[3 * at + 1] = words[bundle + 31];
    first[3 * at + 2] = ray;
    fine[3 * at] = words[bundle + 32];
    fine[3 * at + 1] = words[bundle + 33];
    fine[3 * at + 2] = ray;
}
