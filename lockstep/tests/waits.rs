//! Each way to wait, and each clock: simulated time passes, real time does not.

mod common;

use common::{CLIENT, c_prints, play, prints, python};
use rigsim_lockstep::{End, Reason};

#[test]
fn a_sleep_takes_simulated_time_and_next_to_no_real_time() {
    let played = play(&["sleep", "30"]);
    assert_eq!(played.ending.end, End::Exited(0));
    assert_eq!(played.ending.reason, Reason::Itself);
    assert_eq!(played.ending.at, 30_000_050_000);
    assert!(played.took.as_secs() < 20, "{:?}", played.took);
}

#[test]
fn clocks_agree_on_how_long_a_sleep_was() {
    let code = r#"
import time
names = "REALTIME MONOTONIC MONOTONIC_RAW BOOTTIME TAI REALTIME_COARSE MONOTONIC_COARSE".split()
coarse = {"REALTIME_COARSE": 5, "MONOTONIC_COARSE": 6}
clocks = {n: getattr(time, "CLOCK_" + n, coarse.get(n)) for n in names}
before = {n: time.clock_gettime_ns(c) for n, c in clocks.items()}
wall = time.time_ns()
time.sleep(12.5)
for n, c in clocks.items():
    print(n, time.clock_gettime_ns(c) - before[n])
print("time", time.time_ns() - wall, time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime()))
"#;
    let Some(played) = python(code) else { return };
    for line in played.output.lines().take(7) {
        assert!(line.ends_with(" 12500050000"), "{}", played.output);
    }
    assert!(
        played
            .output
            .ends_with("time 12500050000 2030-01-01 00:00:12\n"),
        "{}",
        played.output
    );
}

#[test]
fn threads_wait_for_one_another_in_simulated_time() {
    prints(
        r#"
import threading, time
start = time.monotonic()
event, condition, log = threading.Event(), threading.Condition(), []
def at(): return round(time.monotonic() - start, 6)
def waiter():
    log.append(("timeout", event.wait(2.5), at()))
    log.append(("set", event.wait(100), at()))
def setter():
    time.sleep(7)
    event.set()
    with condition: condition.notify_all()
def conditional():
    with condition: log.append(("notified", condition.wait(50), at()))
    with condition: log.append(("late", condition.wait(1.25), at()))
threads = [threading.Thread(target=f) for f in (waiter, setter, conditional)]
for t in threads: t.start()
for t in threads: t.join()
for entry in sorted(log, key=lambda e: (e[2], e[0])): print(*entry)
"#,
        "timeout False 2.50005\nnotified True 7.00005\nset True 7.00005\nlate False 8.2501\n",
    );
}

#[test]
fn asyncio_sleeps_and_times_out() {
    prints(
        r#"
import asyncio, time
async def main():
    start = time.monotonic()
    await asyncio.gather(*(asyncio.sleep(n) for n in (1, 5, 3)))
    print(round(time.monotonic() - start, 3))
    try:
        await asyncio.wait_for(asyncio.Event().wait(), 20)
    except asyncio.TimeoutError:
        print("timeout", round(time.monotonic() - start, 3))
    print(await asyncio.get_running_loop().run_in_executor(None, lambda: time.sleep(4) or "slept"))
asyncio.run(main())
"#,
        "5.0\ntimeout 25.0\nslept\n",
    );
}

#[test]
fn polls_of_all_kinds_time_out_in_simulated_time() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <poll.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
int main(void) {
  int p[2]; pipe(p);
  long start = now();
  struct pollfd f = {p[0], POLLIN, 77};
  int n = poll(&f, 1, 1500); printf("poll %d %d %ld\n", n, f.revents, now() - start);
  struct timespec two = {2, 0};
  f.revents = 77;
  n = ppoll(&f, 1, &two, 0); printf("ppoll %d %d %ld\n", n, f.revents, now() - start);
  fd_set set; FD_ZERO(&set); FD_SET(p[0], &set);
  struct timeval three = {3, 0};
  n = select(p[0] + 1, &set, 0, 0, &three);
  printf("select %d %d %ld %ld\n", n, FD_ISSET(p[0], &set), (long)three.tv_sec, now() - start);
  FD_SET(p[0], &set);
  n = pselect(p[0] + 1, &set, 0, 0, &two, 0);
  printf("pselect %d %d %ld\n", n, FD_ISSET(p[0], &set), now() - start);
  int e = epoll_create1(0); struct epoll_event ev = {EPOLLIN, {0}}; epoll_ctl(e, EPOLL_CTL_ADD, p[0], &ev);
  n = epoll_wait(e, &ev, 1, 250); printf("epoll_wait %d %ld\n", n, now() - start);
  n = epoll_pwait(e, &ev, 1, 250, 0); printf("epoll_pwait %d %ld\n", n, now() - start);
  write(p[1], "x", 1);
  n = poll(&f, 1, 1500); printf("ready %d %d\n", n, f.revents);
  n = epoll_wait(e, &ev, 1, -1); printf("ready %d %ld\n", n, now() - start);
}
"#,
        "poll 0 0 1500\nppoll 0 0 3500\nselect 0 0 0 6500\npselect 0 0 8500\nepoll_wait 0 8750\n\
         epoll_pwait 0 9000\nready 1 1\nready 1 9000\n",
    );
}

#[test]
fn select_tells_the_time_that_is_left() {
    c_prints(
        r#"
#include <stdio.h>
#include <sys/select.h>
#include <unistd.h>
int main(void) {
  int p[2]; pipe(p);
  if (!fork()) { sleep(1); write(p[1], "x", 1); _exit(0); }
  fd_set set; FD_ZERO(&set); FD_SET(p[0], &set);
  struct timeval five = {5, 0};
  int n = select(p[0] + 1, &set, 0, 0, &five);
  printf("%d %ld.%06ld\n", n, (long)five.tv_sec, (long)five.tv_usec);
}
"#,
        "1 3.999950\n",
    );
}

