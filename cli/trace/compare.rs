//! Place where two recordings part.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};
use rigsim_core::SimTime;
use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::trace::Onlooker;

use super::{Part, exit};
use crate::args::TraceArgs;
use crate::exit::{Exit, Failure};
use crate::log::Words;
use crate::print::print;
use crate::recording::{self, Played};
use crate::visible;
use rigsim_core::device::Devices;

/// Most events that one of them may be ahead of the other.
const AHEAD: usize = 1 << 10;
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
    thread::scope(|scope| {
        let players = paths.map(|path| {
            let (begins, begun) = bounded(1);
            let (happens, happened) = bounded(AHEAD);
            let player = scope.spawn(move || {
                let (_, played) = recording::view(devices, path, |run| {
                    // It is not waited for if the other one cannot be read.
                    let _ = begins.send(Begun::new(run));
                    Teller::new(args, run, happens)
                })?;
                Ok::<Played, Failure>(played)
            });
            (player, begun, happened)
        });
        let [(player_a, begun_a, a), (player_b, begun_b, b)] = players;
        let parted = match (begun_a.recv(), begun_b.recv()) {
            (Ok(begun_a), Ok(begun_b)) => {
                let begun = begun_a.differences(&begun_b);
                let within = args.within.map_or(Duration::ZERO, |within| within.0);
                Some((begun, parting(&a, &b, within, paths)))
            }
            _ => None,
        };
        // They end as soon as there is no receiver.
        drop((a, b));
        for player in [player_a, player_b] {
            let played = player
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            let exit = exit(played?)?;
            if exit != Exit::Clean {
                return Ok(exit);
            }
        }
        let (mut text, parting) = parted.unwrap_or_default();
        let same = parting.is_empty();
        if same {
            text.push("the same happens from the beginning to the end".to_owned());
        }
        text.extend(parting);
        print(&text.join("\n"))?;
        Ok(if same { Exit::Clean } else { Exit::Failed })
    })
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
                ("text of the scenario", scenario.text.clone()),
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

/// An event, as far as it is compared.
struct Happened {
    at: SimTime,
    device: usize,
    code: &'static str,
    text: String,
    bytes: Option<Vec<u8>>,
    line: String,
}

impl Happened {
    fn is_same(&self, other: &Self, within: Duration) -> bool {
        let apart = self.at.max(other.at).since(self.at.min(other.at));
        let what = |one: &Self| (one.device, one.code);
        // Words may tell times.
        let words = !within.is_zero() || self.text == other.text;
        what(self) == what(other) && self.bytes == other.bytes && words && apart <= within
    }
}

/// Where they part, in lines; none if they do not.
fn parting(
    a: &Receiver<Happened>,
    b: &Receiver<Happened>,
    within: Duration,
    paths: [&PathBuf; 2],
) -> Vec<String> {
    let mut before = VecDeque::new();
    let mut count = 0_u64;
    loop {
        let (in_a, in_b) = (a.recv().ok(), b.recv().ok());
        match (&in_a, &in_b) {
            (None, None) => return Vec::new(),
            (Some(one), Some(other)) if one.is_same(other, within) => {
                count += 1;
                if before.len() == BEFORE {
                    before.pop_front();
                }
                before.push_back(in_a.map(|one| one.line).unwrap_or_default());
            }
            _ => {
                let mut text = vec![format!("the same for {count} events, the last of them:")];
                text.extend(before.iter().map(|line| format!("  {line}")));
                text.extend(follow(paths[0], in_a, a));
                text.extend(follow(paths[1], in_b, b));
                return text;
            }
        }
    }
}

/// Continuation of one of them.
fn follow(path: &Path, first: Option<Happened>, rest: &Receiver<Happened>) -> Vec<String> {
    let lines = first.into_iter().chain(rest.iter()).take(AFTERWARDS);
    let lines: Vec<String> = lines.map(|one| format!("  {}", one.line)).collect();
    let word = match lines.is_empty() {
        true => "nothing more happens in",
        false => "then in",
    };
    std::iter::once(format!("{word} {}:", visible::name(path)))
        .chain(lines)
        .collect()
}

/// Sends the events of a recording.
struct Teller {
    part: Part,
    words: Words,
    happens: Sender<Happened>,
    has_no_receiver: bool,
}

impl Teller {
    fn new(args: &TraceArgs, run: &Run, happens: Sender<Happened>) -> Result<Self, Failure> {
        Ok(Self {
            part: Part::new(args, run)?,
            words: Words::new(&run.scenario().rig),
            happens,
            has_no_receiver: false,
        })
    }
}

impl Onlooker for Teller {
    fn event(&mut self, _: &Run, event: &Event) {
        if self.has_no_receiver || !self.part.has(event.at, Some(event.device)) {
            return;
        }
        let sent = self.happens.send(Happened {
            at: event.at,
            device: event.device,
            code: event.kind.code().as_str(),
            text: event.kind.to_string(),
            bytes: event.kind.bytes().map(std::borrow::Cow::into_owned),
            line: self.words.plain(event),
        });
        self.has_no_receiver = sent.is_err();
    }

    fn has_enough(&self) -> bool {
        self.has_no_receiver
    }
}
