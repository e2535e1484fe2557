//! Validates the schedule by simulating it: every row is written before it is read, and read before it is overwritten.
//!
//! The simulation advances by whole entries, not by steps, because an entry of 8 bytes may have thousands of steps. Rows read and rows
//! written never decrease from step to step. So the first and the last step of an entry decide, except where the rows being written are
//! compared with those being read: see [`Operator::deciding_steps`].

use super::work::{ENTRY, LINK, OPERATOR, TENSOR, Work};
use crate::nn::file::{MAX_RECORDS, ModelError, NONE, Operator};
use crate::nn::model::Model;
use crate::nn::tensor::Tensor;
use crate::part::{item, put};
use core::ops::Range;

/// Stands for "none" in the lists below.
const ABSENT: u16 = u16::MAX;

/// A number for every tensor or every operator.
#[derive(Clone, Copy)]
struct List([u16; MAX_RECORDS]);

impl List {
    fn at(&self, index: usize) -> u16 {
        item(&self.0, index)
    }

    fn set(&mut self, index: usize, value: u16) {
        put(&mut self.0, index, value);
    }
}

/// The state of every tensor and operator during the simulation. Some lists serve twice, because the stack is short in flight.
struct Lifetimes<'a, 'm> {
    model: &'a Model<'m>,
    work: &'a Work,
    /// The operator that writes a tensor. In `run`: number of rows of a tensor that have been written.
    writer: List,
    /// First entry that writes a tensor (0 for inputs, which exist before), and last entry that reads or writes it.
    born: List,
    dies: List,
    /// The tensor that overwrites this one row by row. A row's bytes belong to this tensor until the successor's row is written. In
    /// `find_lives`: first entry of each operator.
    successor: List,
    /// The tensor that this one overwrites.
    predecessor: List,
    /// Number of finished steps of each operator. In `find_lives`: its last entry.
    done: List,
}

/// Simulates the schedule of a model whose operators are legal alone.
pub(super) fn check(model: &Model<'_>, work: &Work) -> Result<(), ModelError> {
    let (all, none) = (List([ABSENT; MAX_RECORDS]), List([0; MAX_RECORDS]));
    let mut lifetimes =
        Lifetimes { model, work, writer: all, born: all, dies: none, successor: all, predecessor: all, done: none };
    lifetimes.find_lives()?;
    lifetimes.find_successors()?;
    lifetimes.find_lines()?;
    lifetimes.run()
}

impl Lifetimes<'_, '_> {
    fn operator(&self, index: usize) -> Result<Operator, ModelError> {
        self.work.spend(OPERATOR)?;
        self.model.operator(index).ok_or(ModelError::Header)
    }

    fn tensor(&self, index: usize) -> Result<Tensor, ModelError> {
        self.work.spend(TENSOR)?;
        Ok(self.model.tensor(index as u32))
    }

    fn find_lives(&mut self) -> Result<(), ModelError> {
        if self.model.entry_count() >= ABSENT as usize {
            return Err(ModelError::Header);
        }
        let last = self.model.entry_count() as u16;
        for input in [self.model.image_tensor(), self.model.coarse_tensor()] {
            if input != NONE {
                self.born.set(input as usize, 0);
            }
        }
        // Entries count from 1, because inputs exist at 0.
        self.work.spend(self.model.entry_count() * ENTRY)?;
        for number in 0..last {
            let refuse = ModelError::Schedule { entry: number as u32 };
            let entry = self.model.entry(number as usize).ok_or(refuse)?;
            if entry.operator >= self.model.operator_count() {
                return Err(refuse);
            }
            self.successor.set(entry.operator, self.successor.at(entry.operator).min(number + 1));
            self.done.set(entry.operator, number + 1);
        }
        for index in 0..self.model.operator_count() {
            let operator = self.operator(index)?;
            let out = operator.output() as usize;
            if self.writer.at(out) != ABSENT || self.born.at(out) == 0 {
                return Err(ModelError::Schedule { entry: 0 });
            }
            self.writer.set(out, index as u16);
            self.born.set(out, self.successor.at(index));
            for tensor in operator.inputs().into_iter().flatten().chain([operator.output()]) {
                self.dies.set(tensor as usize, self.dies.at(tensor as usize).max(self.done.at(index)));
            }
        }
        self.successor.0.fill(ABSENT);
        self.done.0.fill(0);
        self.dies.set(self.model.output_tensor() as usize, ABSENT);
        Ok(())
    }

