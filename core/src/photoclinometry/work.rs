//! The work on a field in bounded units, in the order of the passes: flight software does one after another between its other duties.

use super::{COLUMNS, Field, LitTile, OCTAVES, Photoclinometry, Power, Rows, Share, TOGETHER, Way, transform};
use crate::error::LengthError;
use crate::mask::Mean;
use crate::words::Words;

/// What is found from a field.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Task<'a> {
    /// [`Photoclinometry::contrast`].
    Contrast,
    /// [`Photoclinometry::relief`].
    Relief { share: &'a Share, trust: f32 },
}

/// The position of the work on a field, and what was found so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct FieldWork {
    pub(crate) pass: u32,
    pub(crate) unit: u32,
    /// Slopes of lit ground.
    pub(crate) lit: Mean,
    /// Sum of the squares of the taper.
    pub(crate) squares: f32,
    pub(super) power: [Power; OCTAVES],
}

impl FieldWork {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.u32(&mut self.pass);
        words.u32(&mut self.unit);
        self.lit.visit(words);
        words.f32(&mut self.squares);
        self.power.iter_mut().for_each(|power| power.visit(words));
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pass {
    Tables,
    Fill,
    Level,
    Taper,
    MirrorCols,
    RowsForward,
    Clear,
    MirrorRows,
    ColumnsForward,
    Power,
    Filter,
    ColumnsBackward,
    RowsBackward,
}

const CONTRAST: &[Pass] = {
    use Pass::*;
    &[Tables, Fill, Level, Taper, RowsForward, Clear, ColumnsForward, Power]
};
const RELIEF: &[Pass] = {
    use Pass::*;
    &[Tables, Fill, Level, MirrorCols, RowsForward, MirrorRows, ColumnsForward, Filter, ColumnsBackward, RowsBackward]
};

impl Photoclinometry {
    /// Does a unit of the work; returns its cost, about that of so many multiply-accumulates, or `None` if all is done. `scratch` is unchanged
    /// between units.
    ///
    /// # Errors
    /// [`LengthError`] if `scratch` is shorter than [`Self::scratch_len`].
    pub(crate) fn advance(
        &self,
        work: &mut FieldWork,
        task: &Task<'_>,
        tile: &LitTile<'_, impl Rows, impl Rows>,
        scratch: &mut [f32],
    ) -> Result<Option<u64>, LengthError> {
        let passes = match task {
            Task::Contrast => CONTRAST,
            Task::Relief { .. } => RELIEF,
        };
        let Some(&pass) = passes.get(work.pass as usize) else { return Ok(None) };
        self.unit(pass, work, task, tile, self.field(scratch)?);
        let (units, cost) = self.extent(pass);
        work.unit += 1;
        if work.unit as usize >= units {
            (work.pass, work.unit) = (work.pass + 1, 0);
        }
        Ok(Some(cost))
    }

    /// Returns the number of units of a pass, and the cost of one.
    fn extent(&self, pass: Pass) -> (usize, u64) {
        let (height, width) = (self.rows.len(), self.cols.len());
        let (field, line) = (self.field_len(), TOGETHER * width);
        let (units, cost) = match pass {
            Pass::Tables => (2, 2100 * height.max(width)),
            Pass::Fill => (self.tile.rows, 80 * width),
            Pass::Level | Pass::MirrorCols | Pass::Clear | Pass::MirrorRows => (1, 7 * field),
            Pass::Taper => (1, 10 * field),
            Pass::RowsForward | Pass::RowsBackward => (self.tile.rows.div_ceil(TOGETHER), 85 * line),
            Pass::ColumnsForward | Pass::ColumnsBackward => ((width / 2).div_ceil(COLUMNS), 130 * COLUMNS * height),
            Pass::Power | Pass::Filter => (1 + height.div_ceil(TOGETHER), 24 * line),
        };
        (units, cost as u64)
    }

    fn unit(
        &self,
        pass: Pass,
        work: &mut FieldWork,
        task: &Task<'_>,
        tile: &LitTile<'_, impl Rows, impl Rows>,
        Field { field, row_roots, col_roots }: Field<'_>,
    ) {
        let unit = work.unit as usize;
        match pass {
            Pass::Tables if unit == 0 => self.rows.roots(row_roots),
            Pass::Tables => self.cols.roots(col_roots),
            Pass::Fill => self.fill_row(field, tile, unit, &mut work.lit),
            Pass::Level => self.level(field, work.lit),
            Pass::Taper => work.squares = self.taper(field),
            Pass::MirrorCols => self.mirror_cols(field),
            Pass::RowsForward => self.rows_forward(field, col_roots, unit),
            Pass::Clear => self.clear_margins(field),
            Pass::MirrorRows => self.mirror_rows(field),
            Pass::ColumnsForward => transform(field, &self.rows, row_roots, self.columns(unit), Way::Forward),
            Pass::Power => self.power(field, unit, &mut work.power),
            Pass::Filter => {
                if let Task::Relief { share, trust } = *task {
                    self.filter(field, Self::direction(tile.light), tile.coarse_px, (share, trust), unit);
                }
            }
            Pass::ColumnsBackward => transform(field, &self.rows, row_roots, self.columns(unit), Way::Backward),
            Pass::RowsBackward => self.rows_backward(field, col_roots, unit),
        }
    }
}
