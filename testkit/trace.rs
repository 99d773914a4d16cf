//! Traces: recordings of live runs, whole and damaged, and any text: replayed, or refused in words.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::line::{ClientLine, Wire};
use rigsim_core::rig::PortId;
use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::{Record, Replay, ReplayError, Timed};
use rigsim_runner::{Run, RunOptions, Scenario};
use rigsim_settings::Source;

use crate::operation::{Operation, Wait};
use crate::text::{MOST_DRIVEN, goes_on, is_reported};

/// Most simulated time of a replay, ns; what comes later is left out.
const MOST_TIME: u64 = 2_000_000_000;

/// Recorded run: a car with both its links and an R150, and some of everything that a scenario
/// writes into a trace.
const SCENARIO: &str = r#"
schema = 1
title = "t"
good_client = "g"
limit = "1500 ms"

[settings]
r150.noise.voltage = "1 V"

[[device]]
kind = "r150"

[[device]]
kind = "mecanum"
ros = true
pose = { x = "1.5 m" }

[[step]]
name = "noise"
at = "400 ms"
device = "r150"
for = "300 ms"
fault = { kind = "dropped-bytes", probability = 0.1, direction = "to-client" }

[[always]]
that = "r150.truth.speed_mps < 0.2"
"#;

/// A live run to be recorded: any client does this. What only a scenario or an operator can do is
/// passed over.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct Recording {
    /// Bytes take no time.
    pub instant: bool,
    /// Of everything random.
    pub seed: u64,
    /// Operations of the clients.
    #[cfg_attr(feature = "proptest", proptest(strategy = "crate::some(40)"))]
    pub operations: Vec<Operation>,
}

impl Recording {
    /// The lines of the trace.
    #[must_use]
    pub fn record(&self) -> Vec<String> {
        let source = Source {
            file: "recorded.toml",
            text: SCENARIO,
        };
        let settings = SimSettings::new(rigsim_core::SHIPPED);
        let scenario = Scenario::parse(source, &settings);
        let scenario = scenario.unwrap_or_else(|error| panic!("{error}"));
        let options = RunOptions {
            seed: self.seed,
            wire: if self.instant {
                Wire::Instant
            } else {
                Wire::Paced
            },
            live: true,
            trace: true,
        };
        let run = Run::new(scenario.into(), None, options);
        let mut run = run.unwrap_or_else(|error| panic!("{error}"));
        let ports = run.ports().to_vec();
        let mut attached = vec![false; ports.len()];
        let mut now = SimTime::ZERO;
        for operation in &self.operations {
            let done = match operation {
                Operation::Wait(wait) => {
                    let wait = match wait {
                        Wait::UntilDue(_) => Wait::Milliseconds(50),
                        wait => *wait,
                    };
                    now += wait.span(Duration::ZERO);
                    run.advance(now)
                }
                Operation::Attach { port } | Operation::Detach { port } => {
                    let index = usize::from(*port) % ports.len();
                    attached[index] = !attached[index];
                    if attached[index] {
                        run.attach(ports[index], now)
                    } else {
                        run.detach(ports[index], now)
                    }
                }
                Operation::SetLine {
                    port,
                    speed,
                    cooked,
                    ..
                } => {
                    let index = usize::from(*port) % ports.len();
                    let baud = [9600, 115_200][usize::from(*speed) % 2];
                    let line = ClientLine {
                        raw: !cooked,
                        ..ClientLine::at(baud)
                    };
                    run.set_line(ports[index], line);
                    Ok(())
                }
                Operation::Send { port, message } => {
                    let index = usize::from(*port) % ports.len();
                    if attached[index] {
                        let PortId { device, link } = ports[index];
                        let bytes = message.bytes(&run.scenario().rig.devices[device], link);
                        run.send(ports[index], now, &bytes)
                    } else {
                        attached[index] = true;
                        run.attach(ports[index], now)
                    }
                }
                Operation::Late { by, stood } => {
                    let [by, stood] = [by, stood].map(|span| Duration::from_millis((*span).into()));
                    run.late(by, stood);
                    Ok(())
                }
                _ => Ok(()),
            };
            done.unwrap_or_else(|error| panic!("{error}"));
        }
        run.end();
        std::iter::from_fn(|| run.poll_trace()).collect()
    }
}

/// Damage to a trace on its way. Places are taken modulo what there is.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Damage {
    /// So many lines, two at most, give way to another one, which may be one that no recording has, or
    /// to none.
    Lines {
        /// The first line.
        at: u16,
        /// How many.
        gone: u8,
        /// Index of what comes in their place.
        other: u16,
    },
    /// The file ends early; so many characters are left.
    Cut(u32),
    /// A number is another one.
    Number {
        /// Index of the number.
        at: u32,
        /// Index among some.
        other: u8,
    },
    /// A byte is another one.
    Byte {
        /// Index of the byte.
        at: u32,
        /// Value that it then has.
        byte: u8,
    },
}

