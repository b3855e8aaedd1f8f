//! Each fused operation against the same from plain tensor operations, on one device: time, and how far they differ.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail};
use burn::optim::{AdamConfig, Optimizer};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::adam::Adam;
use infonerf_ops::factored::{self, Layout, Query};
use infonerf_ops::mlp::{self, ColorBranch, Dense, Precision, RadianceMlp};
use infonerf_ops::{
    RayDistribution, Segments, composite::composite, composite::plain as plain_composite, divergence, entropy,
    frequency::encoded_width, frequency_encode, from_host, has_host_kernels, to_host,
};
use infonerf_report::chart::{Bar, Frame, bar_chart};
use serde::Serialize;

use super::context::Bench;
use super::options::Options;
use super::output::{TextTable, median};

/// Rays, and samples of the longest of them: about a step of the `fast` preset, of which rays hold 0 to 2 × the mean.
const RAYS: usize = 8192;
const LONGEST: usize = 36;
/// Repeats of each body, in turn; the median counts.
const REPEATS: u32 = 7;
/// Steps of Adam, enough for the allocation of its moments not to count.
const ADAM_STEPS: usize = 20;

/// NeRF's network, and as many samples as keep a measurement short.
const LAYERS: usize = 8;
const WIDTH: usize = 256;
const SKIP: usize = 5;
const FREQUENCIES: [usize; 2] = [10, 4];
const MLP_RAYS: usize = 128;
const MLP_SAMPLES: usize = 64;

const PROTOCOL: &str = "forward and backward of one operation at the size of a step of the fast preset, NeRF's MLP (8 x 256) \
                        on 128 rays of 64 samples; the two bodies in turn, \
                        medians; the difference is the largest in value or gradient over the largest number of the plain one. \
                        Adam is compared with Burn's own";

/// Value and gradients of a body, each flattened.
type Results = Vec<Tensor<1>>;

#[derive(Serialize)]
struct Row {
    operation: &'static str,
    plain_ms: f64,
    fused_ms: f64,
    faster: f64,
    difference: f64,
}

#[derive(Serialize)]
struct Report<'a> {
    rays: usize,
    samples: usize,
    rows: &'a [Row],
}

pub(super) fn run(bench: &Bench, options: &Options, say: &mut dyn FnMut(&str)) -> Result<()> {
    if !has_host_kernels(&bench.device) {
        bail!("bench ops: this device has the plain bodies only; expected --device flex");
    }
    let input = Input::new(&bench.device.clone().autodiff());
    let repeats = options.steps.unwrap_or(REPEATS).max(1) as usize;
    let rows = [
        compare("factored field", repeats, || input.field(true), || input.field(false)),
        compare("NeRF's MLP", repeats, || input.mlp(true), || input.mlp(false)),
        compare("compositing", repeats, || input.composite(true), || input.composite(false)),
        compare("ray entropy", repeats, || input.entropy(true), || input.entropy(false)),
        compare("ray divergence", repeats, || input.divergence(true), || input.divergence(false)),
        compare("total variation", repeats, || input.variation(true), || input.variation(false)),
        compare("Adam", repeats, || input.adam(true), || input.adam(false)),
    ];
    let mut table = TextTable::new(&["operation", "plain", "fused", "faster", "difference"]);
    for row in &rows {
        table.row(vec![
            row.operation.into(),
            format!("{:.2} ms", row.plain_ms),
            format!("{:.2} ms", row.fused_ms),
            format!("{:.1}x", row.faster),
            format!("{:.1e}", row.difference),
        ]);
    }
    let samples = input.segments.samples();
    say(&format!("\n{RAYS} rays, {samples} samples, forward and backward\n\n{}", table.to_text()));
    let bars = rows.iter().map(|row| Bar { label: row.operation.into(), value: row.faster, spread: None });
    let bars: Vec<Bar> = bars.collect();
    bench.save_chart("ops", &bar_chart(&Frame::new("Fused over plain", "", "times faster"), &bars)?)?;
    bench.save_csv("ops", &table)?;
    bench.save_results(PROTOCOL, &Report { rays: RAYS, samples: input.segments.samples(), rows: &rows })
}

fn compare(operation: &'static str, repeats: usize, fused: impl Fn() -> Results, plain: impl Fn() -> Results) -> Row {
    let difference = difference(fused(), plain());
    let timed = |body: &dyn Fn() -> Results| {
        let start = Instant::now();
        std::hint::black_box(body());
        1e3 * start.elapsed().as_secs_f64()
    };
    let (fused_ms, plain_ms): (Vec<f64>, Vec<f64>) = (0..repeats).map(|_| (timed(&fused), timed(&plain))).unzip();
    let (fused_ms, plain_ms) = (median(&fused_ms), median(&plain_ms));
    Row { operation, plain_ms, fused_ms, faster: plain_ms / fused_ms, difference }
}

