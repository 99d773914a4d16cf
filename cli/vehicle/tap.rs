//! Between a client and a real vehicle: forwards bytes both ways at once, and records them.
//!
//! The vehicle's port is open while the client has its own open, set as the client has set it. When the
//! vehicle is unplugged, the client's port hangs up; it returns with the vehicle.

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::device::host::{FrameReader, Sender};
use rigsim_core::event::{Code, Event, EventKind, code};
use rigsim_core::line::{ClientLine, event};
use rigsim_pty::{
    Event as PortEvent, Port, PortError, PortErrorKind, PtySetup, Waiter, open_port,
    open_serial_port,
};
use rigsim_runner::trace::{Hexed, MOST_BYTES, PortRecord, Record};
use serde_json::json;

use super::guide::Guide;
use super::live::{Live, Piece};
use super::{capture, end, header, plan, plan_of};
use crate::args::TapArgs;
use crate::config;
use crate::exit::{Exit, Failure, refuse};
use crate::log::{Log, LogFormat, LogOptions, Words};
use crate::patient_file::PatientFile;
use crate::print::{complain, print};
use crate::recording::TraceFile;
use crate::visible;

/// Most bytes in the queue to the vehicle; beyond that the client has to wait.
const MOST_WAITING: usize = 1 << 16;
/// Most reads of a port in a row before the other direction gets its turn.
const MOST_READS: usize = 16;
/// Time after which a port that took no more is tried again: an eighth of what the smallest buffer of a
/// serial port holds at 1 Mbit/s.
const RETRY: Duration = Duration::from_millis(1);
/// Interval at which the client's line settings are read while it sends nothing.
const LOOK: Duration = Duration::from_millis(20);
/// Interval of the search for a vehicle that is gone.
const SEARCH: Duration = Duration::from_millis(100);
/// Delay of a wake-up from which it is recorded.
const STALL: Duration = Duration::from_millis(20);
/// Interval at which the recording is written out.
const FLUSH: Duration = Duration::from_secs(1);

rigsim_core::codes! {
    /// The vehicle was unplugged.
    VEHICLE_GONE = "vehicle_gone", Notice, NoParty;
    /// It is there again.
    VEHICLE_BACK = "vehicle_back", Notice, NoParty;
    /// The client's port cannot be used any more; it is opened again.
    CLIENT_PORT_FAILED = "client_port_failed", Notice, NoParty;
    /// The vehicle's port cannot be set as the client has set its own.
    LINE_REFUSED = "line_refused", Notice, NoParty;
}

