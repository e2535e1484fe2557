//! The order in which rows are computed. Each row is computed as late as its reader allows, so that few rows are kept at a time.
//!
//! The output is computed row by row. Every step first runs the operators before it for the rows it reads. A layer norm whose input is read
//! by other layer norms is an exception and runs as soon as possible: its 8-bit output takes less memory than the 16-bit input, which would
//! otherwise be kept.
//!
//! Milestones come first: operators that run to their end, one after the other, so that the memory of their inputs is free. A map that many
//! rows of the output depend on is kept whole in any case. If it is computed first, it does not share the arena with its results.

use elunar_core::nn::file::{Dtype, Entry, Operator, Tensor};

/// A program during a simulated run.
pub struct Play<'a> {
    tensors: &'a [Tensor],
    operators: &'a [Operator],
    writer: Vec<Option<usize>>,
    /// Number of steps done of each operator.
    done: Vec<usize>,
}

impl<'a> Play<'a> {
    /// Starts a simulated run before the first step.
    pub fn new(tensors: &'a [Tensor], operators: &'a [Operator]) -> Self {
        let mut writer = vec![None; tensors.len()];
        operators.iter().enumerate().for_each(|(index, op)| writer[op.output() as usize] = Some(index));
        Self { tensors, operators, writer, done: vec![0; operators.len()] }
    }

    /// Returns the number of rows of a tensor that have been computed.
    pub fn made(&self, tensor: usize) -> usize {
        let t = &self.tensors[tensor];
        self.writer[tensor].map_or(t.rows, |w| self.operators[w].rows_after(t, self.done[w]).min(t.rows))
    }

    /// Returns the tensors that an operator's step reads, with the rows.
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

/// Returns the schedule of a program whose last operator makes the output. `milestones` are operators that run first, in this order.
pub fn schedule(tensors: &[Tensor], operators: &[Operator], milestones: &[usize]) -> Vec<Entry> {
    let mut scheduler = Scheduler { play: Play::new(tensors, operators), entries: Vec::new(), eager: eager(operators) };
    // Then the last operator, then all operators with remaining steps.
    for operator in milestones.iter().copied().chain((0..operators.len()).rev()) {
        while scheduler.play.done[operator] < scheduler.play.steps(operator) {
            scheduler.run(operator);
        }
    }
    scheduler.entries
}

/// Returns which operators run as soon as possible.
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
    /// Runs the next step of an operator, after all steps that it needs.
    fn run(&mut self, operator: usize) {
        let step = self.play.done[operator];
        let reads: Vec<_> = self.play.reads(operator, step).collect();
        // The list has skip connections first, and the input that they wait for last.
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
            return; // An eager operator ran as soon as its input was complete.
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

    /// Prepares rows of a tensor up to `end`. For a layer norm or a linear layer only the inputs are computed, not the result. The result
    /// is quick to compute, and would occupy memory until the other inputs are complete.
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