#[test]
fn timer_descriptors_run_out_in_simulated_time_and_count() {
    c_prints(
        r#"
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
int main(void) {
  long start = now(); uint64_t n;
  int t = timerfd_create(CLOCK_MONOTONIC, 0);
  struct itimerspec every = {{1, 0}, {2, 500000000}}, left;
  timerfd_settime(t, 0, &every, 0);
  read(t, &n, 8); printf("%lu at %ld\n", n, now() - start);
  struct pollfd f = {t, POLLIN, 0};
  int r = poll(&f, 1, -1); printf("%d at %ld\n", r, now() - start);
  read(t, &n, 8); printf("%lu at %ld\n", n, now() - start);
  sleep(5); read(t, &n, 8); printf("%lu at %ld\n", n, now() - start);
  usleep(300000); timerfd_gettime(t, &left);
  printf("left %ld\n", left.it_value.tv_nsec / 1000000);
  struct itimerspec off = {{0, 0}, {0, 0}}; timerfd_settime(t, 0, &off, 0);
  printf("%d\n", poll(&f, 1, 10000));
  int d = timerfd_create(CLOCK_REALTIME, TFD_NONBLOCK);
  struct timespec date; clock_gettime(CLOCK_REALTIME, &date); date.tv_sec += 4;
  struct itimerspec at = {{0, 0}, date}; timerfd_settime(d, TFD_TIMER_ABSTIME, &at, 0);
  start = now(); f.fd = d; poll(&f, 1, -1); printf("date at %ld\n", now() - start);
}
"#,
        "1 at 2500\n1 at 3500\n1 at 3500\n5 at 8500\nleft 699\n0\ndate at 4000\n",
    );
}

#[test]
fn alarms_and_timers_send_their_signals_in_simulated_time() {
    c_prints(
        r#"
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
#include <errno.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
static volatile int hits; static long start;
static void hit(int s) { hits++; }
static void on_thread(union sigval v) { printf("thread %d at %ld\n", v.sival_int, now() - start); fflush(stdout); }
int main(void) {
  start = now(); setvbuf(stdout, 0, _IOLBF, 0);
  signal(SIGALRM, hit); signal(SIGUSR1, hit);
  alarm(3); pause(); printf("alarm %d at %ld\n", hits, now() - start);
  alarm(100); sleep(30); printf("left %u\n", alarm(0));
  struct itimerval every = {{0, 500000}, {1, 0}}; setitimer(ITIMER_REAL, &every, 0);
  hits = 0; while (hits < 4) pause();
  printf("interval at %ld\n", now() - start);
  struct itimerval off = {{0, 0}, {0, 0}}; setitimer(ITIMER_REAL, &off, 0);
  struct sigevent e = {0}; e.sigev_notify = SIGEV_SIGNAL; e.sigev_signo = SIGUSR1;
  timer_t t; timer_create(CLOCK_MONOTONIC, &e, &t);
  struct itimerspec two = {{0, 0}, {2, 0}}; timer_settime(t, 0, &two, 0);
  struct timespec ten = {10, 0}, rest;
  int r = nanosleep(&ten, &rest); printf("nanosleep %d %d rest %ld at %ld\n", r, errno == EINTR, (long)rest.tv_sec, now() - start);
  e.sigev_notify = SIGEV_THREAD; e.sigev_notify_function = on_thread; e.sigev_value.sival_int = 42;
  timer_t u; timer_create(CLOCK_REALTIME, &e, &u); timer_settime(u, 0, &two, 0);
  sleep(5);
  sigset_t set; sigemptyset(&set); sigaddset(&set, SIGUSR2); sigprocmask(SIG_BLOCK, &set, 0);
  struct timespec six = {6, 0};
  r = sigtimedwait(&set, 0, &six); printf("sigtimedwait %d %d at %ld\n", r, errno == EAGAIN, now() - start);
  kill(getpid(), SIGUSR2); printf("%d\n", sigtimedwait(&set, 0, &six) == SIGUSR2);
}
"#,
        "alarm 1 at 3000\nleft 70\ninterval at 35500\nnanosleep -1 1 rest 8 at 37500\n\
         thread 42 at 39500\nsigtimedwait -1 1 at 48500\n1\n",
    );
}

#[test]
fn children_pipes_and_locks_are_waited_for() {
    prints(
        r#"
import fcntl, os, subprocess, tempfile, time, signal
start = time.monotonic()
def at(): return round(time.monotonic() - start, 3)
subprocess.run(["sleep", "3"]); print("run", at())
print(subprocess.run("sleep 2; echo piped", shell=True, capture_output=True, text=True).stdout.strip(), at())
try:
    subprocess.run(["sleep", "60"], timeout=4)
except subprocess.TimeoutExpired:
    print("timeout", at())
file = tempfile.TemporaryFile()
r, w = os.pipe()
if os.fork() == 0:
    os.close(r)
    other = os.open(f"/proc/self/fd/{file.fileno()}", os.O_RDWR)
    fcntl.flock(other, fcntl.LOCK_EX); os.write(w, b"x"); time.sleep(2.5); os._exit(3)
os.read(r, 1); fcntl.flock(file, fcntl.LOCK_EX); print("lock", at())
print(os.waitstatus_to_exitcode(os.wait()[1]), at())
child = subprocess.Popen(["sleep", "60"]); time.sleep(1); child.kill(); print(child.wait(), at())
"#,
        "run 3.0\npiped 5.0\ntimeout 9.0\nlock 11.5\n3 11.5\n-9 12.5\n",
    );
}

