//! The same client for every server: a raw tty, one request after another.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{Timespec, epoll};
use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, SpecialCodeIndex, tcgetattr, tcsetattr};

/// A request and how many bytes answer it.
#[derive(Clone)]
pub struct Exchange {
    pub request: Vec<u8>,
    pub reply_length: usize,
}

/// A client with one request outstanding.
pub struct Client(File);

impl Client {
    pub fn open(path: &Path) -> Self {
        Self(open(path, OFlags::NOCTTY))
    }

    /// Seconds from writing the request to having read the whole reply.
    pub fn ask(&mut self, exchange: &Exchange) -> f64 {
        let mut buffer = [0; 512];
        let start = Instant::now();
        self.0.write_all(&exchange.request).unwrap();
        let mut length = 0;
        while length < exchange.reply_length {
            let count = self.0.read(&mut buffer).unwrap();
            assert!(count > 0, "no reply");
            length += count;
        }
        assert_eq!(
            length, exchange.reply_length,
            "more came than was asked for"
        );
        start.elapsed().as_secs_f64()
    }
}

fn open(path: &Path, flags: OFlags) -> File {
    let flags = i32::try_from(flags.bits()).unwrap();
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags(flags);
    let file = options.open(path).unwrap();
    let mut line = tcgetattr(&file).unwrap();
    line.make_raw();
    // A read that gets nothing for 20 s ends.
    line.special_codes[SpecialCodeIndex::VMIN] = 0;
    line.special_codes[SpecialCodeIndex::VTIME] = 200;
    tcsetattr(&file, OptionalActions::Now, &line).unwrap();
    file
}

/// Many ports, each asked at the same rate, evenly spread over the period. Requests are sent when
/// their time has come, whatever is still unanswered elsewhere.
pub struct Poller {
    ports: Vec<Polled>,
    epoll: rustix::fd::OwnedFd,
    period: Duration,
}

struct Polled {
    file: File,
    /// When what is unanswered was due to be sent, and how many bytes are still to come.
    waiting: VecDeque<(Instant, usize)>,
    turns: usize,
}

/// What [`Poller::run`] measured.
pub struct Polls {
    /// Seconds from when a request was due to be sent to its whole reply.
    pub latencies: Vec<f64>,
    pub unanswered: usize,
}

impl Poller {
    pub fn open(paths: &[PathBuf], period: Duration) -> Self {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).unwrap();
        let ports = paths.iter().enumerate().map(|(index, path)| {
            let file = open(path, OFlags::NOCTTY | OFlags::NONBLOCK);
            let data = epoll::EventData::new_u64(index as u64);
            epoll::add(&epoll, &file, data, epoll::EventFlags::IN).unwrap();
            Polled {
                file,
                waiting: VecDeque::new(),
                turns: 0,
            }
        });
        Self {
            ports: ports.collect(),
            epoll,
            period,
        }
    }

    /// Polls for so many periods; the exchanges take turns on each port.
    pub fn run(&mut self, periods: usize, exchanges: &[Exchange]) -> Polls {
        let mut polls = Polls {
            latencies: Vec::new(),
            unanswered: 0,
        };
        let count = self.ports.len();
        let start = Instant::now();
        for turn in 0..periods * count {
            let due = start + self.period.mul_f64(turn as f64 / count as f64);
            self.listen(due, &mut polls);
            let port = &mut self.ports[turn % count];
            let exchange = &exchanges[port.turns % exchanges.len()];
            port.turns += 1;
            port.waiting.push_back((due, exchange.reply_length));
            port.file.write_all(&exchange.request).unwrap();
        }
        // For what is still on its way.
        let patience = Instant::now() + Duration::from_secs(5);
        while Instant::now() < patience && self.ports.iter().any(|port| !port.waiting.is_empty()) {
            self.listen(Instant::now() + Duration::from_millis(1), &mut polls);
        }
        for port in &mut self.ports {
            polls.unanswered += port.waiting.len();
            port.waiting.clear();
        }
        polls
    }

    /// Takes replies until the time has come.
    fn listen(&mut self, until: Instant, polls: &mut Polls) {
        let mut space = [std::mem::MaybeUninit::uninit(); 256];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let timeout = Timespec::try_from(left).unwrap();
            let (events, _) = epoll::wait(&self.epoll, &mut space, Some(&timeout)).unwrap();
            for event in events {
                let index = usize::try_from(event.data.u64()).unwrap();
                self.ports[index].read(polls);
            }
            if left.is_zero() {
                return;
            }
        }
    }
}

impl Polled {
    fn read(&mut self, polls: &mut Polls) {
        let mut buffer = [0; 512];
        let mut count = self.file.read(&mut buffer).unwrap();
        while count > 0 {
            let (due, left) = self.waiting.front_mut().expect("only replies come");
            let taken = count.min(*left);
            *left -= taken;
            count -= taken;
            if *left == 0 {
                polls.latencies.push(due.elapsed().as_secs_f64());
                self.waiting.pop_front();
            }
        }
    }
}
