//! Compares posts pushed row by row with the whole grid at once.

use crate::error::LengthError;
use crate::strip::{PostGrid, Posts, StripError};
use proptest::prelude::*;

/// Interpolates the whole grid, continued by two samples on every side, with Keys' kernel by distance; bilinear if a sample is missing.
fn naive(posts: &[f32], grid: &PostGrid, line: usize, px: usize) -> f64 {
    let (rows, cols) = ((posts.len() / grid.cols) as isize, grid.cols as isize);
    let (r, c) = (grid.row0 + line as f64 * grid.rows_per_line, grid.col0 + px as f64 * grid.cols_per_px);
    let inside = |v: f64, n: isize| v >= -0.5 - 1e-9 && v <= n as f64 - 0.5 + 1e-9;
    if !(inside(r, rows) && inside(c, cols)) {
        return f64::NAN;
    }
    let across = |row: isize, col: isize| {
        let at = |col: isize| f64::from(posts[(row * cols + col) as usize]);
        let (near, next) = if col < 0 { (0, 1.min(cols - 1)) } else { (cols - 1, (cols - 2).max(0)) };
        if (0..cols).contains(&col) { at(col) } else { at(near) - (col - near).abs() as f64 * (at(next) - at(near)) }
    };
    let at = |row: isize, col: isize| {
        let (near, next) = if row < 0 { (0, 1.min(rows - 1)) } else { (rows - 1, (rows - 2).max(0)) };
        if (0..rows).contains(&row) {
            across(row, col)
        } else {
            across(near, col) - (row - near).abs() as f64 * (across(next, col) - across(near, col))
        }
    };
    let keys = |x: f64| match x.abs() {
        x if x < 1.0 => 1.5 * x * x * x - 2.5 * x * x + 1.0,
        x if x < 2.0 => -0.5 * x * x * x + 2.5 * x * x - 4.0 * x + 2.0,
        _ => 0.0,
    };
    let tent = |x: f64| (1.0 - x.abs()).max(0.0);
    let sum = |kernel: &dyn Fn(f64) -> f64, reach: isize| {
        let mut sum = 0.0;
        for i in 1 - reach..=reach {
            for j in 1 - reach..=reach {
                let (row, col) = (r.floor() as isize + i, c.floor() as isize + j);
                let weight = kernel(r - row as f64) * kernel(c - col as f64);
                sum += if weight == 0.0 && reach == 1 { 0.0 } else { weight * at(row, col) };
            }
        }
        sum
    };
    let cubic = sum(&keys, 2);
    if cubic.is_finite() { cubic } else { sum(&tent, 1) }
}

/// Returns all lines; rows are pushed only when they are needed, or as early as they are accepted.
fn lines(posts: &[f32], grid: PostGrid, count: usize, px: usize, early: bool) -> Vec<f32> {
    let mut memory = vec![f32::INFINITY; Posts::memory_len(grid.cols)];
    let mut made = Posts::new(grid, &mut memory).unwrap();
    let mut rows = posts.chunks_exact(grid.cols).peekable();
    let (mut out, mut line) = (vec![], vec![0.0; px]);
    for number in 0..count {
        while early && rows.peek().is_some_and(|row| made.push_row(row) == Ok(())) {
            rows.next();
        }
        while made.line(&mut line).inspect(|found| assert_eq!(*found, number)).is_none() {
            match rows.next() {
                Some(row) => made.push_row(row).unwrap(),
                None => made.finish(),
            }
        }
        out.extend_from_slice(&line);
    }
    out
}

