//! The same each time; no process is left; what cannot be is refused in words.

#![allow(
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "a test fails by panicking, and clippy takes helpers for production code; what is \
              skipped is named"
)]

mod common;

use std::io::BufRead as _;
use std::process::{Command, Stdio};
use std::time::Duration;

use common::{
    Device, Played, Setup, c, c_played, finished, play, play_on, program, python, python_on, text,
};
use rigsim_lockstep::{End, Error, Reason, spawn};

/// Busy loops beside a test, ended on drop.
struct Load(Vec<std::process::Child>);

impl Load {
    fn of(count: usize) -> Self {
        let busy = || {
            let mut command = Command::new("sh");
            command.args(["-c", "while :; do :; done"]);
            spawn(command.stdout(Stdio::null())).expect("a busy loop")
        };
        Self((0..count).map(|_| busy()).collect())
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            child.kill().expect("it runs");
            child.wait().expect("it has been killed");
        }
    }
}

/// Plays it several times beside busy loops; all must be the same. Gives the last.
fn same_each_time(times: usize, mut play: impl FnMut() -> Option<Played>) -> Option<Played> {
    let _load = Load::of(3);
    let first = play()?;
    assert_eq!(first.ending.end, End::Exited(0), "{}", first.output);
    for _ in 1..times {
        let again = play()?;
        assert_eq!(again.output, first.output);
        assert_eq!(again.trace, first.trace);
        assert_eq!(again.ending.at, first.ending.at);
        assert_eq!(again.ending.calls, first.ending.calls);
    }
    Some(first)
}

/// Three threads, a log with dates, random numbers, and a cable that is pulled; a minute.
const JOB: &str = r#"
import hashlib, logging, os, queue, random, secrets, threading, time, uuid
logging.basicConfig(format="%(asctime)s %(threadName)s %(message)s", level=logging.INFO)
log, path, lines = logging.info, os.environ["PORT"], queue.Queue()
stop = threading.Event()
def reader():
    fd = -1
    while not stop.is_set():
        try:
            if fd < 0:
                fd = os.open(path, os.O_RDWR | os.O_NOCTTY); log("open %s", path)
                os.write(fd, b"hello\n")
            data = os.read(fd, 100)
            if not data: raise OSError("gone")
            lines.put(data)
            os.write(fd, b"%d\n" % random.randrange(1000))
        except OSError as error:
            log("lost: %s", error)
            if fd >= 0: os.close(fd)
            fd = -1
            time.sleep(random.random())
def ticker():
    while not stop.wait(0.7): log("tick %s", {str(uuid.uuid4())[:4], secrets.token_hex(2)})
threads = [threading.Thread(target=f, name=f.__name__, daemon=True) for f in (reader, ticker)]
for t in threads: t.start()
end, digest = time.monotonic() + 60, hashlib.sha256()
while time.monotonic() < end:
    try: digest.update(lines.get(timeout=0.3))
    except queue.Empty: log("nothing")
stop.set()
log("%s %s %s", digest.hexdigest(), hash("text"))
"#;

#[test]
fn a_job_of_a_minute_is_the_same_to_the_last_byte() {
    let played = same_each_time(20, || {
        let setup = Setup {
            device: Device {
                cable: Some((20_000_000_000, 31_000_000_000)),
                ..Device::default()
            },
            ..Setup::default()
        };
        python_on(setup, JOB)
    });
    let Some(played) = played else { return };
    assert!(played.output.contains("2030-01-01 "), "{}", played.output);
    assert!(played.trace.len() > 1000, "{:?}", played.trace.len());
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
}

#[test]
fn another_seed_is_another_run() {
    let code = "import os, random; print(random.random(), os.urandom(4).hex(), hash('x'))";
    let with = |seed| {
        let setup = Setup {
            seed,
            ..Setup::default()
        };
        python_on(setup, code).map(|played| played.output)
    };
    let Some(first) = with(Some(1)) else { return };
    assert_eq!(with(Some(1)), Some(first.clone()));
    assert_ne!(with(Some(2)), Some(first));
    assert_ne!(with(None), with(None));
}