    /// Returns two tensors if they are in use at the same time.
    fn together(&self, a: usize, b: usize) -> Result<Option<(Tensor, Tensor)>, ModelError> {
        self.work.spend(LINK)?;
        let used = self.born.at(a) != ABSENT && self.born.at(b) != ABSENT;
        if !used || self.dies.at(a) < self.born.at(b) || self.dies.at(b) < self.born.at(a) {
            return Ok(None);
        }
        Ok(Some((self.tensor(a)?, self.tensor(b)?)))
    }

    /// Finds the successor of every tensor. Tensors that share bytes must follow each other, either as a whole or row by row.
    fn find_successors(&mut self) -> Result<(), ModelError> {
        for (a, b) in pairs(self.model.tensor_count()) {
            let Some((first, second)) = self.together(a, b)? else { continue };
            if !first.overlaps(&second) {
                continue;
            }
            let (old, new) = if self.born.at(a) <= self.born.at(b) { (a, b) } else { (b, a) };
            // A sum overwrites the added tensor sample by sample. A map that is kept whole may be overwritten row by row by any other
            // map; the output may not be overwritten. All tensors that share bytes must be linked in this way, directly or through
            // others: see `find_lines`.
            let sum = first.coincides(&second) && self.adds(new, old)? && self.predecessor.at(new) == ABSENT;
            let (before, after) = if old == a { (first, second) } else { (second, first) };
            let kept = old == self.model.output_tensor() as usize;
            if !kept && self.successor.at(old) == ABSENT && (sum || before.overwritten_by(&after).is_some()) {
                self.successor.set(old, new as u16);
                if sum {
                    self.predecessor.set(new, old as u16);
                }
            }
        }
        Ok(())
    }

    /// Returns whether the writer of `new` adds `old` and does not read it otherwise.
    fn adds(&self, new: usize, old: usize) -> Result<bool, ModelError> {
        let (writer, old) = (self.writer.at(new), old as u32);
        if writer == ABSENT {
            return Ok(false);
        }
        let Operator::Conv(c) = self.operator(writer as usize)? else { return Ok(false) };
        Ok(c.add == Some(old) && c.first != old && c.second != Some(old))
    }

    /// Validates that tensors that exist at the same time in the same place are one line of successors.
    fn find_lines(&self) -> Result<(), ModelError> {
        for (a, b) in pairs(self.model.tensor_count()) {
            let Some((first, second)) = self.together(a, b)? else { continue };
            if first.overlaps(&second) && !self.descends(a, b)? && !self.descends(b, a)? {
                return Err(ModelError::Tensor { tensor: a as u32 });
            }
        }
        Ok(())
    }

    fn descends(&self, from: usize, to: usize) -> Result<bool, ModelError> {
        let mut at = from;
        for _ in 0..self.model.tensor_count() {
            self.work.spend(LINK)?;
            match self.successor.at(at) {
                ABSENT => return Ok(false),
                successor if successor as usize == to => return Ok(true),
                successor => at = successor as usize,
            }
        }
        Ok(false)
    }

    fn run(&mut self) -> Result<(), ModelError> {
        for index in 0..self.model.tensor_count() {
            let exists = self.writer.at(index) == ABSENT && self.born.at(index) == 0;
            self.writer.set(index, if exists { self.tensor(index)?.rows as u16 } else { 0 });
        }
        for number in 0..self.model.entry_count() {
            let refuse = ModelError::Schedule { entry: number as u32 };
            self.work.spend(ENTRY)?;
            let entry = self.model.entry(number).ok_or(refuse)?;
            let operator = self.operator(entry.operator)?;
            let out = self.tensor(operator.output() as usize)?;
            if entry.count == 0
                || entry.first != self.done.at(entry.operator) as usize
                || entry.first + entry.count > operator.steps(&out)
            {
                return Err(refuse);
            }
            let steps = EntrySteps { operator, out, steps: entry.first..entry.first + entry.count };
            for (slot, tensor) in operator.inputs().into_iter().enumerate() {
                let Some(tensor) = tensor else { continue };
                if !self.readable(&steps, slot, tensor as usize)? {
                    return Err(refuse);
                }
            }
            // Nor may it write to rows that have overwritten the tensor it writes.
            let written = operator.rows_after(&out, entry.first);
            if !self.untouched(operator.output() as usize, &out, written, None)? {
                return Err(refuse);
            }
            self.done.set(entry.operator, steps.steps.end as u16);
            self.writer
                .set(operator.output() as usize, operator.rows_after(&out, steps.steps.end).min(out.rows) as u16);
        }
        for index in 0..self.model.operator_count() {
            let operator = self.operator(index)?;
            let out = self.tensor(operator.output() as usize)?;
            if self.done.at(index) as usize != operator.steps(&out) {
                return Err(ModelError::Schedule { entry: self.model.entry_count() as u32 });
            }
        }
        Ok(())
    }

