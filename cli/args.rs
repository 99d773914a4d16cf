//! Flags and subcommands.

mod hunt;
mod merge;
mod run;
mod serve;
mod shard;
mod vehicle;

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{
    Arg, ArgAction, ArgMatches, Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand,
    ValueEnum as _, value_parser,
};
use rigsim_core::device::{DeviceSpec, Devices, LinkSpec};
use rigsim_runner::renamed::{self, Kind, Renamed};
use rigsim_settings::Span;

use crate::control::ctl::{CtlArgs, speed};
use crate::exit::Exit;
use crate::export::ExportFormat;
use crate::lists::{FileKind, SchemaFormat};
use crate::log::LogFormat;

use crate::visible;

pub(crate) use hunt::{HuntArgs, StageArg};
pub(crate) use merge::MergeArgs;
pub(crate) use run::{ExitArg, GivenArgs, RandomArg, RunArgs, ScheduleArg, TimeArg, again};
pub(crate) use serve::ServeArgs;
pub(crate) use shard::{Shard, shard};
pub(crate) use vehicle::{CompareArgs, FitArgs, PosesArgs, TapArgs};

const EXAMPLES: &str = "\
Examples:
  sim --pty /tmp/r150
      Serve an R150 that is ready to drive. Open /tmp/r150 in your client as a serial port, at
      115200 baud.
  sim --pty /tmp/r150 -v
      Also print every request and reply, in words and hex.
  sim --device mecanum --pty /tmp/car --ros-pty /tmp/car-ros --world worlds/yard.toml
      Serve a mecanum car with both of its links, in a yard with walls.
  sim --pty /tmp/r150 --control 127.0.0.1:0
      Also print the URL of a page that shows the vehicle and can break it. See `sim ctl --help`.
  sim --pty /tmp/r150 --scenario scenarios/r150/faults/cable-pulled.toml
      Play the faults of a scenario with any client that opens /tmp/r150, and print the verdict.
  sim run scenarios/r150 -- python3 my_client.py
      Play every scenario with your client, one after the other. See `sim run --help`.
  sim --pty /tmp/r150 --set r150.battery.initial_soc=5% --set world.slope=10deg
      Serve an R150 with a nearly empty battery on a slope. `sim config` lists every setting.
  sim --pty /tmp/r150 --start locked
      Start as the hardware does: locked, parked, in remote mode. Motor commands then do nothing.
  sim --pty /tmp/r150 --wire instant --log-format json | tee run.jsonl
      Send bytes without the delay of a line, and print one JSON object for each event.
  sim --listen rfc2217://127.0.0.1:2217
      Serve on the network: serial_for_url('rfc2217://127.0.0.1:2217') in pyserial. Use it for
      containers, other operating systems, and clients that need modem lines.
  sim --serial /dev/ttyUSB0
      Serve at a real serial port, with your client at the other end of the cable.
  sim --rig worlds/two-and-two.toml
      Serve several devices in one world.";

const CHECK_EXAMPLES: &str = "\
Examples:
  sim check my-scenario.toml
      Print every error with its line and column. The exit code is 2 if there is one.
  sim check scenarios my-scenarios
      Check all files in two folders.
  sim check --job my-job.toml scenarios/r150/faults
      Check every fault file as it would be played within your own job.";

const TRACE_EXAMPLES: &str = "\
Examples:
  sim run --output traces --seed 1 scenarios/r150/faults/cable-pulled.toml
      Write traces/scenarios-r150-faults-cable-pulled.trace.jsonl, a trace.
  sim trace ice.trace.jsonl
      Print all traffic and events, as `sim -v` does.
  sim trace ice.trace.jsonl --from 2s --until 2.5s --device r150
      Print half a second of it, for one device.
  sim trace ice.trace.jsonl --csv t,truth.x_m,reported.v48_a --every 10ms > ice.csv
      Print values as CSV, one line every 10 ms. `sim names` lists the names.
  sim trace ice.trace.jsonl --to ice.pcapng
      Write all frames for Wireshark. docs/tools.md has the formats of other tools.
  sim trace yesterday.trace.jsonl today.trace.jsonl --within 20ms
      Print the first difference of two runs. Times that differ by up to 20 ms count as equal: in
      real time, two runs are never the same to the nanosecond.";

const REPLAY_EXAMPLE: &str = "\
Example:
  sim run --output traces --seed 1 scenarios/r150/faults/cable-pulled.toml
  sim replay traces/scenarios-r150-faults-cable-pulled.trace.jsonl
      Prints `the devices did the same to the last byte`, or the first difference: exit code 1.
  sim replay traces/my.trace.jsonl --until \"12.3 s\"
      Stop there, paused, with ports and the page. `sim ctl advance 50ms` and `sim ctl resume` continue.";

