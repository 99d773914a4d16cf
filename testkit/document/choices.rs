//! Choices made of bytes: any bytes are some, and behind their end everything is the first and
//! simplest there is. So a fuzzer can mutate what was chosen, and a property test can shrink it.

/// Choices that are made one after the other.
#[derive(Debug)]
pub(super) struct Choices<'b> {
    bytes: std::slice::Iter<'b, u8>,
    /// One in so many values is one that nobody means; 0 for none.
    odd: usize,
}

impl<'b> Choices<'b> {
    /// The first byte says how often something is wrong: in one of two documents never.
    pub(super) fn new(bytes: &'b [u8]) -> Self {
        let mut bytes = bytes.iter();
        let odd = match bytes.next().map_or(0, |byte| byte % 8) {
            7 => 20,
            6 => 60,
            5 => 150,
            4 => 400,
            _ => 0,
        };
        Self { bytes, odd }
    }

    pub(super) fn byte(&mut self) -> u8 {
        self.bytes.next().copied().unwrap_or(0)
    }

    /// A number below `count`, or 0 if there is none.
    pub(super) fn below(&mut self, count: usize) -> usize {
        let number = if count > 256 {
            usize::from(u16::from_le_bytes([self.byte(), self.byte()]))
        } else {
            usize::from(self.byte())
        };
        number.checked_rem(count).unwrap_or(0)
    }

    pub(super) fn pick<'a, T>(&mut self, from: &'a [T]) -> Option<&'a T> {
        let at = self.below(from.len());
        from.get(at)
    }

    /// True once in so many times.
    pub(super) fn once_in(&mut self, times: u8) -> bool {
        self.byte() % times == times - 1
    }

    /// Tells whether something odd stands in a place.
    pub(super) fn is_odd(&mut self) -> bool {
        self.odd > 0 && self.below(self.odd) == self.odd - 1
    }
}
