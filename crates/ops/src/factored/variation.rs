//! Total variation of the planes.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::Layout;
use crate::dispatch::dispatch;

/// Smoothness of the planes: Σ_levels (res/64)/(3 res²) Σ over neighbours of squared differences; a scalar.
///
/// The factor res/64 asks more of the finer levels, which fewer rays reach. Differentiable in `tables`.
///
/// # Panics
/// If `tables` is not of the layout's length.
pub fn plane_variation(tables: Tensor<1>, layout: &Arc<Layout>) -> Tensor<1> {
    assert_eq!(tables.dims(), [layout.table_len()], "tables hold every plane and line of the layout");
    dispatch! {
        &tables.device();
        host => crate::kernel::apply(host::VariationKernel { layout: layout.clone() }, tables),
        cube => crate::cube::variation(tables, layout),
        plain => plain(tables, layout),
    }
}

/// Weight of a level's squared differences.
pub(crate) fn weight(resolution: usize) -> f32 {
    1.0 / (64.0 * 3.0 * resolution as f32)
}

/// [`plane_variation`] from plain tensor operations, on any backend.
pub fn plain(tables: Tensor<1>, layout: &Layout) -> Tensor<1> {
    let mut sum = Tensor::zeros([1], &tables.device());
    for level in &layout.levels {
        let (r, c) = (level.resolution, level.channels);
        let planes: Tensor<4> = tables.clone().narrow(0, level.offset, 3 * level.plane_len()).reshape([3, r, r, c]);
        for axis in [1, 2] {
            let difference = planes.clone().narrow(axis, 1, r - 1) - planes.clone().narrow(axis, 0, r - 1);
            sum = sum + difference.square().sum() * weight(r);
        }
    }
    sum
}

#[cfg(feature = "flex")]
mod host {
    use std::sync::Arc;

    use rayon::prelude::*;

    use super::{Layout, weight};
    use crate::kernel::{Kernel, Pass};
    use crate::parts::in_parts;
    use crate::simd::{self, Job};

    #[derive(Debug)]
    pub(super) struct VariationKernel {
        pub(super) layout: Arc<Layout>,
    }

    impl VariationKernel {
        /// `(first number, resolution, channels)` of every plane.
        fn planes(&self) -> Vec<(usize, usize, usize)> {
            let of_level =
                |level: &super::super::Level| [0, 1, 2].map(|p| (level.plane(p), level.resolution, level.channels));
            self.layout.levels.iter().flat_map(of_level).collect()
        }
    }

    /// Σ (a − b)², in as many running sums as fit a vector.
    #[inline(always)]
    fn squares(a: &[f32], b: &[f32]) -> f64 {
        const LANES: usize = 16;
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        let mut sums = [0f32; LANES];
        for (a, b) in a.iter().zip(b) {
            for lane in 0..LANES {
                sums[lane] += (a[lane] - b[lane]) * (a[lane] - b[lane]);
            }
        }
        let mut sum = 0.0;
        for (a, b) in a_rest.iter().zip(b_rest) {
            sum += f64::from((a - b) * (a - b));
        }
        for lane in sums {
            sum += f64::from(lane);
        }
        sum
    }

    /// Σ over neighbours in a plane whose rows are of `width` numbers, `step` of them a texel.
    struct Squares<'a> {
        plane: &'a [f32],
        width: usize,
        step: usize,
        sum: &'a mut f64,
    }

    impl Job for Squares<'_> {
        #[inline(always)]
        fn run<const FMA: bool, const WIDE: bool>(self) {
            // Row by row, so that each sum in `f32` is short.
            for row in self.plane.chunks_exact(self.width) {
                *self.sum += squares(&row[self.step..], &row[..self.width - self.step]);
            }
            for (above, row) in
                self.plane.chunks_exact(self.width).zip(self.plane[self.width..].chunks_exact(self.width))
            {
                *self.sum += squares(row, above);
            }
        }
    }

    /// Its gradient times half of `factor`, added to `out`.
    struct Pulls<'a> {
        plane: &'a [f32],
        width: usize,
        step: usize,
        factor: f32,
        out: &'a mut [f32],
    }

    /// out += k (from − to).
    #[inline(always)]
    fn pull(out: &mut [f32], k: f32, from: &[f32], to: &[f32]) {
        for ((out, a), b) in out.iter_mut().zip(from).zip(to) {
            *out += k * (a - b);
        }
    }

    impl Job for Pulls<'_> {
        #[inline(always)]
        fn run<const FMA: bool, const WIDE: bool>(self) {
            let Self { plane, width, step, factor, out } = self;
            for (y, out) in out.chunks_exact_mut(width).enumerate() {
                let row = &plane[y * width..(y + 1) * width];
                pull(&mut out[..width - step], factor, row, &row[step..]);
                pull(&mut out[step..], factor, &row[step..], row);
                if y > 0 {
                    pull(out, factor, row, &plane[(y - 1) * width..y * width]);
                }
                if (y + 2) * width <= plane.len() {
                    pull(out, factor, row, &plane[(y + 1) * width..(y + 2) * width]);
                }
            }
        }
    }

    impl Kernel for VariationKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![1]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let parts: Vec<f64> = self
                .planes()
                .into_par_iter()
                .map(|(start, r, c)| {
                    let mut sum = 0.0;
                    let plane = &inputs[0][start..start + r * r * c];
                    simd::run(Squares { plane, width: r * c, step: c, sum: &mut sum });
                    sum * f64::from(weight(r))
                })
                .collect();
            vec![parts.iter().sum::<f64>() as f32]
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let tables = pass.inputs[0];
            let grad = in_parts(self.layout.table_parts(), |parts| {
                let mut parts = parts.into_iter();
                let mut tasks = Vec::new();
                for level in &self.layout.levels {
                    let planes = parts.by_ref().take(3).enumerate();
                    tasks.extend(
                        planes.map(|(p, part)| (part, Some((level.plane(p), level.resolution, level.channels)))),
                    );
                    tasks.extend(parts.by_ref().take(3).map(|line| (line, None)));
                }
                tasks.into_par_iter().for_each(|(part, plane)| {
                    let out = part.zeros();
                    let Some((start, r, c)) = plane else { return };
                    let plane = &tables[start..start + r * r * c];
                    let factor = 2.0 * weight(r) * pass.grad[0];
                    simd::run(Pulls { plane, width: r * c, step: c, factor, out });
                });
            });
            vec![Some(grad)]
        }
    }
}