#[test]
fn what_is_random_elsewhere_is_the_same_too() {
    let code = r#"
#include <stdio.h>
#include <stdlib.h>
#include <sys/auxv.h>
#include <x86intrin.h>
int main(void) {
  unsigned char b[8]; FILE *f = fopen("/dev/urandom", "r"); fread(b, 1, 8, f);
  for (int i = 0; i < 8; i++) printf("%02x", b[i]);
  unsigned char *r = (unsigned char *)getauxval(AT_RANDOM);
  for (int i = 0; i < 16; i++) printf("%02x", r[i]);
  unsigned a; printf(" %p %p %p %llu %llu\n", (void *)main, (void *)b, malloc(100000), __rdtsc(), __rdtscp(&a));
}
"#;
    let Some((_folder, binary)) = c(code, &[]) else {
        return;
    };
    same_each_time(5, || Some(play(&[text(&binary)])));
}

#[test]
fn processes_and_pipelines_are_the_same_each_time() {
    let code = "for i in 1 2 3; do (sleep 0.$i; echo $i; date +%s.%N) & done; wait; \
                seq 3 | while read n; do echo $n; sleep 0.1; done | sort -r; date -Ins; \
                trap 'echo trapped; date +%s.%N' USR1; (sleep 1; kill -USR1 $$) & sleep 2; date +%N";
    let played = same_each_time(8, || Some(play(&["bash", "-c", code])));
    let output = played.expect("there is a shell").output;
    assert!(output.contains("trapped"), "{output}");
}

#[test]
fn a_client_that_computes_without_end_learns_where() {
    // Long enough for a busy machine to have begun it.
    let doing = [1, 5, 25, 125].into_iter().find_map(|seconds| {
        let setup = Setup {
            allowed: [Some(Duration::from_secs(seconds)), None],
            ..Setup::default()
        };
        let played = play_on(setup, &["sh", "-c", "while :; do :; done"]).expect("it can be run");
        assert_eq!(played.ending.end, End::Killed(9));
        let Reason::OutOfTime { doing, .. } = played.ending.reason else {
            panic!("{:?}", played.ending)
        };
        doing.starts_with("sh was computing").then_some(doing)
    });
    let doing = doing.expect("it computes at last");
    assert!(doing.starts_with("sh was computing, in /"), "{doing}");
}

#[test]
fn the_world_outside_has_real_time_and_is_named() {
    let Some(python3) = program("python3") else {
        return;
    };
    // Another program: what this one serves is of the run.
    let server = "import socket, time; s = socket.create_server(('127.0.0.1', 0)); \
                  print(s.getsockname()[1], flush=True); c, _ = s.accept(); c.recv(1); \
                  time.sleep(2); c.send(b'y'); c.recv(1)";
    let mut command = Command::new(python3);
    command.args(["-c", server]).stdout(Stdio::piped());
    // The tracer reaps the children of that thread.
    let starting = std::thread::spawn(move || spawn(&mut command).expect("a server"));
    let mut server = starting.join().expect("it has started");
    let mut port = String::new();
    let mut printed = std::io::BufReader::new(server.stdout.take().expect("a pipe"));
    printed.read_line(&mut port).expect("its port");
    let port = port.trim();
    let code = format!(
        "import socket, time; s = socket.create_connection(('127.0.0.1', {port})); s.send(b'x'); \
         t = time.monotonic(); print(s.recv(1), time.monotonic() - t)"
    );
    let played = python(&code).expect("there is a Python");
    server.wait().expect("it has answered");
    let waited = played.output.trim_end().strip_prefix("b'y' ");
    let waited: f64 = waited.and_then(|text| text.parse().ok()).expect("a time");
    // Two seconds, less what a busy machine kept the tracer from looking.
    assert!(waited > 0.1, "{}", played.output);
    assert!(waited < played.took.as_secs_f64(), "{}", played.output);
    let named: Vec<&String> = played.ending.outside.iter().collect();
    assert_eq!(named, [&format!("tcp 127.0.0.1:{port}")]);
}

/// The other end of a named pipe is another program's; that of a pseudo-terminal is the run's.
#[test]
fn a_pipe_that_no_process_of_the_run_writes_is_outside() {
    let Some(python3) = program("python3") else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let fifo = folder.path().join("fifo");
    let mode = rustix::fs::Mode::RWXU;
    rustix::fs::mknodat(rustix::fs::CWD, &fifo, rustix::fs::FileType::Fifo, mode, 0)
        .expect("a pipe");
    let writer = "import os, sys, time; file = os.open(sys.argv[1], os.O_WRONLY); time.sleep(1.5); \
                  os.write(file, b'late'); time.sleep(1)";
    let mut command = Command::new(python3);
    command.args(["-c", writer, text(&fifo)]);
    // The tracer reaps the children of that thread.
    let starting = std::thread::spawn(move || spawn(&mut command).expect("a writer"));
    let mut writer = starting.join().expect("it has started");
    let code = format!(
        "import os, pty, threading, time; file = os.open({:?}, os.O_RDONLY | os.O_NONBLOCK); \
         os.set_blocking(file, True); m, s = pty.openpty(); r, w = os.pipe(); \
         threading.Timer(50, lambda: (os.write(m, b'x\\n'), os.write(w, b'y'))).start(); \
         print(os.read(s, 9), os.read(r, 9), time.monotonic() >= 1050)\n\
         while not (part := os.read(file, 9)): time.sleep(0.01)\n\
         print(part)",
        text(&fifo)
    );
    let played = python(&code).expect("there is a Python");
    writer.wait().expect("it has written");
    assert_eq!(
        played.output, "b'x\\n' b'y' True\nb'late'\n",
        "{:?}",
        played.ending
    );
    let named: Vec<&str> = played.ending.outside.iter().map(String::as_str).collect();
    assert_eq!(named, [text(&fifo)]);
}