    /// Number of rows of a tensor that have been written.
    fn made(&self, tensor: usize) -> usize {
        self.writer.at(tensor) as usize
    }

    /// Returns whether the rows that the steps read are written, and overwritten neither by later rows of the ring nor by the successor.
    fn readable(&self, steps: &EntrySteps, slot: usize, tensor: usize) -> Result<bool, ModelError> {
        let writes = steps.operator.output() as usize;
        let t = self.tensor(tensor)?;
        let Range { start: first, end: last } = steps.steps;
        let rows = |step: usize| steps.operator.rows_read(&steps.out, slot, t.rows, step);
        // What a step reads of its own output is not written yet.
        if tensor == writes || rows(last.saturating_sub(1)).end > self.made(tensor) {
            return Ok(false);
        }
        // The first tensor of a line of sums is the furthest ahead in the ring.
        let (start, mut at) = (rows(first).start, tensor);
        let mut ahead = self.made(tensor);
        for _ in 0..self.model.tensor_count() {
            self.work.spend(LINK)?;
            match self.predecessor.at(at) {
                ABSENT => break,
                elder => at = elder as usize,
            }
            if at == writes {
                if steps.lead(slot, &t, 0) > t.ring as isize {
                    return Ok(false);
                }
            } else {
                ahead = ahead.max(self.made(at));
            }
        }
        // A step must not write bytes that it reads, except for sums, which are computed sample by sample.
        let sum = slot == 2 && t.coincides(&steps.out);
        let making = if sum { None } else { Some((steps, slot)) };
        Ok(ahead <= start + t.ring && self.untouched(tensor, &t, start, making)?)
    }

    /// Returns whether no row from `first` on has been overwritten by the successor, its successor, and so on. `making` are steps that are about to
    /// write rows, and the slot in which it reads this tensor.
    fn untouched(
        &self,
        tensor: usize,
        t: &Tensor,
        first: usize,
        making: Option<(&EntrySteps, usize)>,
    ) -> Result<bool, ModelError> {
        let mut at = tensor;
        for _ in 0..self.model.tensor_count() {
            self.work.spend(LINK)?;
            if self.successor.at(at) == ABSENT {
                break;
            }
            at = self.successor.at(at) as usize;
            let successor = self.tensor(at)?;
            // Rows of the successor beyond the first row that is read.
            let lead = match making {
                Some((steps, slot)) if steps.operator.output() as usize == at => Some(steps.lead(slot, t, 1)),
                _ => match self.made(at) {
                    0 => None,
                    made => Some(made as isize - first as isize),
                },
            };
            let taken = if t.coincides(&successor) { Some(0) } else { t.overwritten_by(&successor) };
            let safe = lead.is_none_or(|lead| taken.is_some_and(|more| lead + more <= 0));
            if !safe && t.overlaps(&successor) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// The steps of an entry of the schedule.
struct EntrySteps {
    operator: Operator,
    out: Tensor,
    steps: Range<usize>,
}

impl EntrySteps {
    /// Returns by how much the rows written after a step (`after` 1) or before it (0) exceed the first row that it reads of `t`: the
    /// largest difference of all steps.
    fn lead(&self, slot: usize, t: &Tensor, after: usize) -> isize {
        let lead = |step: usize| {
            let written = self.operator.rows_after(&self.out, step + after) as isize;
            written - self.operator.rows_read(&self.out, slot, t.rows, step).start as isize
        };
        self.operator.deciding_steps(&self.steps).map(lead).max().unwrap_or(isize::MIN)
    }
}

/// Returns all pairs of numbers below `count`, the larger one first.
fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..count).flat_map(|a| (0..a).map(move |b| (a, b)))
}
