//! How an operation with a backward pass of its own is recorded in the autodiff graph, on whatever backend.

use std::fmt::Debug;
use std::marker::PhantomData;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, ExtensionType};
use burn::tensor::Tensor;

/// The tensors that an operation is a function of.
#[derive(Debug, ExtensionType)]
pub(crate) enum Inputs<B: Backend> {
    One(FloatTensor<B>),
    Two(FloatTensor<B>, FloatTensor<B>),
    Three(FloatTensor<B>, FloatTensor<B>, FloatTensor<B>),
    Four(FloatTensor<B>, FloatTensor<B>, FloatTensor<B>, FloatTensor<B>),
}

impl<B: Backend> Inputs<B> {
    /// All of them, in order.
    pub(crate) fn into_vec(self) -> Vec<FloatTensor<B>> {
        match self {
            Self::One(a) => vec![a],
            Self::Two(a, b) => vec![a, b],
            Self::Three(a, b, c) => vec![a, b, c],
            Self::Four(a, b, c, d) => vec![a, b, c, d],
        }
    }
}

impl<const A: usize> From<Tensor<A>> for Inputs<Dispatch> {
    fn from(a: Tensor<A>) -> Self {
        Self::One(a.into_dispatch())
    }
}

impl<const A: usize, const B: usize> From<(Tensor<A>, Tensor<B>)> for Inputs<Dispatch> {
    fn from((a, b): (Tensor<A>, Tensor<B>)) -> Self {
        Self::Two(a.into_dispatch(), b.into_dispatch())
    }
}

impl<const A: usize, const B: usize, const C: usize> From<(Tensor<A>, Tensor<B>, Tensor<C>)> for Inputs<Dispatch> {
    fn from((a, b, c): (Tensor<A>, Tensor<B>, Tensor<C>)) -> Self {
        Self::Three(a.into_dispatch(), b.into_dispatch(), c.into_dispatch())
    }
}

impl<const A: usize, const B: usize, const C: usize, const D: usize> From<(Tensor<A>, Tensor<B>, Tensor<C>, Tensor<D>)>
    for Inputs<Dispatch>
{
    fn from((a, b, c, d): (Tensor<A>, Tensor<B>, Tensor<C>, Tensor<D>)) -> Self {
        Self::Four(a.into_dispatch(), b.into_dispatch(), c.into_dispatch(), d.into_dispatch())
    }
}

/// A function of tensors of backend `B`, and its vector–Jacobian product.
pub(crate) trait Operation<B: Backend>: Clone + Debug + Send + 'static {
    /// What the forward pass keeps for the backward pass.
    type Kept: Clone + Debug + Send + 'static;

    /// `tensor` in the layout that the operation indexes.
    fn prepare(tensor: FloatTensor<B>) -> FloatTensor<B>;

    /// The output without a backward pass to come, given prepared inputs.
    fn infer(&self, inputs: &[FloatTensor<B>]) -> FloatTensor<B>;

    /// The output, and what the backward pass needs.
    fn forward(&self, inputs: &[FloatTensor<B>]) -> (FloatTensor<B>, Self::Kept);

    /// For each input that is `wanted`, the gradient of ⟨`grad`, output⟩ with respect to it.
    fn backward(
        &self,
        inputs: &[FloatTensor<B>],
        output: FloatTensor<B>,
        kept: Self::Kept,
        grad: FloatTensor<B>,
        wanted: &[bool],
    ) -> Vec<Option<FloatTensor<B>>>;
}

/// The output without a graph.
pub(crate) fn untracked<B: Backend, O: Operation<B>>(operation: &O, inputs: Inputs<B>) -> FloatTensor<B> {
    let inputs: Vec<FloatTensor<B>> = inputs.into_vec().into_iter().map(O::prepare).collect();
    operation.infer(&inputs)
}

/// The output, with the operation recorded where a gradient will be asked for.
pub(crate) fn tracked<B: Backend, C: CheckpointStrategy, O: Operation<B>>(
    operation: O,
    inputs: Inputs<Autodiff<B, C>>,
) -> FloatTensor<Autodiff<B, C>> {
    match inputs {
        Inputs::One(a) => record::<B, C, O, 1>(operation, [a]),
        Inputs::Two(a, b) => record::<B, C, O, 2>(operation, [a, b]),
        Inputs::Three(a, b, c) => record::<B, C, O, 3>(operation, [a, b, c]),
        Inputs::Four(a, b, c, d) => record::<B, C, O, 4>(operation, [a, b, c, d]),
    }
}

fn record<B: Backend, C: CheckpointStrategy, O: Operation<B>, const N: usize>(
    operation: O,
    inputs: [FloatTensor<Autodiff<B, C>>; N],
) -> FloatTensor<Autodiff<B, C>> {
    let guards = inputs.each_ref().map(|input| input.node());
    let inputs = inputs.map(|input| O::prepare(input.into_primitive()));
    match Recorded::<B, O, N>(PhantomData).prepare::<C>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prep) => {
            let (output, kept) = operation.forward(&inputs);
            prep.finish(Saved { operation, inputs, output: output.clone(), kept }, output)
        }
        OpsKind::UnTracked(prep) => prep.finish(operation.infer(&inputs)),
    }
}

#[derive(Debug)]
struct Recorded<B, O, const N: usize>(PhantomData<(B, O)>);

/// An operation with its inputs, its output and what it kept.
#[derive(Clone, Debug)]
struct Saved<B: Backend, O: Operation<B>, const N: usize> {
    operation: O,
    inputs: [FloatTensor<B>; N],
    output: FloatTensor<B>,
    kept: O::Kept,
}

impl<B: Backend, O: Operation<B>, const N: usize> Backward<B, N> for Recorded<B, O, N> {
    type State = Saved<B, O, N>;

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Saved { operation, inputs, output, kept } = ops.state;
        let grad = O::prepare(grads.consume::<B>(&ops.node));
        let wanted = ops.parents.each_ref().map(Option::is_some);
        let results = operation.backward(&inputs, output, kept, grad, &wanted);
        for (parent, result) in ops.parents.into_iter().zip(results) {
            if let (Some(node), Some(gradient)) = (parent, result) {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}
