//! What Linux does with a pseudo-terminal: the facts that the crate rests on, and those for which it
//! does without packet mode. That the exclusive flag of a killed client stays is in `exclusive.rs`;
//! what the crate makes of all this is tested in the files beside.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::mem::MaybeUninit;
use std::path::PathBuf;
use std::time::Duration;

use common::{Bench, Client, until};
use rigsim_pty::{PtySetup, open_unlinked_port};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, WatchFlags};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, LocalModes, OptionalActions, OutputModes, QueueSelector, tcflush, tcgetattr,
    tcsetattr,
};

#[test]
fn a_fresh_pair_echoes_and_cooks() {
    let (master, node) = fresh_pair();
    let client = Client::open(&node);
    let termios = client.termios();
    assert!(
        termios
            .local_modes
            .contains(LocalModes::ECHO | LocalModes::ICANON)
    );
    assert!(termios.output_modes.contains(OutputModes::OPOST));
    // What is sent to the client comes back, and the client gets whole lines only.
    rustix::io::write(&master, b"half a line").unwrap();
    let mut echo = Vec::new();
    until("it is echoed", || {
        echo.extend(read_all(&master));
        echo == b"half a line"
    });
    assert_eq!(client.try_receive(), b"");
    rustix::io::write(&master, b"\n").unwrap();
    assert_eq!(client.receive(12), b"half a line\n");
}

#[test]
fn the_client_s_speed_is_known_even_where_it_is_no_standard_one() {
    let bench = Bench::unlinked();
    let client = bench.client();
    for baud in [9_600, 250_000, 57_600, 3_333_333] {
        client.set_termios(|termios| termios.set_speed(baud).unwrap());
        assert_eq!(bench.port.client_line().unwrap().unwrap().baud, baud);
    }
}

#[test]
fn parity_and_seven_bits_are_refused_and_two_stop_bits_are_taken() {
    let bench = Bench::unlinked();
    let client = bench.client();
    client.set_termios(|termios| {
        termios.control_modes.remove(ControlModes::CSIZE);
        termios.control_modes |= ControlModes::PARENB | ControlModes::CS7 | ControlModes::CSTOPB;
    });
    // The kernel leaves out what it does not take; a client's C library
    // notices and reports EINVAL.
    let control = client.termios().control_modes;
    assert!(!control.contains(ControlModes::PARENB));
    assert_eq!(control & ControlModes::CSIZE, ControlModes::CS8);
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!((line.stop_bits, line.parity), (2, false));
}

#[test]
fn there_are_no_modem_lines() {
    let port = open_unlinked_port(PtySetup::raw(115_200)).unwrap();
    let mut client = serialport::new(port.path().to_str().unwrap(), 115_200)
        .open()
        .unwrap();
    let error = client.read_clear_to_send().unwrap_err();
    // The classic name of ENOTTY.
    assert!(error.to_string().contains("Not a typewriter"), "{error}");
}

/// In packet mode every read of the master begins with a byte that says what it is: 0 before bytes
/// of the client, and otherwise what the client did to the line.
#[test]
fn packet_mode_reports_that_a_client_flushes() {
    let (master, node) = raw_pair();
    let client = Client::open(&node);
    packet::begin(&master);
    client.send(b"data");
    assert_eq!(next_packet(&master), b"\0data");
    for (queue, report) in [
        (QueueSelector::IFlush, packet::FLUSH_READ),
        (QueueSelector::OFlush, packet::FLUSH_WRITE),
        (
            QueueSelector::IOFlush,
            packet::FLUSH_READ | packet::FLUSH_WRITE,
        ),
    ] {
        tcflush(&client, queue).unwrap();
        assert_eq!(next_packet(&master), [report], "{queue:?}");
    }
    assert_eq!(read_all(&master), b"");
}

