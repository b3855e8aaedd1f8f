//! Products with a tall matrix, one row per sample, on GPUs.

use burn::tensor::{Device, Tensor};

use crate::dispatch::is_gpu;

/// Least rows of a part.
const ROWS: usize = 2048;
/// Most parts.
const PARTS: usize = 32;

/// In how many parts a GPU multiplies `rows` rows; 1 on other devices.
///
/// The gradient of a layer's weights is a sum over all samples, `xᵀ dy` of `[k, M]·[M, n]`: with k and n of 256 it is a few
/// tiles, for which most of a large GPU would idle. Taken in parts, `Σ_b x_bᵀ dy_b`, there are as many times more tiles.
pub(crate) fn parts(rows: usize, device: &Device) -> usize {
    if is_gpu(device) { gpu_parts(rows) } else { 1 }
}

/// The same of a GPU.
pub(crate) fn gpu_parts(rows: usize) -> usize {
    (rows / ROWS).clamp(1, PARTS)
}

/// `x` with as many rows of zeros after it as make `parts` equal parts of it.
pub(crate) fn fill_up(x: Tensor<2>, parts: usize) -> Tensor<2> {
    let [rows, columns] = x.dims();
    match rows.next_multiple_of(parts) - rows {
        0 => x,
        missing => Tensor::cat(vec![x.clone(), Tensor::zeros([missing, columns], &x.device())], 0),
    }
}

/// x w, `[M, k]·[k, n]`, M being a multiple of `parts`.
pub(crate) fn product(x: Tensor<2>, w: Tensor<2>, parts: usize) -> Tensor<2> {
    if parts == 1 {
        return x.matmul(w);
    }
    let ([rows, inputs], [_, outputs]) = (x.dims(), w.dims());
    // As w is the same for every part, its gradient is summed over them.
    x.reshape([parts, rows / parts, inputs]).matmul(w.unsqueeze()).reshape([rows, outputs])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{from_host, to_host};

    #[test]
    fn parts_add_up_in_value_and_gradient() {
        let device = Device::flex().autodiff();
        let numbers = |count: usize| -> Vec<f32> { (0..count).map(|i| (1.7 * i as f32).sin()).collect() };
        let run = |parts: usize| {
            let [x, w] =
                [from_host(&numbers(33), 3, &device), from_host(&numbers(6), 2, &device)].map(Tensor::require_grad);
            let out = product(fill_up(x.clone(), parts), w.clone(), parts).narrow(0, 0, 11);
            let grads = (out.clone() * out.clone()).sum().backward();
            [out, x.grad(&grads).unwrap(), w.grad(&grads).unwrap()].map(to_host)
        };
        for (whole, split) in run(1).iter().zip(run(4)) {
            assert_eq!(whole.len(), split.len());
            whole.iter().zip(split).for_each(|(a, b)| approx::assert_abs_diff_eq!(*a, b, epsilon = 1e-5));
        }
    }
}
