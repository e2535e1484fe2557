//! Text in pictures, with a built-in font.

use super::canvas::Canvas;
use super::font::FONT;
use image::RgbImage;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The part of the text that lies at the given column. The text's vertical middle lies at the given row.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    /// The left end.
    Left,
    /// The middle.
    Middle,
}

/// Writes dark text of `size` pixels onto the picture. The part beyond the picture is cut off.
pub(super) fn write(picture: &mut RgbImage, text: &str, col: u32, row: u32, size: u32, anchor: Anchor) {
    let horizontal = match anchor {
        Anchor::Left => HPos::Left,
        Anchor::Middle => HPos::Center,
    };
    let style = (FONT, size).into_font().color(&RGBColor(30, 30, 30)).pos(Pos::new(horizontal, VPos::Center));
    let area = Canvas::new(picture).into_drawing_area();
    // Drawing into memory cannot fail; text outside is clipped.
    let drawn = area.draw_text(text, &style, (col as i32, row as i32));
    debug_assert!(drawn.is_ok(), "text drawn into memory");
}
