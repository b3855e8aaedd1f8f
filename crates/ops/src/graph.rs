//! Operations with a backward pass of their own, and how they are recorded in the autodiff graph.
//!
//! Each kernel of GPUs is an [`Operation`] of its backend; a host [`Kernel`](crate::host::Kernel) becomes one by `apply`.
//! [`evaluate`] runs an operation on the device of its inputs, and records it if any of them needs a gradient.

use std::any::Any;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{
    Autodiff, Backend, BackendTensor, Dispatch, DispatchAutodiffContext, DispatchTensor, DispatchTensorKind,
    ExtensionType, backend_extension,
};
use burn::tensor::Tensor;

/// Input tensors of an operation, at least one.
#[derive(Debug)]
struct Inputs<B: Backend>(Vec<FloatTensor<B>>);

impl<B: Backend> ExtensionType<B> for Inputs<B> {
    type Target = Inputs<Dispatch>;

    fn map_to_dispatch<F>(self, map_kind: F, autodiff: DispatchAutodiffContext) -> Inputs<Dispatch>
    where
        F: Fn(BackendTensor<B>) -> DispatchTensorKind,
    {
        let kinds = self.0.into_iter().map(|tensor| map_kind(BackendTensor::Float(tensor)));
        Inputs(kinds.map(|kind| DispatchTensor { kind, autodiff }).collect())
    }

    fn map_from_dispatch<F>(target: Inputs<Dispatch>, unwrap_kind: F) -> Self
    where
        F: Fn(DispatchTensor) -> BackendTensor<B>,
    {
        Self(target.0.into_iter().map(|tensor| unwrap_kind(tensor).float()).collect())
    }

    fn routing_tensor(target: &Inputs<Dispatch>) -> Option<&DispatchTensor> {
        target.0.first()
    }

    fn routing_float_tensor(target: &Inputs<Dispatch>) -> Option<&DispatchTensor> {
        target.0.first()
    }

    fn autodiff_context(target: &Inputs<Dispatch>) -> DispatchAutodiffContext {
        target.0.iter().fold(DispatchAutodiffContext::Disabled, |context, tensor| context.merge(tensor.autodiff))
    }
}

/// Backend that runs operations by kernels.
pub(crate) trait KernelBackend: Backend {
    /// Values that a forward pass keeps for the backward pass.
    type Kept: Clone + Debug + Default + Send + 'static;

