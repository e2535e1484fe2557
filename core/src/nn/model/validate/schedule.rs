//! Validates the schedule by simulating it: every row is written before it is read, and read before it is overwritten.

use crate::nn::file::{MAX_RECORDS, ModelError, NONE, Operator};
use crate::nn::model::Model;
use crate::nn::tensor::Tensor;
use crate::part::{item, put};
use core::ops::Range;

/// Stands for "none" in the lists below.
const NOBODY: u16 = u16::MAX;

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

/// The state of every tensor and operator during the simulation.
struct Play<'a, 'm> {
    model: &'a Model<'m>,
    /// The operator that writes a tensor.
    writer: List,
    /// First entry that writes a tensor (0 for inputs, which exist before), and last entry that reads or writes it.
    born: List,
    dies: List,
    /// The tensor that overwrites this one row by row. A row's bytes belong to this tensor until the heir's row is written.
    heir: List,
    /// The tensor that this one overwrites.
    elder: List,
    /// Number of finished steps of each operator.
    done: List,
}

/// Simulates the schedule of a model whose operators are legal alone.
pub(super) fn check(model: &Model<'_>) -> Result<(), ModelError> {
    let (all, none) = (List([NOBODY; MAX_RECORDS]), List([0; MAX_RECORDS]));
    let mut play = Play { model, writer: all, born: all, dies: none, heir: all, elder: all, done: none };
    play.find_lives()?;
    play.find_heirs()?;
    play.find_lines()?;
    play.run()
}

impl Play<'_, '_> {
    fn operator(&self, index: usize) -> Result<Operator, ModelError> {
        self.model.operator(index).ok_or(ModelError::Header)
    }

    fn find_lives(&mut self) -> Result<(), ModelError> {
        if self.model.entry_count() >= NOBODY as usize {
            return Err(ModelError::Header);
        }
        let last = self.model.entry_count() as u16;
        for input in [self.model.image_tensor(), self.model.coarse_tensor()] {
            if input != NONE {
                self.born.set(input as usize, 0);
            }
        }
        for index in 0..self.model.operator_count() {
            let out = self.operator(index)?.output() as usize;
            if self.writer.at(out) != NOBODY || self.born.at(out) == 0 {
                return Err(ModelError::Schedule { entry: 0 });
            }
            self.writer.set(out, index as u16);
        }
        for number in 0..last {
            let refuse = ModelError::Schedule { entry: number as u32 };
            let entry = self.model.entry(number as usize).ok_or(refuse)?;
            let operator = self.model.operator(entry.operator).ok_or(refuse)?;
            let out = operator.output() as usize;
            // Entries count from 1, because inputs exist at 0.
            self.born.set(out, self.born.at(out).min(number + 1));
            for tensor in operator.inputs().into_iter().flatten().chain([operator.output()]) {
                self.dies.set(tensor as usize, number + 1);
            }
        }
        self.dies.set(self.model.output_tensor() as usize, NOBODY);
        Ok(())
    }

    /// Finds the heir of every tensor. Tensors that share bytes must follow each other, either as a whole or row by row.
    fn find_heirs(&mut self) -> Result<(), ModelError> {
        for a in 0..self.model.tensor_count() {
            for b in 0..a {
                let (first, second) = (self.model.tensor(a as u32), self.model.tensor(b as u32));
                let used = self.born.at(a) != NOBODY && self.born.at(b) != NOBODY;
                if !used
                    || !first.overlaps(&second)
                    || self.dies.at(a) < self.born.at(b)
                    || self.dies.at(b) < self.born.at(a)
                {
                    continue;
                }
                let (old, new) = if self.born.at(a) <= self.born.at(b) { (a, b) } else { (b, a) };
                let adds = |index: u16| {
                    matches!(self.model.operator(index as usize), Some(Operator::Conv(c)) if c.add == Some(old as u32)
                        && c.first != old as u32 && c.second != Some(old as u32))
                };
                // A sum overwrites the added tensor sample by sample. A map that is kept whole may be overwritten row by row by any other
                // map; the output may not be overwritten. All tensors that share bytes must be linked in this way, directly or through
                // others: see `find_lines`.
                let sum = first.coincides(&second) && adds(self.writer.at(new)) && self.elder.at(new) == NOBODY;
                let (before, after) = if old == a { (first, second) } else { (second, first) };
                let kept = old == self.model.output_tensor() as usize;
                if !kept && self.heir.at(old) == NOBODY && (sum || before.overwritten_by(&after).is_some()) {
                    self.heir.set(old, new as u16);
                    if sum {
                        self.elder.set(new, old as u16);
                    }
                }
            }
        }
        Ok(())
    }