/// No poll reports the room at a receiver.
#[test]
fn a_receiver_outside_that_is_full_has_real_time() {
    let Some(python3) = program("python3") else {
        return;
    };
    let receiver = "import socket, sys, time; s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\n\
                    s.bind('\\0lockstep' + sys.argv[1]); print(flush=True); s.recv(9)\n\
                    s.recv(9); time.sleep(1)\nwhile True: s.recv(9)";
    let name = std::process::id().to_string();
    let mut command = Command::new(python3);
    command.args(["-c", receiver, &name]).stdout(Stdio::piped());
    // The tracer reaps the children of that thread.
    let starting = std::thread::spawn(move || spawn(&mut command).expect("a receiver"));
    let mut receiver = starting.join().expect("it has started");
    let mut printed = std::io::BufReader::new(receiver.stdout.take().expect("a pipe"));
    printed.read_line(&mut String::new()).expect("it is there");
    let code = format!(
        "import socket, threading; name = '\\0lockstep{name}'; new = lambda: socket.socket(socket.AF_UNIX, 2)\n\
         inside = new(); inside.bind('\\0inside' + name[1:]); s = new(); s.setblocking(False); n = 0\n\
         threading.Timer(50, lambda: new().sendto(b'in', '\\0inside' + name[1:])).start(); print(inside.recv(9))\n\
         try:\n  while True: s.sendto(b'x', name); n += 1\n\
         except BlockingIOError: print(n > 0)\n\
         s.setblocking(True); [s.sendto(b'y', name) for _ in range(n)]; s.sendto(b'last', name); print('sent')"
    );
    let played = python(&code).expect("there is a Python");
    receiver.kill().expect("it has got the last");
    receiver.wait().expect("it has been killed");
    assert_eq!(played.output, "b'in'\nTrue\nsent\n", "{:?}", played.ending);
    let named: Vec<&String> = played.ending.outside.iter().collect();
    assert_eq!(named, [&format!("a unix socket at @lockstep{name}")]);
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let played = c_played(
        r#"
#include <errno.h>
#include <stdio.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <unistd.h>
int main(void) {
  printf("%d", ptrace(PTRACE_TRACEME, 0, 0, 0) == -1 && errno == EPERM);
  unsigned long context = 0;
  printf("%d", syscall(SYS_io_uring_setup, 8, 0) == -1 && errno == ENOSYS);
  printf("%d", syscall(SYS_io_setup, 8, &context) == -1 && errno == ENOSYS);
  int word = 0;
  printf("%d", syscall(SYS_futex, &word, 11, 0, 0, &word) == -1 && errno == ENOSYS);
  printf("%d\n", syscall(449, 0, 0, 0, 0, 0) == -1 && errno == ENOSYS);
}
"#,
    );
    let Some(played) = played else { return };
    assert_eq!(played.output, "11111\n");
    let refused: Vec<&String> = played.ending.refused.iter().collect();
    assert!(refused[0].starts_with("a debugger"), "{refused:?}");
    let missing: Vec<&str> = played.ending.missing.iter().map(String::as_str).collect();
    assert!(
        [
            "futex (REQUEUE_PI)",
            "futex_waitv",
            "io_setup",
            "io_uring_setup"
        ]
        .iter()
        .all(|call| missing.contains(call)),
        "{missing:?}"
    );

    let missing = play_on(Setup::default(), &["/missing/here"]);
    assert!(matches!(missing, Err(Error::NotStarted(_))), "{missing:?}");
    let folder = play_on(Setup::default(), &["/"]);
    assert!(matches!(folder, Err(Error::NotStarted(_))), "{folder:?}");
}

