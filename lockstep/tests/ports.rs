//! Ports: reads, writes, settings, modem lines, and cables.

mod common;

use std::time::Duration;

use common::{CLIENT, Device, Setup, c, c_played, c_prints, play_on, python, python_on, text};
use rigsim_lockstep::{End, Reason};

#[test]
fn a_shell_script_talks_to_the_device() {
    let code = "stty -F $PORT 115200 raw -echo; exec 3<>$PORT; echo hello >&3; sleep 1; echo again >&3; head -n 2 <&3";
    let played = play_on(Setup::default(), &["sh", "-c", code]).expect("it can be run");
    assert_eq!(played.output, "HELLO\nAGAIN\n", "{:?}", played);
    assert_eq!(played.ending.at, 1_050_050_000);
}

/// A process that another thread of the tracer's program is about to start has its duplicates for a
/// while, so that the system says late that a port is closed.
#[test]
fn the_end_of_a_client_closes_its_port_whatever_else_has_it_open() {
    let code = "import os; fd = os.open(os.environ['PORT'], os.O_RDWR | os.O_NOCTTY); \
                os.write(fd, b'%d %d\\n' % (os.getpid(), fd))";
    let setup = Setup {
        device: Device {
            keeps: true,
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert!(played.kept_end.is_some(), "{:?}", played.trace);
    let last = played.trace.last().expect("what has happened");
    assert!(last.ends_with(" closed 0"), "{:?}", played.trace);
}

#[test]
fn reads_end_as_vmin_and_vtime_have_it() {
    let code = r#"
import os, termios, time
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
start = time.monotonic()
def at(): return round(time.monotonic() - start, 3)
def wait(least, tenths):
    settings = termios.tcgetattr(fd)
    settings[6][termios.VMIN], settings[6][termios.VTIME] = least, tenths
    termios.tcsetattr(fd, termios.TCSANOW, settings)
wait(0, 20); print(os.read(fd, 10), at())
os.write(fd, b"abc\n"); print(os.read(fd, 10), at())
wait(0, 0); print(os.read(fd, 10), at())
wait(6, 0); os.write(fd, b"abc\n"); os.write(fd, b"def\n"); print(os.read(fd, 20), at())
wait(6, 5); os.write(fd, b"abc\n"); print(os.read(fd, 20), at())
wait(1, 0); os.write(fd, b"abc\n"); print(os.read(fd, 2), os.read(fd, 20), at())
"#;
    let Some(played) = python(code) else { return };
    assert_eq!(
        played.output,
        "b'' 2.0\nb'ABC\\n' 2.05\nb'' 2.05\nb'ABC\\nDEF\\n' 2.1\nb'ABC\\n' 2.65\nb'AB' b'C\\n' 2.7\n",
        "{:?}",
        played.ending
    );
}

/// The kernel has none of the bytes, and a client cannot tell.
#[test]
fn a_port_is_polled_in_every_way() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <termios.h>
#include <unistd.h>
static volatile int caught; static void signalled(int s) { caught++; }
static int fd; static char b[32];
static int unread(void) { int n = -1; ioctl(fd, FIONREAD, &n); return n; }
static int next(int most) { return read(fd, b, most); }
int main(void) {
  int p[2], n; pipe(p); fd = open(getenv("PORT"), O_RDWR | O_NOCTTY | O_NONBLOCK);
  struct pollfd s[4] = {{p[0], POLLIN}, {fd, POLLIN | POLLOUT}, {-1, POLLIN}, {77, POLLIN}};
  n = poll(s, 4, 0); printf("poll %d %x %x %x %x;", n, s[0].revents, s[1].revents, s[2].revents, s[3].revents);
  write(fd, "ab\n", 3); s[1].events = POLLIN; n = poll(s, 3, 1000);
  printf(" %d %x %x, %d unread,", n, s[0].revents, s[1].revents, unread());
  n = next(2); printf(" %d", n); n = next(9); printf(" %d", n); n = next(9); printf(" %d\n", n);
  fd_set in, out; FD_ZERO(&in); FD_ZERO(&out); FD_SET(fd, &in); FD_SET(p[0], &in); FD_SET(p[1], &out);
  write(fd, "cd\n", 3); struct timeval t = {1, 0}; n = select(90, &in, &out, 0, &t);
  printf("select %d %d %d %d;", n, !!FD_ISSET(fd, &in), !!FD_ISSET(p[0], &in), !!FD_ISSET(p[1], &out));
  FD_SET(fd, &in); n = select(90, &in, 0, 0, &t); printf(" %d at %ld;", n, t.tv_usec); next(9);
  FD_SET(77, &in); n = select(90, &in, 0, 0, &t); printf(" %d\n", n);
  int e = epoll_create1(0); struct epoll_event one = {EPOLLIN, {0}}, got; epoll_ctl(e, EPOLL_CTL_ADD, fd, &one);
  write(fd, "ef\n", 3); n = epoll_wait(e, &got, 1, 1000); printf("epoll %d %d", n, next(1));
  n = epoll_wait(e, &got, 1, 0); printf(" %d %d", n, next(9)); n = epoll_wait(e, &got, 1, 10); printf(" %d;", n);
  one.events |= EPOLLET; epoll_ctl(e, EPOLL_CTL_MOD, fd, &one); write(fd, "gh\n", 3);
  n = epoll_wait(e, &got, 1, 1000); printf(" edge %d", n); n = epoll_wait(e, &got, 1, 10); printf(" %d %d", n, next(9));
  write(fd, "wx\n", 3); n = epoll_wait(e, &got, 1, 1000); write(fd, "yz\n", 3); n += epoll_wait(e, &got, 1, 1000);
  printf(" %d", n); n = next(9); printf(" %d", n);
  write(fd, "ij\n", 3); n = epoll_wait(e, &got, 1, 1000); printf(" %d\n", n);
  struct termios raw, line; tcgetattr(fd, &raw); line = raw; line.c_lflag |= ICANON; tcsetattr(fd, TCSANOW, &line);
  printf("line %d unread", unread()); n = next(9); printf(" %d %.2s,", n, b); n = next(9); printf(" %d\n", n);
  tcsetattr(fd, TCSANOW, &raw); write(fd, "kl\n", 3); usleep(60000); tcflush(fd, TCIFLUSH);
  n = epoll_wait(e, &got, 1, 10); printf("flushed %d %d\n", n, unread());
  close(fd); fd = open(getenv("PORT"), O_RDWR | O_NOCTTY | O_NONBLOCK);
  one.events = EPOLLIN; epoll_ctl(e, EPOLL_CTL_ADD, fd, &one);
  write(fd, "qr\n", 3); n = epoll_wait(e, &got, 1, 1000); printf("opened again %d", n); n = next(9); printf(" %d\n", n);
  epoll_ctl(e, EPOLL_CTL_DEL, fd, 0); signal(SIGIO, signalled); fcntl(fd, F_SETOWN, getpid());
  fcntl(fd, F_SETFL, O_NONBLOCK | O_ASYNC); write(fd, "mn\n", 3); pause(); n = next(9); printf("signal %d %d\n", caught, n);
}
"#,
        "poll 2 0 4 0 20; 1 0 1, 3 unread, 2 1 -1\nselect 1 0 0 1; 1 at 950000; -1\n\
         epoll 1 1 1 2 0; edge 1 0 3 2 6 1\nline 3 unread 3 IJ, -1\nflushed 0 0\nopened again 1 3\nsignal 1 3\n",
    );
}