/// The largest difference of any number over the largest of its array, over all arrays.
fn difference(a: Results, b: Results) -> f64 {
    let of = |(a, b): (Tensor<1>, Tensor<1>)| {
        let (a, b) = (to_host(a), to_host(b));
        let largest = b.iter().fold(0f32, |largest, b| largest.max(b.abs()));
        let apart = a.iter().zip(&b).fold(0f32, |most, (a, b)| most.max((a - b).abs()));
        if largest > 0.0 { f64::from(apart / largest) } else { f64::from(apart) }
    };
    a.into_iter().zip(b).map(of).fold(0.0, f64::max)
}

/// What the operations work on: a step of the `fast` preset, in random numbers.
struct Input {
    segments: Segments,
    tau: Tensor<1>,
    near: Tensor<1>,
    values: Tensor<2>,
    layout: Arc<Layout>,
    query: Query,
    tables: Tensor<1>,
    weights: Tensor<1>,
    encoded: Tensor<2>,
    network: RadianceMlp,
}

impl Input {
    fn new(device: &Device) -> Self {
        let numbers = |seed: u64, count: usize| -> Vec<f32> {
            let mut rng = fastrand::Rng::with_seed(seed);
            (0..count).map(|_| rng.f32()).collect()
        };
        let mut lengths = fastrand::Rng::with_seed(1);
        let segments = Segments::from_counts((0..RAYS).map(|_| lengths.usize(0..=LONGEST)));
        let samples = segments.samples();
        let levels = [32, 64, 128, 256].map(|resolution| (resolution, 4));
        let layout = Arc::new(Layout::new(3, &levels, (2, 32), true, (10.0, -5.0)));
        // Weights uniform in ±√(6 / inputs), as He et al. have them for ReLU networks.
        let dense = |seed: u64, [inputs, outputs]: [usize; 2]| {
            let bound = (6.0 / inputs as f32).sqrt();
            let values = numbers(seed, inputs * outputs).into_iter().map(|x| bound * (2.0 * x - 1.0)).collect();
            let weight = Tensor::<2>::from_data(TensorData::new::<f32, _>(values, [inputs, outputs]), device);
            Dense { weight, bias: Tensor::zeros([outputs], device) }
        };
        let [position, direction] = FREQUENCIES.map(|frequencies| encoded_width(3, frequencies));
        let trunk = (0..LAYERS).map(|layer| match layer {
            0 => [position, WIDTH],
            SKIP => [position + WIDTH, WIDTH],
            _ => [WIDTH, WIDTH],
        });
        let network = RadianceMlp {
            trunk: trunk.enumerate().map(|(layer, size)| dense(20 + layer as u64, size)).collect(),
            skip: SKIP,
            sigma: dense(10, [WIDTH, 1]),
            color: Some(ColorBranch {
                feature: dense(11, [WIDTH, WIDTH]),
                view: dense(12, [WIDTH + direction, WIDTH / 2]),
                rgb: dense(13, [WIDTH / 2, 3]),
                directions: from_host(&numbers(14, 3 * MLP_RAYS), 3, device),
                frequencies: FREQUENCIES[1],
                segments: Segments::uniform(MLP_RAYS, MLP_SAMPLES),
            }),
            precision: Precision::F32,
        };
        let centred = |values: Vec<f32>| values.into_iter().map(|x| x - 0.5).collect::<Vec<f32>>();
        let tensor = |values: Vec<f32>| {
            let length = values.len();
            Tensor::<1>::from_data(TensorData::new(values, [length]), device)
        };
        Self {
            tau: tensor(numbers(2, samples)),
            near: tensor(numbers(3, samples)),
            values: tensor(numbers(8, 4 * samples)).reshape([samples, 4]),
            query: Query {
                positions: from_host(&numbers(4, 3 * samples), 3, device),
                directions: Some(from_host(&centred(numbers(5, 3 * samples)), 3, device)),
                frequency_weights: vec![1.0; 3],
                level_weights: vec![1.0; 4],
                color: true,
                negligible: 0.0,
            },
            tables: tensor(centred(numbers(6, layout.table_len()))),
            weights: tensor(centred(numbers(7, layout.weight_len()))),
            layout,
            segments,
            encoded: frequency_encode(
                from_host(&numbers(9, 3 * MLP_RAYS * MLP_SAMPLES), 3, device),
                FREQUENCIES[0],
                &[],
            ),
            network,
        }
    }

