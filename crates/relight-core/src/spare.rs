//! Buffers that threads hand on to one another.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Things that nobody uses now: as many as were in use at once. Made anew for each piece of work, large buffers take more
/// time for their pages than for what is written to them.
#[derive(Debug)]
pub struct Spare<T>(Mutex<Vec<T>>);

impl<T> Default for Spare<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T: Default> Spare<T> {
    /// One that was given back, as it was then, or a new one.
    pub fn take(&self) -> T {
        self.list().pop().unwrap_or_default()
    }

    /// Gives it back.
    pub fn give(&self, thing: T) {
        self.list().push(thing);
    }

    fn list(&self) -> MutexGuard<'_, Vec<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_given_back_is_taken_before_a_new_one() {
        let spare = Spare::<Vec<u8>>::default();
        assert!(spare.take().is_empty());
        spare.give(vec![1, 2]);
        assert_eq!((spare.take(), spare.take()), (vec![1, 2], Vec::new()));
    }
}
