//! Operations of infonerf-ops.

use std::sync::Arc;

use burn::optim::Optimizer;
use burn::tensor::Tensor;
use fastrand::Rng;
use infonerf_ops::adam::{Adam, finite_after, step_if};
use infonerf_ops::drawing::{DrawnViews, PixelDraw, PixelTables, draw_rays};
use infonerf_ops::factored::{Layout, Query, factored_field, plane_variation};
use infonerf_ops::means::{mean_squared_difference, sum_above, weighted_sum};
use infonerf_ops::random::Stream;
use infonerf_ops::sampling::march::{Cells, March, Marched, Reach, march};
use infonerf_ops::sampling::{
    LastInterval, Placement, Streams, importance, intervals, points_on_rays, resample, stratified,
};
use infonerf_ops::{
    Intervals, RayDistribution, Segments, additive_depth, composite, composite_over, frequency_encode, from_host,
    integrated_encode, ray_distortion, ray_divergence, ray_entropy, split_rows, to_host, to_host_together,
};

use super::comparison::{DeviceComparisons, leaf, pulled, uniform};

/// Maximum error of sines and cosines of phases up to 3·2¹⁶.
const ENCODING: f64 = 1e-6;
/// Maximum error of distances: in bins of almost no weight, the last digits of the cumulative sum place a sample.
const DISTANCE: f64 = 1e-3;

/// Compares operations that need inputs from `rng`.
pub(super) type Group = fn(&mut Rng, &mut DeviceComparisons<'_>);

/// Groups of all operations but networks.
pub(super) const GROUPS: [Group; 9] =
    [along_rays, factored, placing, losses, encodings, padded, adam, drawing, marching];

/// Compares compositing, entropies and divergence on rays of all lengths, some of them empty, with optical depths from almost
/// nothing to opaque.
fn along_rays(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 300;
    let segments = Segments::from_counts((0..RAYS).map(|_| rng.usize(0..40)));
    let mut depths =
        || -> Vec<f32> { uniform(rng, segments.samples(), -14.0, 3.0).into_iter().map(f32::exp).collect() };
    let (tau, near) = (depths(), depths());
    let values = uniform(rng, 4 * tau.len(), 0.0, 1.0);
    compare.operation("compositing", |device| {
        let (tau, values) = (leaf(&tau, device), leaf(&values, device));
        let out = composite(tau.clone(), values.clone().reshape([-1, 4]), &segments);
        pulled(Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1)], 1), &[&tau, &values])
    });
    let (color, distances) = (uniform(rng, 3 * tau.len(), 0.0, 1.0), uniform(rng, tau.len(), 1.0, 5.0));
    compare.operation("compositing over a background", |device| {
        let [tau, color, distances] = [&tau, &color, &distances].map(|input| leaf(input, device));
        let out = composite_over(tau.clone(), Some(rows(&color)), distances, [0.2, 0.5, 1.0], &segments);
        let color_out = out.color.expect("colours were given").flatten::<1>(0, 1);
        pulled(Tensor::cat(vec![color_out, out.depth, out.acc], 0), &[&tau, &color])
    });
    for of in [RayDistribution::Alpha, RayDistribution::AlphaBackground, RayDistribution::Termination] {
        for epsilon in [0.0, 1e-10] {
            compare.operation(&format!("entropy of {of:?}, epsilon {epsilon:e}"), |device| {
                let tau = leaf(&tau, device);
                let out = ray_entropy(tau.clone(), &segments, of, epsilon);
                pulled(Tensor::cat(vec![out.bits, out.alpha_sum], 0), &[&tau])
            });
        }
    }
    let (middle, length) = (uniform(rng, tau.len(), 0.0, 1.0), uniform(rng, tau.len(), 0.0, 0.1));
    compare.operation("distortion", |device| {
        let [tau, middle, length] = [&tau, &middle, &length].map(|input| leaf(input, device));
        let intervals = Intervals { middle: middle.clone(), length: length.clone() };
        pulled(ray_distortion(tau.clone(), intervals, &segments), &[&tau, &middle, &length])
    });
    compare.operation("entropy of parts of a bundle", |device| {
        const COUNTS: [usize; 3] = [101, 150, RAYS - 251];
        let tau = leaf(&tau, device);
        let bits = |tau, segments: &Segments| ray_entropy(tau, segments, RayDistribution::Alpha, 0.0).bits;
        // Parts share the transfers of the whole.
        let mut out = vec![bits(tau.clone(), &segments)];
        let parts = segments.split(&COUNTS);
        let sizes: Vec<usize> = parts.iter().map(Segments::samples).collect();
        out.extend(split_rows(tau.clone(), &sizes).into_iter().zip(&parts).map(|(tau, part)| bits(tau, part)));
        pulled(Tensor::cat(out, 0), &[&tau])
    });
    compare.operation("divergence", |device| {
        let (tau, near) = (leaf(&tau, device), leaf(&near, device));
        pulled(ray_divergence(tau.clone(), near.clone(), &segments, 1e-10), &[&tau, &near])
    });
}

