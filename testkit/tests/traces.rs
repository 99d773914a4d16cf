//! A recording of any live run is the same again; a damaged one is replayed or refused in words, as
//! is any text.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod made;

use std::time::Duration;

use proptest::prelude::*;
use rigsim_core::line::{ClientLine, Wire};
use rigsim_core::rig::PortId;
use rigsim_core::settings::SimSettings;
use rigsim_core::{SHIPPED, SimTime};
use rigsim_runner::trace::Replay;
use rigsim_runner::{Run, RunOptions, Scenario};
use rigsim_settings::Source;
use rigsim_testkit::operation::{Operation, Wait};
use rigsim_testkit::trace::play;

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
#[derive(Debug, proptest_derive::Arbitrary)]
struct Recording {
    /// Bytes take no time.
    instant: bool,
    /// Of everything random.
    seed: u64,
    /// Operations of the clients.
    #[proptest(strategy = "made::operations()")]
    operations: Vec<Operation>,
}

impl Recording {
    /// The lines of the trace.
    fn record(&self) -> Vec<String> {
        let source = Source {
            file: "recorded.toml",
            text: SCENARIO,
        };
        let settings = SimSettings::new(SHIPPED);
        let scenario = Scenario::parse(source, &settings).unwrap();
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
        let mut run = Run::new(scenario.into(), None, options).unwrap();
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
            done.unwrap();
        }
        run.end();
        std::iter::from_fn(|| run.poll_trace()).collect()
    }
}

/// Damage to a trace on its way. Places are taken modulo what there is.
#[derive(Debug, proptest_derive::Arbitrary)]
enum Damage {
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
    fn done_to(&self, text: &str) -> String {
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
fn recorded(recording: &Recording, damages: &[Damage]) {
    let lines = recording.record();
    let again = Replay::all(SHIPPED, lines.iter().map(String::as_str));
    assert_eq!(again, Ok(()), "a recording is not the same again");
    let mut text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    for damage in damages {
        text = damage.done_to(&text);
    }
    play(&text);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn recordings_are_the_same_again_and_damaged_ones_are_reported(
        recording: Recording,
        damages in prop::collection::vec(any::<Damage>(), 0..4),
    ) {
        recorded(&recording, &damages);
    }

    #[test]
    fn any_text_is_reported(text in r#"[ -~\n]{0,200}|(\{"kind":"[a-z]{2,6}"(,"[tdproy]{1,4}":[0-9\[\],"A]{0,20}){0,6}\}?\n?){0,8}"#) {
        play(&text);
    }
}
