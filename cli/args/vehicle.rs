//! Flags of the subcommands that work with a real vehicle.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::{LogFormat, SettingsArgs};

const TAP_EXAMPLES: &str = "\
Examples:
  sim tap /dev/ttyUSB0 --pty /tmp/r150 --trace drive.jsonl -v
      Stand between your client, which opens /tmp/r150, and the vehicle at /dev/ttyUSB0; record and
      print all that passes. Ctrl-C ends it.
  sim tap /dev/ttyUSB0 /dev/ttyUSB1 --device mecanum --pty /tmp/car --pty /tmp/ros --trace car.jsonl
      The same with both links of a mecanum car.
  sim tap --csv capture.csv --trace drive.jsonl
      Read a capture made elsewhere. Each line is `seconds,direction,bytes`, as in
      `12.345678,client,AA550007C784`. The direction is `client` or `vehicle`; on the second link it
      is `client:1` or `vehicle:1`.
  sim tap --pcap capture.pcapng --usb 1.5 --trace drive.jsonl
      Read what Wireshark has captured of the adapter that is device 5 at bus 1.";

/// What stands between a client and a vehicle, and writes down what passes.
#[derive(Debug, Args)]
#[command(after_help = TAP_EXAMPLES)]
pub(crate) struct TapArgs {
    /// The serial port of the vehicle; a second one for its second link.
    #[arg(value_name = "DEVICE", required_unless_present_any = ["csv", "pcap"])]
    pub(crate) vehicle: Vec<PathBuf>,
    /// Where the client connects, once for each link: a path for a pseudo-terminal, or
    /// rfc2217://HOST:PORT or tcp://HOST:PORT.
    #[arg(
        long = "pty",
        visible_alias = "listen",
        value_name = "PATH",
        required_unless_present_any = ["csv", "pcap"]
    )]
    pub(crate) client: Vec<PathBuf>,
    /// Read this capture instead of recording.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["vehicle", "client"])]
    pub(crate) csv: Option<PathBuf>,
    /// Read this pcap or pcapng file of a USB adapter instead of recording: of usbmon or USBPcap, with CDC-ACM,
    /// FTDI, CP210x or CH34x.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["vehicle", "client", "csv"])]
    pub(crate) pcap: Option<PathBuf>,
    /// The adapter in it, as BUS.DEVICE, once for each link; not needed if it has only one.
    #[arg(long, value_name = "BUS.DEVICE", requires = "pcap", conflicts_with_all = ["csv", "vehicle", "client"])]
    pub(crate) usb: Vec<String>,
    /// The recording to write.
    #[arg(long, value_name = "PATH")]
    pub(crate) trace: PathBuf,
    /// The kind of vehicle.
    #[arg(long)]
    pub(crate) device: String,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Guide through the drive of `sim fit --plan`: print which manoeuvre is next, and which the client has
    /// performed. The client sends them, as docs/examples/identify.py does.
    #[arg(long, conflicts_with_all = ["csv", "pcap"])]
    pub(crate) plan: bool,
    /// Print every request and reply, in words and hex.
    #[arg(short, long)]
    pub(crate) verbose: bool,
    /// Serve the page, and `sim ctl`, over HTTP at ADDRESS, as `sim --control` does. Replies and reported values
    /// are the vehicle's. All else is of a model that gets what the client sends.
    #[arg(long, value_name = "ADDRESS", value_parser = rigsim_control::listen, conflicts_with_all = ["csv", "pcap"])]
    pub(crate) control: Option<SocketAddr>,
    /// Output format of events.
    #[arg(long, value_enum, default_value_t = LogFormat::Text)]
    pub(crate) log_format: LogFormat,
}

const COMPARE_EXAMPLES: &str = "\
Examples:
  sim compare drive.jsonl
      Play what the client sent into the model, and print where the vehicle does something else.
  sim compare drive.jsonl --config vehicle.toml --report page.html
      The same with other settings, and a page with a plot of each field.
  sim compare drive.jsonl --poses poses.csv
      Compare also where the vehicle was.

Exit codes:
  0  nothing documented is contradicted
  1  something documented is, or a difference that no setting explains
  2  usage or configuration: a flag or a file is wrong
  3  too little is left for a verdict, since the recording machine stalled; or the system refused
     something, such as writing the page";

/// Poses beside recordings.
#[derive(Debug, Args)]
pub(crate) struct PosesArgs {
    /// Compare also with where the vehicle was, by motion capture or GNSS: a CSV file with the columns
    /// seconds, x_m, y_m and heading_deg, which is counter-clockwise. Once for each recording, in the
    /// same order.
    #[arg(long, value_name = "FILE")]
    pub(crate) poses: Vec<PathBuf>,
    /// Time to add to the times of the poses, so that they match the recording. `auto` finds the one at which
    /// vehicle and model move together.
    #[arg(
        long,
        value_name = "TIME",
        default_value = "auto",
        allow_hyphen_values = true,
        requires = "poses"
    )]
    pub(crate) poses_offset: String,
}

/// Comparison of a recording with the model.
#[derive(Debug, Args)]
#[command(after_help = COMPARE_EXAMPLES)]
pub(crate) struct CompareArgs {
    /// A recording of `sim tap`, or a trace of `sim run` with a client.
    pub(crate) trace: PathBuf,
    #[command(flatten)]
    pub(crate) poses: PosesArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Judge only settings that begin so, as in r150.motor,r150.over_rate.
    #[arg(long, value_name = "KEYS", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    /// Write a page with plots.
    #[arg(long, value_name = "FILE")]
    pub(crate) report: Option<PathBuf>,
    /// Print everything as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

const FIT_EXAMPLES: &str = "\
Examples:
  sim fit --plan
      Print a drive of some minutes that makes many settings identifiable. docs/examples/identify.py
      performs it.
  sim fit drive.jsonl --output vehicle.toml
      Find the settings by which the model does what was recorded.
  sim --pty /tmp/r150 --config vehicle.toml
      Serve an R150 with them.

Exit codes:
  0  done
  2  usage or configuration: a flag or a file is wrong
  3  too little is left of the recording, since the machine stalled: nothing is written; or the
     system refused something, such as writing the file";

/// Search for the settings of a recorded vehicle.
#[derive(Debug, Args)]
#[command(after_help = FIT_EXAMPLES)]
pub(crate) struct FitArgs {
    /// Recordings of `sim tap`, of the same vehicle.
    #[arg(required_unless_present = "plan")]
    pub(crate) traces: Vec<PathBuf>,
    /// Where to write the settings that differ.
    #[arg(long, value_name = "FILE", required_unless_present = "plan")]
    pub(crate) output: Option<PathBuf>,
    /// Print a drive that makes settings identifiable, instead.
    #[arg(long, conflicts_with_all = ["traces", "output", "only"])]
    pub(crate) plan: bool,
    /// The kind of vehicle that the plan is for.
    #[arg(long, requires = "plan")]
    pub(crate) device: String,
    #[command(flatten)]
    pub(crate) poses: PosesArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Search only among settings that begin so, as in r150.motor,r150.over_rate.
    #[arg(long, value_name = "KEYS", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    /// Print everything as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}
