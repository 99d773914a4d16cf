//! Flags and subcommands.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{
    Arg, ArgAction, ArgMatches, Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand,
    ValueEnum, value_parser,
};
use sim_control::Listen;
use sim_core::device::{DeviceSpec, Devices, LinkSpec};
use sim_core::line::Wire;
use sim_pty::{Defaults, ListenAddress, PtySetup};
use sim_settings::Span;

use crate::control::ctl::CtlArgs;
use crate::exit::Exit;
use crate::lists::ListFormat;
use crate::schema::FileKind;
use crate::visible;

const EXAMPLES: &str = "\
Examples:
  sim --pty /tmp/r150
      An R150 that is ready to drive. Open /tmp/r150 in your client like a serial port
      at 115200 baud.
  sim --pty /tmp/r150 -v
      The same, printing every request and reply in words and hex.
  sim --pty /tmp/r150 --start locked
      As the hardware starts: locked, parked, in remote mode; motor commands do nothing.
  sim --pty /tmp/r150 --set r150.battery.initial_soc=5% --set world.slope=10deg
      A nearly empty battery on a slope. `sim config` lists every setting.
  sim --pty /tmp/r150 --wire instant --log-format json | tee run.jsonl
      Bytes take no time on the line; one JSON object for each event.
  sim --listen rfc2217://127.0.0.1:2217
      On the network: serial_for_url('rfc2217://127.0.0.1:2217') in pyserial. For
      containers, other systems, and clients that need modem lines.
  sim --serial /dev/ttyUSB0
      The same device on a real serial port, with your client at the other end of the cable.
  sim --device mecanum --pty /tmp/car --ros-pty /tmp/car-ros --world worlds/yard.toml
      A mecanum car with both of its links, in a yard with walls.
  sim --rig my-rig.toml
      Several devices of either kind in one world.
  sim --pty /tmp/r150 --scenario scenarios/r150/faults/cable-pulled.toml
      The faults of a scenario against whatever client opens /tmp/r150, and a verdict.
  sim run scenarios/r150 -- python3 my_client.py
      Your client through every scenario, one after the other: for CI. `sim run --help`.";

const RUN_EXAMPLES: &str = "\
Examples:
  sim run scenarios
      Every scenario with its scripted client, as fast as the machine goes.
  sim run --tag drive scenarios/r150 -- python3 my_client.py
      Your client instead, in the simulator's time. It opens the port named by $SIM_R150_PORT.
  sim run --time real scenarios/r150 -- python3 my_client.py
      The same by the wall clock: 20 simulated seconds take 20 seconds.
  sim run scenarios/r150 -- sh -c 'my_client --port \"$SIM_R150_PORT\"'
      A client that takes the port as an argument.
  sim run --junit results.xml --output traces -j 4 scenarios/r150 -- ./client
      For CI: JUnit XML, traces and reports for `sim replay`, four at a time.
  sim run --report report.html scenarios
      A page with all verdicts, and pictures of what happened.
  sim run --job my-job.toml scenarios/r150/faults -- ./client
      Every fault within a job of your own.
  sim run --set r150.heartbeat_timeout=2s --param pwm=300,600 my.toml -- ./client
      Your vehicle's settings, and each value of a parameter of the file as a case of its own.
  sim run --repeat 20 --fail-fast --filter crc scenarios -- ./client
      Twenty seeds of each scenario whose path contains `crc`, to the first that fails.";

const TRACE_EXAMPLES: &str = "\
Examples:
  sim trace traces/ice.trace.jsonl
      All that was said and that happened, as `sim -v` prints it.
  sim trace traces/ice.trace.jsonl --from 2s --to 2.5s --device r150
      Half a second of it, at one device.
  sim trace traces/ice.trace.jsonl --csv t,truth.x_m,reported.v48_a --every 10ms > ice.csv
      Any names of `sim names`, computed anew.
  sim trace yesterday.trace.jsonl today.trace.jsonl --within 20ms
      Where two runs part; those of real clients are never the same to the nanosecond.";

