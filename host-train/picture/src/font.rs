//! The built-in font.

use plotters::style::{FontStyle, register_font};
use std::sync::Once;

/// Name of the font in plotters.
pub const FONT: &str = "sans-serif";

/// Registers the font with plotters, which asks for it; later calls do nothing.
pub(super) fn install_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for style in [FontStyle::Normal, FontStyle::Bold] {
            // This fails only for bytes that are not a font.
            let registered = register_font(FONT, style, epaint_default_fonts::UBUNTU_LIGHT);
            debug_assert!(registered.is_ok(), "the built-in font is a font");
        }
    });
}
