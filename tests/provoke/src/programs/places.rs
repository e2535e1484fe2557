//! Places of tensors: all apart, or anywhere, mostly in relation to an earlier tensor.

use super::{Dice, Program};
use elunar_core::nn::file::Tensor;

/// Returns the program with all tensors apart and kept whole.
pub(super) fn apart(program: &Program) -> Program {
    let (mut tame, mut at) = (program.clone(), 0);
    for t in &mut tame.tensors {
        *t = Tensor { ring: t.rows, pitch: t.row_bytes(), offset: at, ..*t };
        at += t.size_bytes() + 7;
    }
    tame
}

/// Gives every tensor a place, a ring and a pitch.
pub(super) fn share(d: &mut Dice<'_>, program: &mut Program) {
    let (mut end, last) = (0, program.tensors.len() - 1);
    for index in 0..=last {
        let whole = index == 0 || index == last || program.coarse == index as u32;
        let (earlier, rest) = program.tensors.split_at_mut(index);
        let t = &mut rest[0];
        t.pitch = t.row_bytes() + if d.chance(15) { d.size(0, 40) } else { 0 };
        t.ring = if whole || d.chance(50) { t.rows } else { d.size(1, t.rows) };
        t.offset = match d.size(0, 9) {
            0..=4 if index > 0 => {
                let old = d.pick(earlier);
                beside(d, t, old, whole)
            }
            5 | 6 if end > 0 => d.size(0, end),
            _ => end,
        };
        end = end.max(t.offset + t.size_bytes());
    }
}

/// Returns an offset for `t` that has to do with tensor `old`, and makes ring and pitch alike.
fn beside(d: &mut Dice<'_>, t: &mut Tensor, old: Tensor, whole: bool) -> usize {
    let way = d.size(0, 6);
    if (2..=4).contains(&way) {
        t.pitch = t.row_bytes().max(old.pitch);
        if d.chance(70) {
            t.ring = t.rows;
        }
    }
    match way {
        0 | 1 => {
            t.ring = if whole { t.rows } else { old.ring.min(t.rows) };
            t.pitch = t.row_bytes().max(old.pitch);
            old.offset
        }
        2 => old.offset.saturating_sub(t.pitch * d.size(0, 3)),
        3 => old.offset + d.size(0, t.pitch),
        // Rows that alternate, or nearly.
        4 => (old.offset + old.row_bytes()).saturating_sub(d.size(0, 2)),
        5 => (old.offset + old.size_bytes()).saturating_sub(d.size(0, 3)),
        _ => old.offset.saturating_sub(t.size_bytes().saturating_sub(d.size(0, 5))),
    }
}
