//! Host kernel of [`Adam`](super::Adam).

use burn::backend::Flex;
use burn::backend::tensor::FloatTensor;
use rayon::prelude::*;

use super::{AdamOps, AdamStep};
use crate::host::simd::{self, Job};

const CHUNK: usize = 1 << 14;

type Host = FloatTensor<Flex>;

impl AdamOps for Flex {
    fn adam(x: Host, g: Host, m: Host, v: Host, step: AdamStep) -> (Host, Host, Host) {
        let [mut x, mut m, mut v] = [x, m, v].map(|t| t.to_contiguous());
        let g = g.to_contiguous();
        let slices = (x.storage_mut::<f32>(), m.storage_mut::<f32>(), v.storage_mut::<f32>());
        (slices.0.par_chunks_mut(CHUNK))
            .zip(slices.1.par_chunks_mut(CHUNK))
            .zip(slices.2.par_chunks_mut(CHUNK))
            .zip(g.storage::<f32>().par_chunks(CHUNK))
            .for_each(|(((x, m), v), g)| simd::run(Chunk { step, x, g, m, v }));
        (x, m, v)
    }
}

struct Chunk<'a> {
    step: AdamStep,
    x: &'a mut [f32],
    g: &'a [f32],
    m: &'a mut [f32],
    v: &'a mut [f32],
}

impl Job for Chunk<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { step, x, g, m, v } = self;
        for (((x, m), v), &g) in x.iter_mut().zip(m).zip(v).zip(g) {
            *m = *m * step.beta1 + g * (1.0 - step.beta1);
            *v = *v * step.beta2 + g * g * (1.0 - step.beta2);
            *x -= *m * step.rate / (v.sqrt() + step.epsilon);
        }
    }
}