#[test]
fn wrong_numbers_and_addresses_are_the_clients_affair() {
    let played = c_played(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#define FAILS(call) printf("%d ", (call) == -1 ? errno : 0)
int main(void) {
  char b[8]; struct iovec v = {b, 8}; struct itimerspec t = {{0, 0}, {1, 0}}; struct epoll_event e;
  void *nowhere = (void *)8; int numbers[] = {-1, -2, -7, -100, -2147483647 - 1, 77, 2147483647};
  for (int i = 0; i < 7; i++) {
    int fd = numbers[i];
    FAILS(read(fd, b, 8)); FAILS(write(fd, b, 8)); FAILS(readv(fd, &v, 1)); FAILS(writev(fd, &v, 1));
    FAILS(recv(fd, b, 8, 0)); FAILS(send(fd, b, 8, 0)); FAILS(accept(fd, 0, 0)); FAILS(ioctl(fd, TIOCMGET, b));
    FAILS(epoll_wait(fd, &e, 1, 5)); FAILS(flock(fd, LOCK_EX)); FAILS(timerfd_settime(fd, 0, &t, 0));
    FAILS(splice(fd, 0, fd, 0, 8, 0)); puts("");
  }
  int p[2]; pipe(p); fcntl(p[1], F_SETFL, O_NONBLOCK); write(p[1], "x", 1);
  FAILS(read(p[0], nowhere, 1)); FAILS(poll(nowhere, 1, 5)); FAILS(select(1, nowhere, 0, 0, 0));
  FAILS(nanosleep(nowhere, 0)); FAILS(syscall(SYS_clock_gettime, 0, nowhere));
  FAILS(syscall(SYS_futex, nowhere, FUTEX_WAIT, 0, 0)); FAILS(syscall(SYS_getrandom, nowhere, 8, 0));
  FAILS(write(p[1], nowhere, 8)); FAILS(kill(-2147483647 - 1, 0)); FAILS(wait4(-7, 0, 0, 0)); puts("");
}
"#,
    );
    let Some(played) = played else { return };
    assert_eq!(played.ending.end, End::Exited(0), "{:?}", played.ending);
    let lines: Vec<&str> = played.output.lines().map(str::trim).collect();
    for line in &lines[..7] {
        assert_eq!(*line, ["9"; 12].join(" "), "{}", played.output);
    }
    assert_eq!(
        lines[7], "14 14 14 14 14 14 14 14 3 10",
        "{}",
        played.output
    );
}

#[test]
fn a_32_bit_program_is_refused() {
    let Some(cc) = program("cc") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("old.c");
    let binary = folder.path().join("old");
    let code = "void _start(void) { __asm__(\"mov $1, %eax; xor %ebx, %ebx; int $0x80\"); }";
    std::fs::write(&source, code).expect("a source file");
    let mut command = Command::new(cc);
    command.args(["-m32", "-nostdlib", "-static", "-fno-pie", "-no-pie", "-o"]);
    let built = finished(command.args([&binary, &source])).expect("a compiler that runs");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    let refused = play_on(Setup::default(), &[text(&binary)]);
    let Err(Error::Refused(why)) = refused else {
        panic!("{refused:?}")
    };
    assert!(why.contains("is a 32-bit program"), "{why}");
}

#[test]
fn a_program_that_is_to_run_as_another_user_is_refused() {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown};
    let user = std::fs::metadata("/proc/self").expect("itself").uid();
    let folder = tempfile::tempdir().expect("a folder");
    let binary = folder.path().join("other");
    // Root makes such a program; other users have one.
    if user == 0 {
        std::fs::copy("/bin/true", &binary).expect("a copy");
        chown(&binary, Some(65_534), None).expect("root may");
        let rights = std::fs::Permissions::from_mode(0o4755);
        std::fs::set_permissions(&binary, rights).expect("root may");
    } else if std::path::Path::new("/bin/su").exists() {
        std::os::unix::fs::symlink("/bin/su", &binary).expect("a link");
    } else {
        eprintln!("skipped: there is no program of another user here");
        return;
    }
    let refused = play_on(Setup::default(), &[text(&binary)]);
    let Err(Error::Refused(why)) = refused else {
        panic!("{refused:?}")
    };
    assert!(why.contains("is to run as another user"), "{why}");
}