    /// Converts a tensor to the layout that kernels index: `f32`, row-major and dense.
    fn prepare(tensor: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// Function of prepared tensors of backend `B` with its vector–Jacobian product.
pub(crate) trait Operation<B: KernelBackend>: Debug + Send + Sync {
    /// Computes the output.
    fn forward(&self, inputs: &[FloatTensor<B>]) -> FloatTensor<B>;

    /// Computes the output, and what the backward pass needs in addition to inputs and output; by default nothing.
    fn forward_keeping(&self, inputs: &[FloatTensor<B>]) -> (FloatTensor<B>, B::Kept) {
        (self.forward(inputs), B::Kept::default())
    }

    /// Computes the gradient of ⟨`grad`, output⟩ with respect to each input that is `wanted`, and perhaps to others. Inputs
    /// beyond the end of the result have no gradient.
    fn backward(&self, pass: BackwardPass<'_, B>) -> Vec<Option<FloatTensor<B>>>;
}

pub(crate) struct BackwardPass<'a, B: KernelBackend> {
    pub(crate) inputs: &'a [FloatTensor<B>],
    pub(crate) output: &'a FloatTensor<B>,
    pub(crate) kept: &'a B::Kept,
    /// Gradient with respect to the output.
    pub(crate) grad: &'a FloatTensor<B>,
    pub(crate) wanted: &'a [bool],
}

/// [`Operation`] of one backend, `Arc<dyn Operation<B>>`, as passed through Burn's dispatch to that backend.
type AnyOperation = Arc<dyn Any + Send + Sync>;

/// Returns the operation of the backend to which tensors were dispatched.
fn operation_of<B: KernelBackend>(operation: &AnyOperation) -> Arc<dyn Operation<B>> {
    let operation = operation.downcast_ref::<Arc<dyn Operation<B>>>();
    operation.expect("an operation runs on the backend of its inputs").clone()
}

#[backend_extension(Flex: cfg(feature = "flex"), Cube: cfg(feature = "cube"), Autodiff)]
trait KernelOps: Backend {
    fn run(#[extension_type] inputs: Inputs<Self>, operation: AnyOperation) -> FloatTensor<Self>;
}

impl<B: KernelBackend> KernelOps for B {
    fn run(inputs: Inputs<Self>, operation: AnyOperation) -> FloatTensor<Self> {
        let inputs: Vec<FloatTensor<B>> = inputs.0.into_iter().map(B::prepare).collect();
        operation_of::<B>(&operation).forward(&inputs)
    }
}

impl<B: KernelBackend, C: CheckpointStrategy> KernelOps for Autodiff<B, C> {
    fn run(inputs: Inputs<Self>, operation: AnyOperation) -> FloatTensor<Self> {
        let record = match inputs.0.len() {
            1 => record::<B, C, 1>,
            2 => record::<B, C, 2>,
            3..=4 => record::<B, C, 4>,
            5..=32 => record::<B, C, 32>,
            33..=256 => record::<B, C, 256>,
            count => unreachable!("no operation has {count} inputs"),
        };
        record(operation_of::<B>(&operation), inputs.0)
    }
}

/// Runs an operation of backend `B` on its `inputs`. The output has rank `D`.
pub(crate) fn evaluate<B: KernelBackend, const D: usize>(
    operation: Arc<dyn Operation<B>>,
    inputs: impl IntoIterator<Item = DispatchTensor>,
) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::run(Inputs(inputs.into_iter().collect()), Arc::new(operation)))
}

/// Records an operation of at most `N` inputs. The first input fills unused places, and receives no gradient through them.
fn record<B: KernelBackend, C: CheckpointStrategy, const N: usize>(
    operation: Arc<dyn Operation<B>>,
    inputs: Vec<FloatTensor<Autodiff<B, C>>>,
) -> FloatTensor<Autodiff<B, C>> {
    let guards = std::array::from_fn(|index| inputs.get(index).unwrap_or(&inputs[0]).node());
    let inputs: Vec<FloatTensor<B>> = inputs.into_iter().map(|input| B::prepare(input.into_primitive())).collect();
    match Recorded::<B, N>(PhantomData).prepare::<C>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prep) => {
            let (output, kept) = operation.forward_keeping(&inputs);
            prep.finish(Saved { operation, inputs, output: output.clone(), kept }, output)
        }
        OpsKind::UnTracked(prep) => prep.finish(operation.forward(&inputs)),
    }
}

#[derive(Debug)]
struct Recorded<B, const N: usize>(PhantomData<B>);

#[derive(Clone, Debug)]
struct Saved<B: KernelBackend> {
    operation: Arc<dyn Operation<B>>,
    inputs: Vec<FloatTensor<B>>,
    output: FloatTensor<B>,
    kept: B::Kept,
}

impl<B: KernelBackend, const N: usize> Backward<B, N> for Recorded<B, N> {
    type State = Saved<B>;

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Saved { operation, inputs, output, kept } = ops.state;
        let grad = B::prepare(grads.consume::<B>(&ops.node));
        let wanted: Vec<bool> = ops.parents.iter().take(inputs.len()).map(Option::is_some).collect();
        let pass = BackwardPass { inputs: &inputs, output: &output, kept: &kept, grad: &grad, wanted: &wanted };
        for (parent, result) in ops.parents.into_iter().zip(operation.backward(pass)) {
            if let (Some(node), Some(gradient)) = (parent, result) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}
