//! Who runs: one thread at a time, in the same order each time, as on one processor.

mod common;

use common::c_prints;

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

/// Each computes for longer than the system lets a thread run while another can.
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
#include <sched.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>
int main(void) {
  cpu_set_t set; struct timespec used;
  do clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used); while (used.tv_nsec < 300000000 && !used.tv_sec);
  int r = sched_getaffinity(0, sizeof set, &set); printf("%d %d", r, CPU_COUNT(&set));
  CPU_ZERO(&set); CPU_SET(1000, &set); r = sched_setaffinity(0, sizeof set, &set); printf(" %d", r);
  sched_getaffinity(0, sizeof set, &set); printf(" %d\n", CPU_ISSET(0, &set) && CPU_COUNT(&set) == 1);
  printf("%ld %ld\n", sysconf(_SC_NPROCESSORS_ONLN), sysconf(_SC_NPROCESSORS_CONF));
  const char *lists[] = {"online", "possible", "present"}; char path[64], text[64];
  for (int i = 0; i < 3; i++) {
    sprintf(path, "/sys/devices/system/cpu/%s", lists[i]);
    FILE *f = fopen(path, "r"); r = f ? fread(text, 1, 63, f) : 0; text[r] = 0;
    printf("%s", f ? text : "0\n");
  }
}
"#,
        "0 1 0 1\n1 1\n0\n0\n0\n",
    );
}
