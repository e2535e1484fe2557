//! A picture to draw on with plotters, whose letters stand where the font puts them.
//!
//! Plotters itself cuts the fraction off every letter's place and leaves out the space on its left, so that letters run into each other.

use super::font::install_font;
use ab_glyph::{Font as _, FontRef, PxScaleFont, ScaleFont as _, point};
use image::RgbImage;
use plotters::prelude::{BitMapBackend, DrawingBackend};
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind};
use std::sync::LazyLock;

/// The built-in font; none only if its bytes were not a font.
static FONT: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok());

type Drawn<E> = std::result::Result<(), DrawingErrorKind<E>>;
type Failure = <BitMapBackend<'static> as DrawingBackend>::ErrorType;

/// A drawing backend over a picture in memory. All text has the built-in font.
pub struct Canvas<'a>(BitMapBackend<'a>);

impl<'a> Canvas<'a> {
    /// Draws on `picture`.
    pub fn new(picture: &'a mut RgbImage) -> Self {
        install_font();
        let size = picture.dimensions();
        Self(BitMapBackend::with_buffer(picture.as_mut(), size))
    }
}

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Failure;

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Drawn<Failure> {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Drawn<Failure> {
        self.0.present()
    }

    fn draw_pixel(&mut self, at: BackendCoord, colour: BackendColor) -> Drawn<Failure> {
        self.0.draw_pixel(at, colour)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn<Failure> {
        self.0.draw_line(from, to, style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn<Failure> {
        self.0.draw_rect(upper_left, bottom_right, style, fill)
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn<Failure> {
        let ((width, height), anchor) = (extent(text, style.size()), style.anchor());
        let left = match anchor.h_pos {
            HPos::Left => 0,
            HPos::Right => -width,
            HPos::Center => -width / 2,
        };
        let top = match anchor.v_pos {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        let (turn, size, colour) = (style.transform(), self.get_size(), style.color());
        for (col, row, share) in letters(text, style.size()) {
            let (col, row) = turn.transform(col + left, row + top);
            let (col, row) = (at.0 + col, at.1 + row);
            let inside = |at: i32, count: u32| u32::try_from(at).is_ok_and(|at| at < count);
            if inside(col, size.0) && inside(row, size.1) {
                self.draw_pixel((col, row), colour.mix(f64::from(share)))?;
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> std::result::Result<(u32, u32), DrawingErrorKind<Failure>> {
        let (width, height) = extent(text, style.size());
        Ok((width.unsigned_abs(), height.unsigned_abs()))
    }
}

/// A line of text in pixels.
struct Line {
    font: PxScaleFont<&'static FontRef<'static>>,
    /// Letters with their places along the line.
    letters: Vec<(char, f32)>,
    /// The place behind the last one.
    end: f32,
}

impl Line {
    fn of(text: &str, size: f64) -> Option<Self> {
        let font = FONT.as_ref()?.as_scaled(size as f32);
        let (mut end, mut before, mut letters) = (0.0, None, Vec::new());
        for letter in text.chars() {
            let glyph = font.glyph_id(letter);
            end += before.map_or(0.0, |before| font.kern(before, glyph));
            letters.push((letter, end));
            end += font.h_advance(glyph);
            before = Some(glyph);
        }
        Some(Self { font, letters, end })
    }
}

/// Returns width and height of a text of `size` pixels. The height is that of plotters: of capital letters with what hangs below.
fn extent(text: &str, size: f64) -> (i32, i32) {
    let width = Line::of(text, size).map_or(0.0, |line| line.end);
    (width.ceil() as i32, (size / 1.24) as i32)
}

/// Returns the pixels that letters cover, from the text's upper left: column, row, and the share that is covered.
fn letters(text: &str, size: f64) -> Vec<(i32, i32, f32)> {
    let (mut pixels, Some(line)) = (Vec::new(), Line::of(text, size)) else { return vec![] };
    // Whole rows keep level strokes sharp.
    let base = (size / 2.0 + size / 4.8).round() as f32;
    for (letter, at) in line.letters {
        let mut glyph = line.font.scaled_glyph(letter);
        glyph.position = point(at, base);
        let Some(outline) = line.font.outline_glyph(glyph) else { continue };
        let corner = outline.px_bounds().min;
        outline
            .draw(|col, row, share| pixels.push((corner.x as i32 + col as i32, corner.y as i32 + row as i32, share)));
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the dark columns of a text, as a picture of `#` and blanks.
    fn columns(text: &str, size: f64) -> String {
        let mut dark = vec![0.0_f32; 200];
        letters(text, size).iter().for_each(|(col, _, share)| dark[*col as usize] = dark[*col as usize].max(*share));
        dark.iter().map(|share| if *share > 0.3 { '#' } else { ' ' }).collect::<String>().trim().to_string()
    }

    #[test]
    fn letters_stand_apart_and_words_farther() {
        for size in [13.0, 14.0, 15.0, 18.0, 20.0] {
            // Upright strokes: as many as letters.
            assert_eq!(columns("illilill", size).split_whitespace().count(), 8, "{size}");
            // "cl" must not be a "d".
            assert_eq!(columns("cl", size).split_whitespace().count(), 2, "{size}");
            let gap = |text: &str| columns(text, size).split('#').map(str::len).max();
            assert!(gap("l l") > gap("ll"), "{size}");
        }
        assert!(extent("interpolated", 15.0).0 > 2 * extent("inter", 15.0).0);
        assert_eq!((extent("", 15.0).0, letters(" ", 15.0).len()), (0, 0));
    }
}