/// A client that drives at 1 m/s and goes by its own clock is a quarter of a metre off after that.
pub(crate) const MAX_HOLD_UP: &str = "250ms";

/// A virtual vehicle behind a serial port: test your client without the hardware.
///
/// Serves the protocol of a real device on a pseudo-terminal, while a simulated body moves in
/// response. Ctrl-C stops it and prints a summary.
#[derive(Debug, Parser)]
#[command(name = "sim", version, max_term_width = 100)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", Exit::HELP))]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
    #[command(flatten)]
    pub(crate) serve: ServeArgs,
}

impl Cli {
    /// Reads the program's arguments; ends the program if they are wrong, or ask for help.
    pub(crate) fn read(devices: Devices) -> Self {
        let words: Vec<OsString> = std::env::args_os().collect();
        Self::parse(devices, &words).unwrap_or_else(|error| error.exit())
    }

    /// Reads a command line. What an error repeats of it can be shown on a terminal.
    pub(crate) fn parse(devices: Devices, words: &[OsString]) -> Result<Self, clap::Error> {
        let parse = |words: &[OsString]| {
            let matches = command(devices).try_get_matches_from(words)?;
            let mut cli = Self::from_arg_matches(&matches)?;
            cli.serve.link_ptys = link_ptys(devices, &matches);
            Ok(cli)
        };
        parse(words).map_err(|error: clap::Error| {
            let shown: Vec<OsString> = words
                .iter()
                .map(|word| visible::name(word).into())
                .collect();
            match parse(&shown) {
                Err(shown) => shown,
                Ok(_) => clap::Error::raw(error.kind(), visible::lines(&error.to_string())),
            }
        })
    }
}

/// The command line with what the devices add to it.
fn command(devices: Devices) -> clap::Command {
    let kinds = || {
        let all = devices.iter();
        let value = |device: &&DeviceSpec| PossibleValue::new(device.id).help(device.about);
        PossibleValuesParser::new(all.map(value).collect::<Vec<_>>())
    };
    let usual = devices.first().map_or("", |device| device.id);
    let starts = devices.iter().flat_map(|device| device.starts);
    let starts = starts.map(|start| PossibleValue::new(start.id).help(start.about));
    let starts = PossibleValuesParser::new(starts.collect::<Vec<_>>());
    let device = |arg: Arg| {
        arg.value_parser(kinds())
            .default_value(usual)
            .required(false)
    };
    let mut command = Cli::command()
        .mut_arg("device", device)
        .mut_arg("start", |arg| arg.value_parser(starts))
        .mut_subcommand("faults", |sub| {
            sub.mut_arg("device", |arg| arg.value_parser(kinds()))
        })
        .mut_subcommand("names", |sub| sub.mut_arg("device", device));
    for (spec, link) in optional_links(devices) {
        let costs = link.optional.unwrap_or_default();
        let help = format!(
            "Serve the {} link of {} too, on a second pseudo-terminal or at a URL as --listen has; {costs}",
            link.name, spec.title
        );
        command = command.arg(
            Arg::new(link.id)
                .long(format!("{}-pty", link.id))
                .visible_alias(format!("{}-listen", link.id))
                .value_name("PATH")
                .value_parser(value_parser!(PathBuf))
                .conflicts_with("rig")
                .help(help),
        );
    }
    command
}

fn optional_links(
    devices: Devices,
) -> impl Iterator<Item = (&'static DeviceSpec, &'static LinkSpec)> {
    let links = |device: &'static DeviceSpec| device.links.iter().map(move |link| (device, link));
    let all = devices.iter().copied().flat_map(links);
    all.filter(|(_, link)| link.optional.is_some())
}

