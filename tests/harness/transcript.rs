//! What a process prints, collected as it comes so that its pipe never fills.

use std::io::Read;
use std::sync::{Arc, Condvar, Mutex};
use std::time::Instant;

use super::PATIENCE;

/// Everything that came out of a pipe so far.
pub struct Transcript(Arc<Shared>);

#[derive(Default)]
struct Shared {
    heard: Mutex<Heard>,
    changed: Condvar,
}

#[derive(Default)]
struct Heard {
    bytes: Vec<u8>,
    ended: bool,
}

impl Transcript {
    pub fn of(mut pipe: impl Read + Send + 'static) -> Self {
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        std::thread::spawn(move || {
            let mut chunk = [0; 4096];
            loop {
                let count = pipe.read(&mut chunk).unwrap_or(0);
                let mut heard = own.heard.lock().unwrap();
                heard.bytes.extend_from_slice(&chunk[..count]);
                heard.ended = count == 0;
                own.changed.notify_all();
                if heard.ended {
                    return;
                }
            }
        });
        Self(shared)
    }

    pub fn text(&self) -> String {
        text(&self.0.heard.lock().unwrap().bytes)
    }

    /// Waits for the first complete line that is `wanted`; `None` if none came.
    pub fn find_line(&self, wanted: impl Fn(&str) -> bool) -> Option<String> {
        let start = Instant::now();
        let mut seen = 0;
        let mut heard = self.0.heard.lock().unwrap();
        loop {
            while let Some(length) = heard.bytes[seen..].iter().position(|byte| *byte == b'\n') {
                let line = text(&heard.bytes[seen..seen + length]);
                seen += length + 1;
                if wanted(&line) {
                    return Some(line);
                }
            }
            let left = PATIENCE.checked_sub(start.elapsed())?;
            if heard.ended {
                return None;
            }
            heard = self.0.changed.wait_timeout(heard, left).unwrap().0;
        }
    }

    /// Waits for the first complete line that contains all of `parts`.
    pub fn wait_line(&self, parts: &[&str]) -> String {
        let found = self.find_line(|line| parts.iter().all(|part| line.contains(part)));
        found.unwrap_or_else(|| panic!("no line with {parts:?} in\n{}", self.text()))
    }

    /// Waits for the end of the pipe.
    pub fn whole(&self) -> String {
        let heard = self.0.heard.lock().unwrap();
        let wait = self
            .0
            .changed
            .wait_timeout_while(heard, PATIENCE, |heard| !heard.ended);
        let (heard, timeout) = wait.unwrap();
        assert!(!timeout.timed_out(), "a process keeps the pipe open");
        text(&heard.bytes)
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("what is printed is UTF-8")
}