#[test]
fn sockets_inside_and_their_timeouts() {
    prints(
        r#"
import socket, threading, time
start = time.monotonic()
def at(): return round(time.monotonic() - start, 3)
server = socket.create_server(("127.0.0.1", 0))
def serve():
    connection, _ = server.accept()
    while data := connection.recv(100):
        time.sleep(2)
        connection.sendall(data.upper())
threading.Thread(target=serve, daemon=True).start()
client = socket.create_connection(server.getsockname())
client.sendall(b"hello"); print(client.recv(100), at())
client.settimeout(7)
try: client.recv(1)
except TimeoutError: print("timeout", at())
client.settimeout(None)
import struct
client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 3, 0))
try: client.recv(1)
except BlockingIOError: print("again", at())
a, b = socket.socketpair()
threading.Timer(1, lambda: b.send(b"pair")).start()
print(a.recv(10), at())
# As most servers listen where there is IPv6.
both = socket.has_dualstack_ipv6()
family = socket.AF_INET6 if both else socket.AF_INET
server = socket.create_server(("", 0), family=family, dualstack_ipv6=both)
client = socket.create_connection(("127.0.0.1", server.getsockname()[1]))
threading.Timer(2, lambda: client.send(b"mapped")).start()
print(server.accept()[0].recv(10), at())
"#,
        "b'HELLO' 2.0\ntimeout 9.0\nagain 12.0\nb'pair' 13.0\nb'mapped' 15.0\n",
    );
}

/// The system keeps a second small message of a talk until the first has been acknowledged, which takes
/// up to 40 ms of simulated time.
#[test]
fn what_is_sent_inside_is_there_at_once() {
    prints(
        r#"
import socket, threading, time
start = time.monotonic()
server = socket.create_server(("127.0.0.1", 0))
def serve():
    connection, _ = server.accept()
    for _ in range(20): connection.sendall(connection.recv(1))
    for _ in "abc": print(connection.recv(1), round(time.monotonic() - start, 3))
threading.Thread(target=serve).start()
client = socket.create_connection(server.getsockname())
for _ in range(20): client.sendall(b"x"); client.recv(1)
for letter in b"abc": client.sendall(bytes([letter]))
time.sleep(5)
"#,
        "b'a' 0.0\nb'b' 0.0\nb'c' 0.0\n",
    );
}

#[test]
fn queues_and_semaphores_of_system_v_and_posix() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <mqueue.h>
#include <semaphore.h>
#include <stdio.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/sem.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
int main(void) {
  long start = now();
  int s = semget(IPC_PRIVATE, 1, 0600);
  struct sembuf take = {0, -1, 0}, give = {0, 1, 0}; struct timespec two = {2, 0};
  int r = semtimedop(s, &take, 1, &two); printf("semtimedop %d %d at %ld\n", r, errno == EAGAIN, now() - start);
  fflush(stdout);
  if (!fork()) { sleep(3); semop(s, &give, 1); _exit(0); }
  r = semop(s, &take, 1); printf("semop %d at %ld\n", r, now() - start); semctl(s, 0, IPC_RMID);
  sem_t *shared = mmap(0, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  sem_init(shared, 1, 0); fflush(stdout);
  if (!fork()) { sleep(4); sem_post(shared); _exit(0); }
  sem_wait(shared); printf("sem_wait at %ld\n", now() - start);
  struct mq_attr a = {0, 1, 8, 0}; char name[32]; sprintf(name, "/lockstep-%d", getpid());
  mqd_t q = mq_open(name, O_CREAT | O_RDWR, 0600, &a); mq_unlink(name);
  struct timespec at; clock_gettime(CLOCK_REALTIME, &at); at.tv_sec += 5; char b[8];
  r = mq_timedreceive(q, b, 8, 0, &at); printf("mq %d %d at %ld\n", r, errno == ETIMEDOUT, now() - start);
  while (wait(0) > 0);
}
"#,
        "semtimedop -1 1 at 2000\nsemop 0 at 5000\nsem_wait at 9000\nmq -1 1 at 14000\n",
    );
}

#[test]
fn messages_polls_and_children_by_their_rarer_calls() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <mqueue.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
int main(void) {
  long start = now(); struct timespec one = {1, 0}, two = {2, 0}; char b[2][8];
  int s[2]; socketpair(AF_UNIX, SOCK_DGRAM, 0, s);
  if (!fork()) { sleep(3); write(s[1], "one", 3); _exit(0); }
  struct iovec to[2] = {{b[0], 8}, {b[1], 8}};
  struct mmsghdr m[2] = {{{0, 0, &to[0], 1, 0, 0, 0}, 0}, {{0, 0, &to[1], 1, 0, 0, 0}, 0}};
  int r = recvmmsg(s[0], m, 2, 0, &one); printf("recvmmsg %d of %u at %ld\n", r, m[0].msg_len, now() - start);
  siginfo_t i; r = waitid(P_ALL, 0, &i, WEXITED); printf("waitid %d at %ld\n", r, now() - start);
  fflush(stdout);
  if (!fork()) { sleep(2); _exit(0); }
  r = waitid(P_ALL, 0, 0, WEXITED); printf("waitid %d, %d at %ld\n", r, waitid(P_ALL, 0, 0, WEXITED), now() - start);
  start += 2000; fflush(stdout);
  pid_t p = fork(); if (!p) { sleep(4); _exit(5); }
  r = waitid(P_PID, p, &i, WEXITED); printf("waitid %d %d at %ld\n", r, i.si_status, now() - start);
  int e = epoll_create1(0); struct epoll_event ev = {EPOLLIN, {0}}; epoll_ctl(e, EPOLL_CTL_ADD, s[0], &ev);
  r = syscall(441, e, &ev, 1, &two, 0, 0); printf("epoll_pwait2 %d at %ld\n", r, now() - start);
  struct mq_attr a = {0, 1, 8, 0}; char name[32]; sprintf(name, "/lockstep-m-%d", getpid());
  mqd_t q = mq_open(name, O_CREAT | O_RDWR, 0600, &a); mq_unlink(name);
  struct timespec at; clock_gettime(CLOCK_REALTIME, &at); at.tv_sec += 5;
  mq_send(q, "x", 1, 0);
  r = mq_timedsend(q, "y", 1, 0, &at); printf("mq %d %d at %ld\n", r, errno == ETIMEDOUT, now() - start);
}
"#,
        "recvmmsg 1 of 3 at 3000\nwaitid 0 at 3000\nwaitid 0, -1 at 5000\nwaitid 0 5 at 7000\nepoll_pwait2 0 at 9000\n\
         mq -1 1 at 14000\n",
    );
}