proptest! {
    #[test]
    fn rows_one_by_one_are_the_whole_grid(
        rows in 1_usize..9, cols in 1_usize..7, first in (-9.0..9.0_f64, -9.0..9.0_f64), spacing in (0.7..9.0_f64, 0.7..9.0_f64),
        seed in any::<u64>(), gaps in 0_u64..20,
    ) {
        let mut state = seed;
        let mut next = || { state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); state >> 33 };
        let posts: Vec<f32> =
            (0..rows * cols).map(|_| if next() % 100 < gaps { f32::NAN } else { (next() % 1000) as f32 / 8.0 }).collect();
        let grid = PostGrid::spaced(cols, first, spacing);
        let (late, early) = (lines(&posts, grid, 40, 30, false), lines(&posts, grid, 40, 30, true));
        for (i, (a, b)) in late.iter().zip(&early).enumerate() {
            prop_assert!(a.to_bits() == b.to_bits());
            let expected = naive(&posts, &grid, i / 30, i % 30);
            prop_assert_eq!(a.is_nan(), expected.is_nan(), "{}: {} {}", i, a, expected);
            // About 60 roundings of numbers below 500 (continued over two posts).
            prop_assert!(a.is_nan() || (f64::from(*a) - expected).abs() < 3e-3, "{}: {} {}", i, a, expected);
        }
    }
}

#[test]
fn rows_are_refused_while_the_oldest_is_needed() {
    let mut memory = [0.0; Posts::memory_len(3)];
    let mut posts = Posts::new(PostGrid::spaced(3, (0.0, 0.0), (2.0, 2.0)), &mut memory).unwrap();
    let mut line = [0.0; 5];
    assert_eq!(posts.line(&mut line), None);
    for row in 0..4 {
        posts.push_row(&[row as f32; 3]).unwrap();
    }
    assert_eq!(posts.push_row(&[9.0; 3]), Err(StripError::Full));
    assert_eq!(posts.push_row(&[9.0; 2]), Err(StripError::Line(LengthError { expected: 3, found: 2 })));
    for expected in [0.0, 0.5, 1.0, 1.5] {
        assert!(posts.line(&mut line).is_some());
        assert_eq!(line, [expected; 5]);
    }
    assert_eq!(posts.line(&mut line), None, "the line on row 2 wants row 4");
    posts.finish();
    assert_eq!(posts.push_row(&[9.0; 3]), Err(StripError::Ended));
    let rest: Vec<f32> =
        (4..9).map(|number| (posts.line(&mut line) == Some(number)).then_some(line[0]).unwrap()).collect();
    assert_eq!(rest[..4], [2.0, 2.5, 3.0, 3.5]);
    assert!(rest[4].is_nan(), "beyond the outer edge");
}

#[test]
fn odd_grids_are_refused_and_strange_ones_harmless() {
    let good = PostGrid::spaced(3, (0.0, 0.0), (2.0, 2.0));
    let mut memory = [0.0; Posts::memory_len(3)];
    for bad in [
        PostGrid { cols: 0, ..good },
        PostGrid { rows_per_line: 0.0, ..good },
        PostGrid { rows_per_line: -0.1, ..good },
        PostGrid { row0: f64::NAN, ..good },
        PostGrid { col0: f64::INFINITY, ..good },
        PostGrid::spaced(3, (0.0, 0.0), (0.0, 1.0)),
    ] {
        assert_eq!(Posts::new(bad, &mut memory).unwrap_err(), StripError::Posts, "{bad:?}");
    }
    let short = Posts::new(good, &mut memory[1..]).unwrap_err();
    assert_eq!(short, StripError::Memory(LengthError { expected: 28, found: 27 }));
    let mut line = [0.0; 4];
    for strange in [
        PostGrid { row0: 1e300, ..good },
        PostGrid { row0: -1e300, ..good },
        PostGrid { rows_per_line: 1e300, ..good },
        PostGrid { col0: -1e300, cols_per_px: 1e300, ..good },
    ] {
        let mut posts = Posts::new(strange, &mut memory).unwrap();
        let mut pushed = 0;
        while pushed < 20 && posts.push_row(&[1.0; 3]).is_ok() {
            pushed += 1;
        }
        posts.finish();
        for number in 0..5 {
            assert_eq!(posts.line(&mut line), Some(number));
        }
    }
    let mut empty = Posts::new(good, &mut memory).unwrap();
    empty.finish();
    assert_eq!(empty.line(&mut line), Some(0));
    assert!(line.iter().all(|z| z.is_nan()));
}
