//! Writing a run down as a trace.

use std::collections::{BTreeMap, VecDeque};

use rigsim_core::SimTime;
use rigsim_core::line::Wire;
use rigsim_core::rig::{PortId, Rig};
use rigsim_settings::{Settings, Source};

use super::RunOptions;
use super::record::{FORMAT, Header, Hexed, MOST_BYTES, Record};
use crate::scenario::{NamedText, Scenario};

/// Most lines that wait to be taken; further ones are dropped and the trace is of no use then,
/// which its last line says.
const MOST_LINES: usize = 1 << 20;
/// Interval at which poses are noted, ns.
const POSE_PERIOD: u64 = 100_000_000;

/// Writes a run down.
pub(crate) struct Recorder {
    lines: VecDeque<String>,
    dropped: u64,
    /// Bytes of devices that make one line so far.
    out: BTreeMap<PortId, Burst>,
    poses: Vec<[f64; 3]>,
}

/// Bytes that follow one another evenly.
struct Burst {
    begin: u64,
    last: u64,
    dt: u64,
    bytes: Vec<u8>,
}

impl Recorder {
    pub(crate) fn new(scenario: &Scenario, world: Option<Source<'_>>, options: RunOptions) -> Self {
        let mut recorder = Self {
            lines: VecDeque::new(),
            dropped: 0,
            out: BTreeMap::new(),
            poses: Vec::new(),
        };
        let mut source = scenario.source.clone();
        if scenario.is_endless() {
            source.text = scenario.rig.to_toml();
        }
        recorder.write(&Record::Header(Box::new(Header {
            format: FORMAT,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            seed: options.seed,
            paced: options.wire != Wire::Instant,
            adapters: options.wire == Wire::Paced,
            live: options.live,
            serving: scenario.is_endless(),
            source,
            settings: changed_settings(&scenario.base),
            world: world.map(NamedText::from),
        })));
        recorder
    }

    pub(crate) fn poll(&mut self) -> Option<String> {
        self.lines.pop_front()
    }

    /// Bytes arrived at the client at one instant.
    pub(crate) fn device_sent(&mut self, at: SimTime, port: PortId, bytes: &[u8]) {
        for &byte in bytes {
            self.device_byte(at.as_nanos(), port, byte);
        }
    }

    fn device_byte(&mut self, at: u64, port: PortId, byte: u8) {
        if let Some(burst) = self.out.get_mut(&port) {
            let dt = at - burst.last;
            // A pause begins a new line even behind a single byte.
            let even = (burst.bytes.len() == 1 && dt < 10_000_000) || dt == burst.dt;
            if even && burst.bytes.len() < MOST_BYTES {
                burst.dt = dt;
                burst.last = at;
                burst.bytes.push(byte);
                return;
            }
        }
        let begun = Burst {
            begin: at,
            last: at,
            dt: 0,
            bytes: vec![byte],
        };
        if let Some(burst) = self.out.insert(port, begun) {
            self.write_burst(port, burst);
        }
    }

    /// Notes where devices are, if it is time to.
    pub(crate) fn sample(&mut self, at: SimTime, rig: &Rig) {
        let t = at.as_nanos();
        if !t.is_multiple_of(POSE_PERIOD) {
            return;
        }
        self.poses.resize(rig.devices(), [f64::NAN; 3]);
        for device in 0..rig.devices() {
            let Some(pose) = rig.motion(device).map(|motion| motion.pose) else {
                continue;
            };
            let place = [pose.x, pose.y, pose.heading];
            if std::mem::replace(&mut self.poses[device], place) != place {
                self.write(&Record::Pose {
                    t,
                    device,
                    x: pose.x,
                    y: pose.y,
                    heading: pose.heading,
                });
            }
        }
    }

    pub(crate) fn end(&mut self, at: SimTime, passed: bool, why_skipped: &[String]) {
        for (port, burst) in std::mem::take(&mut self.out) {
            self.write_burst(port, burst);
        }
        let record = Record::End {
            t: at.as_nanos(),
            passed,
            not_applicable: why_skipped.to_vec(),
            dropped: self.dropped,
        };
        self.lines.extend(record.to_line());
    }

    fn write_burst(&mut self, port: PortId, burst: Burst) {
        self.write(&Record::Out {
            t: burst.begin,
            dt: burst.dt,
            port: port.into(),
            bytes: Hexed(burst.bytes),
        });
    }

    /// Adds a line, if there is room.
    pub(crate) fn write(&mut self, record: &Record) {
        if self.lines.len() >= MOST_LINES {
            self.dropped += 1;
        } else {
            self.lines.extend(record.to_line());
        }
    }
}

/// The settings that are not as they are by default, as TOML.
fn changed_settings(settings: &dyn Settings) -> String {
    let entries = settings.entries().into_iter();
    let changed = entries.filter(|entry| entry.value != entry.default);
    changed
        .map(|entry| format!("{} = {}\n", entry.key, entry.value))
        .collect()
}