#[test]
fn messages_wait_for_room_at_their_receiver_and_for_all_that_are_wanted() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <stdio.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#define MANY 600
static long start;
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec * 10 + t.tv_nsec / 100000000; }
static int s[2]; static char b[4096]; static struct iovec v[2] = {{b, 2}, {b + 2, 3}};
static struct mmsghdr m[MANY]; static struct sockaddr_un name = {AF_UNIX, "\0lockstep-"};
static void reads(int from) { if (fork()) return; sleep(1); for (int i = 0; i < MANY; i++) recv(from, b, 8, 0); _exit(0); }
static void sends(void) { start = now(); if (fork()) return; for (int i = 0; i < 3; i++) { sleep(1); send(s[1], "abc", 3, 0); } _exit(0); }
static void said(const char *what, long n) { printf("%s %ld at %ld\n", what, n, now() - start); fflush(stdout); while (wait(0) > 0); start = now(); }
static void rest(void) { while (recv(s[0], b, 9, MSG_DONTWAIT) > 0); }
int main(void) {
  sprintf(name.sun_path + 10, "%d", getpid()); socklen_t length = sizeof name; start = now();
  int to = socket(AF_UNIX, SOCK_DGRAM, 0), from = socket(AF_UNIX, SOCK_DGRAM, 0), n = 0;
  bind(to, (void *)&name, length); reads(to);
  for (int i = 0; i < MANY; i++) n += sendto(from, b, 1, 0, (void *)&name, length);
  said("sendto", n); reads(to); n = 0;
  struct msghdr one = {&name, length, v, 1, 0, 0, 0}; for (int i = 0; i < MANY; i++) n += sendmsg(from, &one, 0);
  said("sendmsg", n); socketpair(AF_UNIX, SOCK_DGRAM, 0, s); reads(s[0]);
  for (int i = 0; i < MANY; i++) { m[i].msg_hdr.msg_iov = v; m[i].msg_hdr.msg_iovlen = 1; }
  n = sendmmsg(s[1], m, MANY, 0); said("sendmmsg", n); rest();
  struct timeval two = {2, 0}; setsockopt(from, SOL_SOCKET, SO_SNDTIMEO, &two, sizeof two);
  for (n = 0; sendto(from, b, 1, 0, (void *)&name, length) == 1; ) n++;
  said("late", n > 0 && errno == EAGAIN);
  sends(); n = recvmmsg(s[0], m, 3, 0, 0); said("recvmmsg", n);
  struct timespec some = {1, 500000000}; sends(); n = recvmmsg(s[0], m, 3, 0, &some); said("in time", n); rest();
  sends(); n = recvmmsg(s[0], m, 3, MSG_WAITFORONE, 0); said("for one", n);
  socketpair(AF_UNIX, SOCK_STREAM, 0, s);
  sends(); n = recv(s[0], b, 8, MSG_WAITALL); said("all", n); rest();
  sends(); struct msghdr both = {0, 0, v, 2, 0, 0, 0}; n = recvmsg(s[0], &both, MSG_WAITALL); printf("%.5s ", b); said("all", n); rest();
  sends(); close(s[1]); n = recv(s[0], b, sizeof b, MSG_WAITALL); said("end", n);
}
"#,
        "sendto 600 at 10\nsendmsg 1200 at 10\nsendmmsg 600 at 10\nlate 1 at 20\nrecvmmsg 3 at 30\n\
         in time 2 at 20\nfor one 1 at 10\nall 8 at 30\nabcab all 5 at 20\nend 9 at 30\n",
    );
}

#[test]
fn copies_between_pipes_wait_for_room() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static long start; static int p[2], q[2], both; static char b[65536] __attribute__((aligned(4096)));
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec * 10 + t.tv_nsec / 100000000; }
static void reads(int from) { start = now(); if (fork()) return; sleep(1); read(from, b, sizeof b); _exit(0); }
static void said(const char *what, long n) { printf("%s %ld at %ld\n", what, n, now() - start); fflush(stdout); while (wait(0) > 0); }
int main(void) {
  start = now(); char folder[] = "/tmp/lockstepXXXXXX", path[64]; struct iovec v = {b, 100}, all = {b, sizeof b};
  mkdtemp(folder); sprintf(path, "%s/fifo", folder); mkfifo(path, 0600); both = open(path, O_RDWR); unlink(path); rmdir(folder);
  pipe(p); pipe(q); write(p[1], "abc", 3); write(q[1], b, sizeof b);
  long n = tee(p[0], q[1], 9, SPLICE_F_NONBLOCK); said("at once", n == -1 && errno == EAGAIN);
  n = splice(p[0], 0, q[1], 0, 9, SPLICE_F_NONBLOCK); said("at once", n == -1 && errno == EAGAIN);
  reads(q[0]); n = tee(p[0], q[1], 9, 0); said("tee", n);
  write(q[1], b, sizeof b - 4096); reads(q[0]); n = vmsplice(q[1], &v, 1, 0); said("vmsplice", n);
  write(q[1], b, sizeof b - 4096); n = vmsplice(q[1], &all, 1, SPLICE_F_NONBLOCK); said("at once", n == -1 && errno == EAGAIN);
  read(q[0], b, 8192); n = vmsplice(q[1], &all, 1, 0); said("part", n);
  write(both, b, sizeof b); reads(both); n = vmsplice(both, &v, 1, 0); said("both", n);
}
"#,
        "at once 1 at 0\nat once 1 at 0\ntee 3 at 10\nvmsplice 100 at 10\nat once 1 at 10\n\
         part 8192 at 10\nboth 100 at 10\n",
    );
}

