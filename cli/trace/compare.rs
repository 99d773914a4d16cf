//! Place where two recordings part.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::trace::Observer;

use super::{Part, exit};
use crate::args::TraceArgs;
use crate::exit::{Exit, Failure, refuse};
use crate::log::Words;
use crate::print::print;
use crate::recording;
use crate::visible;
use rigsim_core::device::Devices;

/// Most events of each that are compared: hours of a client that sends twenty commands a second.
const MOST_EVENTS: usize = 1 << 18;
/// Number of events that are shown of those before they part.
const BEFORE: usize = 8;
/// Number that is shown of each afterwards.
const AFTERWARDS: usize = 4;

/// Says where two recordings part; the exit code is 1 if they do.
pub(super) fn compare(
    devices: Devices,
    args: &TraceArgs,
    paths: [&PathBuf; 2],
) -> Result<Exit, Failure> {
    let play = |path: &Path| {
        let (events, played) = recording::view(devices, path, |run| Events::new(args, run))?;
        if events.has_enough() {
            refuse!(
                "{} has more than {MOST_EVENTS} events, too many to compare; choose some with --from, \
                 --until or --device",
                visible::name(path)
            );
        }
        Ok((events, exit(played)?))
    };
    let (a, exit) = play(paths[0])?;
    if exit != Exit::Clean {
        return Ok(exit);
    }
    let (b, exit) = play(paths[1])?;
    if exit != Exit::Clean {
        return Ok(exit);
    }
    let within = args.within.map_or(Duration::ZERO, |within| within.0);
    let mut text = a.begun.differences(&b.begun);
    let parting = parting(&a.happened, &b.happened, within, paths);
    let same = parting.is_empty();
    if same {
        text.push("the same happens from the beginning to the end".to_owned());
    }
    text.extend(parting);
    print(&text.join("\n"))?;
    Ok(if same { Exit::Clean } else { Exit::Failed })
}

/// Beginning of a run.
struct Begun {
    parts: [(&'static str, String); 4],
}

impl Begun {
    fn new(run: &Run) -> Self {
        let scenario = run.scenario();
        let client = match run.is_live() {
            true => "a real client",
            false => "the scripted client",
        };
        Self {
            parts: [
                ("seed", run.seed().to_string()),
                ("title", scenario.title.clone()),
                ("client", client.to_owned()),
                ("text of the scenario", scenario.source.text.clone()),
            ],
        }
    }

    fn differences(&self, other: &Self) -> Vec<String> {
        let pairs = self.parts.iter().zip(&other.parts);
        let lines = pairs.filter(|(a, b)| a != b).map(|((what, a), (_, b))| {
            match a.contains('\n') || b.contains('\n') {
                true => format!("begun otherwise: the {what} differs"),
                false => format!("begun otherwise: {what} {a} in the first, {b} in the second"),
            }
        });
        lines.collect()
    }
}

/// An event, and its line in the log.
struct Happened {
    event: Event,
    line: String,
}

impl Happened {
    fn is_same(&self, other: &Self, within: Duration) -> bool {
        let (one, other) = (&self.event, &other.event);
        let apart = one.at.max(other.at).since(one.at.min(other.at));
        // Words may tell times.
        let words = !within.is_zero() || one.kind.to_string() == other.kind.to_string();
        one.device == other.device
            && one.kind.code() == other.kind.code()
            && one.kind.bytes() == other.kind.bytes()
            && words
            && apart <= within
    }
}

/// Where they part, in lines; none if they do not.
fn parting(a: &[Happened], b: &[Happened], within: Duration, paths: [&PathBuf; 2]) -> Vec<String> {
    let mut pairs = a.iter().zip(b);
    let count = pairs.position(|(one, other)| !one.is_same(other, within));
    let count = count.unwrap_or(a.len().min(b.len()));
    let (before, rest) = a.split_at(count);
    let mut text = Vec::new();
    if rest.is_empty() && b.len() == count {
        return text;
    }
    text.push(format!("the same for {count} events, the last of them:"));
    let last = &before[count.saturating_sub(BEFORE)..];
    text.extend(last.iter().map(|one| format!("  {}", one.line)));
    text.extend(continuation(paths[0], rest));
    text.extend(continuation(paths[1], &b[count..]));
    text
}

/// Continuation of one of them.
fn continuation(path: &Path, rest: &[Happened]) -> impl Iterator<Item = String> {
    let word = match rest.is_empty() {
        true => "nothing more happens in",
        false => "then in",
    };
    let lines = rest.iter().take(AFTERWARDS);
    std::iter::once(format!("{word} {}:", visible::name(path)))
        .chain(lines.map(|one| format!("  {}", one.line)))
}

/// Keeps the events of a recording.
struct Events {
    begun: Begun,
    part: Part,
    words: Words,
    happened: Vec<Happened>,
}

impl Events {
    fn new(args: &TraceArgs, run: &Run) -> Result<Self, Failure> {
        Ok(Self {
            begun: Begun::new(run),
            part: Part::new(args, run)?,
            words: Words::new(&run.scenario().rig),
            happened: Vec::new(),
        })
    }
}

impl Observer for Events {
    fn event(&mut self, _: &Run, event: &Event) {
        if self.has_enough() || !self.part.has(event.at, Some(event.device)) {
            return;
        }
        self.happened.push(Happened {
            event: event.clone(),
            line: self.words.plain(event),
        });
    }

    fn has_enough(&self) -> bool {
        self.happened.len() > MOST_EVENTS
    }
}
