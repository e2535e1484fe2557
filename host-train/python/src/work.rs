//! Work without the interpreter: on threads of its own, while the caller's thread waits for progress and Ctrl-C.

use crate::errors::{named, raise};
use elunar_base::Result;
use elunar_base::caller::{Caller, Said};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two looks at the interpreter's signals.
const LOOK: Duration = Duration::from_millis(50);

/// How far the work is: its name, pieces done, all pieces, name of the pieces.
type Progress = (String, u64, u64, String);

/// What work has said and not yet passed on.
#[derive(Default)]
struct Heard {
    progress: Option<Progress>,
    said: Vec<(&'static str, String)>,
}

/// What work returns, and what it said: kind and text.
pub(crate) type Worked<T> = (T, Vec<(&'static str, String)>);

/// Runs `work` on `threads` threads (0: as many as there are) without the interpreter. `progress` is called with (name of the work, pieces done,
/// all pieces, name of the pieces). An exception that it raises, and Ctrl-C, stop the work.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    threads: usize,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<Worked<T>> {
    let heard = Arc::new(Mutex::new(Heard::default()));
    let caller = Caller::new({
        let heard = Arc::clone(&heard);
        move |said| hear(&mut heard.lock().unwrap_or_else(PoisonError::into_inner), said)
    });
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|why| named(py, "no_memory", format!("not enough memory or threads: {why}")))?;
    let tell = || -> PyResult<()> {
        let news = heard.lock().unwrap_or_else(PoisonError::into_inner).progress.take();
        match (news, progress) {
            (Some(news), Some(progress)) => progress.call1(news).map(drop),
            _ => Ok(()),
        }
    };
    let here = thread::current();
    let mut raised = None;
    let ended = thread::scope(|scope| {
        let by = &caller;
        let running = scope.spawn(move || {
            // Also if the work panics, the other thread need not wait.
            struct Wake(thread::Thread);
            impl Drop for Wake {
                fn drop(&mut self) {
                    self.0.unpark();
                }
            }
            let _wake = Wake(here);
            pool.install(|| by.run(work))
        });
        while !running.is_finished() {
            py.detach(|| thread::park_timeout(LOOK));
            if raised.is_none() {
                raised = tell().and_then(|()| py.check_signals()).err();
                raised.iter().for_each(|_| caller.stop());
            }
        }
        py.detach(|| running.join())
    });
    if let Some(raised) = raised {
        return Err(raised);
    }
    let text = |panic: Box<dyn std::any::Any + Send>| match panic.downcast::<String>() {
        Ok(text) => *text,
        Err(other) => other.downcast_ref::<&str>().map_or("unknown", |text| text).to_string(),
    };
    let ended = ended.map_err(|panic| named(py, "defect", format!("a defect of this program: {}", text(panic))))?;
    let made = ended.map_err(|error| raise(py, &error))?;
    tell()?;
    let said = std::mem::take(&mut heard.lock().unwrap_or_else(PoisonError::into_inner).said);
    Ok((made, said))
}

fn hear(heard: &mut Heard, said: Said<'_>) {
    match said {
        Said::Warning(text) => heard.said.push(("warning", text.into())),
        Said::Note(text) => heard.said.push(("note", text.into())),
        Said::Detail(text) => heard.said.push(("detail", text.into())),
        Said::Progress { what, done, all, unit } => {
            heard.progress = Some((what.into(), done, all, unit.into()));
        }
    }
}
