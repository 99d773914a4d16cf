/* What the clients of several tests have in common. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/signalfd.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
#define E(x) ({ int r_ = (int)(x); r_ < 0 ? -errno : r_; })
static volatile int caught;
static void hit(int s) { caught = s; }
static int at(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return (t.tv_sec - 1000) * 1000 + t.tv_nsec / 1000000; }
static int port(int f) { return open(getenv("PORT"), O_RDWR | O_NOCTTY | f); }
static void input(int fd, int in, int local, int least) {
  struct termios t; tcgetattr(fd, &t); t.c_iflag = in; t.c_lflag = local; t.c_cc[VSTART] = 021; t.c_cc[VSTOP] = 023;
  t.c_cc[VINTR] = 3; t.c_cc[VEOF] = 4; t.c_cc[VERASE] = 127; t.c_cc[VKILL] = 025; t.c_cc[VMIN] = least; tcsetattr(fd, TCSANOW, &t);
}
