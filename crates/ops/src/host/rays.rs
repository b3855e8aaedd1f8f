//! Host kernels of operations along rays: groups of rays in parallel, each with the processor's widest vectors.

use std::fmt::Debug;
use std::ops::Range;

use burn::backend::DispatchTensor;
use burn::tensor::Tensor;
use rayon::prelude::*;

use super::simd::{self, Job};
use super::{Kernel, Pass};
use crate::segments::Segments;

/// Number of rays of a group, which is one task of a kernel: enough samples to fill vectors, few enough to stay in cache.
pub(crate) const GROUP: usize = 64;

impl Segments {
    /// Divides the rays into groups of [`GROUP`], the last of which may be smaller.
    pub(crate) fn groups(&self) -> impl IndexedParallelIterator<Item = Group<'_>> {
        let (starts, offsets) = ((0..self.rays()).into_par_iter().step_by(GROUP), self.offsets());
        starts.map(move |start| Group { offsets: &offsets[start..=(start + GROUP).min(self.rays())] })
    }

    /// Splits per-sample `values` (`width` values per sample) into one mutable slice per group.
    pub(crate) fn split_mut<'a, T>(&self, mut values: &'a mut [T], width: usize) -> Vec<&'a mut [T]> {
        let offsets = self.offsets();
        let groups = (0..self.rays()).step_by(GROUP).map(|start| {
            let samples = offsets[(start + GROUP).min(self.rays())] - offsets[start];
            values.split_off_mut(..samples as usize * width).expect("there are values of every sample")
        });
        groups.collect()
    }
}

/// Consecutive rays, whose samples are packed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group<'a> {
    offsets: &'a [i32],
}

impl Group<'_> {
    pub(crate) fn samples(&self) -> Range<usize> {
        self.offsets[0] as usize..self.offsets[self.offsets.len() - 1] as usize
    }

    /// Lists the range of each ray's samples among the group's.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let start = self.offsets[0];
        self.offsets.windows(2).map(move |ends| (ends[0] - start) as usize..(ends[1] - start) as usize)
    }
}

/// An operation with `N` inputs, each of which holds a row per packed sample, and one row of output per ray, which depends
/// on that ray's samples alone.
pub(crate) trait RayKernel<const N: usize>: Debug + Send + Sync + 'static {
    fn widths(&self) -> [usize; N] {
        [1; N]
    }

    /// Fills a group's rows of the output. Mark the implementation `#[inline(always)]`.
    fn forward<const FMA: bool>(&self, group: Group<'_>, inputs: [&[f32]; N], out: &mut [f32]);

    /// Writes the gradient of ⟨`grad`, output⟩ with respect to each wanted input of a group into `gradients`, which are 0
    /// before. Mark the implementation `#[inline(always)]`.
    fn backward<const FMA: bool>(
        &self,
        group: Group<'_>,
        inputs: [&[f32]; N],
        grad: &[f32],
        gradients: [Option<&mut [f32]>; N],
    );
}

/// Evaluates `kernel(inputs)` along the rays of `segments` as a tensor of `shape`, whose first axis is the rays.
pub(crate) fn apply<K: RayKernel<N>, const N: usize, const D: usize>(
    kernel: K,
    segments: &Segments,
    shape: [usize; D],
    inputs: impl IntoIterator<Item = DispatchTensor>,
) -> Tensor<D> {
    let columns = shape[1..].iter().product();
    super::apply(AlongRays { kernel, segments: segments.clone(), columns }, shape, inputs)
}

#[derive(Debug)]
struct AlongRays<K, const N: usize> {
    kernel: K,
    segments: Segments,
    /// Number of output values of a ray.
    columns: usize,
}

impl<K: RayKernel<N>, const N: usize> AlongRays<K, N> {
    fn rows<'a>(&self, group: Group<'_>, inputs: &[&'a [f32]]) -> [&'a [f32]; N] {
        let (samples, widths) = (group.samples(), self.kernel.widths());
        std::array::from_fn(|i| &inputs[i][samples.start * widths[i]..samples.end * widths[i]])
    }
}

impl<K: RayKernel<N>, const N: usize> Kernel for AlongRays<K, N> {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let (segments, columns) = (&self.segments, self.columns);
        let mut out = vec![0.0; segments.rays() * columns];
        segments.groups().zip(out.par_chunks_mut(GROUP * columns)).for_each(|(group, out)| {
            simd::run(Forward { kernel: &self.kernel, group, inputs: self.rows(group, inputs), out });
        });
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let (segments, widths) = (&self.segments, self.kernel.widths());
        let gradient = |(input, wanted): (&&[f32], &bool)| wanted.then(|| vec![0.0; input.len()]);
        let mut gradients: Vec<Option<Vec<f32>>> = pass.inputs.iter().zip(pass.wanted).map(gradient).collect();
        let mut parts: Vec<[Option<&mut [f32]>; N]> = segments.groups().map(|_| [const { None }; N]).collect();
        for (i, gradient) in gradients.iter_mut().enumerate() {
            let split = gradient.iter_mut().flat_map(|gradient| segments.split_mut(gradient, widths[i]));
            parts.iter_mut().zip(split).for_each(|(part, split)| part[i] = Some(split));
        }
        let grads = pass.grad.par_chunks(GROUP * self.columns);
        segments.groups().zip(parts).zip(grads).for_each(|((group, gradients), grad)| {
            let inputs = self.rows(group, pass.inputs);
            simd::run(Backward { kernel: &self.kernel, group, inputs, grad, gradients });
        });
        gradients
    }
}

struct Forward<'a, K, const N: usize> {
    kernel: &'a K,
    group: Group<'a>,
    inputs: [&'a [f32]; N],
    out: &'a mut [f32],
}

impl<K: RayKernel<N>, const N: usize> Job for Forward<'_, K, N> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        self.kernel.forward::<FMA>(self.group, self.inputs, self.out);
    }
}

struct Backward<'a, K, const N: usize> {
    kernel: &'a K,
    group: Group<'a>,
    inputs: [&'a [f32]; N],
    grad: &'a [f32],
    gradients: [Option<&'a mut [f32]>; N],
}

impl<K: RayKernel<N>, const N: usize> Job for Backward<'_, K, N> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        self.kernel.backward::<FMA>(self.group, self.inputs, self.grad, self.gradients);
    }
}
