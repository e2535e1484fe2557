//! The units of work after the network.

use super::{JobError, Made, Network, Pass, TileJob, TileMemory};
use crate::nn::sum_floats;
use crate::norm::{Anchor, FineWaves};
use crate::part::{copy, head, part_mut};
use crate::photoclinometry::ExpectedErrors;

/// Farthest that a height may lie outside the coarse heights of its tile, metres (our choice: more than any relief of a body).
const MOST_CHANGE_M: f32 = 1e6;

impl TileJob {
    /// Does a unit of the work after the network; returns its cost, about that of so many multiply-accumulates.
    pub(super) fn finish_unit<N: Network>(
        &mut self,
        network: &N,
        memory: &mut TileMemory<'_>,
    ) -> Result<u64, JobError<N::Fault>> {
        let (pixels, cols, unit) = (self.tile.pixels(), self.tile.cols, self.unit as usize);
        let coarse_m = head(memory.coarse_m, pixels);
        let (heights_m, rest) = memory.scratch.split_at_mut_checked(pixels).unwrap_or_default();
        let (aside, lines) = (part_mut(rest, 0, pixels), &mut *memory.lines);
        let work = match self.pass {
            Pass::Output => {
                network.output(heights_m).map_err(JobError::Network)?;
                self.to(Pass::Check);
                20
            }
            Pass::Check => {
                if let Some(scale) = self.scale() {
                    scale.recover(self.tile, heights_m);
                }
                check(heights_m, coarse_m)?;
                self.to(if self.rules.anchor { Pass::Anchor } else { Pass::Settle });
                20
            }
            Pass::Anchor => {
                Anchor::new(self.rules.coarse_px)
                    .unit(unit, heights_m, coarse_m, cols, aside, lines)
                    .map_err(JobError::Length)?;
                self.next(Anchor::UNITS, Pass::Fine);
                40
            }
            Pass::Fine => {
                self.fine.unit(unit, heights_m, coarse_m, cols, aside, lines).map_err(JobError::Length)?;
                self.next(if self.fine == FineWaves::WHOLE { 1 } else { FineWaves::UNITS }, Pass::Settle);
                40
            }
            Pass::Settle => {
                if self.input.illumination.is_weighed() {
                    self.lighting.settle(heights_m, coarse_m);
                }
                // Memory or code may have changed since the network's heights were checked.
                check(heights_m, coarse_m)?;
                self.end_round(heights_m)?;
                20
            }
            _ => {
                copy(heights_m, coarse_m);
                if self.input.illumination.is_weighed() {
                    let (pixel_m, coarse_px) = (self.rules.pixel_m, self.rules.coarse_px);
                    self.expected = Some(ExpectedErrors::of_coarse(coarse_m, cols, pixel_m, coarse_px));
                }
                self.made = Made::Coarse;
                self.to(Pass::Finished);
                40
            }
        };
        Ok(work * pixels as u64)
    }

    /// Ends a round. Where the processor may err the heights are made twice, because this work is a small part of a tile's: both rounds must
    /// lead to the same.
    fn end_round<F>(&mut self, heights_m: &[f32]) -> Result<(), JobError<F>> {
        if !self.rules.checked {
            self.to(Pass::Finished);
            return Ok(());
        }
        let sum = sum_floats(heights_m);
        match self.first_round.replace(sum) {
            None => self.to(Pass::Output),
            Some(first) if first == sum => self.to(Pass::Finished),
            Some(_) => return Err(JobError::Unequal),
        }
        Ok(())
    }

    /// Gives a tile up whose network reports a fault: it keeps its coarse heights.
    pub fn give_up(&mut self) {
        match (self.pass, self.made) {
            (_, Made::Empty) => (),
            // What is left is to take the samples and to fill voids.
            (Pass::Take | Pass::FillCoarse | Pass::FillImage, _) => self.made = Made::Coarse,
            (Pass::FitMeasure | Pass::FitLit | Pass::Fit | Pass::Axis, _) => {
                self.made = Made::Coarse;
                self.to(Pass::FillCoarse);
            }
            _ => self.keep_coarse(),
        }
    }
}

/// Refuses heights that no ground has: the network is broken, or overflows.
fn check<F>(heights_m: &[f32], coarse_m: &[f32]) -> Result<(), JobError<F>> {
    let range = |(low, high): (f32, f32), z: &f32| (low.min(*z), high.max(*z));
    let (low, high) = coarse_m.iter().fold((f32::INFINITY, f32::NEG_INFINITY), range);
    let (low, high) = (low - MOST_CHANGE_M, high + MOST_CHANGE_M);
    match heights_m.iter().find(|z| !(low..=high).contains(*z)) {
        None => Ok(()),
        Some(found) => Err(JobError::Height { found: *found, low, high }),
    }
}
