//! Rows of a tensor as tensors of their own.

use burn::tensor::Tensor;

use crate::dispatch::dispatch;

/// The first `counts[0]` rows of `tensor`, the next `counts[1]`, and so on. Differentiable: on a GPU the gradients of up to four
/// parts are put together in one launch.
///
/// # Panics
/// If there are not as many rows.
pub fn split_rows<const D: usize>(tensor: Tensor<D>, counts: &[usize]) -> Vec<Tensor<D>> {
    let plain = |tensor: Tensor<D>| {
        let mut start = 0;
        let part = |&count: &usize| {
            let mut shape = tensor.dims();
            (shape[0], start) = (count, start + count);
            match count {
                0 => Tensor::empty(shape, &tensor.device()),
                _ => tensor.clone().narrow(0, start - count, count),
            }
        };
        counts.iter().map(part).collect()
    };
    dispatch! {
        &tensor.device();
        host => plain(tensor),
        cube if counts.len() <= crate::cube::MOST_PARTS && !counts.contains(&0) => crate::cube::split_rows(tensor, counts),
        plain => plain(tensor),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{from_host, to_host};
    use burn::tensor::Device;

    #[test]
    fn parts_have_their_rows_and_gradients_go_back() {
        let rows = from_host(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2, &Device::flex().autodiff()).require_grad();
        let parts = split_rows(rows.clone(), &[2, 0, 1]);
        let slopes = (parts[2].clone() * 3.0).sum().backward();
        assert_eq!(to_host(rows.grad(&slopes).unwrap()), [0.0, 0.0, 0.0, 0.0, 3.0, 3.0]);
        assert_eq!(
            parts.into_iter().map(to_host).collect::<Vec<_>>(),
            [vec![1.0, 2.0, 3.0, 4.0], vec![], vec![5.0, 6.0]]
        );
    }
}
