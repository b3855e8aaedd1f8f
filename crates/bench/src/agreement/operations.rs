use std::sync::Arc;

use burn::optim::Optimizer;
use burn::tensor::Tensor;
use fastrand::Rng;
use infonerf_ops::adam::{Adam, finite_after, step_if};
use infonerf_ops::factored::{FactoredLayout, Query, factored_field, plane_variation};
use infonerf_ops::means::{mask_above, mean_squared_difference, weighted_sum};
use infonerf_ops::random::Stream;
use infonerf_ops::sampling::march::{Cells, MarchSettings, MarchedRays, march};
use infonerf_ops::sampling::{
    LastInterval, PackedSamples, Placement, RaySamples, Streams, importance, intervals, points_on_rays, resample,
    stratified,
};
use infonerf_ops::{
    Segments, composite, composite_over, frequency_encode, integrated_encode, ray_divergence, ray_entropy, to_host,
    to_host_together, upload_rows,
};

use super::comparison::{DeviceComparisons, value_and_gradients};
use crate::values::{joined, leaf, uniform};

/// Maximum error of sines and cosines of phases up to 3·2¹⁶.
const ENCODING: f64 = 1e-6;
/// Maximum error of distances: in bins of almost no weight, rounding of the cumulative sum decides where a sample is.
const DISTANCE: f64 = 1e-3;

/// Function that compares a group of operations, with inputs from `rng`.
pub(super) type Group = fn(&mut Rng, &mut DeviceComparisons<'_>);

pub(super) const GROUPS: [Group; 8] = [along_rays, factored, placing, losses, encodings, padded, adam, marching];

/// Compares compositing, entropy and divergence on rays of any number of samples, from almost transparent to opaque ones.
fn along_rays(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 300;
    let segments = Segments::from_counts((0..RAYS).map(|_| rng.usize(0..40)));
    let mut draw = || -> Vec<f32> { uniform(rng, segments.samples(), -14.0, 3.0).into_iter().map(f32::exp).collect() };
    let (tau, near) = (draw(), draw());
    let values = uniform(rng, 4 * tau.len(), 0.0, 1.0);
    compare.operation("compositing", |device| {
        let (tau, values) = (leaf(&tau, device), leaf(&values, device));
        let out = composite(tau.clone(), values.clone().reshape([-1, 4]), &segments);
        value_and_gradients(Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1)], 1), &[&tau, &values])
    });
    let (color, distances) = (uniform(rng, 3 * tau.len(), 0.0, 1.0), uniform(rng, tau.len(), 1.0, 5.0));
    compare.operation("compositing over a background", |device| {
        let [tau, color, distances] = [&tau, &color, &distances].map(|input| leaf(input, device));
        let out = composite_over(tau.clone(), Some(rows(&color)), distances, [0.2, 0.5, 1.0], &segments);
        let color_out = out.color.expect("colours were given").flatten::<1>(0, 1);
        value_and_gradients(Tensor::cat(vec![color_out, out.depth, out.acc], 0), &[&tau, &color])
    });
    for epsilon in [0.0, 1e-10] {
        compare.operation(&format!("entropy, epsilon {epsilon:e}"), |device| {
            let tau = leaf(&tau, device);
            let out = ray_entropy(tau.clone(), &segments, epsilon);
            value_and_gradients(Tensor::cat(vec![out.bits, out.alpha_sum], 0), &[&tau])
        });
    }
    compare.operation("divergence", |device| {
        let (tau, near) = (leaf(&tau, device), leaf(&near, device));
        value_and_gradients(ray_divergence(tau.clone(), near.clone(), &segments, 1e-10), &[&tau, &near])
    });
}

/// Compares sample rules, with and without jitter, and points on rays, for a number of rays that no workgroup size divides.
fn placing(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 301;
    const SAMPLES: usize = 21;
    const FINE: usize = 34;
    let ends: Vec<f32> = (0..RAYS).flat_map(|_| [1.0 + rng.f32(), 3.0 + rng.f32()]).collect();
    let streams: Vec<Stream> = (0..RAYS).map(|_| Stream { key: rng.u64(..), item: rng.u32(..) as usize }).collect();
    // No sample is opaque: behind one, a bin's probability is 1e-5 up to rounding, where NeRF's rule is discontinuous.
    let tau: Vec<f32> = uniform(rng, RAYS * SAMPLES, -14.0, -3.0).into_iter().map(f32::exp).collect();
    for rule in Placement::ALL {
        for jittered in [true, false] {
            let kind = if jittered { "jittered" } else { "even" };
            compare.within(DISTANCE, &format!("samples {rule:?}, {kind}"), |device| {
                let ends = upload_rows(&ends, 2, device);
                let tau = Tensor::from_floats(tau.as_slice(), device);
                let streams = Streams::new(streams.iter().copied(), device);
                let jitter = Some(&streams).filter(|_| jittered);
                let t = stratified(ends.clone(), [RAYS, SAMPLES], rule, jitter);
                let fine = match rule {
                    Placement::Interval => resample(t.clone(), tau, FINE, jitter),
                    _ => importance(t.clone(), tau, FINE, jitter),
                };
                let [distance, length] = intervals(t.clone(), ends, rule, LastInterval::Finite);
                vec![to_host_together([t.flatten(0, 1), fine.flatten(0, 1), distance, length])]
            });
        }
    }
    let segments = Segments::from_counts((0..RAYS).map(|_| rng.usize(0..9)));
    let rays = [0, 1].map(|_| uniform(rng, 3 * RAYS, -1.0, 1.0));
    let t = uniform(rng, segments.samples(), 1.0, 5.0);
    compare.operation("points on rays", |device| {
        let [origins, directions] = rays.each_ref().map(|values| leaf(values, device));
        let out = points_on_rays(rows(&origins), rows(&directions), leaf(&t, device), &segments);
        value_and_gradients(out, &[&origins, &directions])
    });
}

