//! Flags of `sim` itself, which serves devices.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use sim_core::line::Wire;
use sim_pty::{Defaults, ListenAddress, PtySetup};
use sim_settings::Span;

use super::{LogFormat, MAX_HOLD_UP, SettingsArgs, some_time, speed};

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Serve at PATH, which your client opens as a serial port: a link to a pseudo-terminal, there
    /// while `sim` runs.
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
    /// Serve all devices of a rig file, in one world.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pty", "listen", "serial", "device", "start"])]
    pub(crate) rig: Option<PathBuf>,
    /// With --rig or --scenario: serve every pseudo-terminal in FOLDER, under the name of its device,
    /// wherever the file wants it; so one file can be served several times at once.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["pty", "listen", "serial", "device"])]
    pub(crate) pty_folder: Option<PathBuf>,
    /// The vehicle to simulate.
    #[arg(long)]
    pub(crate) device: String,
    /// Paths of the links that are there only when they are asked for, by their ids.
    #[arg(skip)]
    pub(crate) link_ptys: Vec<(&'static str, PathBuf)>,
    /// Permissions of the pseudo-terminals in octal, such as 660 [default: the system's].
    #[arg(long, value_name = "OCTAL", value_parser = mode)]
    pub(crate) mode: Option<u32>,
    /// The group of the pseudo-terminals, by name or number, such as dialout [default: the system's].
    #[arg(long, value_name = "GROUP", value_parser = group)]
    pub(crate) group: Option<u32>,
    /// Settings of pseudo-terminals until a client sets them.
    #[arg(long, value_enum, default_value_t = TtyDefaults::Raw)]
    pub(crate) tty_defaults: TtyDefaults,
    /// Build the world from a file; `worlds/` has some.
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
    /// Play the steps and faults of a scenario file against whatever client opens the port, and
    /// judge the outcome. The file names the devices; --pty is where the first is served.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rig", "serial", "world", "device", "start"])]
    pub(crate) scenario: Option<PathBuf>,
    /// With --scenario: how long a busy machine may hold the simulator up in all. A failure after more
    /// than that is an error of the machine, exit code 3, and none of the client.
    #[arg(long, value_name = "TIME", default_value = MAX_HOLD_UP, value_parser = some_time)]
    pub(crate) max_hold_up: Span,
    /// State in which the device begins, if it has several [default: the first].
    #[arg(long)]
    pub(crate) start: Option<String>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Pace of bytes on the line [default: paced; instant with --serial, whose cable takes its
    /// own time].
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
    /// Let `sim ctl`, programs and a page look on and change what happens, over HTTP at ADDRESS;
    /// 127.0.0.1:0 is any free port of this machine. Prints the URL, with a new token each time.
    #[arg(long, value_name = "ADDRESS", value_parser = sim_control::listen)]
    pub(crate) control: Option<SocketAddr>,
    /// Print every request and reply, in words and hex.
    #[arg(short, long, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// Print nothing but `ready` and errors.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// Form in which events are printed.
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

/// Settings of pseudo-terminals at first.
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

    /// Setup of pseudo-terminals, but for the speed.
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