#[test]
fn nothing_piles_up_over_many_runs() {
    let open = || std::fs::read_dir("/proc/self/fd").expect("them").count();
    let children = || {
        let tasks = std::fs::read_dir("/proc/self/task").expect("them");
        let lists = tasks
            .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("children")).ok());
        lists
            .map(|list| list.split_whitespace().count())
            .sum::<usize>()
    };
    let run = || {
        play(&[
            "sh",
            "-c",
            "(sleep 1 &) ; (sleep 100 &); echo $PORT >/dev/null",
        ])
    };
    run();
    let before = open();
    for _ in 0..50 {
        run();
    }
    // Other tests of this program have some meanwhile, too.
    assert!(open() < before + 40, "{} {before}", open());
    assert!(children() < 40, "{}", children());
}

/// Numbers that a client in a PID namespace names are those that it knows.
#[test]
fn processes_in_a_namespace_of_their_own_know_one_another() {
    let inside = ["unshare", "-Urpf", "--mount-proc"];
    let mut command = Command::new(inside[0]);
    let allowed = finished(command.args([&inside[1..], &["true"]].concat()));
    if !allowed.is_ok_and(|ended| ended.status.success()) {
        eprintln!("skipped: no PID namespace can be made here");
        return;
    }
    let timers = r#"
#define _GNU_SOURCE
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static volatile int hits; static void hit(int s) { hits++; }
static void on_thread(union sigval v) { printf("thread %d\n", v.sival_int); fflush(stdout); }
int main(void) {
  signal(SIGUSR1, hit); struct sigevent e = {0}; e.sigev_notify = SIGEV_SIGNAL; e.sigev_signo = SIGUSR1;
  timer_t t; timer_create(CLOCK_MONOTONIC, &e, &t);
  struct itimerspec two = {{0, 0}, {2, 0}}; timer_settime(t, 0, &two, 0); pause();
  e.sigev_notify = SIGEV_THREAD; e.sigev_notify_function = on_thread; e.sigev_value.sival_int = 42;
  timer_create(CLOCK_MONOTONIC, &e, &t); timer_settime(t, 0, &two, 0); sleep(3);
  int child = fork(), status; if (!child) { sleep(1000); _exit(0); }
  sleep(1); kill(child, SIGKILL); wait(&status); printf("%d hits, %d\n", hits, status);
}
"#;
    let Some((_folder, binary)) = c(timers, &["-lrt"]) else {
        return;
    };
    let script = "sleep 100 & p=$!; sleep 1; kill -9 $p; wait $p; echo waited $?; \
                  unshare -pf --mount-proc sh -c 'sleep 100 & p=$!; kill -9 $p; wait $p; echo inner $?'; \
                  \"$0\"; sleep 100 & kill -9 -1; echo killed all others; sleep 1";
    let words = [&inside[..], &["sh", "-c", script, text(&binary)]].concat();
    let setup = Setup {
        allowed: [Some(Duration::from_secs(20)), None],
        ..Setup::default()
    };
    let played = play_on(setup, &words).expect("it can be run");
    let expected = "waited 137\ninner 137\nthread 42\n1 hits, 9\nkilled all others\n";
    assert_eq!(played.output, expected, "{:?}", played.ending);
    assert_eq!(played.ending.end, End::Exited(0));
    // A client outside kills the first process of the namespace, and all that are in it.
    let script = "unshare -Urpf --mount-proc sh -c 'sleep 50 & (sleep 60 & sleep 70) & wait' 2>&- & \
                  sleep 1; kill -9 $(pgrep -P $!); wait $! || echo killed";
    let played = play(&["sh", "-c", script]);
    assert_eq!(played.output, "killed\n", "{:?}", played.ending);
}

/// A machine that is busy with something else takes nothing of the time allowed.
#[test]
fn the_time_allowed_is_that_of_processors() {
    let setup = |stalls, allowed: [Option<u64>; 2]| Setup {
        allowed: allowed.map(|seconds| seconds.map(Duration::from_secs)),
        device: Device {
            stalls: Duration::from_millis(stalls),
            ..Device::default()
        },
        ..Setup::default()
    };
    let sleeps = "for i in 1 2 3 4 5; do sleep 1; done";
    let played = play_on(setup(500, [Some(2), None]), &["sh", "-c", sleeps]);
    let played = played.expect("it can be run");
    assert!(played.took.as_millis() > 2500, "{:?}", played.took);
    assert_eq!(played.ending.end, End::Exited(0), "{:?}", played.ending);
    // All of its processes count, also those that have ended.
    let one = "python3 -c 'import time\nwhile time.process_time() < 0.4: pass'";
    let all = format!("{one}; {one} & {one} & wait; {one}; {one}");
    let played = play_on(setup(0, [Some(1), None]), &["sh", "-c", &all]).expect("it can be run");
    let reason = &played.ending.reason;
    assert!(
        matches!(reason, Reason::OutOfTime { real: false, .. }),
        "{reason:?}"
    );
    // Real time has its limit as well.
    let played = play_on(setup(2000, [None, Some(1)]), &["sh", "-c", sleeps]);
    let reason = played.expect("it can be run").ending.reason;
    assert!(
        matches!(reason, Reason::OutOfTime { real: true, .. }),
        "{reason:?}"
    );
}

