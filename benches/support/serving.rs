//! What clients say to R150s, and what they note of the answers.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rigsim_core::message::Message;
use rigsim_core::r150_device::codec::OVERHEAD;
use rigsim_core::r150_device::command::Request;
use rigsim_core::r150_device::command::SystemInfo;

use super::client::{Client, Exchange, Poller};
use super::process::Server;
use super::{Figures, Options, quantile};

/// Interval between motor commands.
const COMMAND_INTERVAL: Duration = Duration::from_millis(50);
/// Replies at once; and to every motor command, since simulated time stands still while the machine
/// is busy elsewhere, so that commands may come too soon by it.
pub const INSTANT: [&str; 6] = [
    "--wire",
    "instant",
    "--set",
    "r150.over_rate=answer",
    "--set",
    "r150.reply_spread=0s",
];
/// Ports of one process.
pub const PORTS: usize = 200;
/// Time from one poll of each to the next.
pub const POLL_PERIOD: Duration = Duration::from_millis(50);

/// A client that keeps its vehicle driving, and asks as fast as it is answered.
pub struct Conversation {
    client: Client,
    poll: Exchange,
    drive: Exchange,
    drive_next: Instant,
}

impl Conversation {
    pub fn new(client: Client, poll: Exchange, drive: Exchange) -> Self {
        Self {
            client,
            poll,
            drive,
            drive_next: Instant::now(),
        }
    }

    /// The latencies of so many requests.
    pub fn ask(&mut self, requests: usize) -> Vec<f64> {
        let mut latencies = Vec::with_capacity(requests);
        while latencies.len() < requests {
            if Instant::now() >= self.drive_next {
                self.client.ask(&self.drive);
                self.drive_next = Instant::now() + COMMAND_INTERVAL;
            }
            latencies.push(self.client.ask(&self.poll));
        }
        latencies
    }
}

pub fn median_and_tail(latencies: &[f64], tail: &mut Figures) -> f64 {
    tail.0.push(quantile(latencies, 0.99));
    quantile(latencies, 0.5)
}

/// Figures of polling many ports, round by round.
#[derive(Default)]
pub struct Polling {
    /// 99th percentiles of the latencies, s.
    pub tails: Figures,
    /// Shares of one core.
    pub shares: Figures,
}

/// Polls all ports for a round; every vehicle drives all the while.
pub fn polls(server: &Server, poller: &mut Poller, options: &Options, noted: &mut Polling) {
    let info = system_info();
    let exchanges = [motors(), info.clone(), info.clone(), info];
    let (cpu, start) = (server.cpu_seconds(), Instant::now());
    let polls = poller.run(options.count(40, 4), &exchanges);
    let seconds = start.elapsed().as_secs_f64();
    noted.shares.0.push((server.cpu_seconds() - cpu) / seconds);
    assert_eq!(polls.unanswered, 0, "requests without a reply");
    noted.tails.0.push(quantile(&polls.latencies, 0.99));
}

/// So many R150s in one process, side by side, and the paths of their ports.
pub fn many(dir: &tempfile::TempDir, devices: usize, arguments: &[&str]) -> (Server, Vec<PathBuf>) {
    let mut rig = String::from("schema = 1\n");
    let mut paths = Vec::new();
    for device in 0..devices {
        let name = format!("r150-{device}");
        let y = 3 * device;
        write!(
            rig,
            "[[device]]\nkind = \"r150\"\nport = \"{name}\"\npose = {{ x = \"0 m\", y = \"{y} m\" }}\n"
        )
        .unwrap();
        paths.push(dir.path().join(name));
    }
    let file = dir.path().join("rig.toml");
    std::fs::write(&file, rig).unwrap();
    let mut all = vec!["--rig", file.to_str().unwrap()];
    all.extend(arguments);
    (Server::sim(&all), paths)
}

pub fn heartbeat() -> Exchange {
    exchange(Request::Heartbeat, 1)
}

pub fn system_info() -> Exchange {
    exchange(Request::SystemInfo, SystemInfo::INFOS[0].length)
}

pub fn motors() -> Exchange {
    let drive = Request::SetMotors {
        right: 900,
        left: 900,
    };
    exchange(drive, 8)
}

fn exchange(request: Request, parameters: usize) -> Exchange {
    Exchange {
        request: request.encode(),
        reply_length: parameters + OVERHEAD,
    }
}

/// The exchange as an echo makes it.
pub fn echoed(exchange: &Exchange) -> Exchange {
    Exchange {
        request: exchange.request.clone(),
        reply_length: exchange.request.len(),
    }
}
