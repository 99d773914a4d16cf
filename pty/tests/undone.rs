//! Whatever a client does to its terminal is undone when it leaves, so that the next finds it as the
//! first did.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::io::Write as _;
use std::process::{Command, Stdio};

use common::{Bench, Client, until};
use rigsim_pty::{Event, PtySetup, open_port, open_unlinked_port};
use rustix::ffi::c_int;
use rustix::fs::{Mode, fchmod};
use rustix::ioctl::{NoArg, Setter, ioctl};
use rustix::process::geteuid;
use rustix::termios::{
    Action, ControlModes, InputModes, LocalModes, OutputModes, SpecialCodeIndex, Termios, Winsize,
    ioctl_tiocexcl, tcflow, tcgetattr, tcsendbreak, tcsetwinsize,
};

type Act = (&'static str, fn(&Client));

/// Termios and the ioctls of a terminal one by one, as far as they change it.
const ACTS: &[Act] = &[
    ("the speed", |client| {
        client.set_termios(|t| t.set_speed(300).unwrap());
    }),
    ("speed 0", |client| {
        client.set_termios(|t| t.set_speed(0).unwrap());
    }),
    ("echo and editing", |client| {
        client.set_termios(|t| t.local_modes |= LocalModes::ECHO | LocalModes::ICANON);
    }),
    ("translation", |client| {
        client.set_termios(|t| {
            t.input_modes |= InputModes::ICRNL | InputModes::IGNCR | InputModes::ISTRIP;
            t.output_modes |= OutputModes::OPOST | OutputModes::ONLCR;
        });
    }),
    ("frames", |client| {
        client.set_termios(|t| t.control_modes |= ControlModes::CSTOPB | ControlModes::PARODD);
    }),
    ("flow control", |client| {
        client.set_termios(|t| {
            t.control_modes |= ControlModes::CRTSCTS;
            t.input_modes |= InputModes::IXON | InputModes::IXOFF;
        });
    }),
    ("a receiver that is off", |client| {
        client.set_termios(|t| t.control_modes -= ControlModes::CREAD | ControlModes::CLOCAL);
    }),
    ("special codes", |client| {
        client.set_termios(|t| {
            t.special_codes[SpecialCodeIndex::VMIN] = 0;
            t.special_codes[SpecialCodeIndex::VTIME] = 7;
            t.special_codes[SpecialCodeIndex::VSTART] = b'x';
        });
    }),
    ("output held back", |client| {
        tcflow(client, Action::OOff).unwrap();
    }),
    ("output held back twice", |client| {
        client.set_termios(|t| t.input_modes |= InputModes::IXON);
        tcflow(client, Action::OOff).unwrap();
    }),
    ("a break", |client| tcsendbreak(client).unwrap()),
    ("exclusive use", |client| ioctl_tiocexcl(client).unwrap()),
    ("the window", |client| {
        let size = Winsize {
            ws_row: 7,
            ws_col: 9,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        tcsetwinsize(client, size).unwrap();
    }),
    ("locked settings", lock_settings),
    ("another line discipline", set_null_discipline),
    ("hung up for all", hang_up),
];

#[expect(unsafe_code, reason = "no library wraps this call")]
fn lock_settings(client: &Client) {
    if !geteuid().is_root() {
        return;
    }
    client.set_termios(|t| {
        t.set_speed(300).unwrap();
        t.local_modes |= LocalModes::ECHO;
    });
    // SAFETY: TIOCSLCKTRMIOS reads a struct termios of the kernel, which is shorter than this.
    unsafe { ioctl(client, Setter::<0x5457, [u8; 64]>::new([0xFF; 64])).unwrap() };
    let termios = tcgetattr(client).unwrap();
    assert_eq!(termios.output_speed(), 300);
}

#[expect(unsafe_code, reason = "no library wraps this call")]
fn set_null_discipline(client: &Client) {
    const N_NULL: c_int = 27;
    // SAFETY: TIOCSETD reads one int, which lives for the call. Not every system has or allows it.
    let _ = unsafe { ioctl(client, Setter::<0x5423, c_int>::new(N_NULL)) };
}

#[expect(unsafe_code, reason = "no library wraps this call")]
fn hang_up(client: &Client) {
    // SAFETY: TIOCVHANGUP takes no argument. It is for privileged clients alone.
    let _ = unsafe { ioctl(client, NoArg::<0x5437>::new()) };
}

/// As a client that does nothing about settings finds the port.
fn expect_sound(bench: &mut Bench, fresh: &Termios, after: &str) {
    let client = bench.client();
    bench.expect(Event::Attached);
    let found = client.termios();
    assert_eq!(format!("{found:?}"), format!("{fresh:?}"), "after {after}");
    // Those who read do not wait for ever.
    client.send(b"request\r\n\x13");
    assert_eq!(bench.expect_bytes(10), b"request\r\n\x13", "after {after}");
    assert_eq!(bench.port.write(b"reply\r\n\x13").unwrap(), 8);
    assert_eq!(client.receive(8), b"reply\r\n\x13", "after {after}");
    client.send(b"more");
    assert_eq!(bench.expect_bytes(4), b"more", "after {after}");
    drop(client);
    bench.expect(Event::Detached);
}

#[test]
fn whatever_a_client_does_to_its_terminal_ends_with_it() {
    for setup in [
        PtySetup::raw(115_200),
        PtySetup {
            mode: Some(0o660),
            ..PtySetup::raw(9_600)
        },
    ] {
        let mut bench = Bench::new(open_unlinked_port(setup).unwrap());
        let fresh = bench.client().termios();
        bench.expect(Event::Attached);
        bench.expect(Event::Detached);
        for (name, act) in ACTS {
            for visits in 1..3 {
                for _ in 0..visits {
                    let client = bench.client();
                    act(&client);
                }
                // One after the other, or before the first look.
                while bench.port.counters().attached == 0 || bench.port.is_attached() {
                    let _ = bench.next();
                }
                drain(&mut bench);
                expect_sound(&mut bench, &fresh, name);
            }
        }
    }
}

/// Until there is nothing left to tell.
fn drain(bench: &mut Bench) {
    let mut buf = [0; 64];
    let moment = std::time::Duration::from_millis(5);
    while !bench.waiter.wait(Some(moment)).unwrap().ready().is_empty() {
        let _ = bench.port.read(&mut buf).unwrap();
    }
}

/// Two that close one after the other are reported as one, so that by counting one of them is there
/// for ever.
#[test]
fn output_held_back_goes_on_though_others_seem_to_be_there() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    drain(&mut bench);
    let second = bench.client();
    drain(&mut bench);
    drop((first, second));
    let holds = bench.client();
    tcflow(&holds, Action::OOff).unwrap();
    drop(holds);
    let next = bench.client();
    drain(&mut bench);
    next.send(b"asks");
    let mut heard = Vec::new();
    let mut buf = [0; 64];
    until("it is heard", || {
        if let Event::Data(count) = bench.port.read(&mut buf).unwrap() {
            heard.extend_from_slice(&buf[..count]);
        }
        heard == b"asks"
    });
}

/// Two that open one after the other are reported as one, so that by counting no client is left when one
/// of them leaves.
#[test]
fn output_held_back_goes_on_though_no_client_seems_to_be_there() {
    let mut bench = Bench::unlinked();
    let (stays, holds) = (bench.client(), bench.client());
    bench.expect(Event::Attached);
    drain(&mut bench);
    tcflow(&holds, Action::OOff).unwrap();
    drop(holds);
    drain(&mut bench);
    for _ in 0..2 {
        stays.send(b"asks");
        assert_eq!(bench.expect_bytes(4), b"asks");
    }
    drop(stays);
    bench.expect(Event::Detached);
    bench.expect_quiet();
}

/// It may come while we ourselves have the node open.
#[test]
fn clients_that_hang_the_port_up_for_all_do_so_at_any_moment() {
    // By a link, since a node that is given up becomes another program's at once.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("port");
    let port = open_port(&path, PtySetup::raw(115_200)).unwrap();
    let mut bench = Bench::new(port);
    let fresh = bench.client().termios();
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
    let hanging_up = std::thread::spawn(move || {
        for _ in 0..3000 {
            // It may be hung up while it is being opened.
            if let Ok(client) = Client::try_open(&path) {
                hang_up(&client);
            }
        }
    });
    let mut buf = [0; 64];
    while !hanging_up.is_finished() {
        let _ = bench.port.read(&mut buf).unwrap();
    }
    hanging_up.join().unwrap();
    until("all have left", || {
        drain(&mut bench);
        !bench.port.is_attached()
    });
    expect_sound(&mut bench, &fresh, "hanging up");
}

/// No client was seen to leave, and the next one is there already.
#[test]
fn output_that_was_held_back_goes_on_for_one_who_comes_at_once() {
    let mut bench = Bench::unlinked();
    for speed in [115_200, 0] {
        let first = bench.client();
        bench.expect(Event::Attached);
        bench.expect_quiet();
        first.set_termios(|t| t.set_speed(speed).unwrap());
        tcflow(&first, Action::OOff).unwrap();
        drop(first);
        let second = bench.client();
        bench.expect(Event::Detached);
        bench.expect(Event::Attached);
        assert_eq!(second.termios().output_speed(), 115_200);
        second.send(b"request");
        assert_eq!(bench.expect_bytes(7), b"request");
        drop(second);
        bench.expect(Event::Detached);
    }
}

#[test]
fn permissions_are_as_asked_for_and_stay_so() {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
    let group = rustix::process::getegid().as_raw();
    let setup = PtySetup {
        mode: Some(0o660),
        group: Some(group),
        ..PtySetup::raw(115_200)
    };
    let mut bench = Bench::new(open_unlinked_port(setup).unwrap());
    let found = |bench: &Bench| {
        let found = std::fs::metadata(bench.port.path()).unwrap();
        (found.permissions().mode() & 0o777, found.gid())
    };
    assert_eq!(found(&bench), (0o660, group));
    let client = bench.client();
    bench.expect(Event::Attached);
    fchmod(&client, Mode::from_raw_mode(0o600)).unwrap();
    drop(client);
    bench.expect(Event::Detached);
    assert_eq!(found(&bench), (0o660, group));
}

/// A client that made the port its controlling terminal hangs it up when it ends, which sets it as a
/// fresh terminal is set, with echo.
#[test]
fn the_end_of_a_session_on_the_port_leaves_it_sound() {
    let mut bench = Bench::unlinked();
    let fresh = bench.client().termios();
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
    // Only the killed one has the port: a child would outlive it where hang-ups are ignored, as
    // under `nohup`.
    let script = r#"exec setsid sh -c 'exec 3<>"$0"; echo there; exec sleep 1000' "$0""#;
    let mut session = Command::new("sh");
    session.args(["-c", script]).arg(bench.port.path());
    let mut session = session
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    bench.expect(Event::Attached);
    let mut said = [0; 5];
    std::io::Read::read_exact(session.stdout.as_mut().unwrap(), &mut said).unwrap();
    assert_eq!(&said, b"there");
    session.kill().unwrap();
    session.wait().unwrap();
    until("it has left", || {
        drain(&mut bench);
        !bench.port.is_attached()
    });
    expect_sound(&mut bench, &fresh, "a session");
}

#[test]
fn a_group_that_is_not_the_user_s_is_refused_in_words() {
    if geteuid().is_root() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED a_group_that_is_not_the_user_s_is_refused_in_words: root may give to any"
        );
        return;
    }
    let setup = PtySetup {
        group: Some(0),
        ..PtySetup::raw(115_200)
    };
    let error = open_unlinked_port(setup).unwrap_err().to_string();
    assert!(error.contains("group"), "{error}");
}
