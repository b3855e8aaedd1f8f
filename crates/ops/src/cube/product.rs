//! Matrix products of `f32` that stay so: tuning may otherwise take tensor cores, which round factors to TF32.

use burn::backend::ops::FloatTensorOps;
use burn::cubecl::prelude::*;
use burn::cubecl::tf32;
use burn::tensor::{Device, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubek::matmul::definition::MatmulElems;
use cubek::matmul::launch::launch_ref;
use cubek::matmul::multi_level;
use cubek::std::InputBinding;

use super::{empty, untracked};

/// Whether `device` may round the factors of Burn's products of `f32` to TF32.
pub(crate) fn has_tf32(device: &Device) -> bool {
    rounds(&untracked(Tensor::<1>::empty([1], &device.clone().inner())))
}

fn rounds(tensor: &CubeTensor) -> bool {
    tensor.client.properties().supports_type(tf32::elem_type_native())
}

/// The product of dense matrices, or of as many, which may be transposed: by the kernel that tuning finds to be the fastest
/// where none rounds, else by one that uses no tensor cores.
pub(super) fn multiplied(lhs: CubeTensor, rhs: CubeTensor) -> CubeTensor {
    let is_tuned = cfg!(feature = "autotune");
    if is_tuned && !rounds(&lhs) { CubeBackend::float_matmul(lhs, rhs) } else { unrounded(lhs, rhs) }
}

fn unrounded(lhs: CubeTensor, rhs: CubeTensor) -> CubeTensor {
    let rank = lhs.meta.shape().num_dims();
    let mut shape = lhs.meta.shape().clone();
    shape[rank - 1] = rhs.meta.shape()[rank - 1];
    let out = empty(&lhs, shape);
    let float = f32::elem_type_native();
    let client = out.client.clone();
    let [lhs, rhs] = [lhs, rhs].map(|factor| InputBinding::new(factor.binding(), float));
    let strategy = multi_level::Strategy::SimpleUnit(Default::default());
    let mut types = MatmulElems::from_single_dtype(float);
    launch_ref(&strategy.into(), &client, lhs, rhs, out.clone().binding(), &mut types)
        .expect("products without tensor cores are for any shape");
    out
}
