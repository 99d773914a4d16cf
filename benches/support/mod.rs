//! What the benchmark programs share: alternating rounds, and ratios with their spread.
//!
//! Machines are noisy, and one that is shared is more so. A figure by itself says little there; the
//! ratio of two figures that were taken right after one another says more, and the median of many
//! such ratios is what is printed.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::cast_precision_loss,
    reason = "each benchmark uses its part, prints its results, and ends at the first surprise"
)]

pub mod client;
pub mod hostile;
pub mod process;
pub mod serving;

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Wishes of the command line.
pub struct Options {
    /// Once through everything, to see that it works; the figures mean nothing.
    pub quick: bool,
    words: Vec<String>,
    flags: Vec<String>,
}

impl Options {
    /// `--test` asks for the quick mode, as it does of divan; words select benchmarks by part of
    /// their names. Cargo's own `--bench` is passed over.
    pub fn read() -> Self {
        let (flags, words): (Vec<String>, Vec<String>) = std::env::args()
            .skip(1)
            .partition(|arg| arg.starts_with("--"));
        Self {
            quick: flags.iter().any(|flag| flag == "--test"),
            words,
            flags,
        }
    }

    pub fn wants(&self, name: &str) -> bool {
        self.words.is_empty() || self.words.iter().any(|word| name.contains(word.as_str()))
    }

    pub fn has(&self, flag: &str) -> bool {
        self.flags.iter().any(|own| own == flag)
    }

    /// Another build of the simulator to measure beside this one: `--beside=PATH`.
    pub fn beside(&self) -> Option<&str> {
        self.flags
            .iter()
            .find_map(|flag| flag.strip_prefix("--beside="))
    }

    /// `full`, or as good as nothing in quick mode.
    pub fn count(&self, full: usize, quick: usize) -> usize {
        if self.quick { quick } else { full }
    }
}

/// One figure per round.
#[derive(Clone, Default)]
pub struct Figures(pub Vec<f64>);

impl Figures {
    pub fn median(&self) -> f64 {
        quantile(&self.0, 0.5)
    }

    pub fn best(&self) -> f64 {
        quantile(&self.0, 0.0)
    }

    pub fn worst(&self) -> f64 {
        quantile(&self.0, 1.0)
    }

    /// Round by round.
    pub fn over(&self, floor: &Self) -> Self {
        Self(self.0.iter().zip(&floor.0).map(|(a, b)| a / b).collect())
    }
}

/// The value below which this share of the values lies.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1).expect("there is a value");
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "an index of a vector in memory"
    )]
    let index = (last as f64 * share).round() as usize;
    sorted[index]
}

/// Runs the contenders in turn, `rounds` times; every other round in reverse, so that none always
/// comes after the same one.
pub fn alternate<const N: usize>(
    rounds: usize,
    contenders: [&mut dyn FnMut() -> f64; N],
) -> [Figures; N] {
    let mut figures = [const { Figures(Vec::new()) }; N];
    for round in 0..rounds {
        for turn in 0..N {
            let index = if round % 2 == 0 { turn } else { N - 1 - turn };
            figures[index].0.push(contenders[index]());
        }
    }
    figures
}

/// Seconds of processor time that `work` takes on this thread; what else runs on the machine does
/// not count.
pub fn cpu_seconds(work: impl FnOnce()) -> f64 {
    let now = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        Duration::try_from(time).unwrap().as_secs_f64()
    };
    let start = now();
    work();
    now() - start
}

/// An aim, and on which side of it is good.
#[derive(Clone, Copy)]
pub enum Aim {
    AtMost(f64),
    AtLeast(f64),
    None,
}

/// The table that is printed.
pub struct Table {
    quick: bool,
}

impl Table {
    pub fn begin(title: &str, options: &Options) -> Self {
        println!("\n## {title}\n");
        if options.quick {
            println!("quick mode: the figures mean nothing\n");
        }
        println!("| what | sim | floor | ratio (lowest to highest round) | aim | |");
        println!("|---|---|---|---|---|---|");
        Self {
            quick: options.quick,
        }
    }

    /// A figure beside that of a floor; `show` prints either.
    pub fn ratio(
        &self,
        what: &str,
        own: &Figures,
        floor: &Figures,
        show: fn(f64) -> String,
        aim: Aim,
    ) {
        let ratio = own.over(floor);
        let shown = format!(
            "{:.2} ({:.2} to {:.2})",
            ratio.median(),
            ratio.best(),
            ratio.worst()
        );
        self.row(
            what,
            &show(own.median()),
            &show(floor.median()),
            &shown,
            (ratio.median(), aim, |value| format!("{value} ×")),
        );
    }

    /// A figure without a floor; the aim is about its median.
    pub fn figure(&self, what: &str, own: &Figures, show: fn(f64) -> String, aim: Aim) {
        let range = format!("({} to {})", show(own.best()), show(own.worst()));
        self.row(
            what,
            &show(own.median()),
            "–",
            &range,
            (own.median(), aim, show),
        );
    }

    fn row(
        &self,
        what: &str,
        own: &str,
        floor: &str,
        ratio: &str,
        (value, aim, show): (f64, Aim, fn(f64) -> String),
    ) {
        let (words, met) = match aim {
            Aim::AtMost(most) => (format!("≤ {}", show(most)), value <= most),
            Aim::AtLeast(least) => (format!("≥ {}", show(least)), value >= least),
            Aim::None => ("–".to_owned(), true),
        };
        let verdict = match (self.quick, met) {
            _ if matches!(aim, Aim::None) => "",
            (true, _) => "",
            (false, true) => "met",
            (false, false) => "missed",
        };
        println!("| {what} | {own} | {floor} | {ratio} | {words} | {verdict} |");
    }
}

pub fn micros(seconds: f64) -> String {
    format!("{:.1} µs", seconds * 1e6)
}

pub fn millis(seconds: f64) -> String {
    format!("{:.2} ms", seconds * 1e3)
}

pub fn nanos(seconds: f64) -> String {
    format!("{:.2} ns", seconds * 1e9)
}

pub fn mebibytes(bytes: f64) -> String {
    format!("{:.1} MiB", bytes / f64::from(1 << 20))
}

pub fn percent(share: f64) -> String {
    format!("{:.2} %", share * 100.0)
}

pub fn times_real_time(factor: f64) -> String {
    format!("{factor:.0} × real time")
}
