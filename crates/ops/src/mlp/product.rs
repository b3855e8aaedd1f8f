//! Matrix products on GPUs by kernels of CubeK. Each is chosen by the precision and the layout of its factors, never by timing:
//! tuning takes seconds for each new shape, and may round `f32` to TF32.

use burn::cubecl::prelude::Scalar;
use burn::tensor::{DType, bf16};
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;
use cubek::matmul::definition::{MatmulElems, MatmulGlobalElems, MatmulSetupError};
use cubek::matmul::launch::launch_ref;
use cubek::matmul::multi_level::Strategy as Kernel;
use cubek::matmul::multi_level::components::tile::TileMatmulKind;
use cubek::matmul::multi_level::routines::TileSizeSelection;
use cubek::matmul::multi_level::routines::batch::simple::SimpleArgs;
use cubek::matmul::multi_level::routines::batch::simple_unit::SimpleUnitSelectionArgs;
use cubek::matmul::routine::BlueprintStrategy::Inferred;
use cubek::matmul::strategy::Strategy;
use cubek::std::InputBinding;

/// Computes a b of matrices or of batches of matrices, both `f32` or both `bf16`, summed and returned in `f32`.
pub(super) fn product(a: CubeTensor, b: CubeTensor) -> CubeTensor {
    let mut shape = a.meta.shape().clone();
    let columns = b.meta.shape().num_dims() - 1;
    shape[columns] = b.meta.shape()[columns];
    let out = empty_device_contiguous_dtype(a.client.clone(), a.device.clone(), shape, DType::F32);
    let launched = kernels(&a).into_iter().any(|kernel| launch(kernel, a.clone(), b.clone(), out.clone()).is_ok());
    assert!(launched, "no kernel for the product of {:?} and {:?}", a.meta, b.meta);
    out
}

/// Lists the kernels for a left factor, fastest first: those of tensor cores multiply `bf16`, the others `f32` exactly.
fn kernels(a: &CubeTensor) -> Vec<Kernel> {
    let unit = |tile_size| Kernel::SimpleUnit(Inferred(SimpleUnitSelectionArgs { tile_size }));
    let args = |tile_matmul| SimpleArgs { tile_matmul, multi_rows: true };
    match a.dtype {
        DType::BF16 => vec![
            Kernel::SimpleCyclicMma(Inferred(args(TileMatmulKind::Mma))),
            Kernel::SimpleCyclicCmma(Inferred(args(TileMatmulKind::Cmma))),
            unit(TileSizeSelection::MinTileSize),
            Kernel::Naive,
        ],
        _ if a.is_contiguous() => vec![unit(TileSizeSelection::MaxTileSize), Kernel::Naive],
        _ => vec![unit(TileSizeSelection::MinTileSize), Kernel::Naive],
    }
}

fn launch(kernel: Kernel, a: CubeTensor, b: CubeTensor, out: CubeTensor) -> Result<(), MatmulSetupError> {
    let float = f32::elem_type_native();
    let factor = if a.dtype == DType::BF16 { bf16::elem_type_native() } else { float };
    let mut types = MatmulElems::from_globals(&MatmulGlobalElems { lhs: factor, rhs: factor, out: float });
    let client = out.client.clone();
    let [a, b] = [a, b].map(|tensor| InputBinding::new(tensor.binding(), factor));
    launch_ref(&Strategy::MultiLevel(kernel), &client, a, b, out.binding(), &mut types)
}
