//! State as plain words: for callers that keep only numbers between two calls, such as a C interface whose memory radiation may change.
//!
//! One list of fields serves both ways. Reading accepts any words: what is not a value of its type is noted ([`Words::is_legal`]).

/// Words that are written or read one after another.
pub(crate) struct Words<'w> {
    words: &'w mut [u64],
    at: usize,
    is_reading: bool,
    is_legal: bool,
}

impl<'w> Words<'w> {
    pub(crate) fn writing(words: &'w mut [u64]) -> Self {
        Self { words, at: 0, is_reading: false, is_legal: true }
    }

    pub(crate) fn reading(words: &'w mut [u64]) -> Self {
        Self { words, at: 0, is_reading: true, is_legal: true }
    }

    /// Returns whether there were as many words as fields, and every word read was a value of its field.
    pub(crate) fn is_legal(&self) -> bool {
        self.is_legal && self.at == self.words.len()
    }

    /// Writes or reads a word.
    pub(crate) fn u64(&mut self, value: &mut u64) {
        match self.words.get_mut(self.at) {
            Some(word) if self.is_reading => *value = *word,
            Some(word) => *word = *value,
            None => self.is_legal = false,
        }
        self.at = self.at.saturating_add(1);
    }

    pub(crate) fn u32(&mut self, value: &mut u32) {
        let mut word = u64::from(*value);
        self.u64(&mut word);
        self.is_legal &= u32::try_from(word).is_ok();
        *value = word as u32;
    }

    pub(crate) fn usize(&mut self, value: &mut usize) {
        let mut word = *value as u64;
        self.u64(&mut word);
        self.is_legal &= usize::try_from(word).is_ok();
        *value = word as usize;
    }

    pub(crate) fn f64(&mut self, value: &mut f64) {
        let mut word = value.to_bits();
        self.u64(&mut word);
        *value = f64::from_bits(word);
    }

    pub(crate) fn f32(&mut self, value: &mut f32) {
        let mut bits = value.to_bits();
        self.u32(&mut bits);
        *value = f32::from_bits(bits);
    }

    pub(crate) fn bool(&mut self, value: &mut bool) {
        self.choice(value, &[false, true]);
    }

    /// Writes or reads one of several values by its number.
    pub(crate) fn choice<T: Copy + PartialEq>(&mut self, value: &mut T, all: &[T]) {
        let mut number = all.iter().position(|one| one == value).unwrap_or(usize::MAX) as u64;
        self.u64(&mut number);
        match usize::try_from(number).ok().and_then(|number| all.get(number)) {
            Some(found) => *value = *found,
            None => self.is_legal = false,
        }
    }

    /// Writes or reads a value that may be absent; `empty` is what an absent one is written as.
    pub(crate) fn option<T: Copy>(&mut self, value: &mut Option<T>, empty: T, each: impl Fn(&mut T, &mut Self)) {
        let (mut is_there, mut inner) = (value.is_some(), value.unwrap_or(empty));
        self.bool(&mut is_there);
        each(&mut inner, self);
        *value = is_there.then_some(inner);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visit(all: &mut (u32, usize, f64, f32, bool, Option<f32>), words: &mut Words<'_>) {
        words.u32(&mut all.0);
        words.usize(&mut all.1);
        words.f64(&mut all.2);
        words.f32(&mut all.3);
        words.bool(&mut all.4);
        words.option(&mut all.5, 0.0, |v, words| words.f32(v));
    }

    #[test]
    fn what_is_written_is_read_and_other_words_are_noted() {
        let mut words = [9; 7];
        let mut all = (7, 8, -0.5, f32::INFINITY, true, Some(3.0));
        let mut writer = Words::writing(&mut words);
        visit(&mut all, &mut writer);
        assert!(writer.is_legal());
        let mut again = (0, 0, 0.0, 0.0, false, None);
        let mut reader = Words::reading(&mut words);
        visit(&mut again, &mut reader);
        assert!(reader.is_legal() && again == all);
        for (at, word) in [(0, 1 << 32), (4, 2), (5, 3), (3, u64::MAX)] {
            let mut spoilt = words;
            spoilt[at] = word;
            let mut reader = Words::reading(&mut spoilt);
            visit(&mut again, &mut reader);
            assert!(!reader.is_legal(), "word {at}");
        }
        // One word too few, and one too many.
        let mut reader = Words::reading(&mut words[1..]);
        visit(&mut again, &mut reader);
        assert!(!reader.is_legal());
        let mut more = [0; 8];
        let mut writer = Words::writing(&mut more);
        visit(&mut all, &mut writer);
        assert!(!writer.is_legal());
    }
}