/// The `tap` subcommand: records until a signal ends it, or reads a capture.
pub(crate) fn tap(devices: Devices, args: &TapArgs) -> Result<Exit, Failure> {
    let settings = config::load(devices, &args.settings)?;
    if let Some(path) = args.csv.as_ref().or(args.pcap.as_ref()) {
        let most = devices.iter().find(|device| device.id == args.device);
        let most = most.map_or(1, |device| device.links.len());
        let plan = plan_of(devices, &args.device, most, settings)?;
        let records = match args.pcap {
            None => capture::of_text(&config::read(path, "capture")?, most),
            Some(_) => PatientFile::open(path)
                .map_err(Into::into)
                .and_then(|file| capture::of_usb(file, &args.usb, most)),
        };
        let records = records
            .with_context(|| format!("cannot read the capture {}", visible::name(path)))
            .map_err(Failure::usage)?;
        let mut trace = TraceFile::create(args.trace.clone()).map_err(Failure::usage)?;
        trace.record(&Record::Header(Box::new(header(&plan))));
        records.iter().for_each(|record| trace.record(record));
        trace.finish()?;
        let count = |record: &Record| match record {
            Record::In { bytes, .. } => [bytes.0.len(), 0],
            Record::Out { bytes, .. } => [0, bytes.0.len()],
            _ => [0, 0],
        };
        let passed = records.iter().map(count).fold([0; 2], |sum, more| {
            [0, 1].map(|way| sum[way] + more[way] as u64)
        });
        return print(&summary(args.log_format, passed, None));
    }
    if args.vehicle.len() != args.client.len() {
        refuse!("give --pty once for each DEVICE, in the same order");
    }
    let real = |path: &PathBuf| path.canonicalize().unwrap_or(path.clone());
    let real: BTreeSet<PathBuf> = args.vehicle.iter().map(real).collect();
    if real.len() < args.vehicle.len() {
        refuse!("the same DEVICE is named twice; each link has its own");
    }
    let plan = plan_of(devices, &args.device, args.vehicle.len(), settings)?;
    let guide = match args.plan {
        true => {
            let device = Some(plan.devices[0].device);
            let all = plan::of_device(device, &args.device, &plan.settings)?;
            Some(Guide::new(&all, args.vehicle.len()))
        }
        false => None,
    };
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    let mut links = Vec::new();
    for link in plan.links() {
        let index = link.id.link;
        let planned = &plan.devices[0];
        let readers = planned.own_settings().filter(|_| args.verbose);
        let readers = readers.map(|device_settings| {
            [Sender::Client, Sender::Device]
                .map(|sender| (planned.device.host.frames)(index, sender, device_settings))
        });
        let (vehicle, place) = (&args.vehicle[index], &args.client[index]);
        links.push(Link::open(
            index,
            vehicle,
            place,
            link.baud,
            readers,
            &mut waiter,
        )?);
    }
    let options = LogOptions {
        format: args.log_format,
        verbose: args.verbose,
        quiet: false,
    };
    let log = Log::start(options, Words::new(&plan))
        .context("cannot start the thread that prints")
        .map_err(Failure::system)?;
    let first = header(&plan);
    let ports: Vec<String> = links.iter().map(Link::client_path).collect();
    let paths = ports.iter().map(PathBuf::from).collect();
    let live = args
        .control
        .map(|listen| Live::start(listen, plan, paths, &log));
    let live = live.transpose()?;
    // Last, so that a failed start leaves nothing behind.
    let trace = TraceFile::begin(args.trace.clone(), first)?;
    log.text(match args.log_format {
        LogFormat::Text => format!("  between {} and the vehicle\nready", ports.join(", ")),
        LogFormat::Json => visible::json(&json!({"code": "ready", "ports": ports})),
    });
    let mut out = Out {
        live,
        log,
        trace,
        start: Instant::now(),
        guide,
    };
    if let Some((code, text)) = out.guide.as_ref().and_then(Guide::next) {
        out.vehicle(code, text);
    }
    pass(waiter, links, out)
}

/// Forwards everything until a signal comes.
fn pass(mut waiter: Waiter, mut links: Vec<Link>, mut out: Out) -> Result<Exit, Failure> {
    let mut flushed = Instant::now();
    let mut is_kept = true;
    loop {
        let timeout = links.iter().filter_map(Link::timeout).min();
        if links.iter().any(|link| link.is_blocked()) {
            // The waiter would immediately report the port that is not read.
            std::thread::sleep(RETRY);
        }
        let ready = Instant::now();
        let wake = waiter.wait(timeout).map_err(Failure::system)?;
        let late = ready
            .elapsed()
            .saturating_sub(timeout.unwrap_or(Duration::MAX));
        let is_over = wake.is_signalled();
        let woken = Instant::now();
        for link in &mut links {
            if let Err(error) = link.pass(&mut waiter, &mut out) {
                link.lose(&error, &mut out);
            }
            link.search(&mut waiter, &mut out)?;
        }
        out.record_stall(late.max(woken.elapsed()));
        if is_over {
            break;
        }
        if flushed.elapsed() > FLUSH {
            // The vehicle may be moving: bytes still pass, and the reason is reported at the end.
            if let Err(why) = out.trace.flush()
                && std::mem::take(&mut is_kept)
            {
                complain(&format!("{}; what passes now is not recorded", why.error));
            }
            flushed = Instant::now();
        }
    }
    out.trace.record(&end(out.now()));
    let passed = [0, 1].map(|way| links.iter().map(|link| link.passed[way]).sum::<u64>());
    drop(links);
    out.live = None;
    let missing = out.guide.as_ref().map(Guide::missing);
    let last = summary(out.log.options.format, passed, missing);
    out.log.finish(Some(last), |_| false);
    out.trace.finish().map(|_| Exit::Clean)
}

