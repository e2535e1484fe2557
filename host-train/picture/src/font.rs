//! The built-in font.

/// Name of the font in plotters.
pub const FONT: &str = "sans-serif";

/// Registers the font with plotters, which asks for it; later calls do nothing.
#[cfg(not(target_family = "wasm"))]
pub(super) fn install_font() {
    use plotters::style::{FontStyle, register_font};
    use std::sync::Once;
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for style in [FontStyle::Normal, FontStyle::Bold] {
            // This fails only for bytes that are not a font.
            let registered = register_font(FONT, style, epaint_default_fonts::UBUNTU_LIGHT);
            debug_assert!(registered.is_ok(), "the built-in font is a font");
        }
    });
}

/// On WebAssembly nothing draws text.
#[cfg(target_family = "wasm")]
pub(super) fn install_font() {}
