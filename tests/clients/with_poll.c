// Reads and waits with poll; the port is opened again when it is gone.
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + t.tv_nsec / 1e9;
}

static int opened(void) {
  int port;
  while ((port = open(getenv("SIM_R150_PORT"), O_RDWR | O_NOCTTY | O_NONBLOCK)) < 0) usleep(30000);
  struct termios settings;
  tcgetattr(port, &settings);
  cfmakeraw(&settings);
  cfsetspeed(&settings, B115200);
  tcsetattr(port, TCSANOW, &settings);
  return port;
}

int main(void) {
  double begun = now();
  int port = opened(), bytes = 0;
  for (int step = 1; step <= 25; step++) {
    double end = now() + 0.1, left;
    int there = write(port, "\xaa\x55\x04\x12\x2c\x01\x2c\x01\x1e\xb4", 10) == 10;
    while (there && (left = end - now()) > 0) {
      struct pollfd polled = {port, POLLIN, 0};
      if (poll(&polled, 1, left * 1000 + 1) == 0) continue;
      char got[64];
      int count = read(port, got, sizeof got);
      there = count > 0;
      if (there) bytes += count;
    }
    if (there) continue;
    close(port);
    port = opened();
    printf("came back in step %d at %.6f\n", step, now() - begun);
  }
  printf("processors %ld\nbytes %d\n", sysconf(_SC_NPROCESSORS_ONLN), bytes);
}
