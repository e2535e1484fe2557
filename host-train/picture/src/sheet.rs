//! Several pictures on one sheet, with captions.

use super::text::{Anchor, write};
use image::{DynamicImage, Rgb, RgbImage, imageops};

/// Space between panels, pixels.
const GAP_PX: u32 = 8;
/// Height of a caption, pixels.
const CAPTION_PX: u32 = 20;

/// One picture of a sheet.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Description; one line, may be empty.
    pub caption: String,
    /// The picture.
    pub picture: RgbImage,
}

impl Panel {
    /// Makes a panel.
    pub fn new(caption: impl Into<String>, picture: impl Into<DynamicImage>) -> Self {
        Self { caption: caption.into(), picture: picture.into().into_rgb8() }
    }
}

/// Puts panels side by side, at most `columns` per row and in rows as even as can be, each caption above its picture. Pictures wider than `panel_px` are reduced to that width
/// with their proportions. Without panels the sheet has one pixel.
pub fn sheet(panels: &[Panel], columns: usize, panel_px: u32) -> RgbImage {
    let shrunk: Vec<RgbImage> = panels.iter().map(|panel| shrink(&panel.picture, panel_px)).collect();
    let rows = panels.len().div_ceil(columns.max(1)).max(1);
    let columns = panels.len().div_ceil(rows).max(1);
    let widest = shrunk.iter().map(RgbImage::width).max().unwrap_or(0);
    let row_heights: Vec<u32> = shrunk
        .chunks(columns)
        .map(|row| row.iter().map(RgbImage::height).max().unwrap_or(0) + CAPTION_PX + GAP_PX)
        .collect();
    let used = columns.min(panels.len()) as u32;
    let (width, height) = (GAP_PX + used * (widest + GAP_PX), GAP_PX + row_heights.iter().sum::<u32>());
    let mut out = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    for (k, (panel, picture)) in panels.iter().zip(&shrunk).enumerate() {
        let top = GAP_PX + row_heights[..k / columns].iter().sum::<u32>();
        let left = GAP_PX + (k % columns) as u32 * (widest + GAP_PX);
        write(&mut out, &panel.caption, left, top + CAPTION_PX / 2, 15, Anchor::Left);
        imageops::replace(&mut out, picture, i64::from(left), i64::from(top + CAPTION_PX));
    }
    out
}

fn shrink(picture: &RgbImage, width: u32) -> RgbImage {
    if picture.width() <= width || width == 0 {
        return picture.clone();
    }
    let height = (u64::from(picture.height()) * u64::from(width) / u64::from(picture.width())).max(1) as u32;
    imageops::thumbnail(picture, width, height)
}