/// Compares marches through a partly empty grid, with gradients of losses at their samples.
fn marching(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 301;
    const CELLS: usize = 7;
    let origins = uniform(rng, 3 * RAYS, 1.5, 2.5);
    let towards: Vec<f32> = origins.iter().map(|o| rng.f32() - 0.5 - o).collect();
    let unit = |v: &[f32; 3]| v.map(|x| x / v.iter().map(|x| x * x).sum::<f32>().sqrt());
    let directions: Vec<f32> = towards.as_chunks().0.iter().flat_map(unit).collect();
    // One ray in ten misses the grid.
    let ends: Vec<f32> =
        (0..RAYS).flat_map(|ray| if ray % 10 == 3 { [0.0; 2] } else { [1.0, 3.0 + 2.0 * rng.f32()] }).collect();
    let streams: Vec<Stream> = (0..RAYS).map(|_| Stream { key: rng.u64(..), item: rng.u32(..) as usize }).collect();
    let density: Vec<f32> = (0..CELLS.pow(3)).map(|_| if rng.f32() < 0.4 { -1.0 } else { 9.0 * rng.f32() }).collect();
    for (name, hidden_depth, jittered) in [("", 6.0, true), (", evenly and to the end", f32::INFINITY, false)] {
        compare.operation(&format!("marching{name}"), |device| {
            let plain = device.clone().inner();
            let settings = MarchSettings { step: 0.1, hidden_depth };
            // On the host, rays march cell by cell.
            let walk = |ray: usize, samples: &mut RaySamples| {
                let [near, far] = [ends[2 * ray], ends[2 * ray + 1]];
                if near >= far {
                    return;
                }
                let count = ((far - near) / settings.step).ceil().max(1.0);
                let length = (far - near) / count;
                let shift = if jittered { streams[ray].uniform(0) } else { 0.5 };
                let mut depth = 0.0;
                for i in 0..count as usize {
                    let t = near + (i as f32 + shift) * length;
                    let p: [f32; 3] = std::array::from_fn(|i| origins[3 * ray + i] + t * directions[3 * ray + i]);
                    let cell = p.map(|x| ((x + 1.0) * 3.5).floor());
                    let is_inside = cell.iter().all(|c| (0.0..CELLS as f32).contains(c));
                    let [x, y, z] = cell.map(|c| c as usize);
                    let found = if is_inside { density[x + CELLS * (y + CELLS * z)] } else { 0.0 };
                    if found >= 0.0 && depth < hidden_depth {
                        depth += found * length;
                        samples.push(t, length, p);
                    }
                }
            };
            let on_gpu = || {
                let [origins, directions] = [&origins, &directions].map(|values| upload_rows(values, 3, &plain));
                let jitter = jittered.then(|| Streams::new(streams.iter().copied(), &plain));
                let density = Tensor::from_floats(density.as_slice(), &plain);
                let cells = Cells { density, resolution: CELLS, corner: [-1.0; 3], per_unit: [3.5; 3] };
                Some((MarchedRays { origins, directions, ends: upload_rows(&ends, 2, &plain), jitter }, Some(cells)))
            };
            let PackedSamples { segments, distance, delta, positions, .. } =
                march(RAYS, &plain, settings, walk, on_gpu);
            let tau = leaf(&to_host(distance.clone() * delta.clone() * 3.0), device);
            let color = (positions.clone() * 0.1 + 0.5).autodiff();
            let seen = composite_over(tau.clone(), Some(color), distance.clone(), [0.2, 0.5, 1.0], &segments);
            let bits = ray_entropy(tau.clone(), &segments, 0.0).bits;
            let color = seen.color.expect("colours were given").flatten(0, 1);
            let mut answers = value_and_gradients(Tensor::cat(vec![color, seen.acc, bits], 0), &[&tau]);
            answers.push(to_host_together([distance, delta, positions.flatten(0, 1)]));
            answers
        });
    }
}

fn losses(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    let [a, b] = [0, 1].map(|_| uniform(rng, 3000, 0.0, 1.0));
    compare.operation("squared differences and masked sums", |device| {
        let [a, b] = [&a, &b].map(|input| leaf(input, device));
        let [mean, sum] = [mean_squared_difference(rows(&a), rows(&b)), mask_above(a.clone(), b, 0.3).sum()];
        let both = weighted_sum(vec![(mean.clone(), 700.0), (sum.clone(), -0.5), (mean.clone(), 3.0)]);
        value_and_gradients(Tensor::cat(vec![mean, sum, both.expect("there are terms")], 0), &[&a])
    });
}