    /// Validates that tensors that exist at the same time in the same place are one line of heirs.
    fn find_lines(&self) -> Result<(), ModelError> {
        for a in 0..self.model.tensor_count() {
            for b in 0..a {
                let (first, second) = (self.model.tensor(a as u32), self.model.tensor(b as u32));
                let used = self.born.at(a) != NOBODY && self.born.at(b) != NOBODY;
                if !used
                    || !first.overlaps(&second)
                    || self.dies.at(a) < self.born.at(b)
                    || self.dies.at(b) < self.born.at(a)
                {
                    continue;
                }
                if !self.descends(a, b) && !self.descends(b, a) {
                    return Err(ModelError::Tensor { tensor: a as u32 });
                }
            }
        }
        Ok(())
    }

    fn descends(&self, from: usize, to: usize) -> bool {
        let mut at = from;
        for _ in 0..self.model.tensor_count() {
            match self.heir.at(at) {
                NOBODY => return false,
                heir if heir as usize == to => return true,
                heir => at = heir as usize,
            }
        }
        false
    }

    /// Number of rows of a tensor that have been written.
    fn made(&self, tensor: usize, t: &Tensor) -> usize {
        match self.writer.at(tensor) {
            NOBODY => t.rows * (self.born.at(tensor) == 0) as usize,
            writer => self
                .model
                .operator(writer as usize)
                .map_or(0, |op| op.rows_after(t, self.done.at(writer as usize) as usize).min(t.rows)),
        }
    }

    fn run(&mut self) -> Result<(), ModelError> {
        for number in 0..self.model.entry_count() {
            let refuse = ModelError::Schedule { entry: number as u32 };
            let entry = self.model.entry(number).ok_or(refuse)?;
            let operator = self.model.operator(entry.operator).ok_or(refuse)?;
            let out = self.model.tensor(operator.output());
            let steps = operator.steps(&out);
            if entry.count == 0
                || entry.first != self.done.at(entry.operator) as usize
                || entry.first + entry.count > steps
            {
                return Err(refuse);
            }
            for step in entry.first..entry.first + entry.count {
                for (slot, tensor) in operator.inputs().into_iter().enumerate() {
                    let Some(tensor) = tensor else { continue };
                    let t = self.model.tensor(tensor);
                    let rows = operator.rows_read(&out, slot, t.rows, step);
                    // A step must not write bytes that it reads, except for sums, which are computed sample by sample.
                    let sum = slot == 2 && t.coincides(&out);
                    let making =
                        if sum { None } else { Some((operator.output(), operator.rows_after(&out, step + 1))) };
                    if !self.readable(tensor as usize, &t, rows, making) {
                        return Err(refuse);
                    }
                }
                // Nor may it write to rows that have overwritten the tensor it writes.
                let written = operator.rows_after(&out, step);
                if !self.untouched(operator.output() as usize, &out, written, None) {
                    return Err(refuse);
                }
                self.done.set(entry.operator, self.done.at(entry.operator).saturating_add(1));
            }
        }
        let finished = (0..self.model.operator_count()).all(|index| {
            self.model
                .operator(index)
                .is_some_and(|op| self.done.at(index) as usize == op.steps(&self.model.tensor(op.output())))
        });
        if finished { Ok(()) } else { Err(ModelError::Schedule { entry: self.model.entry_count() as u32 }) }
    }

    /// Returns whether rows are written, and overwritten neither by later rows of the ring nor by the heir. `making` is a tensor that is
    /// about to have this number of rows.
    fn readable(&self, tensor: usize, t: &Tensor, rows: Range<usize>, making: Option<(u32, usize)>) -> bool {
        if rows.is_empty() {
            return true;
        }
        // The first tensor of a line of sums is the furthest ahead in the ring.
        let made = self.made(tensor, t);
        let (mut ahead, mut at) = (made, tensor);
        for _ in 0..self.model.tensor_count() {
            match self.elder.at(at) {
                NOBODY => break,
                elder => at = elder as usize,
            }
            ahead = ahead.max(self.made(at, t));
        }
        self.untouched(tensor, t, rows.start, making) && rows.end <= made && ahead <= rows.start + t.ring
    }

    /// Returns whether no row from `first` on has been overwritten by the heir, its heir, and so on.
    fn untouched(&self, tensor: usize, t: &Tensor, first: usize, making: Option<(u32, usize)>) -> bool {
        let mut at = tensor;
        for _ in 0..self.model.tensor_count() {
            if self.heir.at(at) == NOBODY {
                break;
            }
            at = self.heir.at(at) as usize;
            let heir = self.model.tensor(at as u32);
            let made = match making {
                Some((number, made)) if number as usize == at => made,
                _ => self.made(at, &heir),
            };
            let taken = if t.coincides(&heir) { Some(0) } else { t.overwritten_by(&heir) };
            let safe = made == 0 || taken.is_some_and(|more| made as isize + more <= first as isize);
            if !safe && t.overlaps(&heir) {
                return false;
            }
        }
        true
    }
}