const NUMBERS: &[&str] = &[
    "0",
    "-1",
    "1",
    "0.5",
    "1e308",
    "400000000",
    "18446744073709551615",
    "99999999999999999999999",
    "null",
];

const STRANGE: &[&str] = &[
    r#"{"kind":"attach","t":1000000,"port":[9,0]}"#,
    r#"{"kind":"in","t":5,"port":[18446744073709551615,1],"bytes":""}"#,
    r#"{"kind":"out","t":18446744073709551615,"dt":18446744073709551615,"port":[0,0],"bytes":"AAAA"}"#,
    r#"{"kind":"line","t":0,"port":[1,0],"baud":0,"stop_bits":255,"raw":false}"#,
    r#"{"kind":"late","t":0,"by":18446744073709551615,"stood":18446744073709551615}"#,
    r#"{"kind":"end","t":0,"passed":true,"dropped":0}"#,
    r#"{"kind":"end","t":3,"passed":true,"dropped":9}"#,
    r#"{"kind":"nothing that is known"}"#,
    r#"{"kind":"in","t":0,"port":[0,0],"bytes":"A"}"#,
    r#"{"kind":"in","t":0,"port":[0,0],"bytes":"é"}"#,
    "[[[[[[[[[[[[[[[[[[[[",
    "",
    "\u{0}",
];

impl Damage {
    /// The trace when this has happened to it.
    #[must_use]
    pub fn done_to(&self, text: &str) -> String {
        let mut lines: Vec<&str> = text.lines().collect();
        if lines.is_empty() {
            return String::new();
        }
        match *self {
            Self::Lines { at, gone, other } => {
                let others = [STRANGE, &lines].concat();
                let other = others.get(usize::from(other) % (others.len() + 1));
                let at = usize::from(at) % lines.len();
                let end = lines.len().min(at + usize::from(gone % 3));
                lines.splice(at..end, other.copied());
                lines.iter().map(|line| format!("{line}\n")).collect()
            }
            Self::Cut(at) => {
                let length = text.chars().count();
                let left = usize::try_from(at).unwrap_or(0) % length;
                text.chars().take(left).collect()
            }
            Self::Byte { at, byte } => {
                let mut bytes = text.as_bytes().to_vec();
                let at = usize::try_from(at).unwrap_or(0) % bytes.len();
                bytes[at] = byte;
                String::from_utf8_lossy(&bytes).into_owned()
            }
            Self::Number { at, other } => {
                let is_digit = |c: char| c.is_ascii_digit();
                let starts: Vec<usize> = text
                    .match_indices(is_digit)
                    .map(|(at, _)| at)
                    .filter(|&at| !text[..at].ends_with(is_digit))
                    .collect();
                let Some(which) = usize::try_from(at).unwrap_or(0).checked_rem(starts.len()) else {
                    return text.to_owned();
                };
                let (before, rest) = text.split_at(starts[which]);
                let rest = rest.trim_start_matches(is_digit);
                let other = NUMBERS[usize::from(other) % NUMBERS.len()];
                [before, other, rest].concat()
            }
        }
    }
}

/// A recording is the same again; with anything done to it, it is replayed or refused in words.
pub fn recorded(recording: &Recording, damages: &[Damage]) {
    let lines = recording.record();
    if let Err(error) = Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str)) {
        panic!("a recording is not the same again: {error}");
    }
    let mut text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    for damage in damages {
        text = damage.done_to(&text);
    }
    play(&text);
}

/// Any text: a trace that is replayed for a while, or none.
pub fn play(text: &str) {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    if is_large(header) {
        return;
    }
    let mut replay = match Replay::begin(rigsim_core::SHIPPED, header) {
        Ok(replay) => replay,
        Err(error) => return reported(&error),
    };
    for line in lines {
        if serde_json::from_str::<Timed>(line).is_ok_and(|line| line.over() > MOST_TIME) {
            return;
        }
        if let Err(error) = replay.line(line) {
            return reported(&error);
        }
    }
    if let Err(error) = replay.finish() {
        reported(&error);
    }
}

/// Returns whether more vehicles are asked for than are driven here.
fn is_large(header: &str) -> bool {
    let Ok(Record::Header(header)) = serde_json::from_str(header) else {
        return false;
    };
    Scenario::parse(
        header.source.source(),
        &SimSettings::new(rigsim_core::SHIPPED),
    )
    .is_ok_and(|scenario| scenario.rig.devices.len() > MOST_DRIVEN)
}

fn reported(error: &ReplayError) {
    is_reported(&error.to_string());
    if let ReplayError::Run(error) = error {
        goes_on(error);
    }
}