/// How many bytes were recorded, to the vehicle and from it, and what is missing of a plan.
fn summary(format: LogFormat, passed: [u64; 2], missing: Option<Vec<&str>>) -> String {
    let [to_vehicle, to_client] = passed;
    match format {
        LogFormat::Text => {
            let of_plan = match missing.as_deref() {
                None => String::new(),
                Some([]) => "\nthe plan is complete".to_owned(),
                Some(missing) => format!("\nmissing of the plan: {}", missing.join("; ")),
            };
            format!("{to_vehicle} bytes to the vehicle, {to_client} bytes from it{of_plan}")
        }
        LogFormat::Json => visible::json(&json!({
            "code": "summary", "to_vehicle": to_vehicle, "from_vehicle": to_client, "missing": missing,
        })),
    }
}

/// Log and recording.
struct Out {
    log: Log,
    live: Option<Live>,
    trace: TraceFile,
    start: Instant,
    /// Set if the client performs the plan.
    guide: Option<Guide>,
}

impl Out {
    /// Time since the beginning, ns.
    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn record(&mut self, record: Record) {
        self.trace.record(&record);
        if let Some(live) = &mut self.live {
            live.show(Piece::Record(record));
        }
    }

    /// Records that the machine stalled for this long: bytes with a time in it may be older.
    fn record_stall(&mut self, late: Duration) {
        if late > STALL {
            let by = u64::try_from(late.as_nanos()).unwrap_or(u64::MAX);
            self.trace.record(&Record::Late {
                t: self.now(),
                by,
                stood: 0,
            });
        }
    }

    fn event(&self, t: u64, kind: EventKind) {
        self.log.event(Event {
            at: SimTime::from_nanos(t),
            device: 0,
            kind,
        });
    }

    /// The client has sent this.
    fn guide(&mut self, link: usize, t: u64, bytes: &[u8]) {
        let guide = self.guide.as_mut();
        let said = guide.map(|guide| guide.client_sent(link, t, bytes));
        for (code, text) in said.into_iter().flatten() {
            self.vehicle(code, text);
        }
    }

    /// Something happened to the vehicle itself, or to the plan.
    fn vehicle(&mut self, code: Code, text: String) {
        let t = self.now();
        self.trace.record(&Record::Event {
            t,
            device: 0,
            code: code.name.into(),
            text: text.clone(),
        });
        let kind = EventKind::new(code, text);
        if let Some(live) = &mut self.live {
            live.show(Piece::Event(t, kind.clone()));
        }
        self.event(t, kind);
    }
}

/// A link of the vehicle with a port on either side.
struct Link {
    index: usize,
    place: PathBuf,
    vehicle_path: PathBuf,
    setup: PtySetup,
    /// `None` while the vehicle is gone.
    client: Option<Box<dyn Port>>,
    /// Open while the client has its own open, and until what that has sent is passed on.
    vehicle: Option<Box<dyn Port>>,
    line: Option<ClientLine>,
    /// Bytes that the other side has not taken yet: to the vehicle, to the client.
    waiting: [VecDeque<u8>; 2],
    passed: [u64; 2],
    /// Set if all traffic is decoded for the log.
    readers: Option<[Box<dyn FrameReader>; 2]>,
}

impl Link {
    fn open(
        index: usize,
        vehicle: &Path,
        place: &Path,
        baud: u32,
        readers: Option<[Box<dyn FrameReader>; 2]>,
        waiter: &mut Waiter,
    ) -> Result<Self, Failure> {
        // A wrong path is reported before a client comes.
        drop(open_serial_port(vehicle, baud).map_err(Failure::system)?);
        let mut link = Self {
            index,
            place: place.to_owned(),
            vehicle_path: vehicle.to_owned(),
            setup: PtySetup::raw(baud),
            client: None,
            vehicle: None,
            line: None,
            waiting: Default::default(),
            passed: [0; 2],
            readers,
        };
        link.publish(waiter).map_err(Failure::system)?;
        Ok(link)
    }

    fn client_path(&self) -> String {
        let client = self.client.as_ref();
        visible::name(client.map_or(&*self.place, |port| port.path()))
    }

