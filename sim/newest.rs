//! The newest of many things.

use std::collections::VecDeque;

/// Things that are kept until they are taken, up to a number; beyond it the oldest are lost.
#[derive(Debug, Clone)]
pub struct Newest<T> {
    kept: VecDeque<T>,
    most: usize,
    /// How many were lost.
    pub lost: u64,
}

impl<T> Newest<T> {
    /// None yet.
    #[must_use]
    pub fn new(most: usize) -> Self {
        Self {
            kept: VecDeque::new(),
            most,
            lost: 0,
        }
    }

    /// Keeps one more.
    pub fn push(&mut self, one: T) {
        if self.kept.len() >= self.most {
            self.kept.pop_front();
            self.lost += 1;
        }
        self.kept.push_back(one);
    }

    /// Takes the oldest.
    pub fn pop(&mut self) -> Option<T> {
        self.kept.pop_front()
    }

    /// Takes all, the oldest first.
    pub fn take(&mut self) -> impl Iterator<Item = T> {
        self.kept.drain(..)
    }

    /// Returns whether there is none to take.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }
}
