//! A step of automatic differentiation for operators that need all their operands again for the gradients.

use super::shaped;
use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Flex};
use std::fmt::Debug;

/// An operator of N operands with one result.
pub(super) trait Operator<const N: usize>: Debug + Clone + Send + 'static {
    /// Applies the operator to contiguous operands.
    fn forward(&self, operands: &[FloatTensor<Flex>; N]) -> FloatTensor<Flex>;

    /// Returns the gradients of contiguous operands from the contiguous gradient of the result: at least those that are `wanted`.
    fn backward(
        &self,
        operands: &[FloatTensor<Flex>; N],
        gradient: &FloatTensor<Flex>,
        wanted: [bool; N],
    ) -> [Option<Vec<f32>>; N];
}

/// The step of an operator.
#[derive(Debug)]
struct Step<O>(std::marker::PhantomData<O>);

impl<const N: usize, O: Operator<N>> Backward<Flex, N> for Step<O> {
    type State = ([NodeId; N], O);

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let gradient = grads.consume::<Flex>(&ops.node).to_contiguous();
        let (nodes, operator) = ops.state;
        let operands = nodes.map(|id| checkpointer.retrieve_node_output::<FloatTensor<Flex>>(id).to_contiguous());
        let wanted = ops.parents.each_ref().map(Option::is_some);
        let found = operator.backward(&operands, &gradient, wanted);
        for ((node, operand), found) in ops.parents.iter().zip(&operands).zip(found) {
            if let (Some(node), Some(found)) = (node, found) {
                grads.register::<Flex>(node.id, shaped(found, operand));
            }
        }
    }
}

/// Applies an operator without automatic differentiation.
pub(super) fn apply<const N: usize>(
    operator: &impl Operator<N>,
    operands: [FloatTensor<Flex>; N],
) -> FloatTensor<Flex> {
    operator.forward(&operands.map(|operand| operand.to_contiguous()))
}

/// Applies an operator, and keeps what its gradients need.
pub(super) fn track<C: CheckpointStrategy, const N: usize>(
    operator: impl Operator<N>,
    operands: [FloatTensor<Autodiff<Flex, C>>; N],
) -> FloatTensor<Autodiff<Flex, C>> {
    let nodes = operands.each_ref().map(|operand| operand.node());
    let step = Step(std::marker::PhantomData);
    match step.prepare::<C>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(mut prep) => {
            let ids = operands.each_ref().map(|operand| prep.checkpoint(operand));
            let out = apply(&operator, operands.map(|operand| operand.into_primitive()));
            prep.finish((ids, operator), out)
        }
        OpsKind::UnTracked(prep) => prep.finish(apply(&operator, operands.map(|operand| operand.into_primitive()))),
    }
}