#[test]
fn locks_with_priority_inheritance_and_barriers() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000 + t.tv_nsec / 1000000; }
static pthread_mutex_t lock; static pthread_barrier_t barrier; static pthread_rwlock_t both = PTHREAD_RWLOCK_INITIALIZER;
static void *other(void *_) {
  pthread_mutex_lock(&lock); pthread_rwlock_wrlock(&both);
  sleep(5); pthread_mutex_unlock(&lock);
  sleep(2); pthread_rwlock_unlock(&both);
  sleep(3); pthread_barrier_wait(&barrier); return 0;
}
int main(void) {
  pthread_mutexattr_t a; pthread_mutexattr_init(&a);
  pthread_mutexattr_setprotocol(&a, PTHREAD_PRIO_INHERIT); pthread_mutex_init(&lock, &a);
  pthread_barrier_init(&barrier, 0, 2);
  long start = now(); pthread_t t; pthread_create(&t, 0, other, 0); sleep(1);
  struct timespec at; clock_gettime(CLOCK_REALTIME, &at); at.tv_sec += 2;
  int r = pthread_mutex_timedlock(&lock, &at); printf("late %d at %ld\n", r == ETIMEDOUT, now() - start);
  r = pthread_mutex_lock(&lock); printf("lock %d at %ld\n", r, now() - start);
  r = pthread_rwlock_rdlock(&both); printf("both %d at %ld\n", r, now() - start);
  pthread_barrier_wait(&barrier); printf("barrier at %ld\n", now() - start);
}
"#,
        "late 1 at 3000\nlock 0 at 5000\nboth 0 at 7000\nbarrier at 10000\n",
    );
}

/// Loops that go on until the clock is past their end, with each way to wait for what is left.
#[test]
fn loops_that_wait_until_after_their_deadline_end() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
typedef long long ns;
static ns at(int clock) { struct timespec t; clock_gettime(clock, &t); return t.tv_sec * 1000000000LL + t.tv_nsec; }
static struct timespec spec(ns t) { struct timespec s = {t / 1000000000, t % 1000000000}; return s; }
static void sleeps(ns left, ns end) { struct timespec t = spec(left); nanosleep(&t, 0); }
static void until(ns left, ns end) { struct timespec t = spec(end); clock_nanosleep(CLOCK_REALTIME, TIMER_ABSTIME, &t, 0); }
static void waits(ns left, ns end) {
  static pthread_mutex_t m = PTHREAD_MUTEX_INITIALIZER; static pthread_cond_t c = PTHREAD_COND_INITIALIZER;
  struct timespec t = spec(end); pthread_mutex_lock(&m); pthread_cond_timedwait(&c, &m, &t); pthread_mutex_unlock(&m);
}
static void takes(ns left, ns end) { sem_t s; sem_init(&s, 0, 0); struct timespec t = spec(end); sem_timedwait(&s, &t); }
static void signals(ns left, ns end) {
  sigset_t set; sigemptyset(&set); sigaddset(&set, SIGUSR2); sigprocmask(SIG_BLOCK, &set, 0);
  struct timespec t = spec(left); sigtimedwait(&set, 0, &t);
}
static void polls(ns left, ns end) { struct timespec t = spec(left); ppoll(0, 0, &t, 0); }
static void by_millis(ns left, ns end) { poll(0, 0, left / 1000000); }
static void by_micros(ns left, ns end) { usleep(left / 1000); }
int main(void) {
  void (*ways[])(ns, ns) = {sleeps, until, waits, takes, signals, polls, by_millis, by_micros};
  for (int way = 0; way < 8; way++) {
    ns end = at(CLOCK_REALTIME) + 123456789, now; int rounds = 0;
    while ((now = at(CLOCK_REALTIME)) <= end) { ways[way](end - now, end); rounds++; }
    printf("%d:%d%s ", way, now - end < 1000000, rounds < 3 ? "" : way < 6 ? " many rounds" : "");
  }
  printf("\n");
}
"#,
        "0:1 1:1 2:1 3:1 4:1 5:1 6:1 7:1 \n",
    );
}

#[test]
fn signals_are_read_from_descriptors() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec; }
static void later(int signal) { if (!fork()) { sleep(1); kill(getppid(), signal); _exit(0); } }
static void *thread(void *set) {
  int fd = signalfd(-1, set, 0); struct signalfd_siginfo info;
  int n = read(fd, &info, sizeof info); printf("thread %d %d\n", n, info.ssi_signo); return 0;
}
int main(void) {
  sigset_t set; sigfillset(&set); sigprocmask(SIG_BLOCK, &set, 0);
  sigemptyset(&set); sigaddset(&set, SIGTERM); sigaddset(&set, SIGCHLD);
  long start = now(); setvbuf(stdout, 0, _IOLBF, 0);
  int fd = signalfd(-1, &set, 0), quick = signalfd(-1, &set, SFD_NONBLOCK); struct signalfd_siginfo info;
  printf("%zd\n", read(quick, &info, sizeof info));
  later(SIGTERM); int n = read(fd, &info, sizeof info); printf("read %d %d at %ld\n", n, info.ssi_signo, now() - start);
  struct pollfd p = {fd, POLLIN, 0};
  n = poll(&p, 1, 100000); read(quick, &info, sizeof info); printf("poll %d %d\n", n, info.ssi_signo);
  wait(0); later(SIGTERM); fd_set in; FD_ZERO(&in); FD_SET(fd, &in); struct timeval t = {50, 0};
  n = select(fd + 1, &in, 0, 0, &t); read(fd, &info, sizeof info); printf("select %d %d at %ld\n", n, info.ssi_signo, now() - start);
  wait(0); read(fd, &info, sizeof info); later(SIGTERM);
  int e = epoll_create1(0), outer = epoll_create1(0); struct epoll_event event = {EPOLLIN, {0}}, got;
  epoll_ctl(e, EPOLL_CTL_ADD, fd, &event); epoll_ctl(outer, EPOLL_CTL_ADD, e, &event);
  n = epoll_wait(e, &got, 1, 50000); printf("epoll %d at %ld\n", n, now() - start);
  n = epoll_wait(outer, &got, 1, 50000); read(fd, &info, sizeof info); printf("outer %d %d at %ld\n", n, info.ssi_signo, now() - start);
  wait(0); read(fd, &info, sizeof info); n = epoll_wait(e, &got, 1, 2000); printf("none %d at %ld\n", n, now() - start);
  sigaddset(&set, SIGUSR1); pthread_t other; pthread_create(&other, 0, thread, &set);
  sleep(1); pthread_kill(other, SIGUSR1); pthread_join(other, 0);
}
"#,
        "-1\nread 128 15 at 1\npoll 1 17\nselect 1 15 at 2\nepoll 1 at 3\nouter 1 15 at 3\n\
         none 0 at 5\nthread 128 10\n",
    );
}

