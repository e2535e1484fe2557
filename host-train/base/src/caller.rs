//! A caller in this process: it hears what work says, and may stop it. Without one, work speaks to the person who started the program.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What work says besides its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Said<'t> {
    /// The result is probably not what the user meant.
    Warning(&'t str),
    /// What else the user should know.
    Note(&'t str),
    /// What was chosen, and how long it took.
    Detail(&'t str),
    /// How far the work is.
    Progress {
        /// Name of the work; empty for that of the command.
        what: &'t str,
        /// Pieces that are done.
        done: u64,
        /// All pieces.
        all: u64,
        /// Name of the pieces.
        unit: &'t str,
    },
}

/// A caller in this process.
pub struct Caller {
    asked: AtomicBool,
    hear: Box<dyn Fn(Said<'_>) + Send + Sync>,
}

thread_local! {
    static CALLER: RefCell<Option<Arc<Caller>>> = const { RefCell::new(None) };
}

impl Caller {
    /// Makes a caller that hears by `hear`.
    #[must_use]
    pub fn new(hear: impl Fn(Said<'_>) + Send + Sync + 'static) -> Arc<Self> {
        Arc::new(Self { asked: AtomicBool::new(false), hear: Box::new(hear) })
    }

    /// Asks the work to stop at its next safe point.
    pub fn stop(&self) {
        self.asked.store(true, Ordering::SeqCst);
    }

    /// Returns whether the work is asked to stop.
    #[must_use]
    pub fn asks_to_stop(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }

    /// Runs work on this thread for the caller. Other threads that the work starts have no caller.
    pub fn run<T>(self: &Arc<Self>, work: impl FnOnce() -> T) -> T {
        // Also if the work panics, the thread is free again.
        struct Before(Option<Arc<Caller>>);
        impl Drop for Before {
            fn drop(&mut self) {
                CALLER.set(self.0.take());
            }
        }
        let _before = Before(CALLER.replace(Some(Arc::clone(self))));
        work()
    }

    pub(crate) fn hear(&self, said: Said<'_>) {
        (self.hear)(said);
    }
}

/// Returns the caller that this thread works for.
#[must_use]
pub fn current() -> Option<Arc<Caller>> {
    CALLER.with_borrow(Clone::clone)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{interrupt, progress, say};
    use std::sync::Mutex;

    #[test]
    fn a_caller_hears_and_stops_its_own_thread_alone() {
        let heard = Arc::new(Mutex::new(vec![]));
        let kept = Arc::clone(&heard);
        let caller = Caller::new(move |said| kept.lock().unwrap().push(format!("{said:?}")));
        let found = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            caller.run(|| {
                say::warning("w");
                say::note("n");
                let bar = progress::bar("tour", 4, "tiles");
                bar.inc(3);
                assert!(!interrupt::requested());
                caller.stop();
                interrupt::listen();
                assert!(interrupt::requested());
                assert!(interrupt::check("test").unwrap_err().to_string().contains("test: interrupted"));
                panic!("the work fails");
            });
        }));
        assert!(found.is_err() && current().is_none() && !interrupt::requested());
        let heard = heard.lock().unwrap();
        assert_eq!(heard[..2], ["Warning(\"w\")", "Note(\"n\")"]);
        assert_eq!(heard.last().unwrap(), "Progress { what: \"tour\", done: 3, all: 4, unit: \"tiles\" }");
    }
}