#[test]
fn a_thread_that_waits_in_memory_alone_goes_on_when_time_does() {
    let code = r#"
#include <pthread.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>
static volatile int ready;
static void *later(void *_) { usleep(150000); ready = 1; return 0; }
int main(void) {
  struct timespec a, b; pthread_t t; clock_gettime(CLOCK_MONOTONIC, &a);
  pthread_create(&t, 0, later, 0); usleep(1); while (!ready); pthread_join(t, 0);
  clock_gettime(CLOCK_MONOTONIC, &b);
  double took = b.tv_sec - a.tv_sec + (b.tv_nsec - a.tv_nsec) / 1e9;
  printf("%d\n", took > 0.15 && took < 0.3);
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(played.output, "1\n", "{:?}", played.ending);
    let what: Vec<&String> = played.ending.outside.iter().collect();
    assert_eq!(what, ["client, which computed for long"]);
}

#[test]
fn processes_that_a_client_leaves_behind_are_named() {
    let played = play(&["sh", "-c", "sleep 1000 & sleep 1; exit 0"]);
    assert_eq!(played.ending.end, End::Exited(0));
    assert_eq!(played.ending.left.iter().collect::<Vec<_>>(), ["sleep"]);
    let played = play(&["sh", "-c", "sleep 1 & wait"]);
    assert!(played.ending.left.is_empty(), "{:?}", played.ending);
}

#[test]
fn a_wait_in_the_kernel_is_named_by_its_syscall() {
    let code = r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <linux/openat2.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
int main(void) {
  char folder[] = "/tmp/lockstepXXXXXX", fifo[64]; mkdtemp(folder);
  sprintf(fifo, "%s/fifo", folder); mkfifo(fifo, 0600);
  if (!fork()) { usleep(200000); close(open(fifo, O_WRONLY)); _exit(0); }
  struct open_how how = {.flags = O_RDONLY};
  printf("%d\n", syscall(SYS_openat2, AT_FDCWD, fifo, &how, sizeof how) > 0);
  unlink(fifo); rmdir(folder);
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(played.output, "1\n", "{:?}", played.ending);
    let outside: Vec<&String> = played.ending.outside.iter().collect();
    assert!(outside.len() == 1, "{outside:?}");
    assert!(outside[0] == "client in openat2", "{outside:?}");
}

/// It waits for what no poll reports, and for a thread of the same process that only time can resume.
#[test]
fn time_passes_while_the_kernel_keeps_a_thread_for_long() {
    let code = r#"
import ctypes, os, resource, select, socket, struct, threading, time
start, done = time.monotonic(), []
def child(name, run):
    if os.fork() == 0:
        run(); print(name, flush=True); os._exit(0)
    os.wait()
def later(run): threading.Thread(target=lambda: (time.sleep(0.5), run())).start()
def many():
    r, w = os.pipe(); later(lambda: os.write(w, b"x"))
    resource.setrlimit(resource.RLIMIT_NOFILE, (w + 1, w + 1)); assert os.read(r, 5) == b"x"
def lingers():
    s = socket.create_server(("127.0.0.1", 0)); a = socket.create_connection(s.getsockname()); b, _ = s.accept()
    a.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 60)); a.setblocking(False)
    try:
        while True: a.send(bytes(65536))
    except BlockingIOError: a.setblocking(True)
    def reads():
        while b.recv(1 << 20): pass
    later(reads); a.close()
def naps():
    def busy():
        while not done: sum(range(1000)); time.sleep(0)
    threading.Thread(target=busy).start()
    ctypes.CDLL(None).clock_nanosleep(2, 0, (ctypes.c_long * 2)(0, 300000000), None); done.append(1)
child("many", many); child("lingers", lingers); child("naps", naps)
"#;
    let Some(played) = python(code) else { return };
    assert_eq!(
        played.output, "many\nlingers\nnaps\n",
        "{:?}",
        played.ending
    );
    let outside: Vec<&String> = played.ending.outside.iter().collect();
    assert!(
        outside.iter().any(|one| one.ends_with("in close"))
            && outside
                .iter()
                .any(|one| one.ends_with("in clock_nanosleep")),
        "{outside:?}"
    );
}