    /// Opens the client's port.
    fn publish(&mut self, waiter: &mut Waiter) -> Result<(), PortError> {
        let mut client = open_port(&self.place, self.setup)?;
        waiter.add(2 * self.index, &mut client)?;
        self.client = Some(client);
        Ok(())
    }

    fn is_attached(&self) -> bool {
        self.client.as_ref().is_some_and(|port| port.is_attached())
    }

    /// Whether the client has to wait for the vehicle.
    fn is_blocked(&self) -> bool {
        self.waiting[0].len() >= MOST_WAITING
    }

    fn timeout(&self) -> Option<Duration> {
        match &self.client {
            None => Some(SEARCH),
            Some(_) if self.waiting.iter().any(|waiting| !waiting.is_empty()) => Some(RETRY),
            Some(client) => client.is_attached().then_some(LOOK),
        }
    }

    /// Forwards the bytes that are there. An error means that the vehicle is gone.
    fn pass(&mut self, waiter: &mut Waiter, out: &mut Out) -> Result<(), PortError> {
        self.set_line(out)?;
        self.write_vehicle()?;
        self.read_client(waiter, out)?;
        if !self.is_attached() && self.waiting[0].is_empty() {
            // The client's port hangs up, too.
            self.vehicle = None;
        }
        self.write_client()?;
        self.read_vehicle(out)
    }

    fn read_client(&mut self, waiter: &mut Waiter, out: &mut Out) -> Result<(), PortError> {
        let mut buf = [0; 4096];
        for _ in 0..MOST_READS {
            let Some(client) = self
                .client
                .as_mut()
                .filter(|_| self.waiting[0].len() < MOST_WAITING)
            else {
                break;
            };
            let event = client.read(&mut buf)?;
            let (t, port) = (out.now(), PortRecord(0, self.index));
            match event {
                PortEvent::Idle => break,
                PortEvent::Attached => {
                    self.line = None;
                    out.record(Record::Attach { t, port });
                    self.emit(out, t, event::attached());
                    if self.vehicle.is_none() {
                        let mut vehicle = open_serial_port(&self.vehicle_path, self.setup.baud)?;
                        waiter.add(2 * self.index + 1, &mut vehicle)?;
                        self.vehicle = Some(vehicle);
                    }
                    self.set_line(out)?;
                }
                PortEvent::Data(n) => {
                    // It may have been set between two bursts.
                    self.set_line(out)?;
                    self.waiting[0].extend(&buf[..n]);
                    self.write_vehicle()?;
                    self.passed[0] += n as u64;
                    self.record(out, t, Sender::Client, &buf[..n]);
                    out.guide(self.index, t, &buf[..n]);
                }
                PortEvent::Detached => {
                    self.waiting[1].clear();
                    out.record(Record::Detach { t, port });
                    self.emit(out, t, event::detached());
                }
            }
        }
        Ok(())
    }

    fn read_vehicle(&mut self, out: &mut Out) -> Result<(), PortError> {
        let mut buf = [0; 4096];
        for _ in 0..MOST_READS {
            let Some(vehicle) = &mut self.vehicle else {
                break;
            };
            // What the client does not take stays in the vehicle's port, as without `sim`.
            let room = if self.waiting[1].is_empty() {
                buf.len()
            } else {
                0
            };
            match vehicle.read(&mut buf[..room])? {
                PortEvent::Data(n) => {
                    let t = out.now();
                    self.waiting[1].extend(&buf[..n]);
                    self.write_client()?;
                    self.passed[1] += n as u64;
                    self.record(out, t, Sender::Device, &buf[..n]);
                }
                PortEvent::Attached => {}
                PortEvent::Detached | PortEvent::Idle => break,
            }
        }
        Ok(())
    }

    fn write_vehicle(&mut self) -> Result<(), PortError> {
        write(self.vehicle.as_mut(), &mut self.waiting[0])
    }

    fn write_client(&mut self) -> Result<(), PortError> {
        let attached = self.client.as_mut().filter(|client| client.is_attached());
        if attached.is_none() {
            // Lost, as from a cable that is in no port.
            self.waiting[1].clear();
        }
        write(attached, &mut self.waiting[1])
    }