fn factored(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const SAMPLES: usize = 700;
    let layout = Arc::new(FactoredLayout::new(3, &[(8, 4), (16, 4)], (2, 32), true, (10.0, -5.0)));
    let tables = uniform(rng, layout.table_len(), -0.5, 0.5);
    let weights = uniform(rng, layout.weight_len(), -0.4, 0.4);
    let positions = uniform(rng, 3 * SAMPLES, 0.0, 1.0);
    let directions = uniform(rng, 3 * SAMPLES, -0.5, 0.5);
    for color in [true, false] {
        let name = if color { "factored field" } else { "factored field, density alone" };
        compare.operation(name, |device| {
            let [tables, weights, positions] = [&tables, &weights, &positions].map(|input| leaf(input, device));
            let query = Query {
                positions: rows(&positions),
                directions: Some(upload_rows(&directions, 3, device)),
                frequency_weights: vec![1.0, 1.0, 0.5],
                level_weights: vec![1.0, 0.5],
                color,
                negligible: 0.0,
            };
            let out = joined(factored_field(tables.clone(), weights.clone(), &layout, query));
            value_and_gradients(out, &[&tables, &weights, &positions])
        });
    }
    compare.operation("plane variation", |device| {
        let tables = leaf(&tables, device);
        value_and_gradients(plane_variation(tables.clone(), &layout), &[&tables])
    });
}

/// Compares encodings, one of them at more points than one dimension of a GPU's grid has workgroups.
fn encodings(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const MANY: usize = 1_500_000;
    const SHOWN: usize = 1000;
    const WINDOW: [f32; 4] = [1.0, 1.0, 0.5, 0.0];
    let points = uniform(rng, 3 * 500, -3.0, 3.0);
    let variances: Vec<f32> = uniform(rng, points.len(), -25.0, 0.0).into_iter().map(f32::exp).collect();
    let many = uniform(rng, 3 * MANY, -1.0, 1.0);
    for frequencies in [0, 1, 17] {
        compare.within(ENCODING, &format!("frequency encoding, {frequencies} octaves"), |device| {
            let points = leaf(&points, device);
            value_and_gradients(frequency_encode(rows(&points), frequencies, &WINDOW), &[&points])
        });
        // Without frequencies the integrated encoding is empty.
        if frequencies > 0 {
            compare.within(ENCODING, &format!("integrated encoding, {frequencies} octaves"), |device| {
                let (means, variances) = (leaf(&points, device), leaf(&variances, device));
                let out = integrated_encode(rows(&means), rows(&variances), frequencies, &WINDOW);
                value_and_gradients(out, &[&means, &variances])
            });
        }
    }
    compare.within(ENCODING, "frequency encoding of 1.5 million points", |device| {
        let points = upload_rows(&many, 3, device);
        vec![to_host(frequency_encode(points, 1, &[]).narrow(0, MANY - SHOWN, SHOWN))]
    });
}

fn rows(points: &Tensor<1>) -> Tensor<2> {
    points.clone().reshape([-1, 3])
}

/// Compares compositing of rows with padding between them, as CUDA lays them out; columns that are cut off pad the gradient.
fn padded(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const BETWEEN: usize = 64;
    const CHANNELS: usize = 3;
    let segments = Segments::from_counts((0..100).map(|_| rng.usize(0..20)));
    let tau = uniform(rng, segments.samples(), 0.0, 1.0);
    let values = uniform(rng, tau.len() * (CHANNELS + BETWEEN), 0.0, 1.0);
    compare.operation("compositing of padded rows", |device| {
        let (tau, values) = (leaf(&tau, device), leaf(&values, device));
        let cut = values.clone().reshape([-1, (CHANNELS + BETWEEN) as i32]).narrow(1, 0, CHANNELS);
        let out = composite(tau.clone(), cut, &segments);
        let padding = Tensor::zeros([segments.rays(), BETWEEN], &out.acc.device());
        value_and_gradients(Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1), padding], 1), &[&tau, &values])
    });
}

fn adam(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    let (start, factors) = (uniform(rng, 3 * 500, -1.0, 1.0), uniform(rng, 3 * 500, 0.0, 1.0));
    compare.operation("Adam", |device| {
        let factors = upload_rows(&factors, 3, device);
        let (mut x, mut state) = (upload_rows(&start, 3, device), None);
        let mut finite = None;
        // The last two steps are skipped.
        for loss in [1.0, -f32::MAX, 0.0, 1.0, 2.0, f32::NAN, 1.0] {
            let gradient = x.clone() * factors.clone();
            let flag = finite_after(finite, Tensor::from_floats([loss], device));
            let step = |(x, state)| Adam::default().step(1e-2, x, gradient, state);
            (x, state) = step_if(flag.clone(), (x, state), step);
            finite = Some(flag);
        }
        let infinite = finite_after(None, Tensor::from_floats([f32::NEG_INFINITY], device));
        vec![to_host(x), to_host(infinite)]
    });
}
