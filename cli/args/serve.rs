//! Flags of `sim` itself, which serves devices.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use rigsim_core::line::Wire;
use rigsim_pty::{Defaults, ListenAddress, PtySetup};
use rigsim_settings::Span;

use super::{LogFormat, MAX_STALL, SettingsArgs, some_time, speed};

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Serve at PATH, which your client opens as a serial port. It is a link to a pseudo-terminal, and
    /// exists while `sim` runs.
    #[arg(long, value_name = "PATH", conflicts_with = "serial")]
    pub(crate) pty: Option<PathBuf>,
    /// Serve on a real serial port.
    #[arg(long, value_name = "DEVICE")]
    pub(crate) serial: Option<PathBuf>,
    /// Serve on the network: rfc2217://HOST:PORT with the settings and modem lines of a serial port, or
    /// tcp://HOST:PORT with bytes only. Use it for containers, for clients on Windows and macOS, and for
    /// clients that need modem lines. It accepts one client at a time. Port 0 means any free port.
    #[arg(long, value_name = "URL", conflicts_with_all = ["pty", "serial"], value_parser = listen)]
    pub(crate) listen: Option<PathBuf>,
    /// Serve all devices of a rig file, in one world.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pty", "listen", "serial", "device", "start"])]
    pub(crate) rig: Option<PathBuf>,
    /// With --rig or --scenario: put every pseudo-terminal into FOLDER, under the name of its device,
    /// instead of the paths in the file. So one file can be served several times at once.
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
    /// Play the steps and faults of a scenario file with any client that opens the port, and print the
    /// verdict. The file names the devices; --pty is the path of the first one.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rig", "serial", "world", "device", "start"])]
    pub(crate) scenario: Option<PathBuf>,
    /// With --scenario: how long a busy machine may stall the simulator in all. A failure after more
    /// than that is an error of the machine (exit code 3) and not of the client.
    #[arg(long, value_name = "TIME", default_value = MAX_STALL, value_parser = some_time)]
    pub(crate) max_stall: Span,
    /// State in which the device starts, if it has several [default: the first].
    #[arg(long)]
    pub(crate) start: Option<String>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Speed of bytes on the line [default: paced; instant with --serial, where the cable itself takes
    /// time].
    #[arg(long, value_enum)]
    pub(crate) wire: Option<WireArg>,
    /// Seed of all random numbers [default: a random one, which is printed].
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Simulated seconds for each second of real time, 0.01 to 100.
    #[arg(long, value_name = "X", default_value = "1", value_parser = speed)]
    pub(crate) speed: f64,
    /// Write this file when clients can connect, and remove it on exit.
    #[arg(long, value_name = "PATH")]
    pub(crate) ready_file: Option<PathBuf>,
    /// Write a trace, for `sim replay` and `sim trace`.
    #[arg(long, value_name = "PATH")]
    pub(crate) trace: Option<PathBuf>,
    /// Let `sim ctl`, programs and a page observe and control the simulator, over HTTP at ADDRESS.
    /// 127.0.0.1:0 means any free port of this machine. Prints the URL, with a new token each time.
    #[arg(long, value_name = "ADDRESS", value_parser = rigsim_control::listen)]
    pub(crate) control: Option<SocketAddr>,
    /// Print every request and reply, in words and hex.
    #[arg(short, long, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// Print nothing but `ready` and errors.
    #[arg(short, long)]
    pub(crate) quiet: bool,
    /// Output format of events.
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
    /// Raw and at the device's speed, so that `cat` and `printf` work.
    Raw,
    /// As Linux sets a serial port: 9600 baud, with echo and line editing. A client that forgets to set
    /// up the port then fails, as on real hardware.
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
