//! Ctrl-C as a flag that long loops read, so that the program does not end at once.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();

/// Installs the handler. The first Ctrl-C (or SIGTERM) then sets the flag that [`requested`] reads; the second ends the program.
pub fn listen() {
    HANDLER.call_once(|| {
        let installed = ctrlc::set_handler(|| {
            if ASKED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
            eprintln!("\nstopping at the next safe point; press Ctrl-C again to stop at once");
        });
        if let Err(error) = installed {
            eprintln!("note: Ctrl-C will stop at once ({error})");
        }
    });
}

/// Returns whether the user has asked to stop.
pub fn requested() -> bool {
    ASKED.load(Ordering::SeqCst)
}