/// An epoll keeps the file whose number was closed, and no file of the system says which that is.
#[test]
fn an_epoll_finds_a_signal_whatever_became_of_the_number() {
    c_prints(
        r#"
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <time.h>
#include <unistd.h>
static long now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec * 10 + t.tv_nsec / 100000000; }
static void later(int signal) { if (!fork()) { sleep(1); kill(getppid(), signal); _exit(0); } }
static void hit(int s) {}
int main(void) {
  sigset_t set; sigemptyset(&set); sigaddset(&set, SIGTERM); sigprocmask(SIG_BLOCK, &set, 0);
  signal(SIGALRM, hit); setvbuf(stdout, 0, _IOLBF, 0); long start = now(); struct signalfd_siginfo info;
  int fd = signalfd(-1, &set, 0), e = epoll_create1(0), n; struct epoll_event event = {EPOLLIN, {.u32 = 7}}, got;
  epoll_ctl(e, EPOLL_CTL_ADD, fd, &event); int other = dup(fd); close(fd);
  later(SIGTERM); n = epoll_wait(e, &got, 1, 50000); printf("moved %d %u at %ld\n", n, got.data.u32, now() - start);
  n = epoll_wait(e, &got, 1, 0); read(other, &info, sizeof info); printf("%d %d\n", n, info.ssi_signo);
  n = epoll_wait(e, &got, 1, 1500); printf("none %d at %ld\n", n, now() - start);
  alarm(1); n = epoll_wait(e, &got, 1, 50000); printf("alarm %d %d at %ld\n", n, errno == EINTR, now() - start);
}
"#,
        "moved 1 7 at 10\n1 15\nnone 0 at 25\nalarm -1 1 at 35\n",
    );
}

/// As DDS and ROS 2 find their participants: none of them knows which answers, and who does is inside.
#[test]
fn groups_of_the_run_are_not_outside() {
    let Some(played) = python(
        r#"
import os, socket, struct, sys, time
group = ("239.255.0.77", 7477)
def member():
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    s.bind(("0.0.0.0", group[1]))
    s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", socket.inet_aton(group[0]), socket.inet_aton("127.0.0.1")))
    return s
me = member()
if os.fork() == 0:
    while True:
        data, _ = me.recvfrom(100)
        if data == b"hello": time.sleep(10); me.sendto(b"here", group); os._exit(0)
time.sleep(5); other = member(); start = time.monotonic(); other.sendto(b"hello", group)
while (data := other.recv(100)) != b"here": pass
print(data, round(time.monotonic() - start, 2)); os.wait()
"#,
    ) else {
        return;
    };
    assert_eq!(played.output, "b'here' 10.0\n", "{:?}", played.ending);
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
    assert!(played.took.as_secs() < 10, "{:?}", played.took);
}

/// A client that has asked another machine waits for the answer in real time.
#[test]
fn datagrams_to_another_machine_are_outside() {
    let code = r#"
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(0.3)
try: s.sendto(b"x", ("192.0.2.1", 9))
except OSError as e: print(e.errno); raise SystemExit
try: s.recv(10)
except TimeoutError: print("timeout")
"#;
    let Some(played) = python(code) else { return };
    if played.output == "timeout\n" {
        let outside: Vec<&String> = played.ending.outside.iter().collect();
        assert!(
            outside.len() == 1 && outside[0].starts_with("udp 0.0.0.0:"),
            "{outside:?}"
        );
    }
}

/// However a descriptor is closed, its other end knows at once.
#[test]
fn a_pipe_ends_when_its_other_end_is_closed_in_any_way() {
    prints(
        "import os, signal, time\n\
         def ends(close):\n  \
             r, w = os.pipe()\n  \
             os.write(w, b'x')\n  \
             assert os.read(r, 1) == b'x'\n  \
             begun = time.monotonic()\n  \
             close(r, w)\n  \
             assert os.read(r, 1) == b''\n  \
             print(round(time.monotonic() - begun, 3))\n\
         def by_child(end):\n  \
             def close(r, w):\n    \
                 if os.fork() == 0:\n      \
                     os.write(w, b'y')\n      \
                     end()\n    \
                 os.close(w)\n    \
                 assert os.read(r, 1) == b'y'\n  \
             return close\n\
         null = os.open('/dev/null', os.O_RDWR)\n\
         ends(lambda r, w: os.close(w))\n\
         ends(lambda r, w: os.dup2(null, w))\n\
         ends(lambda r, w: os.closerange(w, w + 1))\n\
         ends(by_child(lambda: os._exit(0)))\n\
         ends(by_child(lambda: os.kill(os.getpid(), signal.SIGKILL)))\n\
         ends(by_child(lambda: os.execv('/bin/sleep', ['sleep', '1'])))\n",
        &"0.0\n".repeat(6),
    );
}

