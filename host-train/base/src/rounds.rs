//! Items of work, several at a time, in rounds: what may succeed later is tried again.

use crate::Result;
use std::collections::VecDeque;
use std::panic::resume_unwind;
use std::sync::Mutex;
use std::sync::mpsc::{Sender, channel};

/// What became of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ItemEnd {
    /// Made, now or before.
    Done,
    /// It never succeeds as it is.
    Failed,
    /// It may succeed later.
    TryAgain,
}

/// Numbers of items, by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ItemCounts {
    /// Made, now or before.
    pub done: usize,
    /// Never succeeds.
    pub failed: usize,
    /// May succeed later, or was not begun.
    pub again: usize,
}

/// How items are worked on.
pub struct ItemRounds<'m, T, R> {
    /// Number of items at a time, each in a slot, from 1 on.
    pub slots: usize,
    /// Works on an item in a slot.
    pub attempt: &'m (dyn Fn(&T, usize) -> R + Sync),
    /// Returns whether no further item may begin.
    pub stops: &'m (dyn Fn() -> bool + Sync),
}

impl<T: Sync, R: Send> ItemRounds<'_, T, R> {
    /// Works on all items, and passes what each attempt gave to `tell`, which judges it. What may succeed later is tried again as long as `waits`,
    /// which waits for the next round, returns true.
    ///
    /// # Errors
    /// Errors of `tell`.
    pub fn run<'t>(
        &self,
        items: &[&'t T],
        tell: &mut dyn FnMut(&'t T, R) -> Result<ItemEnd>,
        waits: &mut dyn FnMut() -> bool,
    ) -> Result<ItemCounts> {
        let (mut counts, mut left) = (ItemCounts::default(), items.to_vec());
        loop {
            let (mut begun, mut again) = (0, vec![]);
            self.round(&left, &mut |item, outcome| {
                begun += 1;
                match tell(item, outcome)? {
                    ItemEnd::Done => counts.done += 1,
                    ItemEnd::Failed => counts.failed += 1,
                    ItemEnd::TryAgain => again.push(item),
                }
                Ok(())
            })?;
            if again.is_empty() || (self.stops)() || !waits() {
                counts.again = again.len() + left.len() - begun;
                return Ok(counts);
            }
            left = again;
        }
    }

    /// Works on items once.
    fn round<'t>(&self, items: &[&'t T], tell: &mut dyn FnMut(&'t T, R) -> Result<()>) -> Result<()> {
        let waiting = Mutex::new(items.iter().copied().collect());
        std::thread::scope(|scope| {
            let (send, receive) = channel();
            let start = |slot| {
                let (waiting, send) = (&waiting, send.clone());
                scope.spawn(move || self.work(waiting, slot, &send))
            };
            let workers: Vec<_> = (1..=self.slots.clamp(1, items.len().max(1))).map(start).collect();
            drop(send);
            let told = receive.into_iter().try_for_each(|(item, outcome)| tell(item, outcome));
            workers.into_iter().for_each(|worker| worker.join().unwrap_or_else(|why| resume_unwind(why)));
            told
        })
    }

    fn work<'t>(&self, waiting: &Mutex<VecDeque<&'t T>>, slot: usize, send: &Sender<(&'t T, R)>) {
        while !(self.stops)() {
            let Some(item) = waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop_front() else {
                return;
            };
            if send.send((item, (self.attempt)(item, slot))).is_err() {
                return;
            }
        }
    }
}
