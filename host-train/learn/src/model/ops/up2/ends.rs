//! The ends of [`super::border`]'s strips along rows, without what belongs to the strips along columns.
//!
//! A strip convolves its upsampled small row with zeros beyond its ends. At each end, the part of the first two pixels that depends on the
//! outermost small pixel as in a strip along columns is subtracted: the folded kernels are folded once more, along the strip.

use super::super::correlate::correlate;
use super::super::frame::Frame;
use super::super::product::{Area, Taps, multiply};
use super::super::scratch::Scratch;
use super::fold::{FIRST, Fold, LAST, OUT};
use super::shape::{SIDE, Up2Shape};

/// The two ends: their shares of folded kernels, counted from the end.
const ENDS: [&Fold; 2] = [&FIRST, &LAST];

/// Returns the position along a strip of `length` of a value at `deep` from an end.
fn place(end: usize, deep: usize, length: usize) -> usize {
    if end == 0 { deep } else { length - 1 - deep }
}

/// Returns the layout of lines of one number per image.
fn frame(shape: &Up2Shape) -> Frame {
    Frame::new(1, [1, shape.images], [0, 0])
}

/// Returns numbers `[.., images]` as lines.
fn lines(frame: &Frame, images: usize, numbers: &[f32]) -> Scratch {
    let mut lines = Scratch::new(numbers.len() / images * frame.length);
    frame.fill(&mut lines, |line, _, _, to| {
        to[..images].copy_from_slice(&numbers[line * images..][..images]);
        images
    });
    lines
}

/// Returns the negative weights of an end, `[OUT, OUT * outputs, inputs]`, from folded kernels `[OUT * outputs, inputs, SIDE]`.
fn fold(folded: &[f32], end: usize) -> Vec<f32> {
    let of = |shares: [f32; SIDE]| {
        let kernels = folded.as_chunks::<SIDE>().0.iter();
        kernels.map(move |kernel| -(0..SIDE).map(|i| shares[i] * kernel[place(end, i, SIDE)]).sum::<f32>())
    };
    ENDS[end].iter().flat_map(|shares| of(*shares)).collect()
}

/// Subtracts from strips `[OUT * outputs, images, columns]` what belongs to the strips along columns. `corners` are the small pixels at the
/// ends, `[ends, inputs, images]`.
pub(super) fn forward(corners: &[f32], folded: &[f32], shape: &Up2Shape, strips: &mut [f32]) {
    let ([inputs, outputs], images, frame) = (shape.channels, shape.images, frame(shape));
    let (columns, wide) = ((0..inputs).collect::<Vec<_>>(), 2 * shape.small[1]);
    let mut found = Scratch::new(OUT * OUT * outputs * images);
    for (end, corners) in corners.chunks_exact(inputs * images).enumerate() {
        let shifts = (0..inputs).map(|i| frame.neighbour(i, 0, 0)).collect();
        let taps = Taps::new(OUT * OUT * outputs, shifts, &fold(folded, end), |m| m * inputs, &columns);
        let area = Area { origin: [0, 0], size: [1, images] };
        multiply(&taps, &lines(&frame, images, corners), &frame, area, &mut found);
        for (deep, found) in found.chunks_exact(OUT * outputs * images).enumerate() {
            let at = strips.iter_mut().skip(place(end, deep, wide)).step_by(wide);
            at.zip(found).for_each(|(to, value)| *to += value);
        }
    }
}

/// The gradients at the ends, `[ends, OUT, OUT * outputs, images]`.
pub(super) struct Slope(Vec<f32>);

impl Slope {
    /// Takes them from the lines of the strips' gradient.
    pub(super) fn new(shape: &Up2Shape, strips: &Frame, gradient: &[f32]) -> Self {
        let mut found = Vec::new();
        for (end, deep) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let along = place(end, deep, 2 * shape.small[1]);
            for line in gradient.chunks_exact(strips.length) {
                found.extend((0..shape.images).map(|image| line[strips.at(image, 0, along)]));
            }
        }
        Self(found)
    }

    /// Returns the gradients of the corners, `[ends, inputs, images]`.
    pub(super) fn of_corners(&self, folded: &[f32], shape: &Up2Shape) -> Vec<f32> {
        let ([inputs, outputs], images, frame) = (shape.channels, shape.images, frame(shape));
        let depth = OUT * OUT * outputs;
        let columns: Vec<usize> = (0..depth).map(|k| k * inputs).collect();
        let mut found = vec![0.0; 2 * inputs * images];
        for (end, found) in found.chunks_exact_mut(inputs * images).enumerate() {
            let shifts = (0..depth).map(|k| frame.neighbour(k, 0, 0)).collect();
            let taps = Taps::new(inputs, shifts, &fold(folded, end), |m| m, &columns);
            let lines = lines(&frame, images, &self.0[end * depth * images..][..depth * images]);
            multiply(&taps, &lines, &frame, Area { origin: [0, 0], size: [1, images] }, found);
        }
        found
    }

    /// Adds the gradient of the folded kernels to `folded`.
    pub(super) fn of_weight(&self, corners: &[f32], shape: &Up2Shape, folded: &mut [f32]) {
        let ([inputs, outputs], images, frame) = (shape.channels, shape.images, frame(shape));
        let depth = OUT * OUT * outputs;
        let shifts: Vec<usize> = (0..inputs).map(|i| frame.neighbour(i, 0, 0)).collect();
        for (end, corners) in corners.chunks_exact(inputs * images).enumerate() {
            let gradient = lines(&frame, images, &self.0[end * depth * images..][..depth * images]);
            let found = correlate(&gradient, &lines(&frame, images, corners), &shifts, &frame);
            for (shares, found) in ENDS[end].iter().zip(found.chunks_exact(OUT * outputs * inputs)) {
                for (kernel, value) in folded.as_chunks_mut::<SIDE>().0.iter_mut().zip(found) {
                    (0..SIDE).for_each(|i| kernel[place(end, i, SIDE)] -= shares[i] * value);
                }
            }
        }
    }
}
