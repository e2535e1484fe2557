//! Blocks, mesas, cobbles, and the pits of the same shapes: cells of a Voronoi diagram with a warped border.

use super::{Canvas, smooth_step};
use rand::Rng;

/// One cell: its centre, pixels, and its height over that of a whole block; 0: none.
#[derive(Clone, Copy)]
struct Cell {
    row: f32,
    col: f32,
    tall: f32,
}

/// Draws heights in pixels.
pub(super) fn draw(canvas: &mut Canvas) -> Vec<f32> {
    let side = canvas.length(8.0, 70.0);
    let warp = canvas.within(0.0, 0.3) * side;
    let [warp_down, warp_across] = [0; 2].map(|_| canvas.noise(1.5 * side));
    let gap = canvas.within(0.02, 0.2) * side;
    let cliff = canvas.length(1.5, f64::from((0.3 * side).max(2.0)));
    let slope = canvas.within(0.15, 0.8);
    let sign = if canvas.rng.random_bool(0.25) { -1.0 } else { 1.0 };
    let cells = Cells::draw(canvas, side);
    let height = |pixel: usize| {
        let (row, col) = ((pixel / canvas.cols) as f32, (pixel % canvas.cols) as f32);
        let (row, col) = (row + warp * warp_down.at(pixel), col + warp * warp_across.at(pixel));
        let (tall, from_border) = cells.nearest(row, col);
        sign * slope * cliff * tall * smooth_step((from_border - gap) / cliff)
    };
    (0..canvas.rows * canvas.cols).map(height).collect()
}

/// Cells on a jittered grid that reaches two sides beyond the canvas.
struct Cells {
    side: f32,
    across: usize,
    down: usize,
    cells: Vec<Cell>,
}

/// Cells beyond each border of the canvas.
const BEYOND: usize = 3;

impl Cells {
    fn draw(canvas: &mut Canvas, side: f32) -> Self {
        let [down, across] = [canvas.rows, canvas.cols].map(|n| (n as f32 / side).ceil() as usize + 2 * BEYOND);
        let covered = f64::from(canvas.within(0.3, 1.0));
        let (rows, cols, mask) = (canvas.rows, canvas.cols, canvas.patches(0.2));
        let within = |at: f32, n: usize| (at.max(0.0) as usize).min(n - 1);
        let cell = |i: usize| {
            let [jitter_down, jitter_across] = [0; 2].map(|_| canvas.within(0.1, 0.9));
            let row = ((i / across) as f32 + jitter_down - BEYOND as f32) * side;
            let col = ((i % across) as f32 + jitter_across - BEYOND as f32) * side;
            // Blocks are whole or absent: the patch at their centre decides.
            let there = mask[within(row, rows) * cols + within(col, cols)] > 0.5 && canvas.rng.random_bool(covered);
            let tall = canvas.within(0.5, 1.5);
            Cell { row, col, tall: if there { tall } else { 0.0 } }
        };
        let cells = (0..down * across).map(cell).collect();
        Self { side, across, down, cells }
    }

    /// Returns the height of the nearest cell, and the distance from its border, pixels.
    fn nearest(&self, row: f32, col: f32) -> (f32, f32) {
        let place =
            |v: f32, n: usize| ((v / self.side).floor() as isize + BEYOND as isize).clamp(1, n as isize - 2) as usize;
        let (r, c) = (place(row, self.down), place(col, self.across));
        let around = (r - 1..=r + 1).flat_map(|r| (c - 1..=c + 1).map(move |c| (r, c)));
        let mut two = [(f32::INFINITY, 0.0); 2];
        for cell in around.map(|(r, c)| self.cells[r * self.across + c]) {
            let distance = libm::hypotf(row - cell.row, col - cell.col);
            if distance < two[0].0 {
                two = [(distance, cell.tall), two[0]];
            } else if distance < two[1].0 {
                two[1] = (distance, cell.tall);
            }
        }
        (two[0].1, 0.5 * (two[1].0 - two[0].0))
    }
}