    /// Sets the vehicle's port as the client has set its own.
    fn set_line(&mut self, out: &mut Out) -> Result<(), PortError> {
        let Some(client) = self.client.as_ref().filter(|client| client.is_attached()) else {
            return Ok(());
        };
        let line = client.client_line()?;
        if line == self.line {
            return Ok(());
        }
        self.line = line;
        let Some(line) = line else {
            return Ok(());
        };
        let (t, port) = (out.now(), PortRecord(0, self.index));
        out.record(Record::Line { t, port, line });
        if line.parity {
            self.emit(out, t, event::parity());
        }
        let (client, device) = (line.baud, self.setup.baud);
        if client != 0 && client != device {
            self.emit(out, t, event::baud_mismatch(client, device));
        }
        let vehicle = self.vehicle.as_mut();
        match vehicle.map_or(Ok(()), |vehicle| vehicle.set_line(line)) {
            // For example, the adapter does not support the baud rate: the vehicle is still there.
            Err(error) if matches!(error.kind(), PortErrorKind::System { .. }) => {
                out.vehicle(LINE_REFUSED, error.to_string());
                Ok(())
            }
            set => set,
        }
    }

    fn emit(&self, out: &Out, t: u64, event: EventKind) {
        out.event(t, event.on(self.index));
    }

    fn record(&mut self, out: &mut Out, t: u64, sender: Sender, bytes: &[u8]) {
        let port = PortRecord(0, self.index);
        for bytes in bytes.chunks(MOST_BYTES) {
            let bytes = Hexed(bytes.to_vec());
            out.record(match sender {
                Sender::Client => Record::In { t, port, bytes },
                Sender::Device => Record::Out {
                    t,
                    dt: 0,
                    port,
                    bytes,
                },
            });
        }
        let Some(readers) = &mut self.readers else {
            return;
        };
        let reader = &mut readers[usize::from(sender == Sender::Device)];
        for byte in bytes {
            for frame in reader.push(SimTime::from_nanos(t), *byte) {
                let code = match sender {
                    Sender::Client => code::REQUEST,
                    Sender::Device => code::REPLY,
                };
                out.event(t, frame.event(code, self.index));
            }
        }
    }

    /// A port failed, such as that of an unplugged vehicle: the client's port hangs up until both can be opened
    /// again.
    fn lose(&mut self, error: &PortError, out: &mut Out) {
        let (t, port) = (out.now(), PortRecord(0, self.index));
        if self.is_attached() {
            out.record(Record::Detach { t, port });
        }
        (self.client, self.vehicle, self.line) = (None, None, None);
        self.waiting.iter_mut().for_each(VecDeque::clear);
        match error.path() == self.vehicle_path {
            true => {
                let what = match error.kind() {
                    PortErrorKind::Unplugged | PortErrorKind::NoSuchDevice => "the vehicle is gone",
                    _ => "the vehicle's port cannot be used",
                };
                out.vehicle(VEHICLE_GONE, format!("{what}: {error}"));
            }
            false => out.vehicle(CLIENT_PORT_FAILED, error.to_string()),
        }
    }

    /// Searches for a vehicle that is gone, and opens the client's port again when it is there.
    fn search(&mut self, waiter: &mut Waiter, out: &mut Out) -> Result<(), Failure> {
        if self.client.is_some() || open_serial_port(&self.vehicle_path, self.setup.baud).is_err() {
            return Ok(());
        }
        self.publish(waiter).map_err(Failure::system)?;
        let path = self.client_path();
        out.vehicle(
            VEHICLE_BACK,
            format!("the vehicle is there again, at {path}"),
        );
        Ok(())
    }
}

/// Writes as much as a port takes without losing any.
fn write(port: Option<&mut Box<dyn Port>>, waiting: &mut VecDeque<u8>) -> Result<(), PortError> {
    let Some(port) = port.filter(|_| !waiting.is_empty()) else {
        return Ok(());
    };
    let bytes = waiting.make_contiguous();
    let most = bytes.len().min(port.room());
    let accepted = port.write(&bytes[..most])?;
    waiting.drain(..accepted);
    Ok(())
}