/// Another thread closes what is waited for, and opens something else with its number.
#[test]
fn a_wait_is_for_what_its_number_led_to() {
    prints(
        r#"
import os, select, socket, threading, time
start = time.monotonic()
def at(): return round(time.monotonic() - start, 1)
def later(time, do): threading.Timer(time, do).start()
def pipes(): return os.pipe() + os.pipe()
r, w, other, full = pipes(); poll = select.poll(); poll.register(r, select.POLLIN)
later(1, lambda: os.dup2(other, r)); later(2, lambda: os.write(w, b"x"))
print(poll.poll(5000), at())
r, w, other, full = pipes(); os.write(full, b"x")
later(1, lambda: os.dup2(other, r))
print(select.select([r], [], [], 3)[0] == [r], at())
r, w, other, full = pipes(); os.write(full, b"theirs")
later(1, lambda: os.dup2(other, r)); later(2, lambda: os.write(w, b"x"))
print(os.read(r, 9), at(), os.read(other, 9))
r, w, other, full = pipes(); os.write(full, b"theirs")
later(1, lambda: os.dup2(full, w)); later(2, lambda: os.read(r, 70000))
print(os.write(w, bytes(100000)), at(), os.read(other, 9), len(os.read(r, 70000)), os.read(r, 9))
"#,
        "[] 5.0\nTrue 8.0\nb'x' 10.0 b'theirs'\n100000 12.0 b'theirs' 34464 b''\n",
    );
}

#[test]
fn a_wait_that_comes_to_nothing_ends_in_its_time() {
    prints(
        r#"
import socket, threading, time
start = time.monotonic()
a, b = socket.socketpair()
a.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, (2).to_bytes(8, "little") + bytes(8))
def take():
    try: print(a.recv(9), flush=True)
    except BlockingIOError: print("nothing", round(time.monotonic() - start, 1), flush=True)
for _ in range(2): threading.Thread(target=take).start()
time.sleep(1); b.send(b"x")
"#,
        "b'x'\nnothing 2.0\n",
    );
}

/// Several wait for one event. The kernel would keep those that come late for it, in its own time.
#[test]
fn one_of_several_that_wait_gets_what_is_there() {
    prints(
        r#"
import os, select, socket, threading, time
start = time.monotonic()
def at(): return round(time.monotonic() - start, 3)
def served(name, take, give):
    pids = []
    for n in range(2):
        if not (pid := os.fork()):
            take(); print(name, n, at(), flush=True); os._exit(0)
        pids.append(pid)
    for _ in pids: time.sleep(0.5); give()
    for pid in pids: os.waitpid(pid, 0)
server = socket.create_server(("127.0.0.1", 0))
served("accept", server.accept, lambda: socket.create_connection(server.getsockname()))
r, w = os.pipe()
served("read", lambda: os.read(r, 1), lambda: os.write(w, b"x"))
events = select.epoll(); events.register(r, select.EPOLLIN)
def take(): events.poll(); os.read(r, 1)
served("epoll", take, lambda: os.write(w, b"x"))
r, w = os.pipe()
for n in range(2):
    if not os.fork():
        os.close(r)
        for _ in range(60): os.write(w, bytes(4096))
        os._exit(0)
os.close(w); count = 0
while part := os.read(r, 4096): count += len(part); time.sleep(0.001)
print(count)
"#,
        "accept 0 0.5\naccept 1 1.0\nread 0 1.5\nread 1 2.0\nepoll 0 2.5\nepoll 1 3.0\n491520\n",
    );
}

