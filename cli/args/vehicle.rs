//! Flags of the subcommands that work with a real vehicle.

use std::path::PathBuf;

use clap::Args;

use super::{LogFormat, SettingsArgs};

const TAP_EXAMPLES: &str = "\
Examples:
  sim tap /dev/ttyUSB0 --pty /tmp/r150 --trace drive.jsonl -v
      Stand between your client, which opens /tmp/r150, and the vehicle at /dev/ttyUSB0; record and
      print all that passes. Ctrl-C ends it.
  sim tap /dev/ttyUSB0 /dev/ttyUSB1 --device mecanum --pty /tmp/car --pty /tmp/car-ros --trace drive.jsonl
      The same with both links of a mecanum car.
  sim tap --csv capture.csv --trace drive.jsonl
      Read a capture made elsewhere. Each line is `seconds,direction,bytes`, as in
      `12.345678,client,AA5500070A3B`; direction is `client` or `vehicle`, with `:1` behind it for the
      second link.";

/// What stands between a client and a vehicle, and writes down what passes.
#[derive(Debug, Args)]
#[command(after_help = TAP_EXAMPLES)]
pub(crate) struct TapArgs {
    /// The serial port of the vehicle; a second one for its second link.
    #[arg(value_name = "DEVICE", required_unless_present = "csv")]
    pub(crate) vehicle: Vec<PathBuf>,
    /// Where the client connects, once for each link: a path for a pseudo-terminal, or
    /// rfc2217://HOST:PORT or tcp://HOST:PORT.
    #[arg(
        long = "pty",
        visible_alias = "listen",
        value_name = "PATH",
        required_unless_present = "csv"
    )]
    pub(crate) client: Vec<PathBuf>,
    /// Read this capture instead of recording.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["vehicle", "client"])]
    pub(crate) csv: Option<PathBuf>,
    /// The recording to write.
    #[arg(long, value_name = "PATH")]
    pub(crate) trace: PathBuf,
    /// The kind of vehicle.
    #[arg(long)]
    pub(crate) device: String,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Print every request and reply, in words and hex.
    #[arg(short, long)]
    pub(crate) verbose: bool,
    /// Output format of events.
    #[arg(long, value_enum, default_value_t = LogFormat::Text)]
    pub(crate) log_format: LogFormat,
}