#[test]
fn packet_mode_reports_changes_of_settings_with_extproc_only() {
    let (master, node) = raw_pair();
    let client = Client::open(&node);
    packet::begin(&master);
    let report = |baud: u32| {
        client.set_termios(|termios| termios.set_speed(baud).unwrap());
        read_all(&master)
    };
    assert_eq!(report(9_600), b"");
    client.set_termios(|termios| termios.local_modes |= LocalModes::EXTPROC);
    assert_eq!(next_packet(&master)[0] & packet::IOCTL, packet::IOCTL);
    assert_eq!(report(57_600), [packet::IOCTL]);
    // It says that something has changed; what, only the settings themselves tell.
    assert_eq!(tcgetattr(&master).unwrap().output_speed(), 57_600);
}

#[test]
fn the_master_reads_eio_only_once_the_node_was_open() {
    let (master, node) = raw_pair();
    let mut buf = [0; 8];
    assert_eq!(rustix::io::read(&master, &mut buf[..]), Err(Errno::AGAIN));
    drop(Client::open(&node));
    assert_eq!(rustix::io::read(&master, &mut buf[..]), Err(Errno::IO));
    let _client = Client::open(&node);
    assert_eq!(rustix::io::read(&master, &mut buf[..]), Err(Errno::AGAIN));
}

#[test]
fn poll_says_that_the_client_has_hung_up_until_the_next_one_opens() {
    let (master, node) = raw_pair();
    assert!(!hangs_up(&master), "no client was there yet");
    drop(Client::open(&node));
    // It says so at once and each time, so a loop that only polls would spin.
    for _ in 0..3 {
        assert!(hangs_up(&master));
    }
    let _client = Client::open(&node);
    assert!(!hangs_up(&master));
}

#[test]
fn a_client_s_end_of_one_s_own_hides_hang_ups_and_keeps_stale_bytes() {
    let (master, node) = raw_pair();
    let own = Client::open(&node);
    let client = Client::open(&node);
    rustix::io::write(&master, b"stale").unwrap();
    until("the bytes have arrived", || {
        rustix::io::ioctl_fionread(&client) == Ok(5)
    });
    drop(client);
    assert!(!hangs_up(&master));
    assert_eq!(rustix::io::read(&master, &mut [0; 8]), Err(Errno::AGAIN));
    assert_eq!(Client::open(&node).receive(5), b"stale");

    // Nor do they go with the last client: the holder of the master must flush them.
    rustix::io::write(&master, b"stale").unwrap();
    until("the bytes have arrived", || {
        rustix::io::ioctl_fionread(&own) == Ok(5)
    });
    drop(own);
    assert!(hangs_up(&master));
    assert_eq!(Client::open(&node).receive(5), b"stale");
}

#[test]
fn inotify_reports_who_opens_and_closes_the_node() {
    let (_master, node) = raw_pair();
    let watch = inotify::init(CreateFlags::CLOEXEC | CreateFlags::NONBLOCK).unwrap();
    let flags = WatchFlags::OPEN | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE;
    inotify::add_watch(&watch, &node, flags).unwrap();
    let mut buf = [MaybeUninit::uninit(); 4096];
    let mut reader = inotify::Reader::new(&watch, &mut buf);
    for _ in 0..2 {
        let client = Client::open(&node);
        assert_eq!(reader.next().unwrap().events(), ReadFlags::OPEN);
        assert_eq!(reader.next().err(), Some(Errno::AGAIN));
        drop(client);
        assert_eq!(reader.next().unwrap().events(), ReadFlags::CLOSE_WRITE);
    }
    assert_eq!(reader.next().err(), Some(Errno::AGAIN));
}