fn link_ptys(devices: Devices, matches: &ArgMatches) -> Vec<(&'static str, PathBuf)> {
    let path = |(_, link): (_, &'static LinkSpec)| {
        let path = matches.try_get_one::<PathBuf>(link.id).ok().flatten();
        Some((link.id, path?.clone()))
    };
    optional_links(devices).filter_map(path).collect()
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the effective settings as TOML, each with its meaning, its allowed values, and
    /// whether it is documented behaviour or our assumption.
    ///
    /// The output is a valid --config file. Save it, change what you like, delete the rest.
    Config(SettingsArgs),
    /// Play scenario files and say pass or fail, in simulated time: with their scripted client, or with
    /// yours.
    Run(Box<RunArgs>),
    /// Read scenario files and say what is wrong with them, without playing them.
    Check {
        /// Files, or folders of them.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        #[command(flatten)]
        given: GivenArgs,
    },
    /// Play a trace of `run --output` again; the devices must do the same to the last byte.
    Replay {
        /// The trace.
        trace: PathBuf,
    },
    /// Print a trace of `run --output` as decoded traffic and events, in the words of the log; or as
    /// CSV the values of any names, computed anew; or where two traces part.
    Trace(TraceArgs),
    /// Look after a client of `run`.
    #[command(hide = true)]
    Supervise {
        /// The simulator's folder for the ports.
        #[arg(long)]
        folder: Option<PathBuf>,
        /// The client and its arguments.
        #[arg(last = true, required = true)]
        client: Vec<OsString>,
    },
    /// List the faults that a scenario can inject, with what the client sees of them.
    Faults {
        /// Only those that this device can have.
        #[arg(long)]
        device: Option<String>,
        /// How to print them.
        #[arg(long, value_enum, default_value_t = ListFormat::Text)]
        format: ListFormat,
    },
    /// List the names that a scenario's conditions can use, with unit and meaning.
    Names {
        /// Of which device.
        #[arg(long)]
        device: String,
    },
    /// Look at a simulator that runs with --control, and change what happens in it.
    Ctl(CtlArgs),
    /// Print the JSON Schema of world, rig or scenario files; many editors complete and check with
    /// it.
    Schema {
        /// Of which files.
        #[arg(value_enum)]
        of: FileKind,
    },
}