/// No poll reports a lock: it is tried again and again, in real time.
#[test]
fn a_lock_of_another_program_is_outside() {
    let Some(python3) = program("python3") else {
        return;
    };
    for lock in ["flock", "lockf"] {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let path = text(file.path());
        let holder = format!(
            "import fcntl, os, time; file = open({path:?}, 'r+'); fcntl.{lock}(file, fcntl.LOCK_EX); \
             print('holds', flush=True)\n\
             while not os.path.getsize(file.fileno()): time.sleep(0.01)\n\
             time.sleep(0.3)"
        );
        let mut command = Command::new(&python3);
        command.args(["-c", &holder]).stdout(Stdio::piped());
        // The tracer reaps the children of that thread.
        let starting = std::thread::spawn(move || spawn(&mut command).expect("a holder"));
        let mut holder = starting.join().expect("it has started");
        let mut printed = std::io::BufReader::new(holder.stdout.take().expect("a pipe"));
        printed.read_line(&mut String::new()).expect("a line");
        let code = format!(
            "import fcntl, time; start = time.monotonic(); file = open({path:?}, 'w'); \
             file.write('waits'); file.flush(); fcntl.{lock}(file, fcntl.LOCK_EX); print(time.monotonic() - start)"
        );
        let played = python(&code).expect("there is a Python");
        holder.wait().expect("it has given up");
        let waited = played.output.trim().parse();
        let waited: f64 = waited.unwrap_or_else(|_| panic!("{:?}", played.ending));
        assert!(waited < played.took.as_secs_f64(), "{waited}");
        let named: Vec<&String> = played.ending.outside.iter().collect();
        assert_eq!(named, [&format!("a lock of {path}")]);
    }
}

/// The kernel makes an open wait while another program has a lease on the file, as a slow disk does.
#[test]
fn a_thread_that_the_kernel_keeps_waits_for_nothing_outside() {
    let Some(python3) = program("python3") else {
        return;
    };
    let file = tempfile::NamedTempFile::new()
        .expect("a file")
        .into_temp_path();
    let holder = "import fcntl, signal, sys, time\n\
        file = open(sys.argv[1], 'r+')\n\
        def give_up(*_):\n  \
            time.sleep(0.5)\n  \
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)\n  \
            sys.exit()\n\
        signal.signal(signal.SIGIO, give_up)\n\
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)\n\
        print('holds', flush=True)\n\
        while True: signal.pause()";
    let mut command = Command::new(python3);
    command
        .args(["-c", holder, text(&file)])
        .stdout(Stdio::piped());
    // The tracer reaps the children of that thread.
    let starting = std::thread::spawn(move || spawn(&mut command).expect("a holder"));
    let mut holder = starting.join().expect("it has started");
    let mut printed = std::io::BufReader::new(holder.stdout.take().expect("a pipe"));
    let mut line = String::new();
    printed.read_line(&mut line).expect("a line");
    assert_eq!(line, "holds\n");
    let code = format!(
        "import threading, time; start = time.monotonic(); \
         thread = threading.Thread(target=time.sleep, args=(0.1,)); thread.start(); \
         open({:?}).close(); print(time.monotonic() - start < 0.1); thread.join(); \
         print(round(time.monotonic() - start, 3))",
        text(&file)
    );
    let played = python(&code).expect("there is a Python");
    holder.wait().expect("it has given up");
    assert_eq!(played.output, "True\n0.1\n", "{:?}", played.ending);
    assert!(
        played.took > Duration::from_millis(400),
        "{:?}",
        played.took
    );
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
}

/// A process that is being started has a copy of every descriptor of this program, and so of the pipes of
/// other runs.
#[test]
fn runs_at_the_same_time_do_not_keep_pipes_of_one_another_open() {
    let code = "for i in $(seq 60); do x=$(echo $i); done; echo $x";
    let run = || {
        let played = play(&["sh", "-c", code]);
        assert_eq!(played.output, "60\n", "{:?}", played.ending);
        assert_eq!(played.ending.at, 0);
    };
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| (0..10).for_each(|_| run()));
        }
    });
}