/// The kernel keeps 20,480 bytes for a side that does not read: 4 KiB where
/// they are read, and 16 KiB of blocks on the way there. Writes that do not
/// divide a block waste some of it, and a few small ones may fit in addition.
#[test]
fn about_twenty_thousand_bytes_are_kept_each_way() {
    let kept = |from: &dyn std::os::fd::AsFd, chunk: usize| {
        let bytes = vec![0x55; chunk];
        let mut kept = 0;
        // Meanwhile the kernel moves bytes on by itself.
        for _ in 0..3 {
            while let Ok(count) = rustix::io::write(from.as_fd(), &bytes) {
                kept += count;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        kept
    };
    for chunk in [1, 6, 100, 1_000, 4_096] {
        let (master, node) = raw_pair();
        let client = Client::open(&node);
        for kept in [kept(&master, chunk), kept(&client, chunk)] {
            assert!((8_192..=24_576).contains(&kept), "{kept} by {chunk}");
        }
    }
    let (master, node) = raw_pair();
    let client = Client::open(&node);
    let exact = [kept(&master, 1), kept(&client, 1)];
    assert!(exact.contains(&20_480), "{exact:?} byte by byte");
}

/// The two facts about flushing that the crate rests on: neither half alone
/// empties the line.
#[test]
fn flushing_from_the_master_takes_two_steps() {
    let (master, node) = raw_pair();
    let client = Client::open(&node);
    rustix::io::write(&master, b"arrived").unwrap();
    until("the bytes have arrived", || {
        rustix::io::ioctl_fionread(&client) == Ok(7)
    });
    tcflush(&master, QueueSelector::OFlush).unwrap();
    assert_eq!(rustix::io::ioctl_fionread(&client), Ok(7));
    tcsetattr(
        &master,
        OptionalActions::Flush,
        &tcgetattr(&master).unwrap(),
    )
    .unwrap();
    assert_eq!(rustix::io::ioctl_fionread(&client), Ok(0));
}

fn fresh_pair() -> (OwnedFd, PathBuf) {
    use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    rustix::fs::fcntl_setfl(&master, rustix::fs::OFlags::NONBLOCK).unwrap();
    unlockpt(&master).unwrap();
    let node = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (master, node.into())
}

fn raw_pair() -> (OwnedFd, PathBuf) {
    let (master, node) = fresh_pair();
    let mut termios = tcgetattr(&master).unwrap();
    termios.make_raw();
    tcsetattr(&master, OptionalActions::Now, &termios).unwrap();
    (master, node)
}

/// What one read of the master gives, or nothing.
fn read_all(master: &OwnedFd) -> Vec<u8> {
    let mut buf = [0; 64];
    match rustix::io::read(master, &mut buf[..]) {
        Ok(count) => buf[..count].to_vec(),
        Err(Errno::AGAIN) => Vec::new(),
        Err(errno) => panic!("the master reads {errno}"),
    }
}

/// The kernel moves bytes to the master in its own time.
fn next_packet(master: &OwnedFd) -> Vec<u8> {
    let mut packet = Vec::new();
    until("there is a packet", || {
        packet = read_all(master);
        !packet.is_empty()
    });
    packet
}

fn hangs_up(master: &OwnedFd) -> bool {
    let mut polled = [PollFd::new(master, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec::default())).unwrap();
    polled[0].revents().contains(PollFlags::HUP)
}

/// Packet mode, for which no library has a safe call; the numbers are those of `ioctl_tty(2)`.
mod packet {
    use rustix::fd::AsFd;
    use rustix::ffi::c_int;
    use rustix::ioctl::{Opcode, Setter, ioctl};

    const TIOCPKT: Opcode = 0x5420;
    pub(super) const FLUSH_READ: u8 = 1;
    pub(super) const FLUSH_WRITE: u8 = 2;
    pub(super) const IOCTL: u8 = 64;

    pub(super) fn begin(master: impl AsFd) {
        // SAFETY: TIOCPKT reads one int through its argument, which lives for the call.
        #[expect(unsafe_code, reason = "no library wraps this call")]
        unsafe {
            ioctl(master, Setter::<TIOCPKT, c_int>::new(1)).unwrap();
        }
    }
}