/// What to play, and how.
#[derive(Debug, Args)]
#[command(after_help = format!("{RUN_EXAMPLES}\n\n{}", Exit::HELP))]
pub(crate) struct RunArgs {
    /// Scenario files, or folders of them.
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// The client to test, with its arguments. It finds the path of each port in its environment,
    /// in SIM_R150_PORT for the device `r150`, and the seed in SIM_SEED.
    #[arg(last = true, value_name = "CLIENT")]
    pub(crate) client: Vec<OsString>,
    /// How many scenarios to play at a time [default: one for each core, but 1 with a client in real time].
    #[arg(short, long, value_name = "N", value_parser = value_parser!(u32).range(1..=64))]
    pub(crate) jobs: Option<u32>,
    #[command(flatten)]
    pub(crate) given: GivenArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Seed of everything random, instead of the file's or a random one.
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Play each so many times, each time with the next seed.
    #[arg(long, value_name = "N", default_value = "1", value_parser = value_parser!(u32).range(1..=100_000))]
    pub(crate) repeat: u32,
    /// Only files whose path contains TEXT.
    #[arg(long, value_name = "TEXT")]
    pub(crate) filter: Option<String>,
    /// Only scenarios with this tag in their file; may be repeated, and one of them is enough.
    #[arg(long, value_name = "TAG", action = ArgAction::Append)]
    pub(crate) tag: Vec<String>,
    /// Begin no further scenario after the first that fails.
    #[arg(long)]
    pub(crate) fail_fast: bool,
    /// Write the results as JUnit XML, which CI servers show.
    #[arg(long, value_name = "PATH")]
    pub(crate) junit: Option<PathBuf>,
    /// Write a page to look at: all verdicts; of each the world from above, with the ways of the
    /// vehicles; and plots and traffic of those that failed. It is one file and needs nothing else.
    #[arg(long, value_name = "PATH")]
    pub(crate) report: Option<PathBuf>,
    /// Write a trace, a report as JSON, and the client's output of each into this folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Whose time a client has: the simulator's, in which nothing is ever late and the same seed gives
    /// the same bytes, or the wall clock's.
    #[arg(long, value_enum, default_value_t = TimeArg::Lockstep)]
    pub(crate) time: TimeArg,
    /// Where what a client reads as random comes from, with --time lockstep.
    #[arg(long, value_enum, default_value_t = RandomArg::Seed)]
    pub(crate) random: RandomArg,
    /// The date on which a client begins, in UTC, with --time lockstep.
    #[arg(long, value_name = "DATE", default_value = "2025-01-01 00:00:00", value_parser = date)]
    pub(crate) date: Duration,
    /// Play each two times and show the first difference, with --time lockstep.
    #[arg(long)]
    pub(crate) twice: bool,
    /// Simulated seconds for each second of real time, 0.01 to 100; only with --time real
    /// [default: 1].
    #[arg(long, value_name = "X", value_parser = speed)]
    pub(crate) speed: Option<f64>,
    /// Real time allowed for each, as in 90s or "2 min" [default: the file's `wall_limit`, else
    /// twice its `limit` and 30 s].
    #[arg(long, value_name = "TIME", value_parser = some_time)]
    pub(crate) timeout: Option<Span>,
    /// How long a busy machine may hold the simulator up in all, while a client's clock goes on. When
    /// it is longer and the scenario fails, it is played once more; and if that goes the same way, it is
    /// an error of the machine and no failure of the client.
    #[arg(long, value_name = "TIME", default_value = MAX_HOLD_UP, value_parser = some_time)]
    pub(crate) max_hold_up: Span,
    /// Let programs and a page look on and change what happens, as with `sim --control`; each scenario
    /// with a client has a socket of its own, which the client finds in SIM_CONTROL.
    #[arg(long, value_name = "ADDRESS", requires = "client")]
    pub(crate) control: Option<Listen>,
    /// List the files with their titles and tags, and play nothing.
    #[arg(long)]
    pub(crate) list: bool,
    /// Read everything, say what would be played with which seed and ports, and play nothing.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// What scenario files are read with.
#[derive(Debug, Default, Args)]
pub(crate) struct GivenArgs {
    /// Play fault files within this job: a scenario file with devices, a world, a limit and the verdicts
    /// of its mission. It takes the place of the file with the devices that they are based on.
    #[arg(long, value_name = "FILE")]
    pub(crate) job: Option<PathBuf>,
    /// Give a parameter of the files a value, as in --param pwm=300; with several, as in --param
    /// pwm=300,600,1000, each is a case of its own, and each with each of another parameter.
    #[arg(long, value_name = "NAME=VALUE", action = ArgAction::Append)]
    pub(crate) param: Vec<String>,
    /// Build the world from this file instead of those that the files name.
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
}

/// Which part of a trace to print, and how.
#[derive(Debug, Args)]
#[command(after_help = TRACE_EXAMPLES)]
pub(crate) struct TraceArgs {
    /// The trace.
    pub(crate) trace: PathBuf,
    /// Another one: says where the two part, and what came before.
    #[arg(conflicts_with_all = ["csv", "every", "log_format"])]
    pub(crate) other: Option<PathBuf>,
    /// Leave out what comes before this simulated time, as in 2.5s.
    #[arg(long, value_name = "TIME")]
    pub(crate) from: Option<Span>,
    /// Leave out what comes after it.
    #[arg(long, value_name = "TIME")]
    pub(crate) to: Option<Span>,
    /// Only what happens at this device; may be repeated.
    #[arg(long, value_name = "NAME", action = ArgAction::Append, conflicts_with = "csv")]
    pub(crate) device: Vec<String>,
    /// Print the values of these names as CSV instead, as in t,truth.x_m,reported.v48_a; `sim
    /// names` lists them. The trace need not hold them.
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        conflicts_with = "log_format"
    )]
    pub(crate) csv: Vec<String>,
    /// A line of CSV for so much simulated time [default: 100ms].
    #[arg(long, value_name = "TIME", value_parser = some_time, requires = "csv")]
    pub(crate) every: Option<Span>,
    /// Of two traces: times that differ by so much are the same, as are words that tell of them
    /// [default: they are the same to the nanosecond].
    #[arg(long, value_name = "TIME", requires = "other")]
    pub(crate) within: Option<Span>,
    /// How to print what happens.
    #[arg(long, value_enum, default_value_t = LogFormat::Text)]
    pub(crate) log_format: LogFormat,
}