/// Compares sample placement, with and without jitter, and points on rays, for a number of rays that no workgroup divides.
fn placing(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 301;
    const SAMPLES: usize = 21;
    const FINE: usize = 34;
    let ends: Vec<f32> = (0..RAYS).flat_map(|_| [1.0 + rng.f32(), 3.0 + rng.f32()]).collect();
    let streams: Vec<Stream> = (0..RAYS).map(|_| Stream { key: rng.u64(..), item: rng.u32(..) as usize }).collect();
    let tau: Vec<f32> = uniform(rng, RAYS * SAMPLES, -14.0, 3.0).into_iter().map(f32::exp).collect();
    for placement in [Placement::Left, Placement::Mid, Placement::Interval] {
        for jittered in [true, false] {
            let kind = if jittered { "jittered" } else { "even" };
            compare.within(DISTANCE, &format!("samples {placement:?}, {kind}"), |device| {
                let ends = from_host(&ends, 2, device);
                let tau = Tensor::from_floats(tau.as_slice(), device);
                let streams = Streams(Tensor::from_floats(Streams::bits(streams.iter().copied()).as_slice(), device));
                let jitter = Some(&streams).filter(|_| jittered);
                let t = stratified(ends.clone(), [RAYS, SAMPLES], placement, jitter);
                let fine = match placement {
                    Placement::Interval => resample(t.clone(), tau, FINE, jitter),
                    _ => importance(t.clone(), tau, FINE, jitter),
                };
                let [distance, length] = intervals(t.clone(), ends, placement, LastInterval::Finite);
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
        pulled(out, &[&origins, &directions])
    });
}

/// Compares rays drawn for bundles of all views and of one, and the random values that jitter samples along them.
fn drawing(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const WIDTH: usize = 23;
    const HEIGHT: usize = 17;
    const VIEWS: usize = 3;
    let rays = uniform(rng, 4 * WIDTH * HEIGHT, -1.0, 1.0);
    let (poses, colors) = (uniform(rng, 12 * VIEWS, -1.0, 1.0), uniform(rng, 4 * VIEWS * WIDTH * HEIGHT, 0.0, 1.0));
    let bundle = PixelDraw {
        rays: 301,
        views: DrawnViews::All { count: VIEWS, key: rng.u64(..) },
        keys: [rng.u64(..), rng.u64(..)],
        columns: [3, 19],
        rows: [1, 15],
        first: 0,
        size: [WIDTH, HEIGHT],
        widening: 2.0,
        motion: std::array::from_fn(|_| rng.f32()),
        has_poses: true,
        streams: [rng.u64(..), rng.u64(..)],
    };
    let one = PixelDraw { views: DrawnViews::One(2), rays: 150, has_poses: false, ..bundle };
    let bundles = [bundle, one, PixelDraw { views: DrawnViews::One(1), keys: [rng.u64(..); 2], ..one }];
    compare.operation("rays of drawn pixels", |device| {
        let tables = PixelTables {
            rays: from_host(&rays, 4, device),
            poses: from_host(&poses, 12, device),
            shown: from_host(&colors, 4, device),
        };
        let drawn = draw_rays(&tables, &bundles);
        let ends = from_host(&[2.0, 6.0], 2, device);
        let jittered =
            drawn.streams.each_ref().map(|streams| stratified(ends.clone(), [601, 2], Placement::Mid, Some(streams)));
        let rows = [drawn.origins, drawn.directions, drawn.colors].into_iter().chain(jittered);
        vec![to_host_together(rows.map(|rows| rows.flatten(0, 1)).chain([drawn.radii, drawn.classes]))]
    });
}

/// Compares marches through a partly empty grid, with gradients of losses of their samples; the capacity is more than enough, or not
/// enough.
fn marching(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const RAYS: usize = 301;
    const CELLS: usize = 7;
    let origins = uniform(rng, 3 * RAYS, 1.5, 2.5);
    let towards: Vec<f32> = origins.iter().map(|o| rng.f32() - 0.5 - o).collect();
    let unit = |v: &[f32; 3]| v.map(|x| x / v.iter().map(|x| x * x).sum::<f32>().sqrt());
    let directions: Vec<f32> = towards.as_chunks().0.iter().flat_map(unit).collect();
    let streams: Vec<Stream> = (0..RAYS).map(|_| Stream { key: rng.u64(..), item: rng.u32(..) as usize }).collect();
    let density: Vec<f32> = (0..CELLS.pow(3)).map(|_| if rng.f32() < 0.4 { -1.0 } else { 9.0 * rng.f32() }).collect();
    let base = March {
        reach: Reach::Distances { near: 1.0, far: 5.0 },
        bounds: Some([[-1.0; 3], [1.0, 1.1, 0.9]]),
        step: 0.1,
        jittered: true,
        hidden_depth: 6.0,
        capacity: 9000,
    };
    let sphere = Reach::Sphere { centre: [0.1, 0.0, -0.1], radius: 0.9 };
    let all = [
        ("", base),
        (", less capacity", March { capacity: 1001, ..base }),
        (", a sphere", March { reach: sphere, bounds: None, jittered: false, hidden_depth: f32::INFINITY, ..base }),
    ];
    for (name, marching) in all {
        compare.operation(&format!("marching{name}"), |device| {
            let plain = device.clone().inner();
            let rays = [&origins, &directions].map(|values| from_host(values, 3, &plain));
            let streams = Streams(Tensor::from_floats(Streams::bits(streams.iter().copied()).as_slice(), &plain));
            let density = Tensor::from_floats(density.as_slice(), &plain);
            let cells = Cells { density, resolution: CELLS, corner: [-1.0; 3], per_unit: [3.5; 3] };
            let Marched { segments, distance, delta, positions } = march(rays, &streams, Some(&cells), &marching);
            let tau = leaf(&to_host(distance.clone() * delta.clone() * 3.0), device);
            let color = (positions.clone() * 0.1 + 0.5).autodiff();
            let seen = composite_over(tau.clone(), Some(color), distance.clone(), [0.2, 0.5, 1.0], &segments);
            let bits = ray_entropy(tau.clone(), &segments, RayDistribution::Alpha, 0.0).bits;
            // Plain tensor bodies need the offsets.
            let intervals = Intervals { middle: distance.clone(), length: delta.clone() };
            let distortion = ray_distortion(tau.clone(), intervals, &segments);
            let depths = additive_depth(tau.clone() * 0.02, &segments);
            let color = seen.color.expect("colours were given").flatten(0, 1);
            let out = Tensor::cat(vec![color, seen.acc, bits, distortion, depths], 0);
            let mut answers = pulled(out, &[&tau]);
            answers.push(to_host_together([distance, delta, positions.flatten(0, 1)]));
            answers
        });
    }
}

/// Compares the sums that make losses.
fn losses(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    let [a, b] = [0, 1].map(|_| uniform(rng, 3000, 0.0, 1.0));
    compare.operation("squared differences and masked sums", |device| {
        let [a, b] = [&a, &b].map(|input| leaf(input, device));
        let [mean, sum] = [mean_squared_difference(rows(&a), rows(&b)), sum_above(a.clone(), b, 0.3)];
        let both = weighted_sum(vec![(mean.clone(), 700.0), (sum.clone(), -0.5), (mean.clone(), 3.0)]);
        pulled(Tensor::cat(vec![mean, sum, both.expect("there are terms")], 0), &[&a])
    });
}

/// Compares a factored field, and the variation of its planes.
fn factored(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    const SAMPLES: usize = 700;
    let layout = Arc::new(Layout::new(3, &[(8, 4), (16, 4)], (2, 32), true, (10.0, -5.0)));
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
                directions: Some(from_host(&directions, 3, device)),
                frequency_weights: vec![1.0, 1.0, 0.5],
                level_weights: vec![1.0, 0.5],
                color,
                negligible: 0.0,
            };
            let out = factored_field(tables.clone(), weights.clone(), &layout, query);
            pulled(out, &[&tables, &weights, &positions])
        });
    }
    compare.operation("plane variation", |device| {
        let tables = leaf(&tables, device);
        pulled(plane_variation(tables.clone(), &layout), &[&tables])
    });
}

