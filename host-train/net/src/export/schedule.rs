//! The order in which rows are made: each as late as its reader allows, so that few are alive at a time.
//!
//! The output is made row by row; every step first asks the operators before it for the rows it reads. Only a layer norm whose
//! input is read by other layer norms runs as soon as it can: its 8-bit output takes less memory than the 16-bit input that
//! would have to wait for it.
//!
//! Before that come milestones: operators that are run to their end, one after the other, so that what they read may go. A map that many
//! rows of the output wait for is kept whole anyway; made first, it does not share the arena with what is made of it.

use elunar_core::nn::file::{Dtype, Entry, Operator, Tensor};

/// A program being played.
pub struct Play<'a> {
    tensors: &'a [Tensor],
    operators: &'a [Operator],
    writer: Vec<Option<usize>>,
    /// Steps done of each operator.
    done: Vec<usize>,
}

impl<'a> Play<'a> {
    /// Before the first step.
    pub fn new(tensors: &'a [Tensor], operators: &'a [Operator]) -> Self {
        let mut writer = vec![None; tensors.len()];
        operators.iter().enumerate().for_each(|(index, op)| writer[op.output() as usize] = Some(index));
        Self { tensors, operators, writer, done: vec![0; operators.len()] }
    }

    /// Rows of a tensor that have been made.
    pub fn made(&self, tensor: usize) -> usize {
        let t = &self.tensors[tensor];
        self.writer[tensor].map_or(t.rows, |w| self.operators[w].rows_after(t, self.done[w]).min(t.rows))
    }

    /// The tensors that an operator's step reads, with the rows.
    pub fn reads(&self, operator: usize, step: usize) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
        let op = &self.operators[operator];
        let out = &self.tensors[op.output() as usize];
        op.inputs().into_iter().enumerate().filter_map(move |(slot, tensor)| {
            let tensor = tensor? as usize;
            Some((tensor, op.rows_read(out, slot, self.tensors[tensor].rows, step)))
        })
    }

    /// Counts a step as done.
    pub fn advance(&mut self, operator: usize) {
        self.done[operator] += 1;
    }

    fn steps(&self, operator: usize) -> usize {
        let op = &self.operators[operator];
        op.steps(&self.tensors[op.output() as usize])
    }
}

/// The schedule of a program whose last operator makes the output; `milestones` are operators that come first, in this order.
pub fn schedule(tensors: &[Tensor], operators: &[Operator], milestones: &[usize]) -> Vec<Entry> {
    let mut scheduler = Scheduler { play: Play::new(tensors, operators), entries: Vec::new(), eager: eager(operators) };
    // Then the last operator; what nobody asked for at the end.
    for operator in milestones.iter().copied().chain((0..operators.len()).rev()) {
        while scheduler.play.done[operator] < scheduler.play.steps(operator) {
            scheduler.run(operator);
        }
    }
    scheduler.entries
}

/// Operators that run as soon as they can.
fn eager(operators: &[Operator]) -> Vec<bool> {
    let norm = |op: &Operator| matches!(op, Operator::LayerNorm(_));
    let eager = |op: &Operator| {
        let Operator::LayerNorm(n) = op else { return false };
        n.merge == 1 && operators.iter().filter(|o| o.inputs().contains(&Some(n.input))).all(norm)
    };
    operators.iter().map(eager).collect()
}

struct Scheduler<'a> {
    play: Play<'a>,
    entries: Vec<Entry>,
    eager: Vec<bool>,
}

impl Scheduler<'_> {
    /// Runs the next step of an operator, and before it whatever it needs.
    fn run(&mut self, operator: usize) {
        let step = self.play.done[operator];
        let reads: Vec<_> = self.play.reads(operator, step).collect();
        // Skip connections come first in the list; what they wait for last.
        for (tensor, rows) in reads.iter().rev() {
            self.prepare(*tensor, rows.end);
        }
        for (tensor, rows) in reads.into_iter().rev() {
            while self.play.made(tensor) < rows.end {
                let Some(writer) = self.play.writer[tensor] else { break };
                self.run(writer);
            }
        }
        if self.play.done[operator] > step {
            return; // An eager operator that ran as soon as its input was there.
        }
        match self.entries.last_mut() {
            Some(last) if last.operator == operator => last.count += 1,
            _ => self.entries.push(Entry { operator, first: step, count: 1 }),
        }
        self.play.advance(operator);
        let made = self.play.operators[operator].output();
        for next in 0..self.play.operators.len() {
            while self.eager[next] && self.play.operators[next].inputs()[0] == Some(made) && self.ready(next) {
                self.run(next);
            }
        }
    }

    /// Makes what rows of a tensor up to `end` are computed from, but not what is quickly made of it: a layer norm or a linear
    /// layer would only lie there until the rest has come.
    fn prepare(&mut self, tensor: usize, end: usize) {
        let Some(writer) = self.play.writer[tensor] else { return };
        if self.play.made(tensor) >= end {
            return;
        }
        let (op, t) = (&self.play.operators[writer], &self.play.tensors[tensor]);
        let quick = match op {
            Operator::LayerNorm(n) => n.merge == 1,
            Operator::Conv(c) => (c.kernel_rows, c.kernel_cols) == (1, 1) && c.add.is_none(),
            _ => false,
        };
        if quick && t.dtype == Dtype::U8 {
            let last = (self.play.done[writer]..op.steps(t)).find(|s| op.rows_after(t, s + 1) >= end);
            let reads: Vec<_> = last.map(|step| self.play.reads(writer, step).collect()).unwrap_or_default();
            for (tensor, rows) in reads {
                self.prepare(tensor, rows.end);
            }
            return;
        }
        while self.play.made(tensor) < end {
            self.run(writer);
        }
    }

    fn ready(&self, operator: usize) -> bool {
        let step = self.play.done[operator];
        step < self.play.steps(operator)
            && self.play.reads(operator, step).all(|(tensor, rows)| rows.end <= self.play.made(tensor))
    }
}
