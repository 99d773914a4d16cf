//! The drive of `sim fit --plan` as a client performs it: what comes next, what was done, what is missing.

use rigsim_core::event::{Code, read_hex};

use super::plan::Manoeuvre;

/// Tolerance of a manoeuvre's duration: a fraction of it, and ns.
const TOLERANCE: (u64, u64) = (10, 1_000_000_000);

rigsim_core::codes! {
    /// The client may perform this manoeuvre now.
    MANOEUVRE_NEXT = "manoeuvre_next", Notice, NoParty;
    /// It has performed a manoeuvre.
    MANOEUVRE_DONE = "manoeuvre_done", Notice, NoParty;
    /// It has sent the bytes of a manoeuvre, but faster or slower than planned.
    MANOEUVRE_REFUSED = "manoeuvre_refused", Notice, NoParty;
}

/// Compares what a client sends with the plan.
pub(super) struct Guide {
    parts: Vec<Part>,
    /// The last bytes of each link with their times, ns; at least as many as any manoeuvre has.
    tails: Vec<(Vec<u8>, Vec<u64>)>,
    most: usize,
}

struct Part {
    name: String,
    /// What to do, in words.
    text: String,
    /// For each link its bytes, their duration and arrival, both in ns.
    links: Vec<(Vec<u8>, u64, Option<u64>)>,
    /// Duration, ns.
    time: u64,
    is_done: bool,
}

impl Guide {
    /// Begins with all manoeuvres that need no link beyond these.
    pub(super) fn new(all: &[Manoeuvre], links: usize) -> Self {
        let able = all
            .iter()
            .filter(|one| one.frames.iter().all(|frame| frame.link < links));
        let parts: Vec<Part> = able.map(|one| Part::of(one, links)).collect();
        let lengths = parts.iter().flat_map(|part| &part.links);
        Self {
            most: lengths.map(|link| link.0.len()).max().unwrap_or(0),
            parts,
            tails: vec![Default::default(); links],
        }
    }

    /// The next manoeuvre.
    pub(super) fn next(&self) -> Option<(Code, String)> {
        let next = self.parts.iter().find(|part| !part.is_done)?;
        Some((MANOEUVRE_NEXT, next.text.clone()))
    }

    /// The manoeuvres that were not performed.
    pub(super) fn missing(&self) -> Vec<&str> {
        let missing = self.parts.iter().filter(|part| !part.is_done);
        missing.map(|part| part.name.as_str()).collect()
    }

    /// Handles bytes of a link that came at this time, ns; returns what to report.
    pub(super) fn client_sent(&mut self, link: usize, t: u64, bytes: &[u8]) -> Vec<(Code, String)> {
        let mut said = Vec::new();
        let (tail, times) = &mut self.tails[link];
        for byte in bytes {
            tail.push(*byte);
            times.push(t);
            let left = self.parts.iter_mut().filter(|part| !part.is_done);
            said.extend(left.filter_map(|part| part.client_sent(link, tail, times)));
        }
        let old = tail.len().saturating_sub(self.most);
        tail.drain(..old);
        times.drain(..old);
        if said.iter().any(|(code, _)| *code == MANOEUVRE_DONE) {
            said.extend(self.next());
        }
        said
    }
}

impl Part {
    fn of(one: &Manoeuvre, count: usize) -> Self {
        let mut links: Vec<(Vec<u8>, u64, Option<u64>)> = vec![Default::default(); count];
        let mut begun = vec![0; count];
        let mut time = 0;
        for frame in &one.frames {
            let (bytes, span, _) = &mut links[frame.link];
            if bytes.is_empty() {
                begun[frame.link] = time;
            }
            bytes.extend(read_hex(frame.bytes.chars()).unwrap_or_default());
            *span = (time - begun[frame.link]) * 1_000_000;
            time += frame.wait_ms;
        }
        let (name, care, seconds) = (&one.name, &one.care, time / 1000);
        Self {
            text: format!(
                "next: {name}, {seconds} s. {care} `sim fit --plan --json` has its frames; \
                 docs/examples/identify.py --only \"{name}\" sends them"
            ),
            name: one.name.clone(),
            links,
            time: time * 1_000_000,
            is_done: false,
        }
    }

    fn client_sent(&mut self, link: usize, tail: &[u8], times: &[u64]) -> Option<(Code, String)> {
        let (bytes, planned, came) = &mut self.links[link];
        if bytes.is_empty() || !tail.ends_with(bytes) {
            return None;
        }
        let (name, planned) = (&self.name, *planned);
        let now = *times.last()?;
        let took = now - times[times.len() - bytes.len()];
        let tolerance = planned / TOLERANCE.0 + TOLERANCE.1;
        if took.abs_diff(planned) > tolerance {
            let [took, planned] = [took, planned].map(|time| time as f64 / 1e9);
            let text =
                format!("{name} took {took:.1} s instead of {planned:.1} s: perform it again");
            return Some((MANOEUVRE_REFUSED, text));
        }
        *came = Some(now);
        let mut all = self.links.iter().filter(|(bytes, ..)| !bytes.is_empty());
        self.is_done =
            all.all(|(.., came)| came.is_some_and(|came| now - came <= self.time + tolerance));
        self.is_done
            .then(|| (MANOEUVRE_DONE, format!("done: {name}")))
    }
}

#[cfg(test)]
mod tests;
