//! Who runs: one thread at a time, in the same order each time, as on one processor.

mod common;

use common::{Setup, c, c_prints, play, play_on, text};
use rigsim_lockstep::End;

#[test]
fn who_began_first_goes_first_and_goes_on_until_it_waits() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>
static struct timespec start; static int nowhere; static sem_t woken;
static void until(long seconds) {
  struct timespec at = {start.tv_sec + seconds, start.tv_nsec};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, 0);
}
static void *sleeper(void *number) {
  // The last goes to sleep first.
  usleep(100000 * (9 - (long)number)); until(5); printf("%ld ", (long)number); return 0;
}
static void *waker(void *_) {
  until(7); sem_post(&woken); printf("wakes ");
  for (int i = 0; i < 100; i++) { write(nowhere, "x", 1); }
  printf("goes on "); until(8); printf("ends\n"); return 0;
}
int main(void) {
  clock_gettime(CLOCK_MONOTONIC, &start); nowhere = open("/dev/null", O_WRONLY); sem_init(&woken, 0, 0);
  pthread_t t[8];
  for (long i = 1; i < 8; i++) pthread_create(&t[i], 0, sleeper, (void *)i);
  pthread_create(&t[0], 0, waker, 0);
  sem_wait(&woken); printf("woken ");
  for (int i = 0; i < 8; i++) pthread_join(t[i], 0);
}
"#,
        "1 2 3 4 5 6 7 wakes goes on woken ends\n",
    );
}

/// Each waits for the other alone, so that no time would ever pass.
#[test]
fn time_goes_on_while_threads_only_wake_one_another() {
    c_prints(
        r#"
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>
static int there[2], back[2], silent[2];
static void *echoes(void *_) {
  char byte;
  while (read(there[0], &byte, 1) == 1) write(back[1], &byte, 1);
  return 0;
}
int main(void) {
  char byte = 0; struct timespec start, now; pthread_t t; int bad = 0;
  pipe(there); pipe(back); pipe(silent);
  clock_gettime(CLOCK_MONOTONIC, &start);
  pthread_create(&t, 0, echoes, 0);
  do {
    struct pollfd one = {silent[0], POLLIN, 0};
    bad += poll(&one, 1, 0);
    write(there[1], &byte, 1);
    bad += read(back[0], &byte, 1) != 1;
    clock_gettime(CLOCK_MONOTONIC, &now);
  } while (now.tv_sec - start.tv_sec < 2);
  close(there[1]); pthread_join(t, 0); printf("%d\n", bad);
}
"#,
        "0\n",
    );
}

/// Long messages and short ones, and no look at a clock: only the first thread waits for time to pass.
#[test]
fn time_goes_on_while_threads_only_write_to_one_another() {
    for length in [1, 8192] {
        c_prints(
            &format!(
                r#"
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <unistd.h>
static int there[2], back[2]; static volatile int over; static char bytes[{length}];
static void *echoes(void *_) {{
  char all[65536];
  while (read(there[0], all, sizeof all) > 0) write(back[1], all, 1);
  return 0;
}}
static void *pings(void *_) {{
  char byte;
  while (!over) {{ write(there[1], bytes, sizeof bytes); read(back[0], &byte, 1); }}
  close(there[1]); return 0;
}}
int main(void) {{
  pthread_t t[2]; pipe(there); pipe(back);
  pthread_create(&t[0], 0, echoes, 0); pthread_create(&t[1], 0, pings, 0);
  usleep(50000); over = 1; pthread_join(t[1], 0); pthread_join(t[0], 0); puts("over");
}}
"#
            ),
            "over\n",
        );
    }
}
/// Each computes for longer than the system's time slice.
#[test]
fn threads_that_compute_run_one_after_another() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <time.h>
static volatile int inside, together;
static void *computes(void *_) {
  struct timespec used;
  inside++;
  do {
    for (volatile int i = 0; i < 1000; i++);
    if (inside != 1) together = 1;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  } while (used.tv_nsec < 300000000 && !used.tv_sec);
  inside--; return 0;
}
int main(void) {
  pthread_t t[3];
  for (int i = 0; i < 3; i++) pthread_create(&t[i], 0, computes, 0);
  for (int i = 0; i < 3; i++) pthread_join(t[i], 0);
  printf("%d\n", together);
}
"#,
        "0\n",
    );
}

