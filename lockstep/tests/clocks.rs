//! Clocks that a program reads in its own memory, and what makes a call of it.

mod common;

use common::{c, c_played, play, text};
use sim_lockstep::End;

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
    assert_eq!(played.ending.at, 100_000_000);
    // One for each sleep, and those of its beginning; not 90,000.
    assert!(played.ending.calls < 300, "{:?}", played.ending);
}
