//! Clocks that a program reads in its own memory, and what makes a call of it.

mod common;

use std::time::Instant;

use common::{Device, Setup, c, c_played, play, play_on, text};
use rigsim_lockstep::End;

/// What the clocks show by the functions of the C library and by calls of the system, in all the
/// places in which a program can be.
const AGREE: &str = r#"
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static int differences;
static void compare(void) {
  int clocks[] = {0, 1, 4, 5, 6, 7, 8, 9, 11};
  for (int i = 0; i < 9; i++) {
    struct timespec a, b;
    clock_gettime(clocks[i], &a); syscall(SYS_clock_gettime, clocks[i], &b);
    differences += a.tv_sec != b.tv_sec || a.tv_nsec != b.tv_nsec;
  }
  struct timeval c, d;
  gettimeofday(&c, 0); syscall(SYS_gettimeofday, &d, 0);
  differences += c.tv_sec != d.tv_sec || c.tv_usec != d.tv_usec;
  time_t e; differences += time(&e) != d.tv_sec || e != d.tv_sec || time(0) != e;
}
static void *thread(void *_) { usleep(2345678); compare(); return 0; }
int main(int argc, char **argv) {
  compare(); usleep(1234567); compare();
  pthread_t t; pthread_create(&t, 0, thread, 0); compare(); pthread_join(t, 0); compare();
  if (!fork()) { usleep(3456789); compare(); _exit(differences); }
  int status; wait(&status); differences += WEXITSTATUS(status); compare();
  struct timespec cpu; int r = clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  printf("%d %d %d\n", differences, r, clock_gettime(77, &cpu)); fflush(stdout);
  if (argc == 1) execl(argv[0], argv[0], "again", NULL);
}
"#;

#[test]
fn those_of_its_memory_and_those_of_the_system_are_the_same() {
    for flags in [&[][..], &["-static"]] {
        let Some((_folder, binary)) = c(AGREE, flags) else {
            return;
        };
        let played = play(&[text(&binary)]);
        assert_eq!(played.output, "0 0 -1\n0 0 -1\n", "{:?}", played.ending);
    }
}

#[test]
fn asking_for_the_time_is_no_call() {
    let code = r#"
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
int main(void) {
  struct timespec t; struct timeval v;
  for (int i = 0; i < 100; i++) {
    for (int j = 0; j < 300; j++) { clock_gettime(j % 2, &t); gettimeofday(&v, 0); time(0); }
    usleep(1000);
  }
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(played.ending.end, End::Exited(0));
    assert_eq!(played.ending.at, 105_000_000);
    // One for each sleep, and those of its beginning; not 90,000.
    assert!(played.ending.calls < 300, "{:?}", played.ending);
}

/// A delay that watches the time stamp counter, whose ticks are nanoseconds.
#[test]
fn time_goes_on_for_who_watches_the_time_stamp_counter() {
    let code = r#"
#include <stdio.h>
#include <x86intrin.h>
int main(void) {
  unsigned long long begun = __rdtsc(), now; unsigned who; long rounds = 0;
  do { now = rounds++ % 2 ? __rdtsc() : __rdtscp(&who); } while (now - begun < 100000000);
  printf("%d %d\n", now - begun < 101000000, rounds < 10000);
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(played.output, "1 1\n", "{:?}", played.ending);
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
}

/// The kernel sends SIGSEGV for each, and takes away what a program has set for that if it blocks or
/// ignores it.
#[test]
fn the_time_stamp_counter_leaves_the_signals_of_a_program_alone() {
    let code = r#"
#define _GNU_SOURCE
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <x86intrin.h>
static sigjmp_buf back;
static void caught(int s, siginfo_t *info, void *_) { siglongjmp(back, 1); }
static int faults(void) { if (sigsetjmp(back, 1)) return 1; *(volatile int *)8 = 1; return 0; }
static int is_blocked(void) { sigset_t set; sigprocmask(SIG_SETMASK, 0, &set); return sigismember(&set, SIGSEGV); }
static void *thread(void *_) {
  sigset_t all; sigfillset(&all); pthread_sigmask(SIG_BLOCK, &all, 0);
  unsigned long long a = __rdtsc(), b = __rdtsc(); printf("%d %d\n", is_blocked(), b - a < 1000000); return 0;
}
int main(void) {
  struct sigaction on = {0}, old; on.sa_sigaction = caught; on.sa_flags = SA_SIGINFO | SA_NODEFER;
  sigaction(SIGSEGV, &on, 0); printf("%d %d\n", faults(), is_blocked());
  pthread_t t; pthread_create(&t, 0, thread, 0); pthread_join(t, 0);
  sigaction(SIGSEGV, 0, &old); printf("%d %d\n", old.sa_sigaction == caught, (int)(old.sa_flags & SA_SIGINFO));
  printf("%d %d\n", faults(), is_blocked());
  signal(SIGSEGV, SIG_IGN); __rdtsc(); sigaction(SIGSEGV, 0, &old); printf("%d\n", old.sa_handler == SIG_IGN);
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(
        played.output, "1 0\n1 1\n1 4\n1 0\n1\n",
        "{:?}",
        played.ending
    );
}

#[test]
fn rarer_calls_tell_simulated_time() {
    let code = r#"
#include <stdio.h>
#include <sys/sysinfo.h>
#include <sys/timex.h>
#include <time.h>
#include <unistd.h>
int main(void) {
  sleep(50);
  struct sysinfo info; int r = sysinfo(&info); printf("%d %ld\n", r, info.uptime);
  struct timex t = {0}, u = {0}; struct timespec now; clock_gettime(CLOCK_REALTIME, &now);
  r = adjtimex(&t) < 0; printf("%d %d ", r, t.time.tv_sec == now.tv_sec && t.time.tv_usec / 1000000 == 0);
  r = clock_adjtime(CLOCK_REALTIME, &u) < 0; printf("%d %d\n", r, u.time.tv_sec == now.tv_sec);
  t.modes = ADJ_OFFSET; printf("%d ", adjtimex(&t));
  printf("%d\n", clock_settime(CLOCK_REALTIME, &now));
}
"#;
    let Some(played) = c_played(code) else { return };
    assert_eq!(
        played.output, "0 1050\n0 1 0 1\n-1 -1\n",
        "{:?}",
        played.ending
    );
}

/// A tracer cannot read the time stamp counter while clients run, unless it does.
#[test]
fn the_world_reads_clocks_and_starts_threads_that_do() {
    fn besides() {
        let begun = Instant::now();
        let thread = std::thread::spawn(move || begun.elapsed());
        thread.join().expect("it reads the clock");
    }
    let setup = Setup {
        device: Device {
            besides: Some(besides),
            ..Device::default()
        },
        ..Setup::default()
    };
    let sleeps = "for i in 1 2 3 4 5; do sleep 1; done";
    let played = play_on(setup, &["sh", "-c", sleeps]).expect("it can be run");
    assert_eq!(played.ending.end, End::Exited(0), "{:?}", played.ending);
    assert!(played.ending.at > 5_000_000_000, "{:?}", played.ending);
}