/// Where settings come from; later ones win.
#[derive(Debug, Args)]
pub(crate) struct SettingsArgs {
    /// Read settings from a TOML file; `sim config` prints one with every setting in it.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Change one setting, as in --set r150.heartbeat_timeout=5s; may be repeated.
    #[arg(long, value_name = "KEY=VALUE", action = ArgAction::Append)]
    pub(crate) set: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Serve on a pseudo-terminal, and make PATH a link to it while running.
    #[arg(long, value_name = "PATH", conflicts_with = "serial")]
    pub(crate) pty: Option<PathBuf>,
    /// Serve on a real serial port.
    #[arg(long, value_name = "DEVICE")]
    pub(crate) serial: Option<PathBuf>,
    /// Serve on the network: rfc2217://HOST:PORT with the settings and lines of a serial port, or
    /// tcp://HOST:PORT with bytes alone. For containers, for clients on Windows and macOS, and for
    /// those that need modem lines. One client at a time; port 0 is any that is free.
    #[arg(long, value_name = "URL", conflicts_with_all = ["pty", "serial"], value_parser = listen)]
    pub(crate) listen: Option<PathBuf>,
    /// Serve all devices of a rig file, in one world; --pty is the short form for one.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pty", "listen", "serial", "device", "start"])]
    pub(crate) rig: Option<PathBuf>,
    /// What to be.
    #[arg(long)]
    pub(crate) device: String,
    /// Paths of the links that are there only when they are asked for, by their ids.
    #[arg(skip)]
    pub(crate) link_ptys: Vec<(&'static str, PathBuf)>,
    /// Who may open the pseudo-terminals: permissions in octal, such as 660 [default: the system's].
    #[arg(long, value_name = "OCTAL", value_parser = mode)]
    pub(crate) mode: Option<u32>,
    /// The group of the pseudo-terminals, by name or number, such as dialout [default: the system's].
    #[arg(long, value_name = "GROUP", value_parser = group)]
    pub(crate) group: Option<u32>,
    /// How pseudo-terminals are set until a client sets them.
    #[arg(long, value_enum, default_value_t = TtyDefaults::Raw)]
    pub(crate) tty_defaults: TtyDefaults,
    /// Build the world from a file; `worlds/` has some.
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
    /// Play the steps and faults of a scenario file against whatever client opens the port, and
    /// judge the outcome. The file names the devices; --pty is where the first is served.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rig", "serial", "world", "device", "start"])]
    pub(crate) scenario: Option<PathBuf>,
    /// How long a busy machine may hold the simulator up in all, while the client's clock goes on. When
    /// it is longer and the scenario fails, that is an error of the machine: exit code 3.
    #[arg(long, value_name = "TIME", default_value = MAX_HOLD_UP, value_parser = some_time)]
    pub(crate) max_hold_up: Span,
    /// In which state it begins, if it has a choice [default: the first].
    #[arg(long)]
    pub(crate) start: Option<String>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Whether bytes take as long on the line as they do on a cable [default: paced on a
    /// pseudo-terminal, instant on a real serial port, whose cable takes its own time].
    #[arg(long, value_enum)]
    pub(crate) wire: Option<WireArg>,
    /// Seed of everything random; a random one is chosen and printed if not given.
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Simulated seconds for each second of real time, 0.01 to 100.
    #[arg(long, value_name = "X", default_value = "1", value_parser = speed)]
    pub(crate) speed: f64,
    /// Write this file when clients can connect, and remove it on exit.
    #[arg(long, value_name = "PATH")]
    pub(crate) ready_file: Option<PathBuf>,
    /// Write a trace, which `sim replay` plays again and `sim trace` shows.
    #[arg(long, value_name = "PATH")]
    pub(crate) trace: Option<PathBuf>,
    /// Let programs and a page look on and change what happens, over HTTP at ADDRESS: 127.0.0.1:0 is
    /// any free port of this machine. The URL, with a token made anew each time, is printed.
    #[arg(long, value_name = "ADDRESS")]
    pub(crate) control: Option<Listen>,
    /// Print every request and reply, in words and hex.
    #[arg(short, long, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// Print nothing but `ready` and errors.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// How to print what happens.
    #[arg(long, value_enum, default_value_t = LogFormat::Text)]
    pub(crate) log_format: LogFormat,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum WireArg {
    /// Each byte takes ten bits at the baud rate.
    Paced,
    /// Bytes arrive at once.
    Instant,
}

impl From<WireArg> for Wire {
    fn from(wire: WireArg) -> Self {
        match wire {
            WireArg::Paced => Self::Paced,
            WireArg::Instant => Self::Instant,
        }
    }
}

/// How pseudo-terminals are set at first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TtyDefaults {
    /// Raw and at the device's speed, so that `cat` and `printf` will do.
    Raw,
    /// As Linux sets a serial port: 9600 baud, with echo and editing, so that a client that forgets
    /// to set it up fails here as it would there.
    Kernel,
}

impl ServeArgs {
    /// Where the first link is served, a path or a URL.
    pub(crate) fn port(&self) -> Option<&PathBuf> {
        self.pty.as_ref().or(self.listen.as_ref())
    }

    /// How pseudo-terminals are set up, but for the speed.
    pub(crate) fn pty_setup(&self) -> PtySetup {
        PtySetup {
            baud: 0,
            defaults: match self.tty_defaults {
                TtyDefaults::Raw => Defaults::Raw,
                TtyDefaults::Kernel => Defaults::Kernel,
            },
            mode: self.mode,
            group: self.group,
        }
    }

    /// The wire as chosen, or as fits the port.
    pub(crate) fn wire(&self) -> Wire {
        match (self.wire, &self.serial) {
            (Some(wire), _) => wire.into(),
            (None, Some(_)) => Wire::Instant,
            (None, None) => Wire::Paced,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line.
    Json,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TimeArg {
    /// Simulated time, which stands still while the client computes and jumps while it waits.
    Lockstep,
    /// Real time, by the system's clocks.
    Real,
}

impl TimeArg {
    /// As it is written.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Real => "real",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RandomArg {
    /// The run's seed.
    Seed,
    /// The system.
    Real,
}

/// A date, as the time since 1970.
fn date(text: &str) -> Result<Duration, String> {
    humantime::parse_rfc3339_weak(text)
        .ok()
        .and_then(|date| date.duration_since(std::time::UNIX_EPOCH).ok())
        .ok_or_else(|| "wanted: a date since 1970, as in \"2025-01-31 12:00:00\"".to_owned())
}

fn listen(text: &str) -> Result<PathBuf, String> {
    match ListenAddress::parse(text) {
        Some(address) => address.map(|address| PathBuf::from(address.to_string())),
        None => Err("allowed: rfc2217://HOST:PORT or tcp://HOST:PORT".to_owned()),
    }
}

fn mode(text: &str) -> Result<u32, String> {
    match u32::from_str_radix(text, 8) {
        Ok(mode) if mode <= 0o777 => Ok(mode),
        _ => Err("allowed: permissions in octal, 000 to 777".to_owned()),
    }
}

/// The number of a group by its name in `/etc/group`, or by itself.
fn group(text: &str) -> Result<u32, String> {
    if let Ok(number) = text.parse() {
        return Ok(number);
    }
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let number = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let number = (fields.next() == Some(text)).then(|| fields.nth(1))?;
        number?.parse().ok()
    });
    number.ok_or_else(|| "no such group in /etc/group; a number will do as well".to_owned())
}

fn some_time(text: &str) -> Result<Span, String> {
    match text.parse::<Span>()? {
        Span(Duration::ZERO) => Err("allowed: some time, as in 90s".to_owned()),
        span => Ok(span),
    }
}

fn speed(text: &str) -> Result<f64, String> {
    let speed: f64 = text
        .parse()
        .map_err(|_| format!("`{text}` is not a number"))?;
    if (0.01..=100.0).contains(&speed) {
        Ok(speed)
    } else {
        Err("allowed: a number from 0.01 to 100".to_owned())
    }
}
