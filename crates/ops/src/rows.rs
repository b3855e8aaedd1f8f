//! Splitting of a tensor by rows.

use burn::tensor::Tensor;

/// Splits `tensor` into its first `counts[0]` rows, the next `counts[1]`, and so on. Differentiable.
///
/// # Panics
/// If there are fewer rows.
pub fn split_rows<const D: usize>(tensor: Tensor<D>, counts: &[usize]) -> Vec<Tensor<D>> {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::{from_host, to_host};
    use burn::tensor::Device;

    #[test]
    fn parts_have_their_rows_and_pass_gradients_back() {
        let rows = from_host(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2, &Device::flex().autodiff()).require_grad();
        let parts = split_rows(rows.clone(), &[2, 0, 1]);
        let gradients = (parts[2].clone() * 3.0).sum().backward();
        assert_eq!(to_host(rows.grad(&gradients).unwrap()), [0.0, 0.0, 0.0, 0.0, 3.0, 3.0]);
        assert_eq!(
            parts.into_iter().map(to_host).collect::<Vec<_>>(),
            [vec![1.0, 2.0, 3.0, 4.0], vec![], vec![5.0, 6.0]]
        );
    }
}
