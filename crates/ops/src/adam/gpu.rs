//! GPU kernel of [`Adam`](super::Adam): one launch updates many parameters.

use std::cell::RefCell;

use burn::cubecl::{self, prelude::*};
use burn::tensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;

use super::{AdamOps, AdamStep};
use crate::cube::{apply_without_gradient, arg, empty_like, launch, threads, untracked, uploaded};

/// Max number of parameters of a launch. Each thread searches them for the value that it updates.
const MAX_PARAMETERS: usize = 24;
const TENSORS: usize = 5;

/// Updates one value and its moments per thread; moments in place. Nothing changes if `finite` is 0.
#[cube(launch)]
fn update(
    x: &Sequence<OwnedTensor<f32>>,
    g: &Sequence<OwnedTensor<f32>>,
    m: &mut Sequence<OwnedTensor<f32>>,
    v: &mut Sequence<OwnedTensor<f32>>,
    next: &mut Sequence<OwnedTensor<f32>>,
    finite: &Tensor<f32>,
    beta1: f32,
    beta2: f32,
    rate: f32,
    epsilon: f32,
    #[comptime] parameters: usize,
) {
    let mut start = ABSOLUTE_POS - ABSOLUTE_POS;
    #[unroll]
    for i in 0..parameters {
        let x = x.index(i);
        if ABSOLUTE_POS >= start && ABSOLUTE_POS < start + x.len() {
            let at = ABSOLUTE_POS - start;
            let g = g.index(i)[at];
            let (m, v) = (m.index_mut(i), v.index_mut(i));
            let next = next.index_mut(i);
            if finite[0] == 0.0f32 {
                next[at] = x[at];
            } else {
                let mean = m[at] * beta1 + g * (1.0f32 - beta1);
                let square = v[at] * beta2 + g * g * (1.0f32 - beta2);
                m[at] = mean;
                v[at] = square;
                next[at] = x[at] - mean * rate / (f32::sqrt(square) + epsilon);
            }
        }
        start += x.len();
    }
}

/// Writes 1 if `value` is finite and `before` is not 0, else 0. Tests the bits: a shader may assume that all values are finite.
#[cube(launch)]
fn check(value: &Tensor<f32>, before: &Tensor<f32>, out: &mut Tensor<f32>, #[comptime] is_first: bool) {
    let mut finite = 1.0f32;
    if (value[0].to_bits() & 0x7f80_0000u32) == 0x7f80_0000u32 {
        finite = 0.0f32;
    }
    if comptime!(!is_first) {
        finite *= before[0];
    }
    out[0] = finite;
}

pub(super) fn finite_after(before: Option<tensor::Tensor<1>>, value: tensor::Tensor<1>) -> tensor::Tensor<1> {
    let is_first = before.is_none();
    let inputs = [value.clone(), before.unwrap_or(value)].map(|tensor| tensor.into_dispatch());
    apply_without_gradient(inputs, move |[value, before]| {
        let out = empty_like(value);
        launch!(check::launch, 1; value, before, &out; is_first);
        out
    })
}

/// Step of a parameter that is not launched yet: x, g, m, v and the next x.
type PendingUpdate = (AdamStep, [CubeTensor; TENSORS]);

/// Updates that a thread has not launched yet, and the flag that decides whether they take effect.
struct HeldUpdates {
    finite: CubeTensor,
    steps: Vec<PendingUpdate>,
}

thread_local! {
    static HELD: RefCell<Option<HeldUpdates>> = const { RefCell::new(None) };
}

/// Runs `work`, which must not read updated parameters, then launches its updates; they change nothing if `finite` is 0.
pub(super) fn step_together<T>(finite: tensor::Tensor<1>, work: impl FnOnce() -> T) -> T {
    HELD.set(Some(HeldUpdates { finite: untracked(finite), steps: Vec::new() }));
    let result = work();
    if let Some(HeldUpdates { finite, steps }) = HELD.take() {
        launch_all(&finite, steps);
    }
    result
}

fn launch_all(finite: &CubeTensor, mut pending: Vec<PendingUpdate>) {
    while let Some((step, [like, ..])) = pending.first().cloned() {
        // The flag takes one binding.
        let most = ((like.client.properties().hardware.max_bindings as usize - 1) / TENSORS).clamp(1, MAX_PARAMETERS);
        let mut taken = Vec::new();
        pending.retain(|(other, tensors)| {
            let takes = *other == step && tensors[0].device == like.device && taken.len() < most;
            if takes {
                taken.push(tensors.clone());
            }
            !takes
        });
        let values = taken.iter().map(|[x, ..]| x.meta.num_elements()).sum();
        let (count, dim) = threads(&like, values);
        let all =
            |index: usize| taken.iter().map(|tensors| arg(&tensors[index])).collect::<SequenceArg<OwnedTensor<f32>>>();
        let ([x, g, m, v, next], finite) = ([0, 1, 2, 3, 4].map(all), arg(finite));
        let AdamStep { beta1, beta2, rate, epsilon } = step;
        update::launch(&like.client, count, dim, x, g, m, v, next, finite, beta1, beta2, rate, epsilon, taken.len());
    }
}

type Gpu = CubeTensor;

impl AdamOps for CubeBackend {
    fn adam(x: Gpu, g: Gpu, m: Gpu, v: Gpu, step: AdamStep) -> (Gpu, Gpu, Gpu) {
        let [x, g] = [x, g].map(into_contiguous);
        // The model still holds x, so x is not updated in place. Only the optimizer holds moments, unless it was cloned.
        let own = |moment: CubeTensor| if moment.can_mut() { moment } else { moment.copy() };
        let [m, v] = [m, v].map(own).map(into_contiguous);
        let next = empty_like(&x);
        let pending = (step, [x, g, m.clone(), v.clone(), next.clone()]);
        HELD.with_borrow_mut(|held| match held {
            Some(held) => held.steps.push(pending),
            None => launch_all(&uploaded(&[1.0], &next), vec![pending]),
        });
        (next, m, v)
    }
}
