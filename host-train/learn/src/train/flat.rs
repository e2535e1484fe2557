//! All trained parameters of a module as parts of one long tensor, and back.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor, TensorData};
use std::ops::Range;

/// Values of a row. Every parameter begins a row: 512 bytes, what CUDA aligns memory to, so that a part of whole rows is a view.
const ROW: usize = 128;

/// A parameter and its gradient, flattened, on a device without automatic differentiation.
pub(super) struct Part {
    id: ParamId,
    pub(super) weights: Tensor<1>,
    pub(super) gradient: Tensor<1>,
}

/// Returns the parameters that have a gradient, in the module's order.
pub(super) fn parts<M: Module>(module: &M, gradients: GradientsParams) -> Vec<Part> {
    let mut taker = Taker { gradients, parts: Vec::new() };
    module.visit(&mut taker);
    taker.parts
}

struct Taker {
    gradients: GradientsParams,
    parts: Vec<Part>,
}

impl ModuleVisitor for Taker {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.remove::<D>(param.id) {
            let [weights, gradient] = [param.val().inner(), gradient].map(|tensor| tensor.reshape([-1]));
            self.parts.push(Part { id: param.id, weights, gradient });
        }
    }
}

/// Returns the module with new weights, one tensor for each of its [`parts`].
pub(super) fn replaced<M: Module>(module: M, parts: &[Part], weights: Vec<Tensor<1>>) -> M {
    let mut placer = Placer { next: parts.iter().map(|part| part.id).zip(weights).peekable() };
    let module = module.map(&mut placer);
    assert!(placer.next.next().is_none(), "a module is visited and mapped in one order");
    module
}

struct Placer<I: Iterator> {
    next: std::iter::Peekable<I>,
}

impl<I: Iterator<Item = (ParamId, Tensor<1>)>> ModuleMapper for Placer<I> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some((_, new)) = self.next.next_if(|(id, _)| *id == param.id) else { return param };
        param.map(|old| {
            let mut tensor = Tensor::from_inner(new.reshape(old.dims()));
            if let Some(strategy) = old.gradient_checkpointing_strategy() {
                tensor = tensor.with_gradient_checkpointing_strategy(strategy);
            }
            tensor.set_require_grad(old.is_require_grad())
        })
    }
}

/// Where parameters lie in the long tensor. A row of zeros ends it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    lengths: Vec<usize>,
}

impl Layout {
    pub(super) fn of(parts: &[Part]) -> Self {
        Self { lengths: parts.iter().map(|part| part.weights.dims()[0]).collect() }
    }

    /// Returns the rows of every parameter.
    fn rows(&self) -> impl Iterator<Item = Range<usize>> {
        self.lengths.iter().scan(0, |end, length| {
            let begin = *end;
            *end += length.div_ceil(ROW);
            Some(begin..*end)
        })
    }

    /// Returns the values of every parameter.
    pub(super) fn values(&self) -> impl Iterator<Item = Range<usize>> {
        self.rows().zip(&self.lengths).map(|(rows, length)| rows.start * ROW..rows.start * ROW + length)
    }

    /// Returns the number of values of the long tensor.
    pub(super) fn len(&self) -> usize {
        (self.rows().last().map_or(0, |rows| rows.end) + 1) * ROW
    }

    /// Puts tensors of the parameters' lengths together.
    pub(super) fn join(&self, parts: impl Iterator<Item = Tensor<1>>, device: &Device) -> Tensor<1> {
        let zeros = Tensor::zeros([self.len()], device);
        self.values().zip(parts).fold(zeros, |long, (values, part)| long.slice_assign([values], part))
    }

    /// Takes a long tensor apart.
    pub(super) fn split(&self, long: &Tensor<1>) -> Vec<Tensor<1>> {
        self.values().map(|values| long.clone().slice([values])).collect()
    }
}

/// What sums over parameters and spreads a number per parameter, each in a few operators.
pub(super) struct Rows {
    pub(super) layout: Layout,
    /// `[parameters * most]`: rows of every parameter, filled up to the number of rows of the greatest with the row of zeros.
    of_parameter: Tensor<1, Int>,
    /// `[rows]`: the parameter of every row.
    parameter: Tensor<1, Int>,
}

impl Rows {
    pub(super) fn new(layout: Layout, device: &Device) -> Self {
        let zeros = layout.len() / ROW - 1;
        let most = layout.rows().map(|rows| rows.len()).max().unwrap_or(0);
        let filled = |rows: Range<usize>| rows.chain(std::iter::repeat(zeros)).take(most);
        let of_parameter: Vec<usize> = layout.rows().flat_map(filled).collect();
        let numbered = layout.rows().enumerate();
        let parameter: Vec<usize> = numbered.flat_map(|(i, rows)| rows.map(move |_| i)).chain([0]).collect();
        let tensor = |numbers: Vec<usize>| {
            let numbers: Vec<i32> = numbers.into_iter().map(|i| i as i32).collect();
            let count = numbers.len();
            Tensor::from_data(TensorData::new(numbers, [count]), device)
        };
        Self { of_parameter: tensor(of_parameter), parameter: tensor(parameter), layout }
    }

    /// Returns the sum of squares of every parameter's part of a long tensor, `[parameters]`.
    pub(super) fn sums_of_squares(&self, long: Tensor<1>) -> Tensor<1> {
        let rows: Tensor<1> = by_row(long).square().sum_dim(1).reshape([-1]);
        let parameters = self.layout.lengths.len() as i32;
        rows.select(0, self.of_parameter.clone()).reshape([parameters, -1]).sum_dim(1).reshape([-1])
    }

    /// Multiplies every parameter's part of a long tensor by its factor.
    pub(super) fn scaled(&self, long: Tensor<1>, factors: Tensor<1>) -> Tensor<1> {
        let factors: Tensor<2> = factors.select(0, self.parameter.clone()).reshape([-1, 1]);
        by_row(long).mul(factors).reshape([-1])
    }
}

fn by_row(long: Tensor<1>) -> Tensor<2> {
    long.reshape([-1, ROW as i32])
}