/// Also when it has computed for so long that it may do so anywhere.
#[test]
fn one_processor_is_seen_wherever_a_program_looks() {
    c_prints(
        r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>
static int fd; static long long place;
static long by_read(char *to, long n) { return read(fd, to, n); }
static long by_bytes(char *to, long n) { return read(fd, to, 1); }
static long by_pread(char *to, long n) { n = pread(fd, to, n, place); place += n; return n; }
static long by_bytes_at_places(char *to, long n) { return pread(fd, to, 1, place++); }
static long by_readv(char *to, long n) {
  struct iovec parts[] = {{to, 1}, {to + 1, 0}, {to + 1, n - 1}}; return readv(fd, parts, 3);
}
static long by_preadv(char *to, long n) {
  struct iovec parts[] = {{to, 2}, {to + 2, n - 2}}; n = preadv(fd, parts, 2, place); place += n; return n;
}
static long by_preadv2(char *to, long n) {
  struct iovec part = {to, n}; return preadv2(fd, &part, 1, -1, 0);
}
static long all(const char *path, long (*get)(char *, long), char *text) {
  long n, sum = 0;
  place = 0; fd = open(path, O_RDONLY); if (fd < 0) return -1;
  while (sum < 60000 && (n = get(text + sum, 4096)) > 0) sum += n;
  close(fd); text[sum] = 0; return sum;
}
static int count(const char *text, const char *word) {
  int n = 0; for (; (text = strstr(text, word)); text++) n++; return n;
}
int main(void) {
  cpu_set_t set; struct timespec used;
  do clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used); while (used.tv_nsec < 300000000 && !used.tv_sec);
  int r = sched_getaffinity(0, sizeof set, &set); printf("%d %d", r, CPU_COUNT(&set));
  CPU_ZERO(&set); CPU_SET(1000, &set); r = sched_setaffinity(0, sizeof set, &set); printf(" %d", r);
  sched_getaffinity(0, sizeof set, &set); printf(" %d\n", CPU_ISSET(0, &set) && CPU_COUNT(&set) == 1);
  unsigned here = 7, node = 7; r = syscall(SYS_getcpu, &here, &node, 0);
  printf("%d %d %u %u\n", sched_getcpu(), r, here, node);
  printf("%ld %ld\n", sysconf(_SC_NPROCESSORS_ONLN), sysconf(_SC_NPROCESSORS_CONF));
  long (*ways[])(char *, long) = {by_read, by_bytes, by_pread, by_bytes_at_places, by_readv, by_preadv, by_preadv2};
  const char *lists[] = {"online", "possible", "present"}; static char path[64], text[65536];
  for (int way = 0; way < 7; way++) {
    for (int i = 0; i < 3; i++) {
      sprintf(path, "/sys/devices/system/cpu/%s", lists[i]);
      r = all(path, ways[way], text); printf("%d ", r < 0 || !strcmp(text, "0\n"));
    }
    r = all("/proc/cpuinfo", ways[way], text); printf("%d ", r < 0 || count(text, "processor\t:") == 1);
    r = all("/proc/stat", ways[way], text);
    printf("%d%d\n", r < 0 || count(text, "\ncpu") == 1, r < 0 || count(text, "\nbtime ") == 1);
  }
  fd = open("/proc/stat", O_RDONLY); printf("%zd\n", sendfile(1, fd, 0, 100));
}
"#,
        &format!("0 1 0 1\n0 0 0 0\n1 1\n{}-1\n", "1 1 1 1 11\n".repeat(7)),
    );
}

/// A program that is read through `/dev/urandom` in ways other than the plain one has the seed's.
#[test]
fn what_is_random_is_so_however_it_is_read() {
    let code = r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdio.h>
#include <sys/uio.h>
#include <unistd.h>
int main(void) {
  unsigned char b[24] = {0}; int fd = open("/dev/urandom", O_RDONLY);
  struct iovec parts[] = {{b + 8, 3}, {b + 11, 5}};
  printf("%zd %zd", pread(fd, b, 8, 5), readv(fd, parts, 2)); printf(" %zd:", read(fd, b + 16, 8));
  for (int i = 0; i < 24; i++) printf("%02x", b[i]);
}
"#;
    let Some((_folder, binary)) = c(code, &[]) else {
        return;
    };
    let [first, again] = [(); 2].map(|()| play(&[text(&binary)]).output);
    assert!(first.starts_with("8 8 8:"), "{first}");
    assert_eq!(first, again);
}

/// Two threads that add to a number without a lock, and an order in which that goes wrong.
#[test]
fn a_seed_chooses_which_thread_runs() {
    let code = r#"
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <unistd.h>
static int sum, nowhere;
static void *adds(void *_) {
  for (int i = 0; i < 3; i++) { int before = sum; write(nowhere, "x", 1); sum = before + 1; }
  return 0;
}
int main(void) {
  pthread_t t[2]; nowhere = open("/dev/null", O_WRONLY);
  for (int i = 0; i < 2; i++) pthread_create(&t[i], 0, adds, 0);
  for (int i = 0; i < 2; i++) pthread_join(t[i], 0);
  printf("%d\n", sum);
}
"#;
    let Some((_folder, binary)) = c(code, &[]) else {
        return;
    };
    let sum = |schedule| {
        let setup = Setup {
            schedule,
            ..Setup::default()
        };
        let played = play_on(setup, &[text(&binary)]).expect("it can be run");
        assert_eq!(played.ending.end, End::Exited(0));
        played.output
    };
    assert_eq!(sum(None), "6\n");
    let sums: Vec<String> = (0..20).map(|seed| sum(Some(seed))).collect();
    let all: std::collections::BTreeSet<&String> = sums.iter().collect();
    assert!(
        all.len() > 1 && sums.iter().any(|sum| sum != "6\n"),
        "{sums:?}"
    );
    let again: Vec<String> = (0..20).map(|seed| sum(Some(seed))).collect();
    assert_eq!(sums, again);
}