/// A signal may be there before the poll that waits for it begins.
#[test]
fn polls_with_a_mask_find_signals_that_are_there() {
    let code = r#"
int main(void) {
  sigset_t m, o, both; sigemptyset(&m); sigaddset(&m, SIGTERM); sigprocmask(SIG_BLOCK, &m, &o); signal(SIGTERM, hit);
  struct timespec second = {1, 0}, none = {0, 0}; int n, p[2]; pipe(p); write(p[1], "x", 1);
  raise(SIGTERM); n = E(pselect(0, 0, 0, 0, &second, &o)); printf("%d %d at %d\n", n, caught, at()); caught = 0;
  raise(SIGTERM); n = E(ppoll(0, 0, &none, &o)); printf("%d %d", n, caught); n = E(ppoll(0, 0, &none, &o)); printf(" %d\n", n);
  raise(SIGTERM); caught = 0; struct pollfd q = {p[0], POLLIN}; n = E(ppoll(&q, 1, &second, &o)); printf("%d %d\n", n, caught);
  int e = epoll_create1(0); struct epoll_event v = {EPOLLIN}, g; n = E(epoll_pwait(e, &g, 1, 100, &o)); printf("%d %d\n", n, caught);
  sigemptyset(&both); sigaddset(&both, SIGTERM); sigaddset(&both, SIGUSR1); sigprocmask(SIG_BLOCK, &both, 0);
  sigemptyset(&m); sigaddset(&m, SIGUSR1); int f = signalfd(-1, &m, SFD_NONBLOCK); epoll_ctl(e, EPOLL_CTL_ADD, f, &v);
  struct pollfd pe = {e, POLLIN}; n = poll(&pe, 1, 50); printf("%d", n); raise(SIGUSR1); n = poll(&pe, 1, 50); printf(" %d", n);
  n = epoll_pwait(e, &g, 1, 100, &both); struct signalfd_siginfo i; read(f, &i, sizeof i); printf(" %d %d", n, i.ssi_signo);
  n = epoll_pwait(e, &g, 1, 100, &both); printf(" %d at %d\n", n, at());
}
"#;
    let expected = "-4 15 at 0\n-4 15 0\n1 0\n-4 15\n0 1 1 10 0 at 150\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}

#[test]
fn the_time_that_is_left_is_written_however_a_poll_ends() {
    let code = r#"
static int raw(long call, struct timespec *t) {
  struct pollfd p = {0, 0}; return E(call == SYS_ppoll ? syscall(call, &p, 0, t, 0, 8) : syscall(call, 0, 0, 0, 0, t, 0));
}
int main(void) {
  struct itimerval soon = {{0, 0}, {0, 100000}}; int n; signal(SIGALRM, hit);
  long calls[] = {SYS_ppoll, SYS_pselect6};
  for (int i = 0; i < 2; i++) {
    struct timespec t = {0, 300000000}; setitimer(ITIMER_REAL, &soon, 0); n = raw(calls[i], &t); printf("%d %ld, ", n, t.tv_nsec);
    n = raw(calls[i], &t); printf("%d %ld\n", n, t.tv_nsec);
  }
  struct timeval t = {1, 0}; fd_set s; FD_ZERO(&s); FD_SET(0, &s); setitimer(ITIMER_REAL, &soon, 0);
  n = E(select(0, &s, 0, 0, &t)); printf("%d %ld %d\n", n, t.tv_usec, FD_ISSET(0, &s));
}
"#;
    let expected = "-4 200000000, 0 0\n-4 200000000, 0 0\n-4 900000 1\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}

/// A syscall keeps what its numbers led to.
#[test]
fn a_number_that_is_closed_meanwhile_ends_no_wait() {
    let code = r#"
static int e, f, p[2], q[2]; static struct epoll_event v = {EPOLLIN}, g; static pthread_t t; static const char *closes; static int *which;
static void *later(void *_) { usleep(50000); close(*which); usleep(50000); uint64_t c = 1; write(f, &c, 8); if (which == p) write(p[1], "abc", 3); return 0; }
static void begin(int *number) {
  uint64_t c; which = number; e = epoll_create1(0); epoll_ctl(e, EPOLL_CTL_ADD, f, &v); read(f, &c, 8); pipe(p); pipe(q);
  fcntl(q[1], F_SETPIPE_SZ, 4096); pthread_create(&t, 0, later, 0);
}
static void ended(const char *what, int n) { printf("%s %d at %d\n", what, n, at()); pthread_join(t, 0); }
int main(void) {
  char page[4096]; f = eventfd(0, EFD_NONBLOCK); sigset_t m, none; sigemptyset(&none); sigemptyset(&m); sigaddset(&m, SIGUSR2); sigprocmask(SIG_BLOCK, &m, 0);
  for (int i = 0; i < 2; i++) {
    begin(&e); ended("epoll", E(epoll_wait(e, &g, 1, 500))); begin(&e); ended("late", E(epoll_wait(e, &g, 1, 80)));
    begin(&e); ended("mask", E(epoll_pwait(e, &g, 1, 500, &none))); signalfd(-1, &m, 0);
  }
  begin(&e); struct pollfd y = {e, POLLIN}; int n = E(poll(&y, 1, 500)); printf("%x ", y.revents); ended("poll", n);
  begin(&e); fd_set s; FD_ZERO(&s); FD_SET(e, &s); struct timeval w = {0, 500000}; ended("select", E(select(e + 1, &s, 0, 0, &w)));
  n = E(select(e + 1, &s, 0, 0, &w)); printf("closed %d %d %d\n", n, E(epoll_wait(e, &g, 1, 0)), E(splice(e, 0, q[1], 0, 9, 0)));
  begin(p); ended("read", E(read(p[0], page, 9))); begin(p); ended("splice from", E(splice(p[0], 0, q[1], 0, 3, 0)));
  begin(q + 1); write(q[1], page, 4096); write(p[1], "xyz", 3); if (!fork()) { usleep(200000); read(q[0], page, 4096); _exit(0); }
  ended("splice to", E(splice(p[0], 0, q[1], 0, 3, 0)));
}
"#;
    let expected = "epoll 1 at 100\nlate 0 at 180\nmask 1 at 300\nepoll 1 at 400\nlate 0 at 480\nmask 1 at 600\n\
                    20 poll 1 at 700\nselect 1 at 800\nclosed -9 -9 -9\nread 3 at 900\nsplice from 3 at 1001\nsplice to 3 at 1201\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}

#[test]
fn timer_descriptors_take_all_reads_and_no_wrong_flags() {
    let code = r#"
int main(void) {
  uint64_t c; int f = timerfd_create(CLOCK_BOOTTIME, 0), n; struct itimerspec i = {{0, 10000000}, {0, 10000000}};
  n = E(timerfd_settime(f, 8, &i, 0)); printf("%d %d\n", n, E(read(f, &c, 4)));
  struct iovec v[2] = {{&c, 4}, {(char *)&c + 4, 4}}; timerfd_settime(f, TFD_TIMER_ABSTIME | TFD_TIMER_CANCEL_ON_SET, &i, 0);
  timerfd_settime(f, 0, &i, 0); usleep(105000); n = E(readv(f, v, 2)); printf("%d %lu\n", n, c); fflush(stdout);
  int d = dup(f); close(f); i.it_interval.tv_nsec = 0; timerfd_settime(d, 0, &i, 0);
  if (!fork()) { n = E(read(d, &c, 8)); printf("%d %lu at %d\n", n, c, at()); fflush(stdout); _exit(0); }
  wait(0); struct pollfd p = {d, POLLIN}; n = poll(&p, 1, 50); printf("%d\n", n);
}
"#;
    let expected = "-22 -22\n8 10\n8 1 at 115\n0\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}

/// A signal of a timer is sent once until it has been taken, real-time signals as well.
#[test]
fn timers_that_run_out_while_their_signal_waits_are_counted() {
    let code = r#"
int main(void) {
  sigset_t s; sigemptyset(&s); sigaddset(&s, SIGRTMIN); sigprocmask(SIG_BLOCK, &s, 0); siginfo_t i; int n;
  struct sigevent e = {0}; e.sigev_notify = SIGEV_SIGNAL; e.sigev_signo = SIGRTMIN; timer_t t, other;
  timer_create(CLOCK_MONOTONIC, &e, &t); e.sigev_value.sival_int = 7; timer_create(CLOCK_MONOTONIC, &e, &other);
  struct itimerspec every = {{0, 20000000}, {0, 20000000}}, once = {{0, 0}, {0, 70000000}};
  timer_settime(t, 0, &every, 0); timer_settime(other, 0, &once, 0); usleep(110000);
  for (int k = 0; k < 2; k++) { sigwaitinfo(&s, &i); printf("%d ", i.si_value.sival_int == 7); }
  printf("missed %d at %d\n", timer_getoverrun(t), at());
  sigwaitinfo(&s, &i); printf("next %d at %d\n", timer_getoverrun(t), at());
}
"#;
    let expected = "0 1 missed 4 at 110\nnext 0 at 120\n";
    c_prints(&format!("{CLIENT}{code}"), expected);
}