const MCP_EXAMPLE: &str = "\
Example:
  sim mcp < /dev/null
      Start it and end at once. An agent starts it by a file like this, in its own folder:
      {\"mcpServers\": {\"sim\": {\"command\": \"sim\", \"args\": [\"mcp\"]}}}
      A call of `run` or `hunt` starts the client's command.";

const FAULTS_EXAMPLES: &str = "\
Examples:
  sim faults --device r150
      List every fault that an R150 can have, with its parameters.
  sim ctl fault bit-flips probability=0.01 --for 2s
      Start one of them in a simulator that runs with --control.

In a scenario file:
  [[step]]
  when = \"truth.distance_m > 1\"
  for = \"2 s\"
  fault = { kind = \"bit-flips\", probability = 0.01 }";

const NAMES_EXAMPLES: &str = "\
Examples:
  sim names
      List the names of an R150.
  sim names --device mecanum | grep truth
      List the names of the true state of a mecanum car, as opposed to what it reports.

In a scenario file:
  always = [{ that = \"truth.speed_mps < 0.8\" }]";

const CONFIG_EXAMPLES: &str = "\
Examples:
  sim config --device r150 | less
      Show the settings of an R150, beginning with those to compare with your vehicle first.
  sim config > mine.toml
      Save every setting. Change what you like, delete the rest.
  sim --pty /tmp/r150 --config mine.toml
      Serve an R150 with these settings.
  sim config --config mine.toml --set r150.over_rate=silent | grep -B4 over_rate
      Show the result of a file and a flag together.";

const SCHEMA_EXAMPLES: &str = "\
Example:
  sim schema scenario > scenario.schema.json
      Put `#:schema scenario.schema.json` first in a scenario file. Editors with Taplo or Even
      Better TOML then complete and check the file.";

/// A client that drives at 1 m/s and goes by its own clock is a quarter of a metre off after that.
pub(crate) const MAX_STALL: &str = "250ms";

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
            if let Some(Command::Run(args)) = &mut cli.command {
                args.again = matches
                    .subcommand()
                    .map_or(Vec::new(), |(_, run)| again(run));
            }
            Ok(cli)
        };
        parse(words).map_err(|error: clap::Error| {
            if let Some(renamed) = former_name(&error, words) {
                return clap::Error::raw(error.kind(), format!("{renamed}\n"));
            }
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

/// What a flag or subcommand is called now that there is no more.
fn former_name(error: &clap::Error, words: &[OsString]) -> Option<&'static Renamed> {
    let context = match error.kind() {
        ErrorKind::UnknownArgument => ContextKind::InvalidArg,
        ErrorKind::InvalidSubcommand => ContextKind::InvalidSubcommand,
        _ => return None,
    };
    let Some(ContextValue::String(word)) = error.get(context) else {
        return None;
    };
    let word = word.split('=').next()?;
    let is_here = |kind| match kind {
        // A simulator that serves has no subcommand.
        Kind::Flag(command) => words
            .get(1)
            .is_some_and(|word| word == command || word.as_encoded_bytes().starts_with(b"-")),
        kind => kind == Kind::Ctl,
    };
    renamed::find(is_here, word)
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
        .mut_subcommand("schema", |sub| {
            let files = FileKind::value_variants().iter();
            let files = files.filter_map(|kind| kind.to_possible_value());
            let about = |device: &&DeviceSpec| {
                let help = format!("The protocol of {}, with `--format lua`", device.title);
                PossibleValue::new(device.id).help(help)
            };
            let all = files.chain(devices.iter().map(about));
            let all = PossibleValuesParser::new(all.collect::<Vec<_>>());
            sub.mut_arg("of", |arg| arg.value_parser(all))
        });
    for name in ["config", "faults"] {
        command = command.mut_subcommand(name, |sub| {
            sub.mut_arg("device", |arg| arg.value_parser(kinds()))
        });
    }
    for name in ["tap", "fit", "names"] {
        command = command.mut_subcommand(name, |sub| sub.mut_arg("device", device));
    }
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
    /// Play scenario files with your client, or the client scripted in the file, and print verdicts.
    ///
    /// Time is simulated, also for your client.
    Run(Box<RunArgs>),
    /// Check scenario files for errors, without playing them.
    #[command(after_help = CHECK_EXAMPLES)]
    Check {
        /// Files, or folders of them.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        #[command(flatten)]
        given: GivenArgs,
    },
    /// Search for the smallest faults that make your client break a rule, and write them as scenario
    /// files.
    Hunt(Box<HuntArgs>),
    /// Merge the results of all shards of a campaign; refuse if a result is missing.
    Merge(MergeArgs),
    /// Show what happened in a run, from its trace: as text, as CSV, or compared with another trace.
    Trace(TraceArgs),
    /// Play a trace again: the devices must send the same bytes.
    #[command(after_help = REPLAY_EXAMPLE)]
    Replay(ReplayArgs),
    /// Stand between your client and a real vehicle, and record what passes.
    Tap(TapArgs),
    /// Compare a recording of a vehicle with the model: replies, fields, and which settings it supports
    /// or contradicts.
    Compare(CompareArgs),
    /// Find the settings by which the model does what was recorded.
    Fit(FitArgs),
    /// Observe and control a simulator that runs with --control.
    Ctl(CtlArgs),
    /// Serve agents: a server of the Model Context Protocol on standard input and output.
    ///
    /// Its tools list, check, run, hunt, explain, and control a simulator step by step. It ends when its
    /// input ends.
    #[command(after_help = MCP_EXAMPLE)]
    Mcp,
    /// List the faults: what can be broken, with parameters, and what the client sees of it.
    #[command(after_help = FAULTS_EXAMPLES)]
    Faults {
        /// List only the faults of this device.
        #[arg(long)]
        device: Option<String>,
    },
    /// List the names for conditions, such as `truth.speed_mps`, with unit and meaning.
    #[command(after_help = NAMES_EXAMPLES)]
    Names {
        /// List the names of this device.
        #[arg(long)]
        device: String,
    },
    /// List every setting, with its meaning, its allowed values, and whether it is documented or
    /// assumed.
    ///
    /// The output is a valid --config file.
    #[command(after_help = CONFIG_EXAMPLES)]
    Config {
        /// List only settings of this device, beginning with those to compare with yours first.
        #[arg(long)]
        device: Option<String>,
        #[command(flatten)]
        settings: SettingsArgs,
    },
    /// Print the JSON Schema of world, rig or scenario files for your editor, or the dissector of a
    /// device for Wireshark.
    #[command(after_help = SCHEMA_EXAMPLES)]
    Schema {
        /// The kind of file, or a device.
        of: String,
        /// `markdown` prints the reference of scenario files as a page; `lua` prints the dissector of a
        /// device.
        #[arg(long, value_enum, default_value = "json")]
        format: SchemaFormat,
    },
    /// Look after a client of `run`.
    #[command(hide = true)]
    Supervise {
        /// The client and its arguments.
        #[arg(last = true, required = true)]
        client: Vec<OsString>,
    },
}

/// A trace, and where to stop.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// A trace of `sim run --output` or `sim --trace`.
    pub(crate) trace: PathBuf,
    /// Stop at this simulated time, paused. From there the run continues live, in real time, by control
    /// and with any client that opens a port then.
    #[arg(long, value_name = "TIME")]
    pub(crate) until: Option<Span>,
    /// With --until: the address of control and of the page, as for `sim --control`.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", requires = "until", value_parser = rigsim_control::listen)]
    pub(crate) control: std::net::SocketAddr,
}

/// Which part of a trace to print, and how.
#[derive(Debug, Args)]
#[command(after_help = TRACE_EXAMPLES)]
pub(crate) struct TraceArgs {
    /// A trace of `sim run --output` or `sim --trace`.
    pub(crate) trace: PathBuf,
    /// Another trace: print the first difference, and what came before it.
    #[arg(conflicts_with_all = ["csv", "every", "log_format", "to"])]
    pub(crate) other: Option<PathBuf>,
    /// Begin at this simulated time, as in 2.5s.
    #[arg(long, value_name = "TIME")]
    pub(crate) from: Option<Span>,
    /// End at this simulated time.
    #[arg(long, value_name = "TIME")]
    pub(crate) until: Option<Span>,
    /// Show only this device; may be repeated.
    #[arg(long, value_name = "NAME", action = ArgAction::Append, conflicts_with = "csv")]
    pub(crate) device: Vec<String>,
    /// Print the values of these names as CSV instead, as in t,truth.x_m,reported.v48_a.
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        conflicts_with = "log_format"
    )]
    pub(crate) csv: Vec<String>,
    /// Simulated time between two lines of CSV [default: 100ms].
    #[arg(long, value_name = "TIME", value_parser = some_time, requires = "csv")]
    pub(crate) every: Option<Span>,
    /// Treat times of the two traces as equal if they differ by no more than this [default: 0].
    #[arg(long, value_name = "TIME", requires = "other")]
    pub(crate) within: Option<Span>,
    /// Output format of events.
    #[arg(long, value_enum, default_value_t = LogFormat::Text)]
    pub(crate) log_format: LogFormat,
    /// Write the whole trace to a file for another tool, whose ending names the format.
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["from", "until", "device", "csv", "log_format"]
    )]
    pub(crate) to: Option<PathBuf>,
    /// The format of --to, whatever the ending.
    #[arg(long, value_enum, requires = "to")]
    pub(crate) format: Option<ExportFormat>,
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

fn some_time(text: &str) -> Result<Span, String> {
    match text.parse::<Span>()? {
        Span(Duration::ZERO) => Err("allowed: some time, as in 90s".to_owned()),
        span => Ok(span),
    }
}