#[test]
fn modem_lines_are_kept_and_reported() {
    let code = r#"
import fcntl, os, struct, termios
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
def get(): return hex(struct.unpack("I", fcntl.ioctl(fd, termios.TIOCMGET, b"\0\0\0\0"))[0])
print(get())
fcntl.ioctl(fd, termios.TIOCMBIC, struct.pack("I", termios.TIOCM_DTR)); print(get())
fcntl.ioctl(fd, termios.TIOCMSET, struct.pack("I", 0)); print(get())
fcntl.ioctl(fd, termios.TIOCMBIS, struct.pack("I", termios.TIOCM_RTS | termios.TIOCM_DTR)); print(get())
print(any(fcntl.ioctl(fd, 0x545D, bytes(80))))
"#;
    let Some(played) = python(code) else { return };
    assert_eq!(
        played.output, "0x166\n0x164\n0x160\n0x166\nFalse\n",
        "{:?}",
        played.ending
    );
    let lines: Vec<&String> = played
        .trace
        .iter()
        .filter(|line| line.contains("modem"))
        .collect();
    assert_eq!(
        lines,
        [
            "0 modem lines 0x4",
            "0 modem lines 0x0",
            "0 modem lines 0x6"
        ]
    );
}

#[test]
fn a_client_loses_the_cable_and_comes_back() {
    let code = r#"
import os, select, time
start = time.monotonic()
def at(): return round(time.monotonic() - start, 3)
path = os.environ["PORT"]
fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
os.write(fd, b"one\n"); print(os.read(fd, 10))
poll = select.poll(); poll.register(fd, select.POLLIN)
events = poll.poll(); print(events[0][1] & select.POLLHUP != 0, at())
print(os.read(fd, 10))
try: os.write(fd, b"lost\n")
except OSError as error: print(error.errno, os.path.exists(path))
os.close(fd)
while not os.path.exists(path): time.sleep(0.25)
print("back", at())
fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
os.write(fd, b"two\n"); print(os.read(fd, 10), at())
"#;
    let setup = Setup {
        device: Device {
            cable: Some((3_000_000_000, 4_900_000_000)),
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert_eq!(
        played.output, "b'ONE\\n'\nTrue 3.0\nb''\n5 False\nback 5.0\nb'TWO\\n' 5.05\n",
        "{:?}",
        played.ending
    );
}

#[test]
fn a_read_that_waits_fails_when_the_cable_is_pulled() {
    let code = r#"
import os, termios, time
start = time.monotonic()
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
settings = termios.tcgetattr(fd); settings[6][termios.VMIN], settings[6][termios.VTIME] = 0, 7
termios.tcsetattr(fd, termios.TCSANOW, settings)
try:
    while not os.read(fd, 10): pass
except OSError as error: print(error.errno, round(time.monotonic() - start, 3), os.read(fd, 10))
"#;
    let setup = Setup {
        device: Device {
            cable: Some((3_000_000_000, 4_900_000_000)),
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert_eq!(played.output, "5 3.0 b''\n", "{:?}", played.ending);
}

/// A process that another thread starts has it open, too, until it has become another program.
#[test]
fn a_client_sees_a_pulled_cable_at_its_time_although_the_system_is_late_with_it() {
    let code = r#"
import os, select, time
start = time.monotonic()
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
poll = select.poll(); poll.register(fd, select.POLLIN)
while not poll.poll(10): pass
print(round(time.monotonic() - start, 3), os.read(fd, 10))
"#;
    let setup = Setup {
        device: Device {
            cable: Some((3_000_000_000, 4_900_000_000)),
            // Much longer than a client needs that does not find it.
            kept: Some(Duration::from_secs(1)),
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert_eq!(played.output, "3.0 b''\n", "{:?}", played.ending);
}

#[test]
fn bytes_for_a_client_that_has_left_are_not_for_the_next() {
    let code = r#"
import os, time
def one():
    fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
    return fd
fd = one(); os.write(fd, b"unread\n"); time.sleep(1); os.close(fd)
fd = one(); os.write(fd, b"read\n"); print(os.read(fd, 100))
"#;
    let Some(played) = python(code) else { return };
    assert_eq!(played.output, "b'READ\\n'\n", "{:?}", played.ending);
    let kinds: Vec<&str> = played
        .trace
        .iter()
        .filter_map(|line| line.split(' ').nth(1))
        .collect();
    assert_eq!(
        kinds,
        [
            "opened", "sent", "answered", "closed", "opened", "sent", "answered", "closed"
        ]
    );
}

#[test]
fn much_comes_through_in_order_and_a_full_line_holds_a_write_up() {
    let code = r#"
import os, threading
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
lines = b"".join(b"line %04d\n" % n for n in range(2000))
got = bytearray()
def read():
    while len(got) < len(lines): got.extend(os.read(fd, 4096))
reader = threading.Thread(target=read); reader.start()
sent = 0
while sent < len(lines): sent += os.write(fd, lines[sent:sent + 7000])
reader.join(); print(bytes(got) == lines.upper())
"#;
    let setup = Setup {
        device: Device {
            room: 64,
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert_eq!(played.output, "True\n", "{:?}", played.ending);
}

#[test]
fn a_client_that_waits_for_nothing_learns_so_at_once() {
    let code = "import os; fd = os.open(os.environ['PORT'], os.O_RDWR); os.read(fd, 1)";
    let Some(played) = python(code) else { return };
    assert_eq!(played.ending.end, End::Killed(15));
    let Reason::Deadlock(what) = &played.ending.reason else {
        panic!("{:?}", played.ending)
    };
    assert!(what.contains("waited for bytes from "), "{what}");
    assert!(played.took.as_secs() < 10);
}

#[test]
fn a_busy_poll_of_the_clock_or_the_port_advances_time_slowly() {
    let code = r#"
import fcntl, os, struct, termios, time
start = time.monotonic()
while time.monotonic() < start + 0.5: pass
print("clock")
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
os.write(fd, b"hello\n")
def unread(): return struct.unpack("i", fcntl.ioctl(fd, termios.FIONREAD, b"\0\0\0\0"))[0]
while unread() < 6: pass
print(os.read(fd, 10))
os.write(fd, b"again\n")
while True:
    try: print(os.read(fd, 10)); break
    except BlockingIOError: os.sched_yield()
"#;
    let Some(played) = python(code) else { return };
    assert_eq!(
        played.output, "clock\nb'HELLO\\n'\nb'AGAIN\\n'\n",
        "{:?}",
        played.ending
    );
}

/// A port that is not raw takes some bytes for itself; the others are there at their time.
#[test]
fn a_port_that_is_not_raw_behaves_as_its_terminal_does() {
    let code = r#"
import os, select, termios, time
fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
start, raw = time.monotonic(), termios.tcgetattr(fd)
def played(name, index, flags, least=1, tenths=0):
    settings = [s if i < 6 else list(s) for i, s in enumerate(raw)]
    settings[index] |= flags
    settings[6][termios.VMIN], settings[6][termios.VTIME] = least, tenths
    termios.tcsetattr(fd, termios.TCSANOW, settings)
    os.write(fd, b"a\x03b\x11c\x13d\re\xe1\x1a\n")
    got = b""
    while select.select([fd], [], [], 0.3)[0]: got += os.read(fd, 100)
    print(name, got, round(time.monotonic() - start, 2))
    termios.tcsetattr(fd, termios.TCSAFLUSH, raw)
played("raw", 0, 0)
played("ISIG", 3, termios.ISIG)
played("ISIG, NOFLSH", 3, termios.ISIG | termios.NOFLSH)
played("IXON", 0, termios.IXON)
played("IXON", 0, termios.IXON, 4)
played("IXON", 0, termios.IXON, 4, 2)
played("IGNCR", 0, termios.IGNCR)
played("ICRNL", 0, termios.ICRNL)
played("ISTRIP", 0, termios.ISTRIP)
played("OPOST", 1, termios.OPOST | termios.ONLCR)
played("ICANON", 3, termios.ICANON)
played("OCRNL", 1, termios.OPOST | termios.OCRNL)
played("OLCUC", 1, termios.OPOST | termios.OLCUC)
"#;
    let Some(played) = python(code) else { return };
    let expected = r"raw b'A\x03B\x11C\x13D\rE\xe1\x1a\n' 0.35
ISIG b'\n' 0.7
ISIG, NOFLSH b'AB\x11C\x13D\rE\xe1\n' 1.05
IXON b'A\x03BCD\rE\xe1\x1a\n' 1.4
IXON b'A\x03BCD\rE\xe1\x1a\n' 1.75
IXON b'A\x03BCD\rE\xe1\x1a\n' 2.1
IGNCR b'A\x03B\x11C\x13DE\xe1\x1a\n' 2.45
ICRNL b'A\x03B\x11C\x13D\nE\xe1\x1a\n' 2.8
ISTRIP b'A\x03B\x11C\x13D\rEa\x1a\n' 3.15
OPOST b'A\x03B\x11C\x13D\rE\xe1\x1a\r\n' 3.5
ICANON b'A\x03B\x11C\x13D\rE\xe1\x1a\n' 3.85
OCRNL b'A\x03B\x11C\x13D\nE\xe1\x1a\n' 4.2
OLCUC b'A\x03B\x11C\x13D\rE\xc1\x1a\n' 4.55
";
    assert_eq!(played.output, expected, "{:?}", played.ending);
    assert!(played.took.as_secs() < 20, "{:?}", played.took);
}

/// The device stops what the client writes, and starts it again.
#[test]
fn a_port_with_flow_control_is_stopped_by_the_device() {
    let code = r#"
import os, select, termios, time
def opened():
    fd = os.open(os.environ["PORT"], os.O_RDWR | os.O_NOCTTY)
    return fd, termios.tcgetattr(fd)
(fd, raw), start = opened(), time.monotonic()
def at(): return round(time.monotonic() - start, 2)
def set(flags):
    termios.tcsetattr(fd, termios.TCSANOW, [raw[0] | flags, *raw[1:]])
def stopped(): return not select.select([], [fd], [], 0)[1]
set(termios.IXON)
os.write(fd, b"a\x13b\n"); time.sleep(0.02); os.write(fd, b"c\x11d\n"); time.sleep(0.04)
print(stopped(), os.read(fd, 9), at())
os.set_blocking(fd, False)
try: os.write(fd, b"no\n")
except BlockingIOError: print("full")
os.set_blocking(fd, True)
os.write(fd, b"e\n"); print(stopped(), os.read(fd, 9), at())
os.write(fd, b"\x13\n"); time.sleep(0.06); print(stopped())
set(0); set(termios.IXON); print(stopped())
set(termios.IXON | termios.IXANY)
os.write(fd, b"\x13\n"); time.sleep(0.06); print(stopped())
set(termios.IXON)
os.write(fd, b"\n\x13"); os.write(fd, b"\n"); time.sleep(0.06); print(stopped())
os.close(fd); fd, _ = opened(); set(termios.IXON); print(stopped())
"#;
    let Some(played) = python(code) else { return };
    let expected =
        "True b'AB\\n' 0.06\nfull\nFalse b'CD\\n' 0.07\nTrue\nFalse\nFalse\nTrue\nFalse\n";
    assert_eq!(played.output, expected, "{:?}", played.ending);
}

#[test]
fn bytes_go_through_the_line_however_they_are_written() {
    let code = r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/sendfile.h>
#include <sys/uio.h>
#include <unistd.h>
int main(void) {
  int fd = open(getenv("PORT"), O_RDWR | O_NOCTTY), p[2], q[2]; pipe(p); pipe(q); char b[10];
  struct iovec v = {"abc\n", 4}; int n = pwritev2(fd, &v, 1, -1, 0);
  printf("%d ", n); n = read(fd, b, 10); printf("%d %.3s\n", n, b);
  struct iovec w = {b, 1}; n = vmsplice(p[1], &w, 1, 0); printf("%d %d", n, tee(p[0], q[1], 1, 0));
  printf(" %zd\n", read(q[0], b, 1));
  n = splice(fd, 0, p[1], 0, 1, 0); printf("%d %d ", n, errno == EINVAL);
  n = sendfile(p[1], fd, 0, 1); printf("%d %d ", n, errno == EINVAL);
  n = splice(p[0], 0, fd, 0, 1, 0); printf("%d %d ", n, errno == EINVAL);
  n = vmsplice(fd, &v, 1, 0); printf("%d %d ", n, errno == EBADF);
  read(p[0], b, 1); if (!fork()) { sleep(2); write(p[1], "x", 1); _exit(0); }
  n = tee(p[0], q[1], 1, 0); printf("%d\n", n);
  n = read(open(getenv("PORT"), O_WRONLY | O_NOCTTY), b, 1); printf("%d %d", n, errno == EBADF);
  n = write(open(getenv("PORT"), O_RDONLY | O_NOCTTY), b, 1); printf(" %d %d\n", n, errno == EBADF);
}
"#;
    let Some(played) = c_played(code) else { return };
    let expected = "4 4 ABC\n1 1 1\n-1 1 -1 1 -1 1 -1 1 1\n-1 1 -1 1\n";
    assert_eq!(played.output, expected, "{:?}", played.ending);
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
    assert_eq!(played.trace[1], "0 sent \"abc\\n\" at 115200 baud");
}

/// Else one that has kept the path might find the port of another run there.
#[test]
fn no_program_gets_the_path_of_a_port_whose_cable_has_been_pulled() {
    let code = r#"
import os, time
before = os.path.realpath(os.environ["PORT"])
os.close(os.open(before, os.O_RDWR | os.O_NOCTTY))
time.sleep(4)
others = [os.ttyname(os.openpty()[1]) for _ in range(3)]
try:
    os.open(before, os.O_RDWR | os.O_NOCTTY)
except FileNotFoundError:
    print("gone", before in others)
time.sleep(2)
after = os.path.realpath(os.environ["PORT"])
print(after == before, os.open(after, os.O_RDWR | os.O_NOCTTY) > 0)
"#;
    let setup = Setup {
        device: Device {
            cable: Some((3_000_000_000, 4_900_000_000)),
            ..Device::default()
        },
        ..Setup::default()
    };
    let Some(played) = python_on(setup, code) else {
        return;
    };
    assert_eq!(
        played.output, "gone False\nFalse True\n",
        "{:?}",
        played.ending
    );
}

/// The kernel edits what arrives, and a client cannot tell that it does so at once.
#[test]
fn all_modes_of_a_terminal_are_those_of_linux() {
    let code = r#"
static int fd; static char b[99];
static int unread(void) { int n = -1; ioctl(fd, FIONREAD, &n); return n; }
static int next(int most) { return read(fd, b, most); }
static void ask(const char *text, int length) { write(fd, text, length); usleep(60000); }
static void shows(int n) { for (int i = 0; i < n; i++) printf("%02x ", (unsigned char)b[i]); }
int main(void) {
  fd = port(0); int n; struct pollfd p = {fd, POLLIN}; input(fd, IXON, 0, 1);
  ask("ab\n", 3); ask("cd\n", 3); n = unread(); printf("unread %d, %d\n", n, next(99));
  input(fd, IXON, 0, 6); ask("ab\n", 3); ask("cd\n", 3); n = poll(&p, 1, 500); printf("least %d %d\n", n, next(99));
  input(fd, ICRNL | IXON, 0, 1); ask("e\rf\n", 4); shows(next(99));
  input(fd, ISTRIP | IUCLC, 0, 1); ask("\303B\n", 3); shows(next(99));
  input(fd, PARMRK, 0, 1); ask("\377\n", 2); shows(next(99)); puts("");
  input(fd, 0, ICANON, 1); ask("one\ntwo\nthr", 11); n = unread(); printf("lines %d", n);
  n = next(99); printf(" %d", n); n = next(2); printf(" %d", n); n = next(99); printf(" %d\n", n);
  n = poll(&p, 1, 50); printf("part %d %d", n, unread()); ask("ee\n", 3); n = poll(&p, 1, 0); printf(" %d %d\n", n, next(99));
  ask("x\177y\025z\004\n", 8); n = unread(); printf("edited %d", n); n = next(99); printf(" %d %c", n, *b); n = next(99); printf(" %d\n", n);
  ask("par\n", 4); ask("q\n", 2); input(fd, 0, 0, 1); n = unread(); printf("no lines %d %d", n, next(99));
  ask("r\n", 2); ask("s\n", 2); input(fd, 0, ICANON, 1); n = unread(); printf(", one line %d %d\n", n, next(99));
  input(fd, 0, ISIG, 1); ask("be\003fore\n", 8); n = unread(); printf("signal %d %d\n", n, next(99));
}
"#;
    let expected = "unread 6, 6\nleast 1 6\n45 0a 46 0a 43 42 0a ff ff 0a \nlines 8 4 2 2\n\
                    part 0 0 1 6\nedited 2 1 Z 1\nno lines 7 7, one line 4 4\nsignal 5 5\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}

#[test]
fn what_is_stopped_or_full_is_not_writable_for_any_poll() {
    let code = r#"
static int fd, e; static char b[99]; static struct epoll_event edge = {EPOLLIN | EPOLLOUT | EPOLLET}, got;
static void writable(const char *what) {
  struct pollfd p = {fd, POLLOUT}; fd_set s; FD_ZERO(&s); FD_SET(fd, &s); struct timeval none = {0, 0};
  int n = poll(&p, 1, 0), m = select(fd + 1, 0, &s, 0, &none), k = epoll_wait(e, &got, 1, 0), l = epoll_wait(e, &got, 1, 0);
  printf("%s %d %d %d %d\n", what, n, m, k, l);
}
int main(void) {
  fd = port(O_NONBLOCK); input(fd, IXON, 0, 1); e = epoll_create1(0); epoll_ctl(e, EPOLL_CTL_ADD, fd, &edge);
  writable("free"); tcflow(fd, TCOOFF); writable("stopped"); printf("%d\n", E(write(fd, "x", 1)));
  tcflow(fd, TCOON); writable("started"); write(fd, "\023\n", 2); usleep(60000); read(fd, b, 9);
  writable("by the device"); printf("%d\n", E(write(fd, "x", 1))); input(fd, 0, 0, 1); writable("ignored");
  int n = E(write(fd, "abcdef\n", 7)); printf("%d", n); writable(" full"); n = epoll_wait(e, &got, 1, 1000);
  printf("%d %x %d\n", n, got.events & EPOLLOUT, E(write(fd, "x", 1)));
}
"#;
    let Some((_folder, binary)) = c(&format!("{CLIENT}{code}"), &[]) else {
        return;
    };
    let setup = Setup {
        device: Device {
            room: 2,
            ..Device::default()
        },
        ..Setup::default()
    };
    let played = play_on(setup, &[text(&binary)]).expect("it can be run");
    assert_eq!(
        played.output,
        "free 1 1 1 0\nstopped 0 0 0 0\n-11\nstarted 1 1 1 0\nby the device 0 0 0 0\n-11\nignored 1 1 1 0\n\
         2 full 0 0 0 0\n1 4 1\n",
        "{:?}",
        played.ending
    );
}

/// Room that there is again, and an edge for all that was written.
#[test]
fn an_epoll_finds_room_whatever_has_happened_meanwhile() {
    let code = r#"
static int fd, e; static struct epoll_event edge = {EPOLLOUT | EPOLLET}, got;
static int found(int ms) { return epoll_wait(e, &got, 1, ms); }
int main(void) {
  struct pollfd p; fd = port(O_NONBLOCK); p = (struct pollfd){fd, POLLOUT};
  int n = E(write(fd, "abcd", 4)); e = epoll_create1(0); epoll_ctl(e, EPOLL_CTL_ADD, fd, &edge);
  printf("added %d %d", n, found(0)); printf(" %d\n", found(1000));
  n = E(write(fd, "x", 1)); printf("written %d %d", n, found(10)); printf(" %d\n", found(10));
  n = E(write(fd, "abcd", 4)); printf("stopped %d %d", n, found(0)); tcflow(fd, TCOOFF); usleep(1000);
  printf(" %d %d %d", poll(&p, 1, 0), found(0), E(write(fd, "x", 1))); tcflow(fd, TCOON); printf(" %d %d\n", poll(&p, 1, 0), found(0));
  n = E(write(fd, "abcd", 4)); tcflow(fd, TCOOFF); tcflow(fd, TCOON); printf("started %d %d", n, found(0)); printf(" %d\n", found(1000));
  signal(SIGIO, hit); fcntl(fd, F_SETOWN, getpid()); fcntl(fd, F_SETFL, O_NONBLOCK | O_ASYNC);
  n = E(write(fd, "x", 1)); usleep(1000); printf("signal %d %d", n, caught); n = E(write(fd, "abcd", 4)); printf(" %d %d", n, caught);
  usleep(1000); printf(" %d\n", caught == SIGIO);
}
"#;
    let Some((_folder, binary)) = c(&format!("{CLIENT}{code}"), &[]) else {
        return;
    };
    let setup = Setup {
        device: Device {
            room: 2,
            ..Device::default()
        },
        ..Setup::default()
    };
    let played = play_on(setup, &[text(&binary)]).expect("it can be run");
    assert_eq!(
        played.output,
        "added 2 0 1\nwritten 1 1 0\nstopped 2 0 0 0 -11 1 1\nstarted 2 0 1\n\
                        signal 1 0 2 0 1\n",
        "{:?}",
        played.ending
    );
}

/// It leads to the port that controls the client, which is open as long as that is.
#[test]
fn a_port_is_used_through_the_terminal_that_controls_a_client() {
    let code = r#"
static char b[9];
static int tty(void) { return open("/dev/tty", O_RDWR); }
static int said(int fd, const char *text) { write(fd, text, 3); usleep(60000); return read(fd, b, 9); }
int main(void) {
  if (fork()) { wait(0); return 0; }
  setsid(); int fd = open(getenv("PORT"), O_RDWR), t = tty(), n = 0; write(t, "ab\n", 3);
  struct pollfd p = {t, POLLIN}; printf("%d", poll(&p, 1, 1000)); ioctl(t, FIONREAD, &n); printf(" %d %d\n", n, E(read(t, b, 9)));
  close(fd); printf("%d\n", said(t, "cd\n")); close(t); usleep(1000);
  t = tty(); printf("%d %.2s\n", said(t, "ef\n"), b);
}
"#;
    let Some(played) = c_played(&format!("{CLIENT}{code}")) else {
        return;
    };
    assert_eq!(played.output, "1 3 3\n3\n3 EF\n", "{:?}", played.ending);
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
    let kinds = played
        .trace
        .iter()
        .filter_map(|line| line.split(' ').nth(1));
    assert_eq!(
        kinds.collect::<Vec<_>>().join(" "),
        "opened sent answered sent answered closed opened sent answered closed"
    );
}

#[test]
fn the_last_close_makes_the_port_as_it_was() {
    let code = r#"
int main(void) {
  struct termios t; int fd = port(O_NONBLOCK), n; char b[9]; input(fd, IXON, ICANON | ECHO, 7);
  tcgetattr(fd, &t); cfsetspeed(&t, B9600); tcsetattr(fd, TCSANOW, &t); ioctl(fd, TIOCEXCL); tcflow(fd, TCOOFF);
  printf("%d ", E(write(fd, "x", 1))); close(fd); fd = port(0); tcgetattr(fd, &t);
  printf("%d %x %x %d\n", cfgetospeed(&t) == B115200, t.c_iflag, t.c_lflag, t.c_cc[VMIN]);
  write(fd, "ab\n", 3); n = read(fd, b, 9); printf("%d\n", n);
  // One that another process still has open is left as it is.
  input(fd, 0, ICANON, 1); if (!fork()) { close(fd); _exit(0); } wait(0); tcgetattr(fd, &t); printf("%x\n", t.c_lflag & ICANON);
}
"#;
    c_prints(&format!("{CLIENT}{code}"), "-11 1 0 0 1\n3\n2\n");
}

/// What an epoll finds are signs of bytes, in all modes.
#[test]
fn an_epoll_finds_lines_and_edited_bytes() {
    let code = r#"
static int fd, e; static char b[99]; static struct epoll_event v = {EPOLLIN | EPOLLET}, g;
static int found(int ms) { return epoll_wait(e, &g, 1, ms); }
static int next(int most) { return E(read(fd, b, most)); }
static int unread(void) { int n = -1; ioctl(fd, FIONREAD, &n); return n; }
int main(void) {
  int n; fd = port(O_NONBLOCK); e = epoll_create1(0); epoll_ctl(e, EPOLL_CTL_ADD, fd, &v); input(fd, 0, ICANON, 1);
  write(fd, "one\ntw", 6); n = found(500); printf("%d", n); n = found(60); printf(" %d %d", n, unread()); n = next(99); printf(" %d", n);
  n = next(99); printf(" %d\n", n); write(fd, "o\n", 2); n = found(500); printf("%d %d", n, unread()); n = next(2); printf(" %d %d", n, next(99));
  v.events = EPOLLIN; epoll_ctl(e, EPOLL_CTL_MOD, fd, &v); write(fd, "a\nb\n", 4); usleep(100000); n = found(50); printf(", %d %d", n, next(99));
  n = found(50); printf(" %d %d", n, next(99)); printf(" %d\n", found(50));
  input(fd, IXON, 0, 1); write(fd, "x\n", 2); n = found(500); printf("%d %d", n, next(99)); printf(" %d,", found(50));
  input(fd, IXON | ICRNL, 0, 4); write(fd, "x\n", 2); printf(" %d", found(200)); write(fd, "y\n", 2); n = found(200); printf(" %d %d\n", n, next(99));
  input(fd, 0, 0, 1); write(fd, "r\n", 2); n = found(500); input(fd, 0, ICANON, 1); printf("%d %d", n, found(50)); printf(" %d", next(99));
  write(fd, "ab\n", 3); usleep(100000); input(fd, 0, 0, 1); n = found(50); printf(" %d %d", n, next(99)); printf(" %d\n", found(50));
}
"#;
    let expected = "1 0 4 4 -11\n1 4 2 2, 1 2 1 2 0\n1 2 0, 0 1 4\n1 1 2 1 3 0\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}