    fn mlp(&self, fused: bool) -> Results {
        let mut parameters = Vec::new();
        let mut leaf = |dense: &Dense| {
            let dense = Dense { weight: parameter(&dense.weight), bias: parameter(&dense.bias) };
            parameters.push(dense.clone());
            dense
        };
        let network = RadianceMlp {
            trunk: self.network.trunk.iter().map(&mut leaf).collect(),
            sigma: leaf(&self.network.sigma),
            color: self.network.color.as_ref().map(|branch| ColorBranch {
                feature: leaf(&branch.feature),
                view: leaf(&branch.view),
                rgb: leaf(&branch.rgb),
                ..branch.clone()
            }),
            ..self.network.clone()
        };
        let body = if fused { mlp::radiance_mlp } else { mlp::plain };
        let out = body(self.encoded.clone(), &network);
        let grads = out.clone().sum().backward();
        let all = parameters.iter().flat_map(|dense| {
            let weight = dense.weight.grad(&grads).expect("each weight has a gradient").flatten(0, 1);
            [weight, dense.bias.grad(&grads).expect("each bias has a gradient")]
        });
        std::iter::once(out.inner().flatten(0, 1)).chain(all).collect()
    }

    fn field(&self, fused: bool) -> Results {
        let (tables, weights) = (parameter(&self.tables), parameter(&self.weights));
        let out = if fused {
            factored::factored_field(tables.clone(), weights.clone(), &self.layout, self.query.clone())
        } else {
            factored::plain(tables.clone(), weights.clone(), &self.layout, &self.query)
        };
        with_gradients(out, &[tables, weights])
    }

    fn composite(&self, fused: bool) -> Results {
        let (tau, values) = (parameter(&self.tau), parameter(&self.values));
        let body = if fused { composite } else { plain_composite };
        let out = body(tau.clone(), values.clone(), &self.segments);
        with_gradients(Tensor::cat(vec![out.values, out.acc.unsqueeze_dim::<2>(1)], 1), &[tau])
    }

    fn entropy(&self, fused: bool) -> Results {
        let tau = parameter(&self.tau);
        let body = if fused { entropy::ray_entropy } else { entropy::plain };
        with_gradients(body(tau.clone(), &self.segments, RayDistribution::Alpha, 1e-10).bits, &[tau])
    }

    fn divergence(&self, fused: bool) -> Results {
        let (tau, near) = (parameter(&self.tau), parameter(&self.near));
        let body = if fused { divergence::ray_divergence } else { divergence::plain };
        with_gradients(body(tau.clone(), near.clone(), &self.segments, 1e-10), &[tau, near])
    }

    fn variation(&self, fused: bool) -> Results {
        let tables = parameter(&self.tables);
        let out = if fused {
            factored::plane_variation(tables.clone(), &self.layout)
        } else {
            factored::plain_variation(tables.clone(), &self.layout)
        };
        with_gradients(out, &[tables])
    }

    /// Steps on the tables, with the tables' own values as gradient.
    fn adam(&self, fused: bool) -> Results {
        let start = self.tables.clone().inner();
        let end = if fused {
            steps(&Adam { beta2: 0.99, epsilon: 1e-10, ..Adam::default() }, start)
        } else {
            steps(&AdamConfig::new().with_beta_2(0.99).with_epsilon(1e-10).build(), start)
        };
        vec![end]
    }
}

/// The same numbers as a leaf of a new graph.
fn parameter<const D: usize>(values: &Tensor<D>) -> Tensor<D> {
    values.clone().detach().require_grad()
}

fn steps(optimiser: &impl Optimizer, start: Tensor<1>) -> Tensor<1> {
    let (mut weights, mut state) = (start.clone(), None);
    for _ in 0..ADAM_STEPS {
        (weights, state) = optimiser.step(1e-2, weights, start.clone(), state);
    }
    weights
}

/// A value, and the gradient of half its sum of squares with respect to each of `inputs`.
fn with_gradients<const D: usize>(out: Tensor<D>, inputs: &[Tensor<1>]) -> Results {
    let mut grads = (out.clone() * out.clone().detach()).sum().backward();
    let gradients = inputs.iter().filter_map(|input| input.grad_remove(&mut grads));
    std::iter::once(out.flatten::<1>(0, D - 1)).chain(gradients).collect()
}
