//! Renders for the tests of terms, and a check of a term against its formula in `f64`.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor};
use infonerf_ops::means::mean_squared_difference;
use infonerf_ops::{Segments, composite, to_host, upload};
use infonerf_render::{Passes, RenderOutput, Samples};

use crate::objective::LossConfig;
use crate::renders::{Renders, Target};
use crate::term::Term;

/// Returns the config of every term, all off, with `settings` (TOML) merged in.
pub fn config(settings: &str) -> LossConfig {
    let mut table: toml::Table = "
        rgb = { weight = 0, norm = 'mean', coarse = 1 }
        entropy = { weight = 0, rays = 'all', neighbours = false, epsilon = 1e-10, \
                    mask = { rule = 'acc', threshold = 0.1 } }
        kl = { weight = 0, direction = 'paper', rays = 'all', epsilon = 1e-10 }
        semantic = { weight = 0, every = 10, size = 64, weights = '' }
        stereo = { weight = 0 }
        opacity_prior = { weight = 0, rays = 'seen' }
        silhouette = { weight = 0 }
        tv = { weight = 0, views = 0 }
        latent = { weight = 0 }
    "
    .parse()
    .unwrap();
    for (name, term) in settings.parse::<toml::Table>().unwrap() {
        table[&name].as_table_mut().unwrap().extend(term.as_table().unwrap().clone());
    }
    table.try_into().unwrap()
}

/// Optical depths along the rays of each bundle: seen, unseen, neighbours of seen and of unseen ones, and the coarse pass of
/// seen ones. Rays without samples, thin and opaque ones are among them.
pub type Depths<T> = [Vec<Vec<T>>; 5];

/// Indices into [`Depths`].
pub const SEEN: usize = 0;
pub const UNSEEN: usize = 1;
pub const NEAR_SEEN: usize = 2;
pub const NEAR_UNSEEN: usize = 3;
pub const COARSE: usize = 4;

fn depths() -> Depths<f32> {
    let seen = vec![vec![0.3, 1.2, 0.7], vec![], vec![2.0, 0.1], vec![0.01, 0.02]];
    let unseen = vec![vec![0.9], vec![0.5, 3.0, 0.2, 0.4]];
    let turned = |ray: &Vec<f32>| ray.iter().rev().map(|tau| 0.8 * tau + 0.05).collect();
    let near = |rays: &[Vec<f32>]| rays.iter().map(turned).collect();
    let coarse = vec![vec![1.0, 0.2], vec![0.4], vec![0.6, 0.6], vec![0.3]];
    [seen.clone(), unseen.clone(), near(&seen), near(&unseen), coarse]
}

/// Colour of sample `i` of any ray.
pub fn color(i: usize) -> [f64; 3] {
    [0.2 * i as f64, 0.5, 1.0 - 0.1 * i as f64]
}

/// Colours of the training pixels.
pub const PIXELS: [[f64; 3]; 4] = [[0.1, 0.9, 0.4], [0.0, 0.0, 0.2], [1.0, 0.3, 0.5], [0.7, 0.2, 0.0]];

/// Returns optical depths and the output of `rays`, whose sample `i` lies between the distances `i` and `i + 1`.
fn output(rays: &[Vec<f32>], device: &Device) -> (Tensor<1>, RenderOutput) {
    let segments = Segments::from_counts(rays.iter().map(Vec::len));
    let count = segments.samples();
    let tau = upload(rays.concat(), [count], device);
    let tau = if device.is_autodiff() { tau.require_grad() } else { tau };
    let places = || rays.iter().flat_map(|ray| 0..ray.len());
    let colors: Vec<f32> = places().flat_map(color).map(|c| c as f32).collect();
    let t: Vec<f32> = places().map(|i| i as f32 + 0.5).collect();
    let seen = composite(tau.clone(), upload(colors, [count, 3], device), &segments);
    let depth = Tensor::zeros([rays.len()], device);
    let samples = Samples::new(segments, upload(t, [count], device), Tensor::ones([count], device), count);
    let (color, acc) = (Some(seen.values), seen.acc);
    (tau.clone(), RenderOutput { samples, tau, color, depth, acc, background: [0.0; 3] })
}

/// Returns the tensors of [`depths`], and the renders that depend on them.
pub fn scenario(device: &Device) -> ([Tensor<1>; 5], Renders) {
    let [seen, unseen, near_seen, near_unseen, coarse] = depths().map(|rays| output(&rays, device));
    let rays = PIXELS.len();
    let on_host = PIXELS.map(|pixel| pixel.map(|c| c as f32)).to_vec();
    let pixels = vec![infonerf_scene::PixelAt { view: 0, x: 0.5, y: 0.5 }; rays];
    let target = Target { rgb: upload(on_host.concat(), [rays, 3], device), on_host, pixels, background: [1.0; 3] };
    let seen_color = seen.1.color.clone().unwrap();
    let renders = Renders {
        squared_error: Some(mean_squared_difference(seen_color, target.rgb.clone())),
        seen: Passes { coarse: Some(coarse.1), fine: seen.1 },
        target,
        unseen: Some(unseen.1),
        seen_neighbours: Some(near_seen.1),
        unseen_neighbours: Some(near_unseen.1),
        picture: None,
        penalties: BTreeMap::new(),
    };
    ([seen.0, unseen.0, near_seen.0, near_unseen.0, coarse.0], renders)
}

/// Checks the value of `term`, and its gradient with respect to every optical depth, against `formula` and its differences.
pub fn check(term: &dyn Term, formula: impl Fn(&Depths<f64>) -> f64) {
    check_with(term, |_| (), formula);
}

/// Checks `term` as [`check`] does, on renders after `set_up`.
pub fn check_with(term: &dyn Term, set_up: impl Fn(&mut Renders), formula: impl Fn(&Depths<f64>) -> f64) {
    let (tau, mut renders) = scenario(&Device::flex().autodiff());
    set_up(&mut renders);
    let value = term.value(&renders);
    let gradients = value.backward();
    let mut depths =
        depths().map(|rays| rays.into_iter().map(|ray| ray.into_iter().map(f64::from).collect()).collect());
    let want = formula(&depths);
    approx::assert_abs_diff_eq!(f64::from(value.into_scalar::<f32>()), want, epsilon = 2e-6 * (1.0 + want.abs()));
    for (bundle, tau) in tau.into_iter().enumerate() {
        let mut got = tau.grad(&gradients).map(to_host).unwrap_or_default().into_iter();
        for ray in 0..depths[bundle].len() {
            for i in 0..depths[bundle][ray].len() {
                let mut moved = |step: f64| {
                    depths[bundle][ray][i] += step;
                    let value = formula(&depths);
                    depths[bundle][ray][i] -= step;
                    value
                };
                let want = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let got = f64::from(got.next().unwrap_or(0.0));
                let agrees = (got - want).abs() <= 1e-5 * (1.0 + want.abs());
                assert!(agrees, "bundle {bundle}, ray {ray}, {i}: {got}, {want}");
            }
        }
    }
}

/// Returns the mean of `value` over all `rays`.
pub fn mean<'a>(rays: impl Iterator<Item = &'a Vec<f64>>, value: impl Fn(&[f64]) -> f64) -> f64 {
    let values: Vec<f64> = rays.map(|ray| value(ray)).collect();
    values.iter().sum::<f64>() / values.len() as f64
}