/// Whatever a write is longer than, it waits for the one who reads, and for nothing in the kernel.
#[test]
fn long_writes_wait_in_simulated_time() {
    let code = r#"
import fcntl, os, pty, socket, sys, tempfile, threading, time
start = time.monotonic()
def at(): return round(time.monotonic() - start, 2)
def slow(read):
    count = 0
    while part := read(100000):
        count += len(part); time.sleep(0.1)
    print("read", count, at(), flush=True)
def writes(name, write, read, close):
    thread = threading.Thread(target=slow, args=(read,)); thread.start()
    print(name, write(bytes(1000000)), at(), flush=True); close(); thread.join()
r, w = os.pipe()
writes("pipe", lambda b: os.write(w, b), lambda n: os.read(r, n), lambda: os.close(w))
a, b = socket.socketpair()
writes("socket", lambda d: a.send(d), lambda n: b.recv(n), a.close)
r, w = os.pipe()
writes("parts", lambda b: os.writev(w, [b[:70000], b[70000:]]), lambda n: os.read(r, n), lambda: os.close(w))
file = tempfile.TemporaryFile(); file.write(bytes(1000000)); file.flush()
a, b = socket.socketpair()
writes("file", lambda _: os.sendfile(a.fileno(), file.fileno(), 0, 2000000), lambda n: b.recv(n), a.close)
r, w = os.pipe(); p, q = os.pipe()
threading.Timer(1, lambda: os.write(w, b"late")).start()
print("splice", os.splice(r, q, 100), os.read(p, 9), at())
r, w = os.pipe()
threading.Timer(1, lambda: (os.read(r, 5000), os.close(r))).start()
print("ends", os.write(w, bytes(100000)), at())
try: os.write(w, b"x")
except BrokenPipeError: print("broken")
a, b = socket.socketpair(); a.settimeout(None)
import struct; a.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", 2, 0))
before = at(); sent = a.send(bytes(10000000)); print("late", 0 < sent < 10000000, round(at() - before, 2))
m, s = pty.openpty()
threading.Timer(1, lambda: os.write(m, b"typed\n")).start()
print(os.read(s, 9), at())
"#;
    let Some(played) = same_each_time(4, || python(code)) else {
        return;
    };
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
    let lines: Vec<&str> = played.output.lines().collect();
    let of = |name: &str| lines.iter().find(|line| line.starts_with(name)).copied();
    for name in ["pipe", "socket", "parts", "file"] {
        let line = of(name).unwrap_or_else(|| panic!("{}", played.output));
        assert!(
            line.starts_with(&format!("{name} 1000000 ")),
            "{}",
            played.output
        );
    }
    assert_eq!(
        played.output.matches("read 1000000 ").count(),
        4,
        "{}",
        played.output
    );
    for line in ["broken", "late True 2.0"] {
        assert!(lines.contains(&line), "{}", played.output);
    }
}

/// The client's own signal, and the client's own number.
#[test]
fn long_writes_are_the_clients_own() {
    let code = r#"
import os, signal, socket, struct, threading, time
signal.signal(signal.SIGPIPE, lambda *_: print("SIGPIPE", flush=True))
r, w = os.pipe()
threading.Timer(1, lambda: (os.read(r, 5000), os.close(r))).start()
print("pipe", os.write(w, bytes(100000)))
a, b = socket.socketpair()
threading.Timer(1, lambda: (b.recv(5000), b.close())).start()
print("socket", 0 < os.write(a.fileno(), bytes(1000000)) < 1000000)
a, b = socket.socketpair(); b.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
def writes(): a.send(b"x" * 300000); a.sendmsg([b"y" * 1000, b"z" * 300000]); a.close()
threading.Thread(target=writes).start()
count, writers, letters = 0, set(), ""
while True:
    data, others, *_ = b.recvmsg(50000, 1000)
    if not data: break
    count += len(data)
    for letter in data.decode():
        if not letters.endswith(letter): letters += letter
    for *_, cred in others: writers.add(struct.unpack("3i", cred)[0])
    time.sleep(0.01)
print(count, letters, writers == {os.getpid()})
"#;
    let expected = "SIGPIPE\npipe 65536\nsocket True\n601000 xyz True\n";
    common::prints(code, expected);
}

#[test]
fn a_long_write_arrives_whole() {
    let code = r#"
import hashlib, os, random, threading
sent, came, (r, w) = random.Random(1).randbytes(1 << 24), hashlib.sha256(), os.pipe()
def write(): print(os.write(w, sent)); os.close(w)
threading.Thread(target=write).start()
while part := os.read(r, 99999): came.update(part)
print(came.digest() == hashlib.sha256(sent).digest())
"#;
    if let Some(played) = same_each_time(5, || python(code)) {
        assert_eq!(played.output, "16777216\nTrue\n", "{:?}", played.ending);
    }
}
