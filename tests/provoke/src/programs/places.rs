//! Places of tensors: all apart, or anywhere, mostly in relation to another tensor.

use super::{Dice, Program};
use elunar_core::nn::file::Tensor;

/// Puts all tensors apart and keeps them whole.
pub(super) fn apart(program: &mut Program) {
    let mut at = 0;
    for t in &mut program.tensors {
        *t = Tensor { ring: t.rows, pitch: t.row_bytes(), offset: at, ..*t };
        at += t.size_bytes() + 7;
    }
}

/// Gives one to three tensors, or now and then all, another place, ring and pitch.
pub(super) fn redraw(d: &mut Dice<'_>, program: &mut Program) {
    let all = program.tensors.len();
    if d.chance(10) {
        (0..all).for_each(|index| place(d, program, index, index));
    } else {
        for _ in 0..d.pick(&[1, 1, 1, 2, 3]) {
            let index = d.size(0, all - 1);
            place(d, program, index, all);
        }
    }
}

/// Gives a tensor a place, mostly in relation to another one among the first `known`.
fn place(d: &mut Dice<'_>, program: &mut Program, index: usize, known: usize) {
    let last = program.tensors.len() - 1;
    let whole = index == 0 || index == last || program.coarse == index as u32;
    let others = &program.tensors[..known];
    let end = others.iter().map(|t| t.offset + t.size_bytes()).max().unwrap_or(0);
    let mut t = program.tensors[index];
    t.pitch = t.row_bytes() + if d.chance(15) { d.size(0, 40) } else { 0 };
    t.ring = if whole || d.chance(50) { t.rows } else { d.size(1, t.rows) };
    t.offset = match d.size(0, 9) {
        0..=6 if known > 0 => {
            let other = d.pick(others);
            beside(d, &mut t, other, whole)
        }
        7 | 8 if end > 0 => d.size(0, end),
        _ => end,
    };
    program.tensors[index] = t;
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
