//! Places tensors in the arena: two tensors may share bytes if they are never alive together.

use elunar_core::nn::format::NONE;
use elunar_core::nn::{Operator, Tensor};

/// Alignment of tensors, bytes: not needed by the runner, kind to caches.
const ALIGNMENT: usize = 64;

/// Sets every tensor's offset; returns the bytes they take together. `inputs` are written before the first operator.
///
/// Tensors are placed largest first, each at the lowest offset where no placed tensor with an overlapping life is in the way.
/// An added tensor that ends with the operator lends its bytes to the output, if they are of one size and type.
pub fn plan(tensors: &mut [Tensor], operators: &[Operator], inputs: &[u32]) -> usize {
    let mut lives: Vec<Option<Life>> = vec![None; tensors.len()];
    for &input in inputs.iter().filter(|&&i| i != NONE) {
        lives[input as usize] = Some(Life { first: 0, last: 0, home: input as usize });
    }
    for (index, operator) in operators.iter().enumerate() {
        let time = index + 1;
        for read in operator.inputs().into_iter().flatten() {
            if let Some(life) = &mut lives[read as usize] {
                life.last = time;
            }
        }
        lives[operator.output() as usize] = Some(Life { first: time, last: time, home: operator.output() as usize });
    }
    share_homes(tensors, operators, &mut lives);
    place(tensors, &lives)
}

/// First and last operator (from 1; 0 is before the first) that touches a tensor, and the tensor whose place it takes.
#[derive(Clone, Copy)]
struct Life {
    first: usize,
    last: usize,
    home: usize,
}

fn share_homes(tensors: &[Tensor], operators: &[Operator], lives: &mut [Option<Life>]) {
    for (index, operator) in operators.iter().enumerate() {
        let Operator::Conv(conv) = operator else { continue };
        let Some(add) = conv.add.map(|add| add as usize) else { continue };
        let out = conv.out as usize;
        let also_read = conv.first.tensor as usize == add || conv.second.is_some_and(|s| s.tensor as usize == add);
        let same = tensors[add].dtype == tensors[out].dtype && tensors[add].len() == tensors[out].len();
        let (Some(added), Some(born)) = (lives[add], lives[out]) else { continue };
        if same && !also_read && added.last == index + 1 {
            lives[out] = Some(Life { home: added.home, ..born });
            if let Some(home) = &mut lives[added.home] {
                home.last = home.last.max(born.last);
            }
        }
    }
}

fn place(tensors: &mut [Tensor], lives: &[Option<Life>]) -> usize {
    let mut order: Vec<usize> = (0..tensors.len()).filter(|&t| lives[t].is_some_and(|l| l.home == t)).collect();
    order.sort_by_key(|&t| (std::cmp::Reverse(tensors[t].size_bytes()), t));
    let mut placed: Vec<usize> = Vec::new();
    let mut end = 0;
    for &t in &order {
        let Some(life) = lives[t] else { continue };
        let rivals = placed.iter().filter(|&&p| lives[p].is_some_and(|l| l.first <= life.last && life.first <= l.last));
        let mut taken: Vec<(usize, usize)> =
            rivals.map(|&p| (tensors[p].offset, tensors[p].offset + tensors[p].size_bytes())).collect();
        taken.sort_unstable();
        let size = tensors[t].size_bytes();
        let mut offset = 0;
        for (from, to) in taken {
            if offset + size <= from {
                break;
            }
            offset = offset.max(to.next_multiple_of(ALIGNMENT));
        }
        tensors[t].offset = offset;
        end = end.max(offset + size);
        placed.push(t);
    }
    for t in 0..tensors.len() {
        if let Some(life) = lives[t] {
            tensors[t].offset = tensors[life.home].offset;
        }
    }
    end
}