/// Compares encodings, one of more points than one dimension of a GPU's grid has workgroups.
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
            pulled(frequency_encode(rows(&points), frequencies, &WINDOW), &[&points])
        });
        // Without frequencies the integrated encoding is empty.
        if frequencies > 0 {
            compare.within(ENCODING, &format!("integrated encoding, {frequencies} octaves"), |device| {
                let (means, variances) = (leaf(&points, device), leaf(&variances, device));
                pulled(integrated_encode(rows(&means), rows(&variances), frequencies, &WINDOW), &[&means, &variances])
            });
        }
    }
    compare.within(ENCODING, "frequency encoding of 1.5 million points", |device| {
        let points = from_host(&many, 3, device);
        vec![to_host(frequency_encode(points, 1, &[]).narrow(0, MANY - SHOWN, SHOWN))]
    });
}

/// Reshapes points, three values each.
fn rows(points: &Tensor<1>) -> Tensor<2> {
    points.clone().reshape([-1, 3])
}

/// Compares compositing of rows with padding between them in memory, as CUDA lays them out; the columns that are cut off pad the gradient,
/// too.
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
        pulled(Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1), padding], 1), &[&tau, &values])
    });
}

/// Compares steps of Adam on a matrix, with changing gradients.
fn adam(rng: &mut Rng, compare: &mut DeviceComparisons<'_>) {
    let (start, factors) = (uniform(rng, 3 * 500, -1.0, 1.0), uniform(rng, 3 * 500, 0.0, 1.0));
    compare.operation("Adam", |device| {
        let factors = from_host(&factors, 3, device);
        let (mut x, mut state) = (from_host(&start, 3, device), None);
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
